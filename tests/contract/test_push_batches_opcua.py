"""The gateway hands over a layer to the control's double: one program, one restart, each table by itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable, LiveSet
from gateway.axes import AxisRecord
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.preflight import group_transactions
from gateway.push.recovery import recover_table, unfinished_tables
from gateway.push.transaction import push_tables
from gateway.say import silence
from tests.contract.opcua_stage import Stage, on_stage, plan
from tests.contract.test_batches_opcua import BATCH, MANY
from tests.contract.test_push_opcua import C_AXIS, NOTHING, X_AXIS, Z_AXIS, context_for, identity_of, starting
from tests.selftested import passed
from tests.sizes import few

RECORDS = {"X1": X_AXIS, "Z1": Z_AXIS, "C1": C_AXIS}
Wish = tuple[TableChange, PushContext]


async def wishes(on: Stage, root: Path, count: int) -> list[Wish]:
    """The first tables of the batch as changes of what is live now."""
    bases = {name: await live_of(on, axis) for name, axis in RECORDS.items()}
    return [await wish(on, root, order.table, bases[order.table.output_axis]) for order in BATCH[:count]]


async def live_of(on: Stage, axis: AxisRecord) -> LiveSet:
    nothing = plan((), axis=axis.name, letter=axis.letter, unit=axis.unit, rotary=axis.rotary)
    await on.walk(nothing)
    return await on.device.saved_tables(axis.name)


async def wish(on: Stage, root: Path, table: CompensationTable, live: LiveSet) -> Wish:
    old = table_in(live, table)
    axis = table.output_axis
    change = TableChange(axis, old.table, table, old.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)
    proof = SignProof(identity_of(on), table.kind, axis, -1.0, 0.02, 1, "2026-11-21T09:00:00+00:00")
    context = await context_for(on, root, proof, RECORDS[table.input_axis] if table.kind == "cross" else None)

    def say(code: str, /, **_fields: object) -> None:
        if code == "P-PUSH-RESET":
            on.nck.channel_reset()

    tested = passed(identity_of(on), axis)
    return change, replace(context, axis=RECORDS[axis], self_test=tested, say=say)


async def pushed(on: Stage, asked: list[Wish], *, stays: bool = True) -> tuple[PushRecord, ...]:
    (group,) = group_transactions(asked)
    async with starting(on):
        return await push_tables(group, lambda _changes: stays)


@contextmanager
def one_stored_wrongly(on: Stage) -> Iterator[None]:
    """The control keeps one value of the second table a little off, once."""
    kept, off = on.nck.core.memory.kept, [False] * 40 + [True, False]

    def wrong(value: float) -> float:
        return kept(value) + (2e-6 if value == pytest.approx(-0.0036, abs=1e-9) and off and off.pop() else 0.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(on.nck.core.memory), "kept", staticmethod(wrong))
        yield


@contextmanager
def starts_counted(on: Stage) -> Iterator[list[bool]]:
    """Every NC START from now on, and whether the control took it."""
    press, starts = on.nck.nc_start, []

    def counting() -> bool:
        starts.append(press())
        return starts[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(on.nck, "nc_start", counting)
        yield starts


@pytest.mark.parametrize("count", few([3, 7], 1))
async def test_a_layer_goes_by_one_program_and_one_restart(keys: Path, tmp_path: Path, count: int) -> None:
    async with on_stage(MANY, folder=keys) as on:
        asked = await wishes(on, tmp_path, count)
        records = await pushed(on, asked)
        assert [record.outcome for record in records] == ["committed"] * count, [
            record.steps[-3:] for record in records
        ]
        assert on.pressed.count("activate") == 1
        marker = await on.device.marker()
        assert marker is not None
        assert (marker.transaction, marker.state) == (records[0].transaction, "committed")
        assert not unfinished_tables(tmp_path / "journal", identity_of(on).serial)


@pytest.mark.parametrize("stays", few([True, False]))
async def test_a_wrong_table_goes_back_alone_or_with_its_layer(keys: Path, tmp_path: Path, stays: bool) -> None:
    async with on_stage(MANY, folder=keys) as on:
        asked = await wishes(on, tmp_path, 3)
        with one_stored_wrongly(on):
            records = await pushed(on, asked, stays=stays)
        good = "committed" if stays else "rolled-back"
        assert [record.outcome for record in records] == [good, "rolled-back", good], [r.steps for r in records]
        switches = [bool(on.nck.get(f"$MA_ENC_COMP_ENABLE[0,{axis}]")) for axis in ("X1", "Z1", "C1")]
        assert switches == [stays, False, stays]
        assert on.nck.get("$AA_ENC_COMP_STEP[0,Z1]") == 0.0


async def test_nobody_restarts_the_control_and_a_later_gateway_leads_back(keys: Path, tmp_path: Path) -> None:
    async with on_stage(MANY, folder=keys) as on:
        asked = await wishes(on, tmp_path, 3)
        on.restarts = False
        deaf = [(change, replace(one, start_timeout_s=30.0, say=silence)) for change, one in asked]
        records = await pushed(on, deaf)
        assert {record.outcome for record in records} == {"held-on"}, [record.steps for record in records]
        on.restarts = True
        on.nck.channel_reset()
        async with starting(on):
            for found in unfinished_tables(tmp_path / "journal", identity_of(on).serial):
                context = next(one for change, one in asked if change.name == found.of)
                record = await recover_table(found, context)
                assert record.outcome == "rolled-back", record.steps
        assert not any(on.nck.get(f"$MA_ENC_COMP_ENABLE[0,{axis}]") for axis in ("X1", "Z1", "C1"))
        assert not unfinished_tables(tmp_path / "journal", identity_of(on).serial)
