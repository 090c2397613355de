"""The Modbus road's contract: the driver against the PLC double, honest and hostile, over every wire."""

from __future__ import annotations

import asyncio
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.errors import (
    DeadlineExceeded,
    DeviceRefused,
    LinkBroken,
    RemoteProtocolError,
    TableError,
    TooManyPoints,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
    ValueOutOfRange,
)
from drivers.message import Message
from drivers.ports.controller import Controller
from drivers.sinumerik.tablefile import reader
from drivers.sinumerik.tablefile.tables import HELD_KINDS, REVERSAL
from drivers.types.abilities import Capabilities, Marker
from drivers.types.machine import ChannelStatus
from drivers.types.stops import StopPlan
from drivers.workpiece import GrindAxis, GrindPlan
from tests.batches import sets_of
from tests.contract.modbus_stage import Stage, cross, on_stage, order_for, table
from tests.sizes import few

WIRES: list[tuple[str, dict[str, Any]]] = [
    ("memory://plc", {}),
    ("memory://plc", {"framer": "rtu", "unit": 17, "word_order": "low-first"}),
    ("tcp://127.0.0.1:0", {"unit": 7}),
    ("tcp://127.0.0.1:0", {"word_order": "low-first"}),
]


def nm(values: tuple[float, ...]) -> list[int]:
    return [round(1000 * value) for value in values]


# ---- the honest PLC --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("url", "plc"), WIRES)
async def test_a_table_goes_in_and_acts_over_every_wire(url: str, plc: dict[str, Any]) -> None:
    async with on_stage(url, **plc) as stage:
        order = await order_for(stage.device, table())
        old, new = await stage.push(order)
        assert (old.own.enabled, new.own.enabled) == (False, False)
        assert new.own.table == order.table
        assert [round(value * 1e6) for value in stage.values(111)] == nm(order.table.deviations)
        assert stage.values(120)[111:] == [0.0] * 9
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]") is True
        assert await stage.device.marker() == Marker(17, "committed")
        assert stage.plc.session == 0
        live = await stage.device.saved_tables("X1")
        assert live.own.enabled
        assert live.own.table == order.table
        assert reader.read_tables_loosely(live.native, "text", {"X1": "mm"}).tables[0] == order.table


@pytest.mark.wall_time
async def test_a_table_goes_in_and_acts_over_a_serial_line_in_wall_time() -> None:
    async with on_stage("socket://127.0.0.1:0", framer="rtu", scan_s=0.001) as stage:
        order = await order_for(stage.device, table(), enable=False)
        await stage.push(order)
        assert (await stage.device.saved_tables("X1")).own.table == order.table


async def test_it_is_a_controller_and_says_what_it_can() -> None:
    async with on_stage() as stage:
        device = stage.device
        assert isinstance(device, Controller)
        assert device.capabilities == Capabilities(
            False,
            (*HELD_KINDS, REVERSAL),
            "by-itself",
            True,
            "panel",
            cross_shown="either-way",
            together=True,
            off_anyhow=True,
            unprotected=Message.of("W-MBX-UNPROTECTED"),
        )
        machine = await device.identify()
        assert (machine.serial, machine.version) == ("ST-DOUBLE-0001", "4.8.6")
        assert (machine.axis_names, machine.unit_system) == (("X1", "C1"), "metric")
        assert await device.marker() == Marker(0, "none")
        limits = await device.table_limits("X1")
        assert (limits.reserved_points, limits.resolution) == (120, 1e-6)
        limits = await device.table_limits("C1")
        assert (limits.reserved_points, limits.resolution) == (37, 1e-7)
        assert (await device.table_limits("X1", "cross", 1)).reserved_points == 40
        plan = StopPlan("T", "X1", "X", "mm", False, (), 100.0, 1.0, 0.1)
        for call in (
            device.prepare_stops(plan),
            device.wait_stop(0, 1.0),
            device.release_stop(1),
            device.abort_program(),
            device.wait_ground(-1, 1.0),
        ):
            with pytest.raises(UnsupportedDevice) as caught:
                await call
            assert caught.value.code == "E-MBX-NO-PROGRAMS"
        axis = GrindAxis("X1", "X")
        work = (39, 160.0, 150.0, 10.0, 59.7, 62.3, 0.25)
        with pytest.raises(UnsupportedDevice) as caught:
            await device.prepare_grinding(GrindPlan("G", "PART", axis, axis, axis, None, *work))
        assert caught.value.code == "E-GRIND-NO-PROGRAMS"
        with pytest.raises(DeviceRefused) as refused:
            await device.table_limits("Q9")
        assert refused.value.code == "E-NC-AXIS"


