"""kill -9 of a gateway that pushes two tables in one order through the mailbox: both come home, or both are live."""

from __future__ import annotations

import os
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.types.tables import LiveSet, LiveTable
from gateway import audit
from gateway.domain.proposals import TableChange
from gateway.push import PushContext, push_tables, recover, unfinished
from gateway.push.compare import table_in
from gateway.push.records import journal
from gateway.push.records.history import tables_of
from tests import attacks
from tests.push.killing import IDLE, Ended, gateway
from tests.push.oracle import Oracle
from tests.push.test_kill_modbus import GONE_S, prepared
from tests.push.world import NEVER, NEW, NOTHING, Scene, World, change_of, world
from tests.sizes import few

pytestmark = [
    pytest.mark.attack,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="a process is forked"),
]

BOTH = Scene(cross=True, both=True)
SHARDS = 12
COMMITTED = 2  # the marker in the PLC


def own(context: PushContext) -> PushContext:
    """What the axis' own table is worked with, from what the cross table is."""
    assert context.proof is not None
    return replace(context, input=None, proof=replace(context.proof, kind="axis", slope=-1.0, sign=1))


async def pushing_both(scene: Scene, context: PushContext, base: LiveSet) -> Any:
    """One transaction of the cross table and the axis' own."""
    root = context.journals.parent
    audit.record(root, "push-start", clock=context.clock, serial=context.machine.serial)
    found = table_in(base, NEW)
    mine = TableChange("X1", found.table, NEW, found.enabled, base.digest, NOTHING, NOTHING, NOTHING, base=base)
    records = await push_tables(((change_of(scene, base), context), (mine, own(context))))
    audit.note(root, "push-ended", clock=context.clock, transaction=records[0].transaction)
    return tuple(record.outcome for record in records)


async def recovering_both(_scene: Scene, context: PushContext, _base: LiveSet) -> Any:
    """Each table by itself, as `recover` does."""
    serial = context.machine.serial
    journal.tidy(journal.machine_folder(context.journals, serial))
    outcomes = []
    for one in unfinished(context.journals, serial):
        used = own(context) if tables_of(one)[1].kind == "axis" else context
        outcomes.append((await recover(one, used)).outcome)
    return tuple(outcomes)


def judges(at: World) -> tuple[Oracle, Oracle]:
    """One of each table; both watch every change of the control."""
    return at.oracle, Oracle(at.nck, LiveTable(NEVER, False), NEW)


def steps_of(root: Path) -> tuple[str, ...]:
    """Every step of a push that nobody kills."""

    async def main() -> Ended:
        async with world(BOTH) as at:
            both = judges(at)
            case = await prepared(at, root)
            ended = await gateway(at, case.root, case.base, pushing_both)
            assert ended.result == ("committed", "committed")
            assert all(one.as_wanted and one.broken == [] for one in both)
            return ended

    return run_virtual(main).steps


async def killed_at(at: World, root: Path, step: int) -> None:
    both = judges(at)
    case = await prepared(at, root)
    assert (await gateway(at, case.root, case.base, pushing_both, step)).killed
    await at.clock.sleep(GONE_S)
    done = await gateway(at, case.root, case.base, recovering_both)
    assert set(done.result) <= {"rolled-back"}, done.result
    assert case.open_journals() == ()
    assert all(one.as_before for one in both) or all(one.as_wanted for one in both), "half of the tables stayed"
    assert [one.broken for one in both] == [[], []]
    assert at.station.plc.memory.marker_state == (COMMITTED if both[0].as_wanted else 0)
    assert audit.check(case.root).sound


@pytest.mark.parametrize("shard", few(range(SHARDS)))
def test_killed_between_any_two_steps_of_two_tables(tmp_path: Path, shard: int) -> None:
    """All steps that leave a trace over all shards; two of them alone in the first."""
    steps = steps_of(tmp_path / "count")
    assert sum(name == "VERIFY<" for name in steps) >= 2 or sum(name == "CHUNK<" for name in steps) >= 2
    traces = [number for number, name in enumerate(steps) if name[:-1] not in IDLE]
    mine = traces[shard::SHARDS]
    if not shard:
        mine = random.Random(23).sample(mine, min(2, len(mine)))
    for step in mine:

        async def main(step: int = step) -> None:
            async with world(BOTH) as at:
                await killed_at(at, tmp_path / str(step), step)

        try:
            run_virtual(main)
        except AssertionError as error:
            raise AssertionError(f"killed at step {step} ({steps[step]}): {error}") from error
    attacks.counted("the gateway killed at a step of two tables", "mailbox", len(mine))
