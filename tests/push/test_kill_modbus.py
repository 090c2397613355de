"""kill -9 at every step of a push through the mailbox, and of its recovery: old or new is enabled, always."""

from __future__ import annotations

import os
import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.clock import run_virtual
from drivers.types.tables import LiveSet
from gateway import audit
from gateway.push import journal
from gateway.push.recovery import unfinished_tables
from tests import attacks
from tests.push.judging import truth
from tests.push.killing import IDLE, Ended, gateway, memory_of, pushing, recovering
from tests.push.world import Scene, World, world
from tests.sizes import few

pytestmark = [
    pytest.mark.attack,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="a process is forked"),
]

SCENES = {
    "old on": Scene(),
    "late button": Scene(strict=True),
    "never loaded": Scene(never=True),
    "old off": Scene(old_on=False),
    "cross": Scene(cross=True, sign=-1),
    "forgetful PLC": Scene(plc={"retentive": False}),
    "slow PLC": Scene(plc={"points_a_scan": 1, "scan_s": 0.7}),
    "801 points": Scene(points=801),
}
SHARDS = 10
# The PLC ends the session of a gateway that is gone after 5 s, and with it what that had asked for.
GONE_S = 8.0
# Where the first gateway dies, before the one that recovers does; and the finding.
FIRST = {"journal> DISABLE": "R-PUSH-UNTOUCHED", "VERIFY>": "R-PUSH-WRITTEN", "journal> ENABLED": "R-PUSH-ENABLED"}


@dataclass
class Case:
    """A machine, a gateway's disk, and what was live at first."""

    world: World
    root: Path
    base: LiveSet

    def open_journals(self) -> tuple[journal.JournalRead, ...]:
        return unfinished_tables(self.root / "journal", self.world.nck.spec.serial)


async def prepared(at: World, root: Path) -> Case:
    root.mkdir()  # noqa: ASYNC240 - nothing else runs
    device = at.driver()
    await device.open(5.0)
    base = await device.saved_tables("X1")
    await device.close()
    return Case(at, root, base)


def steps_of(scene: Scene, root: Path) -> tuple[str, ...]:
    """The names of all steps of a push that nobody kills."""

    async def main() -> Ended:
        async with world(scene) as at:
            case = await prepared(at, root)
            ended = await gateway(at, case.root, case.base, pushing)
            assert ended.result == "committed"
            assert at.oracle.as_wanted
            return ended

    return run_virtual(main).steps


async def settled(case: Case) -> str:
    """A fresh gateway looks, changes nothing by looking, says what is true, and leads home."""
    at = case.world
    await at.clock.sleep(GONE_S)
    at.oracle.look("after the kill")
    found = case.open_journals()
    announced = [one for one in found if one.entries]
    before, expected = memory_of(at), truth(at.oracle)
    if not announced:
        assert expected in ("R-PUSH-UNTOUCHED", "R-PUSH-ENABLED"), expected
        assert all(one.is_ended for one in journal.read_journals(case.root / "journal" / at.nck.spec.serial))
        return "nothing open"
    done = await gateway(at, case.root, case.base, recovering)
    assert done.looked == before, "looking has changed the machine"
    codes, outcomes = done.result
    assert codes == [expected]
    assert outcomes == ["rolled-back"]
    assert at.oracle.as_before
    assert case.open_journals() == ()
    assert at.station.plc.memory.marker_state == 0
    return expected


async def killed_at(at: World, root: Path, step: int) -> str:
    case = await prepared(at, root)
    ended = await gateway(at, case.root, case.base, pushing, step)
    assert ended.killed
    found = await settled(case)
    health = audit.check_log(case.root)
    assert health.sound, health.problem
    assert health.head.seq >= 1 or at.oracle.writes == 0, "something was written that the audit does not know"
    assert at.oracle.broken == []
    return found


def chosen(steps: Sequence[str], few: int, every: bool) -> list[int]:
    """The steps to die at: all that leave a trace, and a seeded few of those that only look; or all there are."""
    idle = [number for number, name in enumerate(steps) if name[:-1] in IDLE]
    if every:
        return list(range(len(steps)))
    drawn = random.Random(17).sample(idle, min(few, len(idle)))
    return sorted({*range(len(steps))} - {*idle} | {*drawn})


def sweep(scene: Scene, root: Path, points: Sequence[int]) -> Counter[str]:
    """Die at each of these steps, each time beside a machine of its own."""
    found: Counter[str] = Counter()
    for point in points:

        async def main(point: int = point) -> str:
            async with world(scene) as at:
                if scene.strict:
                    at.person.confirm_after_s = 1.0
                return await killed_at(at, root / str(point), point)

        try:
            found[run_virtual(main)] += 1
        except AssertionError as error:
            raise AssertionError(f"killed at step {point} of {scene}: {error}") from error
    attacks.counted("the gateway killed at a step", "mailbox", len(points))
    return found


