"""Batches through the port over NC programs: one program, one release, one restart; each is switched by itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.contract import table_in
from drivers.types.orders import DisableOrder, PushBatch, PushOrder
from drivers.types.tables import CompensationTable
from tests.contract.opcua_stage import SPEC, Stage, on_stage
from tests.sizes import few, long

MANY = replace(SPEC, cec_points=(10,) * 4)
GRIDS: dict[str, tuple[float, float, float]] = {
    "X1": (-200.0, 200.0, 100.0),
    "Z1": (100.0, 500.0, 100.0),
    "C1": (0.0, 360.0, 90.0),
}
PLACES = {"X1": 0.0, "Z1": 300.0, "C1": 0.0}
UNITS: dict[str, Any] = {"X1": "mm", "Z1": "mm", "C1": "deg"}


def order(input_axis: str, output_axis: str, index: int = 0, size: float = 1.0) -> PushOrder:
    """A small table, zero where its input axis shall stand, as a sign proof loads one."""
    minimum, maximum, step = GRIDS[input_axis]
    table = CompensationTable(
        "axis" if input_axis == output_axis else "cross",
        input_axis,
        output_axis,
        minimum,
        maximum,
        step,
        (0.0, 1.8 * size, 0.0, -3.6 * size, 0.0),
        modulo=input_axis == "C1",
        index=index,
        input_unit=UNITS[input_axis],
        output_unit=UNITS[output_axis],
    )
    place = PLACES[input_axis]
    return PushOrder(4711, table, input_axis[0], input_axis == "C1", True, place, "sign-proof")


BATCH: PushBatch = (
    order("X1", "X1"),
    order("Z1", "Z1"),
    order("C1", "C1"),
    order("Z1", "X1", 0, 0.5),
    order("Z1", "C1", 1, 0.5),
    order("X1", "Z1", 2, 0.5),
    order("C1", "X1", 3, 0.5),
)


async def loaded(on: Stage, batch: PushBatch) -> tuple[bool, ...]:
    """First half; whether each table was found as sent. Every one reads as it was ordered, unless said otherwise."""
    await on.device.stage(batch)
    on.press()
    found = await on.device.read_back(batch, 600.0)
    for one, read in zip(batch, found, strict=True):
        held = table_in(read.found, one.table)
        assert held is not None
        assert not held.enabled
        if read.agreed:
            assert held.table.deviations == pytest.approx(one.table.deviations, abs=0.01)
    return tuple(read.agreed for read in found)


async def on_now(on: Stage, batch: PushBatch) -> list[bool | None]:
    """The switches of all tables."""
    places = [DisableOrder(1, one.table.kind, one.table.output_axis, one.table.index) for one in batch]
    return [(await on.device.switch_reading(place)).enabled for place in places]


@pytest.mark.parametrize("count", few([3, 1, 7]))
async def test_one_program_loads_all_and_one_restart_puts_all_to_work(keys: Path, count: int) -> None:
    async with on_stage(MANY, folder=keys) as on:
        batch = BATCH[:count]
        assert await loaded(on, batch) == (True,) * count
        assert await on_now(on, batch) == [False] * count
        await on.device.activate(batch, batch)
        assert await on.device.confirm(batch, 120.0) == (True,) * count
        await on.device.restarted(batch, 120.0)
        assert on.pressed == ["activate"]
        assert await on_now(on, batch) == [True] * count
        await on.device.finish_push(batch, "committed")
        marker = await on.device.marker()
        assert marker is not None
        assert (marker.transaction, marker.state) == (4711, "committed")
        backups = await on.device.backup_of(batch)
        assert all(
            table_in(old, one.table) is None or not table_in(old, one.table).enabled  # type: ignore[union-attr]
            for old, one in zip(backups, batch, strict=True)
        )


@pytest.mark.parametrize("kept", [(0, 2), (0,), long(((1,),)), long(((1, 2),))])
async def test_only_what_was_released_is_switched_on(keys: Path, kept: tuple[int, ...]) -> None:
    async with on_stage(MANY, folder=keys) as on:
        batch = BATCH[:3]
        await loaded(on, batch)
        passed = tuple(batch[place] for place in kept)
        await on.device.activate(batch, passed)
        assert await on.device.confirm(passed, 120.0) == (True,) * len(kept)
        assert await on_now(on, batch) == [place in kept for place in range(3)]


async def test_cross_tables_of_one_axis_are_switched_by_themselves(keys: Path) -> None:
    async with on_stage(MANY, folder=keys) as on:
        batch = (BATCH[3], BATCH[6])
        await loaded(on, batch)
        await on.device.activate(batch, batch[1:])
        assert await on.device.confirm(batch[1:], 120.0) == (True,)
        switches = [on.nck.get(f"$SN_CEC_TABLE_ENABLE[{index}]") for index in (0, 3)]
        assert [bool(one) for one in switches] == [False, True]


@pytest.mark.parametrize("count", few([3, 1, 7]))
async def test_a_reset_between_the_halves_leaves_all_off(keys: Path, count: int) -> None:
    async with on_stage(MANY, folder=keys) as on:
        batch = BATCH[:count]
        await loaded(on, batch)
        await on.device.activate(batch, batch)
        on.nck.channel_reset()
        assert await on.device.confirm(batch, 120.0) == (False,) * count
        assert await on_now(on, batch) == [False] * count


@pytest.mark.parametrize("released", [False, True])
async def test_a_table_changed_between_the_halves_keeps_all_off_that_are_released_with_it(
    keys: Path, released: bool
) -> None:
    async with on_stage(MANY, folder=keys) as on:
        batch = BATCH[:3]
        await loaded(on, batch)
        on.nck.set("$AA_ENC_COMP[0,1,Z1]", 0.0123, 0)
        passed = batch if released else (batch[0], batch[2])
        await on.device.activate(batch, passed)
        assert await on.device.confirm(passed, 120.0) == (not released,) * len(passed)
        assert await on_now(on, batch) == [not released, False, not released]


@pytest.mark.parametrize("word", few([8.0, 0.0, 9.0, -1.0], 2))
async def test_a_release_that_names_no_table_of_the_batch_switches_nothing(keys: Path, word: float) -> None:
    async with on_stage(MANY, folder=keys) as on:
        batch = BATCH[:3]
        await loaded(on, batch)
        await on.device.activate(batch, batch)
        on.nck.set("R[85]", word, 7)
        assert await on.device.confirm(batch, 120.0) == (False,) * 3
        assert await on_now(on, batch) == [False] * 3


async def test_a_control_that_stores_one_table_wrongly_still_offers_the_others(
    keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with on_stage(MANY, folder=keys) as on:
        batch, kept = BATCH[:3], on.nck.core.memory.kept

        def wrong(value: float) -> float:
            return kept(value) + (2e-6 if value == pytest.approx(-0.0036, abs=1e-9) and off.pop() else 0.0)

        off = [False] * 40 + [True, False]  # the second table that holds this value, not the first
        monkeypatch.setattr(type(on.nck.core.memory), "kept", staticmethod(wrong))
        agreed = await loaded(on, batch)
        monkeypatch.undo()
        assert agreed == (True, False, True)
        passed = (batch[0], batch[2])
        await on.device.activate(batch, passed)
        assert await on.device.confirm(passed, 120.0) == (True, True)
        assert await on_now(on, batch) == [True, False, True]
