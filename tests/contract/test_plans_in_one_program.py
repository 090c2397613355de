"""Stop plans that follow one another: one press for those that need no person, one for each mounting."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.errors import DeviceRefused
from drivers.programs import reading_plan
from drivers.sinumerik.ncprogram.words import Word
from drivers.types.orders import TableQuestion
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.values import Approach
from gateway.moves import Patience, walk_plan
from tests.contract.opcua_stage import SPEC, Stage, on_stage, plan
from tests.contract.test_safe_places import PLACES, Told

PATIENCE = Patience(60.0, 60.0)
JOG = plan((Stop(0.0, 1), Stop(10.0, 1, 0, 1)), setup="TRUEFLANK SETUP ECC ON C", save_tables=True)
ROUND: tuple[tuple[float, Approach], ...] = ((0.0, 1), (90.0, 1), (90.0, -1))
ALL = plan(tuple(Stop(place, way, turn, 0) for turn in range(2) for place, way in ROUND))
OF_X = replace(JOG, name="TX", axis="X1", letter="X", unit="mm", rotary=False, setup="TRUEFLANK SETUP EXX ON X")
TWICE = (JOG, replace(ALL, save_tables=True), OF_X)


async def visited(on: Stage, one: StopPlan, told: Told) -> list[tuple[float, float]]:
    """Where the axis stood at each stop by the control itself, beside where the plan wanted it; press if asked to."""
    seen: list[tuple[float, float]] = []

    async def at_stop(_index: int, stop: Stop, reached: StopReached) -> None:
        assert reached.target == stop.target
        seen.append((stop.target, float(on.nck.get(f"$AA_IM[{one.axis}]"))))

    def say(code: str, /, **fields: object) -> None:
        told(code, **fields)
        if code in ("P-START", "P-START-SETUP"):
            on.pressed.append("start")
            on.press()

    await walk_plan(on.device, one, at_stop, PATIENCE, say)
    return seen


async def test_one_start_and_one_press_for_each_mounting(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told = Told()
        on.device.keep_to(PLACES)
        await on.device.foresee(TWICE)
        for one in TWICE:
            for wanted, stood in await visited(on, one, told):
                assert stood == pytest.approx(wanted, abs=1e-6)
            assert (await on.device.saved_tables(one.axis)).axis == one.axis
        assert on.pressed == ["start", "setup", "setup"]
        assert on.nck.channel_status == 0
    asked = [code for code, _ in told if code in ("P-START", "P-START-SETUP", "P-MOUNT")]
    assert asked == ["P-START-SETUP", "P-MOUNT"]
    goes = [fields["axis"] for code, fields in told if code in ("P-MOVE-BETWEEN", "P-MOVE-TURNS", "P-MOVE-TO")]
    assert goes == ["C1", "X1"]  # the first text names both of what C does, the next one what X does


async def test_the_control_shows_what_the_text_asks_to_mount(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told, shown = Told(), []
        start = on.nck.nc_start

        def pressed() -> bool:
            shown.append(on.nck.message)
            return bool(start())

        on.nck.nc_start = pressed  # type: ignore[method-assign]
        await on.device.foresee(TWICE)
        for one in TWICE:
            await visited(on, one, told)
    assert shown == ["", *(fields["setup"] for code, fields in told if code in ("P-START-SETUP", "P-MOUNT"))]


async def test_tables_are_read_at_the_end_of_the_program_that_measured_without_another_start(keys: Path) -> None:
    """As they stand then: what was written while the program visited its stops is in what it reads."""
    async with on_stage(SPEC, folder=keys) as on:
        told = Told()
        asked = [TableQuestion("X1", "X", "mm", rotary=False), TableQuestion("C1", "C", "deg", rotary=True)]
        reads = [reading_plan(one) for one in asked]
        await on.device.foresee((*TWICE[:2], *reads))
        for one in TWICE[:2]:
            await visited(on, one, told)
        assert on.nck.channel_status == 1
        for name in ("X1", "C1"):
            on.nck.set(f"$AA_ENC_COMP_STEP[0,{name}]", 45.0, 0)
        found = await on.device.live_tables_of(asked, told)
        assert [live.axis for live in found] == ["X1", "C1"]
        assert [live.own.table.step for live in found] == [45.0, 45.0]
        assert on.pressed == ["start", "setup"]
        assert "P-NC-READ" not in [code for code, _ in told]
        assert on.nck.channel_status == 0


async def test_a_program_that_was_ended_is_no_reading(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told, asked = Told(), [TableQuestion("C1", "C", "deg", rotary=True)]
        await on.device.foresee((*TWICE[:2], reading_plan(asked[0])))
        for one in TWICE[:2]:
            await visited(on, one, told)
        on.nck.channel_reset()
        answer = await on.asked(on.device.live_tables_of(asked, told), told)
        assert [live.axis for live in answer] == ["C1"]
        assert told[-1] == ("P-NC-READ", {"axis": "C1"})


async def test_another_program_ends_the_one_that_waits_for_its_next_plan(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told, again = Told(), replace(ALL, name="AGAIN", stops=(Stop(90.0, -1),))
        await on.device.foresee(TWICE)
        for one in (JOG, again, *TWICE[1:]):
            await visited(on, one, told)
        assert on.pressed == ["start", "setup", "start", "start", "setup"]


async def test_a_program_that_waits_ends_when_nothing_follows_and_a_reset_at_the_panel_is_borne(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told = Told()
        await on.device.foresee(TWICE)
        await visited(on, JOG, told)
        assert on.nck.channel_status == 1
        await on.device.foresee(())
        assert on.nck.channel_status == 0
        await on.device.foresee(TWICE)
        await visited(on, JOG, told)
        on.nck.channel_reset()
        await visited(on, ALL, told)
        assert on.pressed == ["start", "setup", "start", "setup", "start"]


async def test_a_program_goes_on_where_what_it_waits_for_is_foreseen_once_more(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told = Told()
        await on.device.foresee(TWICE)
        await visited(on, JOG, told)
        await on.device.foresee((*TWICE[1:], ALL))
        for one in TWICE[1:]:
            await visited(on, one, told)
        assert on.pressed == ["start", "setup", "setup"]


async def test_an_axis_that_left_its_place_while_something_was_mounted_ends_the_program(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told = Told()
        on.device.keep_to(PLACES)
        await on.device.foresee((JOG, OF_X))
        await visited(on, JOG, told)
        await on.clock.sleep(float(on.nck.core.move({on.nck.core.axis("Z1").index: 500.0}, None)) + 0.5)
        with pytest.raises(DeviceRefused, match="E-NC-AWAY"):
            await visited(on, OF_X, told)


ENDS: tuple[tuple[float, Approach], ...] = ((10.0, 1), (200.0, 1), (200.0, -1), (10.0, -1))
OPEN = replace(OF_X, setup="", further=True, stops=tuple(Stop(at, way) for at, way in ENDS), overrun=2.0)
MORE = replace(OPEN, name="TFMOREX", further=False, stops=(Stop(55.5, 1, 3, 2), Stop(150.0, -1, 1, 4)))
TURNED = replace(ALL, further=True)
ROUNDS = replace(TURNED, name="TFAGAINC", stops=(Stop(0.0, -1, 1, 7), Stop(360.0, 1), Stop(90.0, -1)))


async def test_further_stops_of_a_plan_need_no_press(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        told = Told()
        on.device.keep_to(PLACES)
        await on.device.foresee((JOG, TURNED, OF_X, OPEN))
        for one in (JOG, TURNED, ROUNDS, ROUNDS, OF_X, OPEN, MORE, replace(MORE, stops=MORE.stops[:1])):
            for wanted, stood in await visited(on, one, told):
                assert (stood - wanted) % 360.0 == pytest.approx(0.0, abs=1e-6)
            assert (await on.device.saved_tables(one.axis)).axis == one.axis
        assert on.pressed == ["start", "setup", "setup"]
        assert on.nck.channel_status == 1
        await on.device.foresee(())
        assert on.nck.channel_status == 0
    assert [fields["axis"] for code, fields in told if code == "P-MOVE-FURTHER"] == ["C1", "X1"]


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(replace(MORE, stops=(Stop(210.0, 1),)), id="beyond the ends"),
        pytest.param(replace(MORE, feed=OPEN.feed + 1.0), id="faster"),
        pytest.param(replace(MORE, stops=(Stop(20.0, 1, switch=True),)), id="switched"),
        pytest.param(replace(MORE, setup=OF_X.setup), id="mounted anew"),
        pytest.param(ROUNDS, id="another axis"),
    ],
)
async def test_what_was_not_said_before_is_a_program_of_its_own(keys: Path, other: StopPlan) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        await on.device.foresee((OPEN,))
        await visited(on, OPEN, Told())
        await visited(on, other, Told())
        assert on.pressed[:2] == ["start", "start"]


async def test_a_word_beyond_the_ends_moves_nothing(keys: Path) -> None:
    """The program judges what it is sent by itself: whoever writes into its words leads the axis nowhere else."""
    async with on_stage(SPEC, folder=keys) as on:
        await on.device.foresee((OPEN,))
        await visited(on, OPEN, Told())
        stood = on.nck.get("$AA_IM[X1]")
        first = on.device._settings.r_first
        for word, value in ((Word.LEAD, 20.0), (Word.NEXT, 900.0), (Word.SIDE, 1.0)):
            on.nck.set(f"R[{first + word}]", value, 0)
        on.nck.set(f"R[{first + Word.ECHO}]", float(len(OPEN.stops)), 0)
        await on.clock.sleep(30.0)
        assert on.nck.channel_status == 0
        assert on.nck.get("$AA_IM[X1]") == stood


async def test_an_axis_that_left_its_place_stops_further_stops(keys: Path) -> None:
    async with on_stage(SPEC, folder=keys) as on:
        on.device.keep_to(PLACES)
        await on.device.foresee((OPEN,))
        await visited(on, OPEN, Told())
        await on.clock.sleep(float(on.nck.core.move({on.nck.core.axis("Z1").index: 500.0}, None)) + 0.5)
        with pytest.raises(DeviceRefused, match="E-NC-AWAY"):
            await visited(on, MORE, Told())
