"""A wire that breaks in the middle of a push: a fresh connection reads what happened, and the old table comes back."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.push import push_table
from tests import attacks
from tests.push.bench import Moment, Plan, told
from tests.push.judging import Played, ended, judge, settle
from tests.push.mischief import Mischief
from tests.push.world import Scene, change_of, context_for, world
from tests.sizes import few

pytestmark = pytest.mark.attack


@pytest.mark.parametrize("command", ["MARKER", "DISABLE", "BEGIN", "CHUNK", "VERIFY", "ACTIVATE"])
async def test_an_answer_that_is_lost_leads_back_over_a_fresh_connection(tmp_path: Path, command: str) -> None:
    """What the lost command did is unknown: it is never sent again; the restore is a transaction of its own number."""

    clock = LoopClock()
    wire = Mischief(clock, random.Random(1))
    async with world(Scene(), clock, wire.around) as at:
        device = at.driver()
        await device.open(5.0)
        base = await device.saved_tables("X1")
        said: list[str] = []

        def say(code: str, /, **fields: object) -> None:
            said.append(code)
            at.person.hear(code, fields)

        context = context_for(Scene(), device, clock, tmp_path, await device.identify(), say=say)
        wire.due.append((Moment(1, command), lambda: setattr(wire, "lost", True)))
        found = Played(0)
        found.outcome = await ended(push_table(change_of(Scene(), base), context))
        await device.close()
        judge(at.oracle, found, said, context)
        assert found.wrong == []
        assert found.outcome == "rolled-back"
        assert at.oracle.as_before
        assert at.station.plc.memory.marker_state == 0


def test_a_control_that_stays_away_is_told_as_still_on(tmp_path: Path) -> None:
    def gone(at: object) -> None:
        at.station.silent = True  # type: ignore[attr-defined]

    def back(at: object) -> None:
        at.station.silent = False  # type: ignore[attr-defined]

    story = told(Plan(at=((Moment(1, "VERIFY"), gone),), mend=back), tmp_path)
    assert (story.outcome, story.off, story.wrong) == ("held-on", True, [])
    assert "P-PUSH-HELD-ON" in story.said
    assert "rolled-back" in story.recovered


@pytest.mark.parametrize("shard", few(range(5), 1, 2))
def test_cut_after_sampled_bytes_of_the_exchange(tmp_path: Path, shard: int) -> None:
    """Old, new or held, whichever byte is the last to pass."""
    sampled = random.Random(7).sample(range(1, 20_000), 40)[shard::5]
    outcomes = [cut_after(count, tmp_path / str(count)) for count in sampled]
    attacks.judged("the wire cut after a byte", "mailbox", (one.wrong for one in outcomes))
    assert [str(one) for one in outcomes if one.wrong] == []
    assert {"rolled-back"} <= {one.outcome for one in outcomes}


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("shard", range(8))
def test_cut_after_every_seventh_byte(tmp_path: Path, shard: int) -> None:
    outcomes = [cut_after(count, tmp_path / str(count)) for count in range(1 + 7 * shard, 20_000, 56)]
    attacks.judged("the wire cut after a byte", "mailbox", (one.wrong for one in outcomes))
    assert [str(one) for one in outcomes if one.wrong] == []


def cut_after(count: int, root: Path) -> Played:
    """A push whose wire is cut once, after that many bytes both ways."""
    root.mkdir()
    found = Played(count, [f"cut after {count} bytes"])

    async def main() -> None:
        clock = LoopClock()
        wire = Mischief(clock, random.Random(1))
        async with world(Scene(), clock, wire.around) as at:
            device = at.driver()
            await device.open(5.0)
            base = await device.saved_tables("X1")
            said: list[str] = []

            def say(code: str, /, **fields: object) -> None:
                said.append(code)
                at.person.hear(code, fields)

            context = context_for(Scene(), device, clock, root, await device.identify(), say=say)
            at.oracle.writes = wire.passed = 0
            wire.cut_after = count
            found.outcome = await ended(push_table(change_of(Scene(), base), context))
            wire.cut_after = 0
            await device.close()
            judge(at.oracle, found, said, context)
            await clock.sleep(8.0)
            fresh = at.driver()
            await fresh.open(5.0)
            again = context_for(Scene(), fresh, clock, root, await fresh.identify(), say=say)
            await settle(at.oracle, again, found, willing=True)
            await fresh.close()

    run_virtual(main)
    return found