async def test_the_state_of_every_axis() -> None:
    async with on_stage() as stage:
        state = await stage.device.state()
        assert (state.channel, state.mode, state.alarms, state.access_level) == (ChannelStatus.RESET, "AUTO", (), 2)
        assert {name: axis.unit for name, axis in state.axes.items()} == {"X1": "mm", "C1": "deg"}
        assert all(axis.referenced and axis.in_position for axis in state.axes.values())
        order = await order_for(stage.device, replace(table(), deviations=tuple([0.5] * 111)))
        await stage.push(order)
        axis = (await stage.device.state()).axes["X1"]
        assert axis.encoder_compensation == pytest.approx(0.5)


async def test_looking_at_the_machine_writes_selections_only() -> None:
    async with on_stage() as stage:
        await stage.device.identify()
        await stage.device.state()
        await stage.device.table_limits("C1")
        await stage.device.marker()
        image = stage.plc.image.words
        assert image[16] == 11
        assert image[15] == 0
        assert stage.plc.session == 0
        assert stage.plc.memory.marker_state == 0


@pytest.mark.parametrize("sign", [1, -1])
async def test_a_cross_table_carries_the_proven_sign(sign: int) -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, cross(), sign=sign)
        _, new = await stage.push(order)
        assert new.cross[0].table == order.table
        assert round(stage.get("$AN_CEC[0,9]") * 1e6) == sign * 4000
        assert stage.get("$SN_CEC_TABLE_ENABLE[0]") is True
        assert stage.get("$MA_CEC_ENABLE[X1]") is True
        live = await stage.device.saved_tables("X1")
        assert live.cross[0].enabled
        assert live.cross[0].table.deviations[9] == pytest.approx(4.0 * sign)


async def test_a_cross_table_without_proof_is_refused_with_nothing_written() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, cross())
        with pytest.raises(TableError) as caught:
            await stage.device.stage((replace(order, proof=None),))
        assert caught.value.code == "E-TABLE-NO-PROOF"
        assert stage.plc.image.words[16] == 11


async def test_the_old_table_can_be_put_back_from_its_back_up() -> None:
    async with on_stage() as stage:
        first = await order_for(stage.device, table())
        await stage.push(first)
        second = await order_for(stage.device, table(41), 18)
        old, _ = await stage.push(second)
        assert old.own.enabled
        assert old.own.table == first.table
        back = replace(second, transaction=19, table=old.own.table, purpose="restore", proof=None)
        await stage.push(back)
        assert (await stage.device.saved_tables("X1")).own.table == first.table


async def test_an_order_that_shall_stay_off_stays_off() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table(), enable=False)
        await stage.push(order)
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert not stage.plc.waiting


async def test_other_cross_tables_are_neither_woken_nor_silenced_unseen() -> None:
    async with on_stage() as stage:
        await stage.push(await order_for(stage.device, cross(0)))
        second = await order_for(stage.device, cross(1), 18)
        with pytest.raises(DeviceRefused) as caught:
            await stage.device.stage((second,))
        assert caught.value.code == "E-MBX-COUPLED"
        off = replace(second, coupled=True, enable=False, purpose="restore")
        await stage.push(off)
        assert stage.get("$SN_CEC_TABLE_ENABLE[0]") is True
        assert stage.get("$SN_CEC_TABLE_ENABLE[1]") is False
        assert stage.get("$MA_CEC_ENABLE[X1]") is True
        await stage.push(replace(second, coupled=True, transaction=20))
        assert stage.get("$SN_CEC_TABLE_ENABLE[1]") is True


async def test_a_table_is_switched_off_and_on_by_itself_with_the_panel() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        await stage.push(order)
        for _ in range(2):
            await stage.device.switch(order, False, 30.0)
            assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
            await stage.pressed(stage.device.switch(order, True, 30.0))
            assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]") is True
        await stage.device.switch(order, False, 30.0)
        with pytest.raises(DeviceRefused) as caught:
            await stage.device.switch(order, True, 90.0)  # nobody presses
        assert caught.value.code == "E-MBX-TIME"
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        await stage.device.finish_push((order,), "held")
        assert await stage.device.marker() == Marker(17, "held")


