"""kill -9 of a gateway that pushes two, three and seven tables in one order through the mailbox.

All come home, or all are live.
"""

from __future__ import annotations

import os
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import run_virtual
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway import audit
from gateway.domain.proposals import TableChange
from gateway.push import journal
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.history import tables_of
from gateway.push.recovery import recover_table, unfinished_tables
from gateway.push.transaction import push_tables
from tests import attacks
from tests.push.killing import IDLE, Ended, gateway
from tests.push.oracle import Oracle
from tests.push.test_kill_modbus import GONE_S, prepared
from tests.push.world import NEVER, NEW, NOTHING, Scene, World, change_of, world
from tests.sizes import few, soak

pytestmark = [
    pytest.mark.attack,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="a process is forked"),
]

SHARDS = 12
COMMITTED = 2  # the marker in the PLC
SMALL = 0.2  # of the first cross table: what all of them add up to stays within the limits


def shards() -> list[Any]:
    """How many tables, which share of the steps, how many of that share at most.

    Two tables at two steps always, at every fourth with `long`, as three and seven at some; at all of them in a soak.
    """
    return [
        *few([(2, 0, 2), *((2, shard, 999) for shard in range(1, SHARDS, 4)), (3, 0, 6), (7, 0, 6)]),
        *(soak((2, shard, 999)) for shard in range(1, SHARDS) if shard % 4 != 1),
        *(soak((count, shard, 999)) for count in (3, 7) for shard in range(1, SHARDS)),
    ]


def scene_of(count: int) -> Scene:
    """So many tables of X1: its own, and cross tables over Z1; the first of these is live before."""
    return Scene(cross=True, both=True, more=count - 2)


def wanted(scene: Scene) -> tuple[CompensationTable, ...]:
    """The new cross tables but the first."""
    _old, new = scene.tables
    small = tuple(SMALL * value for value in new.deviations)
    return tuple(replace(new, index=index, deviations=small) for index in range(1, 1 + scene.more))


def own(context: PushContext) -> PushContext:
    """What the axis' own table is worked with, from what the cross table is."""
    assert context.proof is not None
    return replace(context, input=None, proof=replace(context.proof, kind="axis", slope=-1.0, sign=1))


def put(live: LiveSet, new: CompensationTable) -> TableChange:
    """The change from what is live."""
    found = table_in(live, new)
    return TableChange("X1", found.table, new, found.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)


async def pushing_all(scene: Scene, context: PushContext, base: LiveSet) -> Any:
    """One transaction of the cross tables and the axis' own."""
    root = context.journals.parent
    audit.record(root, "push-start", clock=context.clock, serial=context.machine.serial)
    more = tuple((put(base, one), context) for one in wanted(scene))
    records = await push_tables(((change_of(scene, base), context), (put(base, NEW), own(context)), *more))
    audit.note(root, "push-ended", clock=context.clock, transaction=records[0].transaction)
    return tuple(record.outcome for record in records)


async def recovering_all(_scene: Scene, context: PushContext, _base: LiveSet) -> Any:
    """Each table by itself, as `recover` does."""
    serial = context.machine.serial
    journal.set_ended_aside(journal.machine_folder(context.journals, serial))
    outcomes = []
    for one in unfinished_tables(context.journals, serial):
        used = own(context) if tables_of(one)[1].kind == "axis" else context
        outcomes.append((await recover_table(one, used)).outcome)
    return tuple(outcomes)


def judges(at: World) -> tuple[Oracle, ...]:
    """One of each table; all watch every change of the control."""
    more = [
        Oracle(at.nck, LiveTable(replace(one, step=0.0, deviations=(0.0,)), False), one) for one in wanted(at.scene)
    ]
    return at.oracle, Oracle(at.nck, LiveTable(NEVER, False), NEW), *more


def steps_of(scene: Scene, root: Path) -> tuple[str, ...]:
    """Every step of a push that nobody kills."""

    async def main() -> Ended:
        async with world(scene) as at:
            every = judges(at)
            case = await prepared(at, root)
            ended = await gateway(at, case.root, case.base, pushing_all)
            assert ended.result == ("committed",) * len(every)
            assert all(one.as_wanted and one.broken == [] for one in every)
            return ended

    return run_virtual(main).steps


async def killed_at(at: World, root: Path, step: int) -> None:
    every = judges(at)
    case = await prepared(at, root)
    assert (await gateway(at, case.root, case.base, pushing_all, step)).killed
    await at.clock.sleep(GONE_S)
    done = await gateway(at, case.root, case.base, recovering_all)
    assert set(done.result) <= {"rolled-back"}, done.result
    assert case.open_journals() == ()
    assert all(one.as_before for one in every) or all(one.as_wanted for one in every), "a part of the tables stayed"
    assert [one.broken for one in every] == [[]] * len(every)
    assert at.station.plc.memory.marker_state == (COMMITTED if every[0].as_wanted else 0)
    assert audit.check_log(case.root).sound


@pytest.mark.parametrize(("count", "part", "most"), shards())
def test_killed_between_any_two_steps_of_several_tables(tmp_path: Path, count: int, part: int, most: int) -> None:
    """All steps that leave a trace over all shards; some of them alone in the first."""
    scene = scene_of(count)
    steps = steps_of(scene, tmp_path / "count")
    assert sum(name == "VERIFY<" for name in steps) >= count or sum(name == "CHUNK<" for name in steps) >= count
    traces = [number for number, name in enumerate(steps) if name[:-1] not in IDLE]
    mine = traces[part::SHARDS]
    mine = random.Random(23).sample(mine, min(most, len(mine)))
    for step in mine:

        async def main(step: int = step) -> None:
            async with world(scene) as at:
                await killed_at(at, tmp_path / str(step), step)

        try:
            run_virtual(main)
        except AssertionError as error:
            raise AssertionError(f"killed at step {step} ({steps[step]}): {error}") from error
    attacks.counted(f"the gateway killed at a step of {count} tables", "mailbox", len(mine))
