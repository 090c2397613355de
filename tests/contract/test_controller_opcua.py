"""The 840D driver on its wire: measuring by hand-shake, the two-half push, and every way it may go wrong."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DeadlineExceeded, DeviceRefused, LinkBroken, TableError, TransportError, TrueflankError
from drivers.ports.controller import Controller
from drivers.sinumerik.ncprogram.words import COUNT
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.pushing import FRESH_S
from drivers.types.machine import ChannelStatus
from drivers.types.orders import TableQuestion
from drivers.types.stops import Stop, StopReached
from drivers.types.tables import CompensationTable
from drivers.units import wrap_deg
from drivers.workpiece import GrindAxis, GrindPlan
from tests.contract.opcua_stage import ORDER, SPEC, TABLE_C, Stage, on_stage, plan
from tests.sizes import few

PART = GrindPlan(
    name="TFGRIND_C1",
    part="THREE LOBES",
    infeed=GrindAxis("X1", "X", (-250.0, 250.0)),
    stroke=GrindAxis("Z1", "Z", (0.0, 600.0)),
    index=GrindAxis("C1", "C"),
    dresser=None,
    spaces=3,
    centre_distance_mm=160.0,
    height_mm=150.0,
    face_mm=10.0,
    root_mm=59.7,
    tip_mm=62.3,
    stock_mm=0.25,
    x_mm=0.012345,
    c_deg=-0.0125,
    dressing_mm=0.004,
    wheel_offset=200,
)
STOPS = tuple(
    Stop(target, approach, repetition, label)
    for repetition in range(2)
    for approach, order in ((1, (0.0, 180.0, 360.0)), (-1, (360.0, 180.0, 0.0)))
    for label, target in enumerate(order)
)


async def refused(work: object, code: str) -> TrueflankError:
    with pytest.raises(TrueflankError) as caught:
        await work  # type: ignore[misc]
    assert caught.value.code == code, caught.value
    assert "<" not in caught.value.what.replace("<>", "")
    assert caught.value.hint
    return caught.value


# ---- measuring --------------------------------------------------------------------------------------


async def test_stops_come_once_in_order_and_each_from_its_own_side(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        assert isinstance(on.device, Controller)
        directions = []

        async def at_stop(stop: StopReached) -> None:
            now = on.clock.now()
            position, direction = on.nck.encoder("C1", np.array([now]))
            assert wrap_deg(position[0] - stop.target) == pytest.approx(0.0, abs=1e-4)
            directions.append(int(direction[0]))
            await on.clock.sleep(3.0)
            assert on.nck.encoder("C1", np.array([on.clock.now()]))[0][0] == pytest.approx(position[0], abs=1e-6)

        seen = await on.walk(plan(STOPS, setup="TRUEFLANK SETUP ECC ON C"), at_stop)
        assert [stop.counter for stop in seen] == list(range(1, 13))
        assert [(stop.target, stop.approach, stop.repetition, stop.label) for stop in seen] == [
            (stop.target, stop.approach, stop.repetition, stop.label) for stop in STOPS
        ]
        assert directions == [stop.approach for stop in STOPS]
        assert on.pressed == ["setup"]
        live = await on.device.saved_tables("C1")
        assert (live.own.enabled, live.own.table.deviations, live.backlash) == (False, (0.0,), 0.0)
        assert await on.device.wait_stop(12, 1.0) is None


async def test_r_parameters_are_given_back_and_the_session_is_closed(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        for number in range(80, 80 + COUNT):
            on.nck.set(f"R[{number}]", number + 0.5, 7)
        await on.walk(plan(STOPS[:2]))
        assert on.nck.get("R[80]") == 2.0
        assert on.server.sessions == 1
        await on.device.close()
        await on.device.close()
        assert [on.nck.get(f"R[{number}]") for number in range(80, 80 + COUNT)] == [
            number + 0.5 for number in range(80, 80 + COUNT)
        ]
        assert on.server.sessions == 0
        await refused(on.device.state(), "E-UA-BROKEN")


async def test_closing_in_the_middle_lets_the_program_leave_first(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.set("R[80]", 7.0, 7)
        await on.device.prepare_stops(plan(STOPS))
        on.press()
        assert await on.device.wait_stop(0, 60.0) is not None
        await on.device.close()
        assert on.nck.channel_status == 0
        assert on.nck.get("R[80]") == 7.0


async def test_an_older_programs_words_are_never_taken_for_a_stop(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.walk(plan(STOPS[:3]))
        await on.device.prepare_stops(plan(STOPS[:1]))
        on.nck.set("R[80]", 3.0, 7)
        error = await refused(on.device.wait_stop(0, 5.0), "E-NC-NO-STOP")
        assert isinstance(error, DeadlineExceeded)
        assert (await on.device.state()).channel is ChannelStatus.RESET  # the session is still good
        await refused(on.device.saved_tables("C1"), "E-NC-NOT-SAVED")


async def test_abort_leaves_a_waiting_program_and_one_not_yet_started(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.prepare_stops(plan(STOPS))
        on.press()
        assert await on.device.wait_stop(0, 60.0) is not None
        await on.device.abort_program()
        assert await on.device.wait_stop(1, 60.0) is None
        assert on.nck.channel_status == 0
        before = on.nck.axis_state("C1").set_position
        await on.device.prepare_stops(plan(STOPS, setup="TRUEFLANK SETUP ECC ON C"))
        await on.device.abort_program()
        on.press()
        assert await on.device.wait_stop(0, 60.0) is None
        assert on.nck.axis_state("C1").set_position == before


async def test_another_gateways_program_is_not_aborted_and_its_words_stay(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.set("R[80]", 7.0, 7)
        await on.device.prepare_stops(plan(STOPS))
        for number, value in ((80, 4.0), (87, 555_555.0), (89, 3.0)):
            on.nck.set(f"R[{number}]", value, 7)
        error = await refused(on.device.abort_program(), "E-NC-ANOTHER")
        assert "555555" in str(error)
        await on.device.close()
        assert [on.nck.get(f"R[{number}]") for number in (80, 86, 87, 89)] == [4.0, 0.0, 555_555.0, 3.0]


async def test_a_program_left_alone_ends_by_itself(keys: Path) -> None:
    async with on_stage(folder=keys, settings={"wait_limit_s": 60.0}) as on:
        await on.device.prepare_stops(plan(STOPS))
        on.press()
        assert await on.device.wait_stop(0, 60.0) is not None
        await on.clock.sleep(70.0)
        assert on.nck.channel_status == 0


async def test_an_alarm_ends_the_wait_with_its_number(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        beyond = plan((Stop(900.0, 1),), axis="X1", letter="X", unit="mm", rotary=False)
        await on.device.prepare_stops(beyond)
        on.press()
        error = await refused(on.device.wait_stop(0, 60.0), "E-NC-ALARM")
        assert error.fields["number"] == on.nck.alarms[0].number
        await refused(on.device.prepare_stops(beyond), "E-NC-NOT-RESET")


async def test_a_part_is_counted_space_by_space_and_carries_the_tables_that_acted(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        for number in (77, 78, 79, 80, 200):
            on.nck.set(f"R[{number}]", 7.5, 7)
        missing = replace(PART, dresser=GrindAxis("Y1", "Y"))
        await refused(on.device.prepare_grinding(missing), "E-NC-AXIS")
        await refused(on.device.prepare_grinding(replace(PART, x_mm=0.3)), "E-GRIND-VALUE")
        assert on.nck.get("R[77]") == 7.5
        text = await on.device.prepare_grinding(PART)
        assert on.nck.files.read("/_N_MPF_DIR/_N_TFGRIND_C1_MPF").decode().split() == text.split()
        assert "0.012345" not in text  # it travels as R parameter
        assert [on.nck.get(f"R[{number}]") for number in (77, 78, 79, 200)] == [0.012345, -0.0125, 0.004, 0.004]
        await refused(on.device.saved_tables("X1"), "E-NC-NOT-SAVED")
        start = on.nck.axis_state("X1").set_position
        await refused(on.device.wait_ground(-1, 5.0), "E-GRIND-NO-START")
        assert on.nck.axis_state("X1").set_position == start
        on.press()
        seen = [0]
        assert await on.device.wait_ground(-1, 60.0) == 0
        while (done := await on.device.wait_ground(seen[-1], 60.0)) is not None:
            seen.append(done)
        assert seen == [0, 1, 2, 3]
        assert on.pressed == ["setup", "setup"]
        for axis in ("X1", "Z1", "C1"):
            assert (await on.device.saved_tables(axis)).axis == axis
        await refused(on.device.saved_tables("Y1"), "E-NC-NOT-SAVED")
        await on.device.close()
        assert [on.nck.get(f"R[{number}]") for number in (77, 78, 79, 80, 200)] == [7.5] * 5


async def test_set_up_values_that_somebody_changed_grind_nothing(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.prepare_grinding(PART)
        on.nck.set("R[78]", 0.06, 7)
        start = on.nck.axis_state("X1").set_position
        on.press()
        await refused(on.device.wait_ground(-1, 60.0), "E-GRIND-SETUP-REFUSED")
        assert on.nck.axis_state("X1").set_position == start
        assert on.nck.channel_status == 0
        held = on.nck.set

        def write(name: str, value: object, level: int) -> None:
            held(name, 1.0 if name == "R[79]" else value, level)

        on.nck.set = write  # a PLC that keeps an R parameter as it likes
        error = await refused(on.device.prepare_grinding(PART), "E-GRIND-NOT-HELD")
        assert error.fields["number"] == 79


async def test_a_reset_by_the_operator_ends_the_stops(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.prepare_stops(plan(STOPS))
        on.press()
        assert await on.device.wait_stop(0, 60.0) is not None
        on.nck.channel_reset()
        assert await on.device.wait_stop(1, 60.0) is None


async def test_nothing_is_sent_while_a_program_runs(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.prepare_stops(plan(STOPS))
        on.press()
        await on.clock.sleep(1.0)
        text = on.nck.files.read("/_N_MPF_DIR/_N_TFMEAS_C1_MPF")
        await refused(on.device.prepare_stops(plan(STOPS[:1])), "E-NC-NOT-RESET")
        await refused(on.device.stage((ORDER,)), "E-NC-NOT-RESET")
        assert on.nck.files.read("/_N_MPF_DIR/_N_TFMEAS_C1_MPF") == text


async def test_tables_limits_and_axes_that_do_not_exist(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        assert (await on.device.table_limits("C1")).reserved_points == 80
        assert (await on.device.table_limits("X1")).max_value == 0.2
        await refused(on.device.table_limits("Q1"), "E-NC-AXIS")
        identity = await on.device.identify()
        assert identity.axis_names == ("X1", "Z1", "C1")
        assert (identity.serial, identity.version) == (SPEC.serial, SPEC.nck_version)
        state = await on.device.state()
        assert (state.mode, state.access_level, state.axes["C1"].unit) == ("AUTO", 2, "deg")
        assert all(axis.referenced and axis.in_position for axis in state.axes.values())


# ---- pushing ----------------------------------------------------------------------------------------


async def test_a_push_loads_proves_enables_and_acts(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        backup, readback = await on.loaded(ORDER)
        assert not on.enabled
        assert backup.own.table.deviations == (0.0,)
        assert readback.own.table == TABLE_C_STORED
        assert not readback.own.enabled
        await on.device.activate((ORDER,), (ORDER,))
        assert await on.device.confirm((ORDER,), 60.0) == (True,)
        await on.device.restarted((ORDER,), 120.0)
        assert on.pressed == ["activate"]
        assert on.enabled
        seen = await on.walk(plan((Stop(17.5, 1), Stop(200.0, -1), Stop(355.0, 1))))
        for stop in seen:
            wanted = TABLE_C_STORED.at(np.array([stop.target]))[0]
            assert stop.encoder_compensation == pytest.approx(wanted, abs=1e-3)
        live = await on.device.saved_tables("C1")
        assert (live.own.table, live.own.enabled) == (TABLE_C_STORED, True)


TABLE_C_STORED = replace(TABLE_C, deviations=tuple(round(d / 3600.0, 6) * 3600.0 for d in TABLE_C.deviations))
TABLE_C_STORED = replace(TABLE_C_STORED, deviations=tuple(round(d, 9) for d in TABLE_C_STORED.deviations))


async def test_a_measured_back_up_and_that_of_the_push_have_one_digest(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.walk(plan(STOPS[:1]))
        measured = await on.device.saved_tables("C1")
        backup, _ = await on.loaded(ORDER)
        assert backup.digest == measured.digest


async def test_without_release_it_ends_disabled_after_its_limit(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.loaded(ORDER)
        assert await on.device.confirm((ORDER,), 700.0) == (False,)
        assert not on.enabled
        assert on.nck.channel_status == 0


@pytest.mark.parametrize("released", [False, True])
async def test_a_reset_between_the_halves_ends_disabled(keys: Path, released: bool) -> None:
    async with on_stage(folder=keys) as on:
        await on.loaded(ORDER)
        if released:
            await on.device.activate((ORDER,), (ORDER,))
        on.nck.channel_reset()
        assert await on.device.confirm((ORDER,), 60.0) == (False,)
        assert not on.enabled


@pytest.mark.parametrize("name", ["$AA_ENC_COMP[0,30,C1]", "$AA_ENC_COMP[0,79,C1]", "$AA_ENC_COMP_MAX[0,C1]"])
async def test_a_table_changed_between_the_halves_stays_disabled(keys: Path, name: str) -> None:
    async with on_stage(folder=keys) as on:
        await on.loaded(ORDER)
        on.nck.set(name, float(on.nck.get(name)) + 0.0001, 0)
        await on.device.activate((ORDER,), (ORDER,))
        assert await on.device.confirm((ORDER,), 60.0) == (False,)
        assert not on.enabled


@pytest.mark.parametrize("number", few([83 + 10, 94, 95, 87, 90], 2))
async def test_words_changed_between_the_halves_stay_disabled(keys: Path, number: int) -> None:
    async with on_stage(folder=keys) as on:
        await on.loaded(ORDER)
        on.nck.set(f"R[{number}]", float(on.nck.get(f"R[{number}]")) + 1.0, 7)
        await on.device.activate((ORDER,), (ORDER,))
        await on.clock.sleep(10.0)
        assert on.nck.channel_status == 0
        assert not on.enabled


async def test_a_control_that_stores_something_else_is_caught_by_the_program(
    keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with on_stage(folder=keys) as on:
        kept = on.nck.core.memory.kept
        calls = []

        def wrong(value: float) -> float:
            calls.append(value)
            return kept(value) + (2e-6 if len(calls) == 40 else 0.0)

        monkeypatch.setattr(type(on.nck.core.memory), "kept", staticmethod(wrong))
        error = await refused(on.loaded(ORDER), "E-NC-MISMATCH")
        assert error.fields["count"] == 1
        assert not on.enabled


async def test_single_precision_tables_pass_the_half_unit(keys: Path) -> None:
    async with on_stage(replace(SPEC, float32_tables=True), folder=keys) as on:
        assert await on.push(ORDER)


async def test_a_control_that_lies_about_the_switch_is_caught_before_a_point_is_written(keys: Path) -> None:
    async with on_stage(replace(SPEC, lies_about_disable=True), folder=keys) as on:
        assert await on.push(ORDER)
        before = on.memory()[:-1]
        place = 30.0
        assert abs(TABLE_C_STORED.at(np.array([place]))[0]) > 0.5
        await refused(on.loaded(replace(ORDER, transaction=4712, agreeing_position=place)), "E-NC-STOPPED")
        assert on.memory()[:-1] == before


async def test_without_the_right_level_nothing_changes(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        assert await on.push(ORDER)
        before = on.memory()
        on.nck.set_access_level(4)
        error = await refused(on.loaded(replace(ORDER, transaction=4712)), "E-NC-LEVEL")
        assert isinstance(error, DeviceRefused)
        assert on.memory() == before
        assert on.enabled


async def test_a_cross_table_that_may_not_be_switched_off_is_left_on_with_every_switch_of_it(keys: Path) -> None:
    """SD41300 may be written by anybody, MD32710 may not: "no table was changed" must be true of both."""
    async with on_stage(folder=keys) as on:
        names = ("$MA_CEC_ENABLE[C1]", "$SN_CEC_TABLE_ENABLE[1]")
        for name in reversed(names):
            on.nck.set(name, 1, 0)
        on.nck.core.newconf()
        on.nck.set_access_level(4)
        cross = CompensationTable(
            "cross", "Z1", "C1", 0.0, 20.0, 10.0, (0.0, 1.0, 0.0), index=1, output_unit="deg", input_unit="mm"
        )
        sent = replace(ORDER, transaction=4713, table=cross, letter="Z", rotary=False)
        order = replace(sent, purpose="sign-proof", coupled=True)
        error = await refused(on.loaded(order), "E-NC-LEVEL")
        assert "no table was changed" in error.hint
        assert [int(on.nck.get(name)) for name in names] == [1, 1]


async def test_a_table_that_does_not_fit_is_never_sent(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        long = CompensationTable("axis", "Z1", "Z1", 0.0, 100.0, 10.0, (0.0,) * 11)
        error = await refused(
            on.device.stage((replace(ORDER, table=long, letter="Z", rotary=False),)), "E-TABLE-POINTS"
        )
        assert isinstance(error, TableError)
        await refused(on.device.stage((replace(ORDER, purpose="table"),)), "E-TABLE-NO-PROOF")
        assert on.nck.files.list("/_N_MPF_DIR") == []
        assert on.nck.selected == ""


async def test_restoring_gives_back_every_value_as_it_was(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        for number, value in enumerate((0.0, 0.0012345678, -0.0000000123, 0.0)):
            on.nck.set(f"$AA_ENC_COMP[0,{number},C1]", value, 0)
        for name, value in (("STEP", 120.0), ("MIN", 0.0), ("MAX", 360.0), ("IS_MODULO", 1)):
            on.nck.set(f"$AA_ENC_COMP_{name}[0,C1]", value, 0)
        on.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 1, 0)
        before = on.memory()
        backup, _ = await on.loaded(ORDER)
        assert on.memory() != before
        on.nck.channel_reset()
        restore = replace(ORDER, transaction=99, table=backup.own.table, enable=backup.own.enabled, purpose="restore")
        assert await on.push(restore)
        assert on.memory() == before


@pytest.mark.parametrize("since", ["at once", "after a minute", "switched on", "another program"])
async def test_a_way_back_that_left_all_off_is_its_own_reading(keys: Path, since: str) -> None:
    """As a program that only reads would say; where it may not be so any more, that program is asked for."""
    async with on_stage(folder=keys) as on:
        told: list[str] = []

        def tell(code: str, /, **_fields: object) -> None:
            told.append(code)

        assert await on.push(replace(ORDER, transaction=99, enable=False, purpose="restore")) is False
        if since == "after a minute":
            await on.clock.sleep(FRESH_S + 1.0)
        elif since == "switched on":
            on.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 1, 0)
        elif since == "another program":
            await on.walk(plan(STOPS[:1]))
        asked = (TableQuestion("C1", "C", "deg", rotary=True),)
        (live,) = await on.asked(on.device.live_tables_of(asked, tell), told)
        assert told == ([] if since == "at once" else ["P-NC-READ"])
        assert live.own.table.deviations == pytest.approx(ORDER.table.deviations, abs=1e-6)
        assert live.own.enabled is (since == "switched on")
        await on.walk(plan(STOPS[:1]))
        assert (await on.device.saved_tables("C1")).digest == live.digest


@pytest.mark.parametrize("two", [False, True])
async def test_what_a_way_back_left_is_believed_once_where_no_program_compares_it(keys: Path, two: bool) -> None:
    """Somebody may change a table after it: one program compares before it writes, two programs read anew."""
    async with on_stage(folder=keys, settings={"two_programs": two}) as on:
        told: list[str] = []

        def tell(code: str, /, **_fields: object) -> None:
            told.append(code)

        order = replace(ORDER, transaction=99, enable=False, purpose="restore")
        await on.loaded(order)
        await on.device.activate((order,), (order,))
        if two:
            on.press()
        assert await on.device.confirm((order,), 120.0) == (False,)
        asked = (TableQuestion("C1", "C", "deg", rotary=True),)
        (first,) = await on.device.live_tables_of(asked, tell)
        assert told == []
        on.nck.set("$AA_ENC_COMP[0,1,C1]", 0.5, 0)
        (second,) = await on.asked(on.device.live_tables_of(asked, tell), told)
        assert told == (["P-NC-READ"] if two else [])
        assert (second.digest == first.digest) is not two
        if not two:
            await on.device.stage((ORDER,))
            on.press()
            (found,) = await on.device.saved_first((ORDER,), 120.0)
            assert found.own.table.deviations != first.own.table.deviations


@pytest.mark.parametrize("ended", ["aborted", "nobody's word", "another word", "reset", "NCK reset"])
async def test_a_program_that_stands_after_its_back_up_changes_nothing_without_the_word(keys: Path, ended: str) -> None:
    """Between back-up and first switching it waits: however that ends, tables and switches are as they were."""
    async with on_stage(folder=keys) as on:
        for number, value in enumerate((0.0, 0.001, 0.002, 0.0)):
            on.nck.set(f"$AA_ENC_COMP[0,{number},C1]", value, 0)
        on.nck.set("$MA_ENC_COMP_ENABLE[0,C1]", 1, 0)
        before = on.memory()
        await on.device.stage((ORDER,))
        on.press()
        await on.device.saved_first((ORDER,), 120.0)
        assert on.nck.message.startswith("TRUEFLANK SAVED")
        place = on.nck.axis_state("C1").set_position
        if ended == "aborted":
            await on.device.abort_program()
        elif ended == "another word":
            on.nck.set("R[89]", float(ORDER.transaction), 0)  # what releases tables lets nothing go on here
        elif ended == "reset":
            on.nck.channel_reset()
        elif ended == "NCK reset":
            await on.restart()
        await on.clock.sleep(700.0)
        assert on.nck.channel_status == 0
        assert on.memory() == before
        assert on.nck.axis_state("C1").set_position == place or ended == "NCK reset"
        await refused(on.device.read_back((ORDER,), 20.0), "E-NC-STOPPED")
        assert on.memory() == before


async def test_an_order_without_enabling_ends_loaded_and_off(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        assert await on.push(replace(ORDER, enable=False)) is False
        assert not on.enabled
        assert on.nck.get("$AA_ENC_COMP[0,1,C1]") != 0.0
        assert "activate" not in on.pressed


async def test_closing_between_the_halves_ends_disabled_after_its_limit(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.loaded(ORDER)
        await on.device.close()
        await on.clock.sleep(700.0)
        assert on.nck.channel_status == 0
        assert not on.enabled


async def test_two_programs_where_files_cannot_be_fetched_meanwhile(keys: Path) -> None:
    spec = replace(SPEC, fetch_while_waiting=False)

    async def one_program(on: Stage) -> None:
        await refused(on.loaded(ORDER), "E-UA-BUSY")
        on.nck.channel_reset()
        assert not on.enabled

    async def two_programs(on: Stage) -> None:
        _, readback = await on.loaded(ORDER)
        assert readback.own.table == TABLE_C_STORED
        assert on.nck.channel_status == 0
        await on.device.activate((ORDER,), (ORDER,))
        on.press()
        assert await on.device.confirm((ORDER,), 60.0) == (True,)
        await on.device.restarted((ORDER,), 120.0)
        assert on.enabled

    async with on_stage(spec, folder=keys) as on:
        await one_program(on)
    async with on_stage(spec, folder=keys, settings={"two_programs": True}) as on:
        await two_programs(on)


async def test_cross_tables_are_on_record_and_can_be_loaded(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        table = CompensationTable(
            "cross", "Z1", "C1", 0.0, 100.0, 50.0, (0.0, 7.2, 0.0), index=1, output_unit="deg", input_unit="mm"
        )
        order = replace(ORDER, table=table, letter="Z", rotary=False, enable=True)
        assert await on.push(order)
        await on.walk(plan(STOPS[:1]))
        (cross,) = (await on.device.saved_tables("C1")).cross
        assert cross.enabled
        assert cross.table == table


async def test_the_switch_at_a_stop_turns_a_table_off_and_on(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        assert await on.push(ORDER)
        stops = tuple(Stop(30.0, 1, 0, n, switch) for n, switch in enumerate((None, False, True)))
        seen = await on.walk(plan(stops))
        value = TABLE_C_STORED.at(np.array([30.0]))[0]
        assert [stop.encoder_compensation for stop in seen] == pytest.approx([value, 0.0, value], abs=1e-3)


# ---- broken wires -----------------------------------------------------------------------------------


async def test_a_dropped_connection_breaks_the_session_until_it_is_opened_again(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        await on.device.prepare_stops(plan(STOPS))
        on.press()
        assert await on.device.wait_stop(0, 60.0) is not None
        await on.server.drop_connections()
        with pytest.raises(TransportError):
            await on.device.release_stop(1)
        with pytest.raises(LinkBroken):
            await on.device.state()
        await on.device.open(5.0)
        await on.device.release_stop(1)
        second = await on.device.wait_stop(1, 60.0)
        assert second is not None
        assert second.counter == 2


async def test_a_cancelled_request_breaks_the_session(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        task = asyncio.get_running_loop().create_task(on.device.state())
        await on.clock.sleep(0)
        await on.clock.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await refused(on.device.state(), "E-UA-BROKEN")
        await on.device.open(5.0)
        assert (await on.device.state()).mode == "AUTO"


async def test_a_restart_of_the_nck_is_seen_as_such(keys: Path) -> None:
    async with on_stage(folder=keys) as on:
        on.nck.nck_reset()
        error = await refused(on.device.state(), "E-UA-NCK-DOWN")
        assert error.retryable
        await on.referenced()
        assert (await on.device.state()).axes["C1"].referenced


async def test_a_server_that_never_answers_is_left_at_the_deadline() -> None:
    async with on_stage() as on:
        held: list[asyncio.StreamWriter] = []

        async def silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            held.append(writer)
            await reader.read()

        server = await asyncio.start_server(silent, "127.0.0.1", 0)
        url = f"opc.tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        device = SinumerikOpcUa("840D", url, {"security": "None"}, on.clock)
        started = on.clock.now()
        await refused(device.open(2.0), "E-LINK-DEADLINE")
        assert on.clock.now() - started == pytest.approx(2.0, abs=0.1)
        for writer in held:
            writer.close()
            await writer.wait_closed()
        server.close()
        await server.wait_closed()
        await refused(device.open(2.0), "E-UA-CONNECT")
