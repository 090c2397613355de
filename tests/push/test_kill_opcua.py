"""kill -9 of a push over OPC UA in fresh processes, and the mains of the control cut at every block of its program."""

from __future__ import annotations

import asyncio
import json
import random
import signal
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.tables import LiveTable
from gateway.push import push_table
from tests import attacks
from tests.push.judging import Played, ended, judge, settle
from tests.push.uaworld import UaWorld, never_loaded, ua_change, ua_context, ua_world
from tests.push.world import OLD
from tests.sizes import few, long, soak

pytestmark = pytest.mark.attack

SPEED = 80.0
SHARDS, EACH = 30, 1
OLDS = {"old on": LiveTable(OLD, True), "never loaded": never_loaded()}


# ---- the gateway in a process of its own, in wall time ----------------------------------------------


async def spawned(at: UaWorld, root: Path, step: int) -> tuple[int, str]:
    """A fresh Python that pushes and dies at a step: (return code, what it printed)."""
    root.mkdir()  # noqa: ASYNC240 - nothing else runs
    words = ["-m", "tests.push.uagateway", at.server.url, str(root), str(SPEED), str(step)]
    process = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=asyncio.subprocess.PIPE)
    out, _ = await process.communicate()
    return process.returncode or 0, out.decode()


async def cleared(at: UaWorld, by: str) -> None:
    """Somebody comes, finds the program waiting, and presses what he thinks is right."""
    await at.clock.sleep(3.0)
    if by == "start":
        at.nck.nc_start()
        await at.clock.sleep(10.0)
    at.nck.channel_reset()
    await at.clock.sleep(1.0)
    await at.ready()


async def recovered(at: UaWorld, root: Path, found: Played) -> Played:
    """A fresh gateway looks, and leads home."""
    device = at.driver()
    await device.open(900.0)
    try:
        machine = await device.identify()
        context = ua_context(
            device, at.clock, root, machine, start_timeout_s=900.0, say=lambda code, /, **f: at.person.hear(code, f)
        )
        await settle(at.oracle, context, found, willing=True)
    finally:
        await device.close()
    return found


def at_a_machine(body: Any, keys: Path, old: LiveTable | None = None) -> Any:
    """Run a body beside a machine in wall time, `SPEED` times as fast."""

    async def main() -> Any:
        clock = LoopClock(SPEED)
        async with ua_world(clock, keys, old) as at:
            return await body(at)

    return asyncio.run(main())


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory, keys: Path) -> list[str]:
    """The names of all steps that leave a trace, from a push that nobody kills."""
    root = tmp_path_factory.mktemp("count") / "push"

    async def body(at: UaWorld) -> list[str]:
        code, out = await spawned(at, root, -1)
        assert code == 0
        told = json.loads(out.splitlines()[-1])
        assert told["outcome"] == "committed"
        assert at.oracle.as_wanted
        return list(told["steps"])

    found: list[str] = at_a_machine(body, keys)
    assert {"journal/ DISABLE", "journal> ENABLE", "call<", "write>", "replace<"} <= set(found)
    return found


@pytest.mark.skipif(sys.platform == "win32", reason="a process that is killed here is ended by a signal")
@pytest.mark.parametrize("shard", few(range(SHARDS), more=3))
def test_killed_in_a_fresh_process(tmp_path: Path, keys: Path, steps: list[str], shard: int) -> None:
    points = random.Random(4).sample(range(len(steps)), SHARDS * EACH)[shard::SHARDS]
    found = [killed(tmp_path / str(point), keys, point, point % 2 == 0) for point in points]
    print([f"{steps[point]}: {one.recovered}" for point, one in zip(points, found, strict=True)])
    wrong = [f"at {steps[point]}: {one}" for point, one in zip(points, found, strict=True) if one.wrong]
    assert wrong == []
    assert len(found) == EACH


def killed(root: Path, keys: Path, point: int, start: bool) -> Played:
    async def body(at: UaWorld) -> Played:
        code, _out = await spawned(at, root, point)
        assert code == -signal.SIGKILL
        await cleared(at, "start" if start else "reset")
        at.oracle.look("after the kill")
        found = await recovered(at, root, Played(point, [f"killed at {point}"], "killed"))
        left = not found.recovered.startswith("nothing")
        found.wrong += [] if left or at.oracle.as_before or at.oracle.as_wanted else ["nothing open, but half"]
        return found

    found: Played = at_a_machine(body, keys)
    return found


# ---- the control's mains, in virtual time -----------------------------------------------------------