async def test_activation_waits_for_reset_and_reference_where_the_control_needs_them() -> None:
    async with on_stage(spec={"strict_activation": True}, driver={"needs_reference": True}) as stage:
        order = await order_for(stage.device, replace(table(), deviations=tuple([0.8] * 111)))
        await stage.device.stage((order,))
        await stage.device.read_back((order,), 100.0)
        await stage.device.activate((order,), (order,))
        assert await stage.pressed(stage.device.confirm((order,), 100.0)) == (True,)
        with pytest.raises(DeadlineExceeded) as caught:
            await stage.device.restarted((order,), 20.0)
        assert caught.value.code == "E-NC-NO-ACTIVATION"
        waiting = asyncio.ensure_future(stage.device.restarted((order,), 600.0))
        await stage.bench.reset_and_reference()
        await waiting
        assert (await stage.device.state()).axes["X1"].encoder_compensation == pytest.approx(0.8)
        await stage.device.finish_push((order,), "committed")


# ---- refusals before anything is written ---------------------------------------------------------------------


async def refused(stage: Stage, order: Any, code: str, kind: type[TrueflankError] = DeviceRefused) -> None:
    """Prepared, it is refused with this code; no session, marker, switch or value has changed then."""
    values, on = stage.values(111), stage.get("$MA_ENC_COMP_ENABLE[0,X1]")
    with pytest.raises(kind) as caught:
        await stage.device.stage((order,))
    assert caught.value.code == code
    assert str(caught.value).count("->") == 1
    assert stage.plc.session == 0
    assert stage.plc.memory.marker_state == 0
    assert (stage.values(111), stage.get("$MA_ENC_COMP_ENABLE[0,X1]")) == (values, on)


async def test_a_machine_that_is_not_released_is_not_written() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        stage.plc.on_session = lambda: None
        await refused(stage, order, "E-MBX-NO-RELEASE")
        stage.plc.release.give()
        await refused(stage, order, "E-MBX-RELEASE-STALE")


async def test_an_alarm_is_told_by_its_number() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        stage.bench.nck.core.alarms.raise_(20124, "test")
        await refused(stage, order, "E-MBX-ALARM")
        assert (await stage.device.state()).alarms == (20124,)


async def test_a_running_program_is_not_disturbed() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        stage.bench.press_start("G4 F600\nM30")
        await stage.bench.sleep(1.0)
        await refused(stage, order, "E-MBX-NOT-IN-RESET")
        assert (await stage.device.state()).channel is ChannelStatus.ACTIVE
        stage.bench.nck.channel_reset()


async def test_too_many_points_are_refused() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table(121))
        await refused(stage, order, "E-TABLE-POINTS", TooManyPoints)


@pytest.mark.parametrize("step", [5.00005, 10.0 / 3.0])
async def test_a_step_that_cannot_be_said_is_refused(step: float) -> None:
    async with on_stage() as stage:
        wanted = replace(table(), step=step, minimum=0.0, maximum=step * 110)
        await refused(stage, await order_for(stage.device, wanted), "E-MBX-FRACTION", ValueOutOfRange)


async def test_a_live_table_that_could_not_be_put_back_is_refused_before_anything_is_disabled() -> None:
    async with on_stage() as stage:
        nck = stage.bench.nck
        for part, value in (("STEP", 30.00004), ("MIN", -50.0), ("MAX", 60.0)):  # no whole number of 0.1 um
            nck.set(f"$AA_ENC_COMP_{part}[0,X1]", value, 2)
        for point in range(4):
            nck.set(f"$AA_ENC_COMP[0,{point},X1]", 0.0005, 2)
        nck.set("$MA_ENC_COMP_ENABLE[0,X1]", True, 2)
        order = await order_for(stage.device, table())
        await refused(stage, order, "E-MBX-GRID")
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]")
        assert stage.values(4) == [0.0005] * 4
        assert stage.plc.session == 0


async def test_an_axis_that_stands_where_the_table_would_move_it_is_refused() -> None:
    async with on_stage() as stage:
        wanted = replace(table(), deviations=tuple([5.0] * 111))
        await refused(stage, await order_for(stage.device, wanted), "E-MBX-PLACE")


