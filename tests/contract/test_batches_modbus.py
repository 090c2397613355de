"""Batches through a mailbox: the same port calls, all tables in one order with one release and one confirm."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.contract import table_in
from drivers.errors import DeviceRefused
from drivers.types.abilities import Marker
from drivers.types.orders import DisableOrder, PushBatch
from tests.contract.modbus_stage import Stage, cross, on_stage, order_for, table


async def batch_of(stage: Stage, count: int) -> PushBatch:
    """X(X), C(C) and two cross tables of X over C."""
    own = replace(cross(), kind="axis", output_axis="C1", output_unit="deg")
    wanted = (table(), own, cross(0), cross(1))[:count]
    return tuple([await order_for(stage.device, one) for one in wanted])


async def on_now(stage: Stage, batch: PushBatch) -> list[bool | None]:
    places = [DisableOrder(1, one.table.kind, one.table.output_axis, one.table.index) for one in batch]
    return [(await stage.device.switch_reading(place)).enabled for place in places]


@pytest.mark.parametrize("count", [1, 3, 4])
async def test_all_tables_of_a_batch_are_loaded_off_and_confirmed_once(count: int) -> None:
    async with on_stage() as stage:
        batch = await batch_of(stage, count)
        await stage.device.stage(batch)
        assert await stage.device.marker() == Marker(17, "in-progress")
        found = await stage.device.read_back(batch, 300.0)
        for one, read in zip(batch, found, strict=True):
            held = table_in(read.found, one.table)
            assert held is not None
            assert (read.agreed, held.enabled) == (True, False)
            assert held.table.deviations == pytest.approx(one.table.deviations, abs=0.002)  # 1e-6 deg are 0.0036 arcsec
        assert await stage.device.backup_of(batch) == tuple(read.backup for read in found)
        await stage.device.activate(batch, batch)
        asked = stage.device.confirm(batch, 100.0)
        stage.plc.confirm()
        assert await asked == (True,) * count, "pressed once"
        await stage.device.restarted(batch, 100.0)
        assert await on_now(stage, batch) == [True] * count
        await stage.device.finish_push(batch, "committed")
        assert await stage.device.marker() == Marker(17, "committed")


async def test_a_table_that_was_not_released_stays_off() -> None:
    async with on_stage() as stage:
        batch = await batch_of(stage, 3)
        await stage.device.stage(batch)
        await stage.device.read_back(batch, 300.0)
        passed = (batch[0], batch[2])
        await stage.device.activate(batch, passed)
        assert await stage.pressed(stage.device.confirm(passed, 100.0)) == (True, True)
        assert await on_now(stage, batch) == [True, False, True]


async def test_nobody_at_the_panel_leaves_all_off() -> None:
    async with on_stage() as stage:
        batch = await batch_of(stage, 3)
        await stage.device.stage(batch)
        await stage.device.read_back(batch, 300.0)
        await stage.device.activate(batch, batch)
        assert await stage.device.confirm(batch, 200.0) == (False,) * 3
        assert await on_now(stage, batch) == [False] * 3


async def test_what_the_nck_took_before_it_refused_is_told_table_by_table() -> None:
    async with on_stage() as stage:
        batch = await batch_of(stage, 3)
        await stage.device.stage(batch)
        await stage.device.read_back(batch, 300.0)
        await stage.device.activate(batch, batch)
        switch, left = stage.plc._access.switch, [True]

        def one_alone(*given: object, **how: object) -> None:
            if left:
                left.clear()
                switch(*given, **how)

        stage.plc._access.switch = one_alone
        assert await stage.pressed(stage.device.confirm(batch, 100.0)) == (True, False, False)


async def test_one_order_that_may_not_be_loaded_leaves_all_untouched() -> None:
    async with on_stage() as stage:
        good, other = await batch_of(stage, 2)
        values = tuple(value + 5.0 for value in other.table.deviations)
        moved = replace(other, table=replace(other.table, deviations=values))
        with pytest.raises(DeviceRefused) as caught:
            await stage.device.stage((good, moved))
        assert caught.value.code == "E-MBX-PLACE"
        assert await stage.device.marker() in (None, Marker(0, "none"))
        assert stage.values(3) == [0.0, 0.0, 0.0]