def cut_at(block: int, keys: Path, root: Path, old: LiveTable, killed: bool) -> Played:
    """The mains of the control fail at a block of the push's program; ``killed``: so do those of the gateway."""
    root.mkdir(parents=True)
    found = Played(block, [f"mains cut at block {block}"])

    async def main() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys, old) as at:
            await _cut(at, block, root, found, killed)

    run_virtual(main)
    return found


def counting(at: UaWorld, act: Callable[[int], None]) -> None:
    """Call with the number of each block of the push's own program, from 1."""
    count = [0]

    def done(_block: int) -> None:
        if "PUSH" in at.nck.selected:
            count[0] += 1
            act(count[0])

    at.nck.on_block = done


async def _cut(at: UaWorld, block: int, root: Path, found: Played, killed: bool) -> None:
    device = at.driver()
    await device.open(5.0)
    base = await at.base(device)
    said: list[str] = []

    def say(code: str, /, **fields: object) -> None:
        said.append(code)
        at.person.hear(code, fields)

    context = ua_context(device, at.clock, root, await device.identify(), say=say)
    task = asyncio.ensure_future(ended(push_table(ua_change(base, at.new), context)))

    def done(number: int) -> None:
        if number == block:
            at.nck.power_cycle()
            at.spawn(at.ready())
            if killed:
                task.cancel()

    counting(at, done)
    found.outcome = await task
    await device.close()
    if not killed:
        judge(at.oracle, found, said, context)
    at.nck.on_block = None
    await cleared(at, "reset")
    fresh = at.driver()
    await fresh.open(5.0)
    try:
        await settle(at.oracle, replace(context, controller=fresh), found, willing=True)
    finally:
        await fresh.close()


@pytest.fixture(scope="module")
def halves(tmp_path_factory: pytest.TempPathFactory, keys: Path) -> tuple[list[int], int]:
    """The blocks after which memory holds neither the old table nor the new one, and how many there are in all."""
    root = tmp_path_factory.mktemp("blocks")
    found: list[int] = []
    last = [0]

    async def main() -> None:
        clock = LoopClock()
        async with ua_world(clock, keys) as at:
            device = at.driver()
            await device.open(5.0)
            base = await at.base(device)

            def done(number: int) -> None:
                last[0] = number
                if not (at.oracle.is_old() or at.oracle.is_new()):
                    found.append(number)

            counting(at, done)
            context = ua_context(device, clock, root, await device.identify())
            assert (await push_table(ua_change(base, at.new), context)).outcome == "committed"
            await device.close()

    run_virtual(main)
    return found, last[0]


def sweep(blocks: Sequence[int], keys: Path, root: Path, old: LiveTable, killed: bool) -> Counter[str]:
    """Cut the mains at each of these blocks, each time at a machine of its own."""
    found = [cut_at(block, keys, root / str(block), old, killed) for block in blocks]
    attacks.judged("the mains cut at a block of the program", "OPC UA", (one.wrong for one in found))
    assert [str(one) for one in found if one.wrong] == []
    return Counter(f"{one.outcome}, {one.recovered.strip()}" for one in found)


@pytest.mark.parametrize("every", [12, long(4), soak(1)])
def test_the_mains_cut_at_every_block_that_leaves_half_a_table(
    tmp_path: Path, keys: Path, halves: tuple[list[int], int], every: int
) -> None:
    blocks = halves[0][::every]
    found = sweep(blocks, keys, tmp_path, OLDS["old on"], killed=True)
    print(halves, dict(found))
    assert found == {"cancelled, R-PUSH-HALF rolled-back": len(blocks)}
    assert len(halves[0]) >= 5


@pytest.mark.parametrize("count", few([1, 5]))
@pytest.mark.parametrize("killed", few([True, False]), ids=["gateway dies too", "gateway lives"])
@pytest.mark.parametrize("name", few(OLDS))
def test_the_mains_cut_at_blocks_of_the_program(
    tmp_path: Path, keys: Path, halves: tuple[list[int], int], name: str, killed: bool, count: int
) -> None:
    rng = random.Random(f"{name} {killed}")
    blocks = sorted({rng.choice(halves[0]), *rng.sample(range(1, halves[1] + 1), count)})
    found = sweep(blocks, keys, tmp_path, OLDS[name], killed)
    print(dict(found))
    assert sum(found.values()) >= count


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("killed", [False, True], ids=["gateway lives", "gateway dies too"])
@pytest.mark.parametrize("name", list(OLDS))
@pytest.mark.parametrize("shard", range(8))
def test_the_mains_cut_at_every_block(
    tmp_path: Path, keys: Path, halves: tuple[list[int], int], name: str, killed: bool, shard: int
) -> None:
    print(dict(sweep(range(1 + shard, halves[1] + 1, 8), keys, tmp_path, OLDS[name], killed)))