@pytest.mark.parametrize("shard", few(range(SHARDS), more=3))
def test_killed_at_every_step_that_leaves_a_trace(tmp_path: Path, shard: int) -> None:
    steps = steps_of(Scene(), tmp_path / "count")
    assert {"journal/ DISABLE", "BEGIN<", "CHUNK>", "VERIFY<", "ACTIVATE>", "MARKER<", "replace> done"} <= set(steps)
    points = chosen(steps, 8, every=False)[shard::SHARDS]
    found = sweep(Scene(), tmp_path, points)
    print(dict(found))
    assert sum(found.values()) == len(points)
    assert {"R-PUSH-UNTOUCHED", "R-PUSH-DISABLED", "R-PUSH-WRITTEN", "R-PUSH-ENABLED", "nothing open"} >= set(found)


@pytest.mark.parametrize("count", few([1, 5]))
@pytest.mark.parametrize("name", few(list(SCENES)[1:], 2))
def test_killed_at_sampled_steps_of_other_machines(tmp_path: Path, name: str, count: int) -> None:
    scene = SCENES[name]
    steps = steps_of(scene, tmp_path / "count")
    points = chosen(steps, 2, every=False)
    found = sweep(scene, tmp_path, random.Random(name).sample(points, count))
    print(dict(found))
    assert sum(found.values()) == count


def test_killed_while_the_points_go_in_leaves_half_a_table_that_is_off(tmp_path: Path) -> None:
    scene = SCENES["slow PLC"]
    steps = steps_of(scene, tmp_path / "count")
    assert sweep(scene, tmp_path, [steps.index("VERIFY>")]) == {"R-PUSH-HALF": 1}


def recovery_steps(scene: Scene, root: Path, first: int) -> tuple[str, ...]:
    """The names of the steps of a recovery, after a push that died at step ``first``."""

    async def main() -> Ended:
        async with world(scene) as at:
            case = await prepared(at, root)
            assert (await gateway(at, case.root, case.base, pushing, first)).killed
            await at.clock.sleep(GONE_S)
            return await gateway(at, case.root, case.base, recovering)

    return run_virtual(main).steps


def killed_twice(scene: Scene, root: Path, first: int, second: int) -> str:
    """The push dies at one step, its recovery at another; a third gateway leads home."""

    async def main() -> str:
        async with world(scene) as at:
            case = await prepared(at, root)
            assert (await gateway(at, case.root, case.base, pushing, first)).killed
            await at.clock.sleep(GONE_S)
            assert (await gateway(at, case.root, case.base, recovering, second)).killed
            found = await settled(case)
            assert audit.check_log(case.root).sound
            assert at.oracle.broken == []
            return found

    try:
        return run_virtual(main)
    except AssertionError as error:
        raise AssertionError(f"killed at {first}, and its recovery at {second}, of {scene}: {error}") from error


def twice(scene: Scene, root: Path, where: str, few: int | None, shard: slice) -> Counter[str]:
    """Kill the recovery at each of its steps, or at those that leave a trace and a few more."""
    first = steps_of(scene, root / "count").index(where)
    steps = recovery_steps(scene, root / "again", first)
    points = chosen(steps, few or 0, every=few is None)[shard]
    found = Counter(killed_twice(scene, root / str(point), first, point) for point in points)
    attacks.counted("the gateway killed, and killed again while recovering", "mailbox", len(points))
    return found


@pytest.mark.parametrize("every", few([40, 15, 5], 1, 1))
@pytest.mark.parametrize("where", few(list(FIRST)[1:] + list(FIRST)[:1]))
def test_killed_again_while_recovering(tmp_path: Path, where: str, every: int) -> None:
    found = twice(Scene(), tmp_path, where, 2, slice(0, None, every))
    print(dict(found))
    # Where nothing was touched yet the recovery reads, and leaves few traces: six to ten.
    assert sum(found.values()) >= max(1, 10 // every)
    assert set(found) <= {FIRST[where], "R-PUSH-UNTOUCHED", "R-PUSH-DISABLED", "R-PUSH-WRITTEN", "nothing open"}


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("shard", range(8))
@pytest.mark.parametrize("where", list(FIRST))
def test_killed_again_at_every_step_of_recovering(tmp_path: Path, where: str, shard: int) -> None:
    print(dict(twice(Scene(), tmp_path, where, None, slice(shard, None, 8))))


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("shard", range(8))
@pytest.mark.parametrize("name", list(SCENES))
def test_killed_at_every_step_there_is(tmp_path: Path, name: str, shard: int) -> None:
    steps = steps_of(SCENES[name], tmp_path / "count")
    points = chosen(steps, 0, every=True)[shard::8]
    print(dict(sweep(SCENES[name], tmp_path, points)))