async def test_a_table_that_stands_finer_in_the_control_than_the_mailbox_can_say_is_not_touched() -> None:
    async with on_stage() as stage:
        nck = stage.bench.nck
        for name, value in (("MIN", 0.0), ("STEP", 0.00005), ("MAX", 0.0005)):
            nck.set(f"$AA_ENC_COMP_{name}[0,X1]", value, 0)
        await refused(stage, await order_for(stage.device, table()), "E-MBX-GRID")


@pytest.mark.parametrize(
    ("plc", "code"),
    [
        ({"swap_words": True}, "E-MBX-WORD-ORDER"),
        ({"map_version": 2}, "E-MBX-OLD-MAP"),
        ({"map_version": 4}, "E-MBX-VERSION"),
    ],
)
async def test_another_map_is_refused_at_once(plc: dict[str, Any], code: str) -> None:
    async with on_stage(opened=False, **plc) as stage:
        with pytest.raises(UnsupportedDevice) as caught:
            await stage.device.open(5.0)
        assert caught.value.code == code
        assert stage.plc._taken == 0


async def test_a_heartbeat_that_stands_still_is_refused() -> None:
    async with on_stage(stale_heartbeat=True) as stage:
        await refused(stage, await order_for(stage.device, table()), "E-MBX-STALLED")


# ---- a push that meets trouble on its way --------------------------------------------------------------------


async def troubled(stage: Stage, order: Any = None) -> TrueflankError:
    """The error of a push; whatever it was, nothing but the old or the new table is enabled."""
    order = order or await order_for(stage.device, table())
    with pytest.raises(TrueflankError) as caught:
        await stage.push(order)
    if stage.get("$MA_ENC_COMP_ENABLE[0,X1]"):
        held = [round(value * 1e6) for value in stage.values(120)]
        assert held in (nm(order.table.deviations) + [0] * 9, [0] * 120)
    return caught.value


@pytest.mark.parametrize(
    ("plc", "codes"),
    [
        ({"wrong_read_back_crc": True}, {"E-MBX-READ-CRC"}),
        ({"swap_data_words": True}, {"E-MBX-CRC", "E-MBX-READBACK", "E-MBX-VALUE"}),
        ({"quantum_points": 100}, {"E-MBX-MISMATCH", "E-MBX-READBACK"}),
        ({"quantum_points": 100, "careless": True}, {"E-MBX-READBACK"}),
        ({"lose_points": 3}, {"E-MBX-MISMATCH", "E-MBX-READBACK"}),
        ({"lose_points": 3, "careless": True}, {"E-MBX-READBACK"}),
        ({"late_command": 2}, {"E-LINK-DEADLINE"}),
        ({"late_command": 4}, {"E-LINK-DEADLINE"}),
        ({"late_command": 5}, {"E-LINK-DEADLINE"}),
        ({"busy_forever": 2}, {"E-MBX-NO-ANSWER"}),
        ({"busy_forever": 4}, {"E-MBX-NO-ANSWER", "E-MBX-SESSION"}),
        ({"busy_forever": 7}, {"E-MBX-NO-ANSWER"}),
        ({"key_back": True}, {"E-MBX-NOT-RELEASED"}),
        ({"alarm_during": 3}, {"E-MBX-ALARM"}),
        ({"alarm_during": 5}, {"E-MBX-NOT-IN-RESET"}),
        ({"nck_refuses": 4}, {"E-MBX-NCK"}),
        ({"nck_refuses": 6}, {"E-MBX-NCK"}),
        ({"nck_refuses": 5}, {"E-MBX-NCK"}),
        ({"overwrites": ((38, 77),)}, {"E-MBX-CRC"}),
        *(({"second_master": place}, {"E-MBX-FOREIGN"}) for place in (20, 22, 28, 37)),
    ],
)
async def test_a_hostile_plc_never_gets_a_wrong_table_to_work(plc: dict[str, Any], codes: set[str]) -> None:
    async with on_stage(**plc) as stage:
        error = await troubled(stage, await order_for(stage.device, table()))
        assert error.code in codes, error
        assert str(error).count("->") == 1


