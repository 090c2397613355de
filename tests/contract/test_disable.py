"""The disable-only order on both roads: it writes no value, it says off only when a read-back does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeadlineExceeded, DeviceRefused
from drivers.types.orders import DisableOrder
from tests.contract import modbus_stage, opcua_stage
from tests.contract.modbus_stage import cross, order_for, table

C1 = DisableOrder(900, "axis", "C1")
X1 = DisableOrder(901, "axis", "X1")
CEC = DisableOrder(902, "cross", "X1", 0)


async def stand(nck: Any, clock: Any, axis: str, position: float) -> None:
    """The operator jogs the axis to where the table does something."""
    nck.set_mode("JOG")
    await clock.sleep(nck.core.move({nck.core.axis(axis).index: position}, None) + 1.0)
    nck.set_mode("AUTO")


# ---- with programs ----------------------------------------------------------------------------------


async def test_a_program_of_its_own_switches_off_and_writes_nothing_else(keys: Path) -> None:
    async with opcua_stage.on_stage(folder=keys) as on:
        await on.push(opcua_stage.ORDER)
        on.nck.channel_reset()
        await stand(on.nck, on.clock, "C1", 20.0)
        before = on.memory()
        assert (reading := await on.device.switch_reading(C1)).enabled
        assert abs(reading.acting) > 0.1
        await on.device.prepare_disable(C1)
        assert on.memory() == before
        on.press()
        found = await on.device.wait_disabled(C1, 60.0)
        assert found.off
        assert found == await on.device.switch_reading(C1)
        assert on.memory() == (*before[:-1], False)
        assert on.nck.core.eec_value(2, 0) == 0.0


async def test_switching_off_what_is_off_says_so_again(keys: Path) -> None:
    async with opcua_stage.on_stage(folder=keys) as on:
        before = on.memory()
        await on.device.prepare_disable(C1)
        on.press()
        assert (await on.device.wait_disabled(C1, 60.0)).off
        assert on.memory() == before


@pytest.mark.parametrize("manner", [{"lies_about_disable": True}, {"ignores_newconf": True}])
async def test_a_table_that_goes_on_acting_is_never_told_as_off(keys: Path, manner: dict[str, Any]) -> None:
    async with opcua_stage.on_stage(replace(opcua_stage.SPEC, **manner), folder=keys) as on:
        await on.push(opcua_stage.ORDER)
        on.nck.channel_reset()
        await stand(on.nck, on.clock, "C1", 20.0)
        await on.device.prepare_disable(C1)
        on.press()
        found = await on.device.wait_disabled(C1, 60.0)
        acts = on.nck.core.eec_value(2, 0) != 0.0
        assert found.off is not acts
        assert acts or "ignores_newconf" in manner


async def test_nobody_starts_it_and_a_running_program_is_left_alone(keys: Path) -> None:
    async with opcua_stage.on_stage(folder=keys) as on:
        await on.loaded(opcua_stage.ORDER)
        with pytest.raises(DeviceRefused) as refused:
            await on.device.prepare_disable(C1)
        assert refused.value.code == "E-NC-NOT-RESET"
        on.nck.channel_reset()
        await on.device.prepare_disable(C1)
        with pytest.raises(DeadlineExceeded):
            await on.device.wait_disabled(C1, 20.0)


# ---- through the mailbox ----------------------------------------------------------------------------


@pytest.mark.parametrize("order", [X1, CEC], ids=["axis", "cross"])
async def test_command_6_alone_switches_off_wherever_the_axis_stands(order: DisableOrder) -> None:
    async with modbus_stage.on_stage() as stage:
        device = stage.device
        wanted = table() if order.kind == "axis" else cross()
        await stage.push(await order_for(device, wanted))
        await stand(stage.bench.nck, stage.bench.clock, wanted.input_axis, 33.0)
        values = stage.values(5)
        assert abs((await device.switch_reading(order)).acting) > 0.1
        assert (await device.switch_reading(order)).enabled
        await device.prepare_disable(order)
        assert (await device.switch_reading(order)).enabled
        found = await device.wait_disabled(order, 60.0)
        assert found.off
        assert stage.values(5) == values
        assert not stage.get("$MA_ENC_COMP_ENABLE[0,X1]")
        assert not stage.get("$MA_CEC_ENABLE[X1]")
        assert (await device.wait_disabled(order, 60.0)).off


async def test_a_plc_that_lies_about_disable_is_told_as_on() -> None:
    async with modbus_stage.on_stage() as stage:
        await stage.push(await order_for(stage.device, table()))
        await stand(stage.bench.nck, stage.bench.clock, "X1", 33.0)
        stage.plc.change(lies_about_disable=True)
        assert not (await stage.device.wait_disabled(X1, 60.0)).off


async def test_its_needs_and_what_is_no_need_of_it() -> None:
    async with modbus_stage.on_stage() as stage:
        device, nck = stage.device, stage.bench.nck
        await stage.push(await order_for(device, table()))
        stage.plc.on_session = lambda: None
        for work in (device.prepare_disable, lambda order: device.wait_disabled(order, 300.0)):
            with pytest.raises(DeviceRefused) as refused:
                await work(X1)
            assert refused.value.code == "E-MBX-RELEASE-STALE"
            assert stage.plc.session == 0
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]") is True
        stage.plc.on_session = stage.plc.release.give
        nck.set_access_level(2)
        nck.drive_alarm(300504, "drive fault")  # an alarm keeps tables from being switched on, not off
        assert (await device.wait_disabled(X1, 30.0)).off