async def test_values_that_a_plc_keeps_as_32_bit_floats_are_still_whole_nanometres() -> None:
    async with on_stage(float32_values=True) as stage:
        order = await order_for(stage.device, table())
        _, new = await stage.push(order)
        assert new.own.table == order.table
        assert stage.values(111) != [value / 1000.0 for value in order.table.deviations]


async def test_a_plc_that_spoils_registers_is_found_out_at_once() -> None:
    async with on_stage(opened=False, overwrites=((26, 77),)) as stage:
        with pytest.raises(RemoteProtocolError) as caught:
            await stage.device.open(5.0)
        assert caught.value.code == "E-MBX-CRC"


async def test_a_plc_that_lies_about_disable_is_found_out_by_what_acts() -> None:
    async with on_stage() as stage:
        first = await order_for(stage.device, replace(table(), deviations=tuple([0.9] * 111)))
        await stage.push(first)
        stage.plc.change(lies_about_disable=True)
        before = stage.values(120)
        second = await order_for(stage.device, table(), 18)
        await stage.device.stage((second,))
        with pytest.raises(DeviceRefused) as caught:
            await stage.device.read_back((second,), 200.0)
        assert caught.value.code == "E-MBX-STILL-ACTING"
        assert stage.values(120) == before


async def test_nobody_at_the_panel_leaves_it_off_and_says_so() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        await stage.device.stage((order,))
        await stage.device.read_back((order,), 100.0)
        await stage.device.activate((order,), (order,))
        assert await stage.device.confirm((order,), 200.0) == (False,)
        assert stage.get("$MA_ENC_COMP_ENABLE[0,X1]") is False
        assert await stage.device.marker() == Marker(17, "in-progress")
        await stage.device.activate((order,), (order,))
        assert await stage.device.confirm((order,), 5.0) == (False,)
        assert not stage.plc.waiting
        await stage.device.finish_push((order,), "held")


async def test_looking_while_the_panel_is_waited_for_disturbs_nothing() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        await stage.device.stage((order,))
        await stage.device.read_back((order,), 100.0)
        await stage.device.activate((order,), (order,))
        assert stage.plc.waiting
        state = await stage.device.state()
        assert set(state.axes) == {"X1", "C1"}
        assert stage.plc.waiting
        waiting = asyncio.ensure_future(stage.device.confirm((order,), 100.0))
        for _ in range(10):
            await stage.device.state()
            await stage.bench.sleep(0.5)
        assert stage.plc.waiting
        stage.plc.confirm()
        assert await waiting
        await stage.device.finish_push((order,), "committed")


async def test_a_lost_pc_leaves_the_table_off_and_the_marker_in_progress() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        await stage.push(order)
        second = replace(order, transaction=18, table=table(41))
        await stage.device.stage((second,))
        task = asyncio.ensure_future(stage.device.read_back((second,), 100.0))
        await stage.bench.sleep(0.25)
        await stage.station.pull()
        with pytest.raises(TransportError):
            await task
        with pytest.raises(LinkBroken):
            await stage.device.state()
        await stage.station.plug("memory://plc")
        again = stage.other()
        await again.open(5.0)
        assert await again.marker() == Marker(18, "in-progress")
        live = await again.saved_tables("X1")  # waits until the lost session has lapsed
        assert not live.own.enabled
        assert stage.plc.session == 0
        await again.close()


async def test_a_second_pc_is_told_that_the_mailbox_is_taken() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        await stage.device.stage((order,))
        other = stage.other()
        await other.open(5.0)
        with pytest.raises(DeviceRefused) as caught:
            await other.saved_tables("X1")
        assert caught.value.code == "E-MBX-TAKEN"
        await other.close()


async def test_a_reopened_driver_goes_on_in_its_session() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        await stage.device.stage((order,))
        session = stage.plc.session
        await stage.station.pull()
        with pytest.raises(TransportError):
            await stage.device.read_back((order,), 100.0)
        await stage.station.plug("memory://plc")
        await stage.device.open(5.0)
        assert stage.plc.session == session
        await stage.bench.sleep(10.0)
        assert stage.plc.session == session, "the heartbeat did not go on"
        _, new = sets_of(await stage.device.read_back((order,), 100.0))
        assert new.own.table == order.table
        await stage.device.finish_push((order,), "none")
        assert await stage.device.marker() == Marker(0, "none")


@pytest.mark.parametrize("after", few([30, 1, 119]))
async def test_a_power_cut_while_loading_leaves_the_table_off(after: int) -> None:
    async with on_stage() as stage:
        first = await order_for(stage.device, table())
        await stage.push(first)
        stage.plc.change(power_cut_after=after)
        second = replace(first, transaction=18, table=table(101))
        await stage.device.stage((second,))
        with pytest.raises(TrueflankError):
            await stage.device.read_back((second,), 100.0)
        while not stage.plc.powered or stage.bench.nck.booting:
            await stage.bench.sleep(0.5)
        await stage.bench.warm_up()
        await stage.device.open(5.0)
        live = await stage.device.saved_tables("X1")
        assert not live.own.enabled
        assert await stage.device.marker() == Marker(18, "in-progress")
        with pytest.raises(DeviceRefused) as caught:
            await stage.device.switch(second, True, 100.0)
        assert caught.value.code == "E-MBX-MISMATCH"
        back = replace(first, transaction=19, purpose="restore", proof=None)
        await stage.push(back)
        assert (await stage.device.saved_tables("X1")).own.table == first.table


async def test_a_repeated_number_is_never_sent() -> None:
    async with on_stage(redo_repeats=True) as stage:
        order = await order_for(stage.device, table())
        await stage.push(order)


@pytest.mark.parametrize("place", few(sorted(range(3, 240, 13), key=lambda place: place % 4), 5))
async def test_a_connection_cut_at_any_request_leaves_old_or_new(place: int) -> None:
    async with on_stage() as stage:
        first = await order_for(stage.device, table())
        await stage.push(first)
        second = replace(first, transaction=18, table=table(101))
        cut = stage.station.served + place
        seen = stage.station._reply

        def reply(frame: Any) -> Any:
            answer = seen(frame)
            if stage.station.served == cut:
                raise TransportError("E-LINK-CLOSED", "test", why="cut")
            return answer

        stage.station._reply = reply  # type: ignore[method-assign]
        try:
            await stage.push(second)
        except TrueflankError:
            await stage.bench.sleep(1.0)
            await stage.device.open(5.0)
        live = await stage.device.saved_tables("X1")
        held = [live.own.table.deviations[: len(one.table.deviations)] for one in (first, second)]
        if live.own.enabled:
            assert live.own.table in (first.table, second.table), held


async def test_registers_are_read_and_written_within_the_limits_of_the_document() -> None:
    async with on_stage() as stage:
        lengths: list[tuple[int, int]] = []
        seen = stage.station._reply

        def reply(frame: Any) -> Any:
            lengths.append(struct.unpack(">BHH", frame.pdu[:5])[0::2])
            return seen(frame)

        stage.station._reply = reply  # type: ignore[method-assign]
        await stage.push(await order_for(stage.device, table()))
        assert {function for function, _ in lengths} <= {3, 6, 16}
        assert max(count for function, count in lengths if function == 3) <= 125
        assert max(count for function, count in lengths if function == 16) <= 123


async def test_one_who_sends_nonsense_from_the_other_side_is_a_protocol_error() -> None:
    async with on_stage() as stage:
        stage.plc.memory.marker = tuple([0x4142] * 8)
        with pytest.raises(RemoteProtocolError) as caught:
            await stage.device.marker()
        assert caught.value.code == "E-MBX-REGISTER"


async def test_a_table_is_switched_where_it_moves_the_axis() -> None:
    async with on_stage() as stage:
        order = await order_for(stage.device, table())
        await stage.push(order)
        nck = stage.bench.nck
        peak = int(np.argmax(np.abs(order.table.deviations)))
        await stage.bench.run(f"G0 X{order.table.positions[peak]}\nM30")
        expected = order.table.deviations[peak]
        assert abs(expected) > 5.0
        assert nck.channel_status == 0
        for _ in range(3):
            await stage.device.switch(order, False, 30.0)
            assert (await stage.device.state()).axes["X1"].encoder_compensation == 0.0
            await stage.pressed(stage.device.switch(order, True, 30.0))
            axis = (await stage.device.state()).axes["X1"]
            assert axis.encoder_compensation == pytest.approx(expected, abs=0.05)
            assert axis.in_position
        await stage.device.finish_push((order,), "committed")
