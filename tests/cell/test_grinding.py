"""A test part ground through the cell's control: judged by the true flank; every way it may go wrong is told."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import DeadlineExceeded, DeviceRefused, TrueflankError
from gateway.config import OperatorTimes, SiteFile, load_site
from gateway.errors import WriteRefused
from gateway.say import silence
from gateway.store import Store
from gateway.tooth import GroundPart, SetupValues
from gateway.workflow.run.folder import store_of
from gateway.workflow.tooth.grinding import grind_site
from simulators.cell import Cell, cell_running
from simulators.cellfile import load_cell, with_plan
from tests.closing.judge import places
from tests.unit.simulators.planned_run import ground
from tests.unit.simulators.test_cell import load_table, settled

SPACES = np.arange(39.0)
Say = Callable[..., None]


def on_cell(folder: Path, story: Callable[[Cell, SiteFile, LoopClock], Awaitable[None]]) -> None:
    async def job() -> None:
        clock = LoopClock()
        async with cell_running(
            with_plan(load_cell("demo")), folder / "cell", clock, wires="memory", block_s=1.0
        ) as cell:
            await story(cell, load_site(cell.site_path), clock)

    run_virtual(job)


async def made(cell: Cell, site: SiteFile, clock: LoopClock, part: str, setup: SetupValues, say: Say = silence) -> Any:
    asked = {"part": part, "setup": setup, "machine_name": site.site.name}
    return await grind_site(site, cell.site_path, clock=clock, say=say, **asked)


def flank(cell: Cell) -> np.ndarray:
    work = cell.shop.ground
    assert work is not None
    assert work.finished
    return work.surplus_um(SPACES, work.lobes.even(8), np.linspace(-5.0, 5.0, 3))


def would_be(cell: Cell, began: float, setup: SetupValues, cross: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """What the truth grinds at the same seat with the EEC of Z and C, and `cross` (mm over C) acting on X."""

    def added(name: str, direction: int) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
        return lambda at: cell.nck.compensated_encoder(name, at[name[0]], direction) - at[name[0]]

    corrections = {"Z": added("Z1", 1), "C": added("C1", -1)}
    corrections["X"] = lambda at: -cell.nck.spec.cec_sign * cross(at["C"])
    places = {"x_mm": setup.x_um / 1e3, "c_deg": setup.c_arcsec / 3600.0, "dressing_mm": setup.dressing_um / 1e3}
    part, seat = cell.file.part, cell.shop.ground.seat
    work = ground(cell.truth, part, seat, corrections=corrections, start_s=began, **places)
    return work.surplus_um(SPACES, work.lobes.even(8), np.linspace(-5.0, 5.0, 3))


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(difference**2)))


def nothing(at: np.ndarray) -> np.ndarray:
    return np.zeros_like(at)


def load_cross(cell: Cell, values: np.ndarray, over: str = "C1") -> None:
    """X over C's whole turn, or over Z from 0 to 300, as a service engineer would load it."""
    turn = over == "C1"
    end = 360.0 if turn else 300.0
    parameters = {"INPUT_AXIS": over, "OUTPUT_AXIS": "X1", "STEP": end / (len(values) - 1), "MIN": 0.0, "MAX": end}
    parameters["IS_MODULO"] = int(turn)
    for name, value in parameters.items():
        cell.nck.set(f"$AN_CEC_{name}[0]", value, 0)
    for place, value in enumerate(values):
        cell.nck.set(f"$AN_CEC[0,{place}]", float(value), 0)
    cell.nck.set("$SN_CEC_TABLE_ENABLE[0]", 1, 0)
    cell.nck.set("$MA_CEC_ENABLE[X1]", 1, 0)


def test_the_part_is_what_the_truth_says_and_set_up_values_and_tables_show_on_its_flanks(tmp_path: Path) -> None:
    """Plain; then x and dressing, whose signs the flank itself tells; then C zero, EEC of C and a cross table X(C)."""

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        for number in (*range(77, 100),):
            cell.nck.set(f"R[{number}]", number + 0.25, 7)
        began = clock.now()
        plain = SetupValues()
        part, folder = await made(cell, site, clock, "before", plain)
        seconds = clock.now() - began
        bare = flank(cell)
        off = bare - would_be(cell, began, plain, nothing)
        print(f"machine {seconds:.0f} s, flank {rms(bare):.2f} um, off {rms(off):.4f}")
        assert seconds < 480.0
        assert rms(bare) > 3.0
        assert rms(off) < 0.1
        assert np.max(np.abs(off[0])) < 0.1  # the first space as any other
        assert cell.operator.log == ["NC START", "clamped a blank", "NC START", "took the part off", "NC START"]
        assert [cell.nck.get(f"R[{number}]") for number in range(77, 96)] == [n + 0.25 for n in range(77, 96)]
        assert folder.get("ground-before", GroundPart) == part
        assert (part.setup, part.spaces, set(part.live)) == (plain, 39, {"X1", "Z1", "C1"})
        assert "FOR USPACE=0 TO 38" in folder.read_text("grind-before.mpf")
        assert "$MA_BACKLASH[0,C1]" in folder.read_text("tables-C1-before.spf")
        assert folder.state == "ground"

        moved = SetupValues(x_um=20.0, dressing_um=15.0)
        await made(cell, site, clock, "moved", moved)
        by = np.mean(flank(cell) - bare, axis=(0, 2))
        lobes = cell.shop.ground.lobes
        normal = lobes.profile(lobes.even(8))[1]
        # x + brings the work to the wheel: less on both flanks. dressing + moves the profile along +Y.
        np.testing.assert_allclose(by, -normal.real * 20.0 + normal.imag * 15.0, atol=0.6)
        assert by[0] < -5.0
        assert by[2] - by[-3] > 15.0

        at = np.arange(0.0, 361.0, 5.0)
        mean = (cell.raw_deviation("C1", at, 1, 0.0) + cell.raw_deviation("C1", at, -1, 0.0)) / 2.0
        knots = np.arange(0.0, 361.0, 10.0)
        cross = 0.004 * np.sin(np.deg2rad(2.0 * knots))
        load_cross(cell, cross)
        load_table(cell, "C1", 0.0, 5.0, ((mean - mean[0]) / 3600.0).tolist(), modulo=1)
        await settled(cell)
        began, turned = clock.now(), SetupValues(c_arcsec=30.0)
        after, folder = await made(cell, site, clock, "after", turned)

        def table(places: np.ndarray) -> np.ndarray:
            return np.interp(np.mod(places, 360.0), knots, cross)

        better = flank(cell)
        off = better - would_be(cell, began, turned, table)
        print(f"with tables {rms(better):.2f} um, off {rms(off):.4f}")
        assert rms(off) < 0.1
        assert after.live["C1"] != part.live["C1"]
        assert after.live["Z1"] == part.live["Z1"] or "AN_CEC" in folder.read_text("tables-Z1-after.spf")
        assert "$MA_ENC_COMP_ENABLE[0,C1]=1" in folder.read_text("tables-C1-after.spf")

    on_cell(tmp_path, story)


@pytest.mark.long
def test_a_reversal_is_taken_up_within_a_stroke_only_where_bit_1_is_off(tmp_path: Path) -> None:
    """A cross table over Z moves X up and down in every stroke; a push sets the bit of MD32454 that keeps it deaf."""

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        at = np.arange(0.0, 301.0, 4.0)
        hump = np.maximum(0.0, 1.0 - np.abs(at - cell.file.part.grinding.height_mm) / 12.0)
        load_cross(cell, 0.001 * hump, "Z1")
        cell.nck.set("$MA_BACKLASH[0,X1]", 0.008, 0)
        there, found = places(cell.file.part), []
        for mode in (2, 0):
            cell.nck.set("$MA_BACKLASH_MODE[0,X1]", mode, 0)
            cell.nck.nck_reset()
            await settled(cell)
            await made(cell, site, clock, f"mode{mode}", SetupValues())
            found.append(there.trued(cell.shop.ground.surplus_um(there.spaces, there.t, there.z)))
        deaf, hearing = found
        print(rms(deaf), rms(hearing), rms(hearing - deaf))
        assert rms(deaf) < 1.5
        assert rms(hearing - deaf) > 1.0

    on_cell(tmp_path, story)


async def failed(kind: type[TrueflankError], code: str, work: Awaitable[Any]) -> TrueflankError:
    with pytest.raises(kind) as caught:
        await work
    assert caught.value.code == code, caught.value
    assert "<" not in str(caught.value)
    return caught.value


def stands(cell: Cell) -> dict[str, float]:
    return {name: cell.nck.axis_state(name).set_position for name in ("X1", "Y1", "Z1", "C1")}


CLEAR = {"X1": -170.0, "Z1": 137.0}


def clear(cell: Cell) -> bool:
    at = stands(cell)
    return all(at[name] == pytest.approx(place) for name, place in CLEAR.items())


def at_space(number: int, act: Callable[[], Any]) -> Say:
    """Something happens once that many spaces are told."""

    def say(code: str, /, **fields: Any) -> None:
        if code == "P-GRIND-SPACE" and number <= fields["done"] < number + 5:
            act()

    return say


def test_who_does_not_start_or_load_stops_it_and_every_break_leaves_a_clear_word(tmp_path: Path) -> None:
    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        hasty = site.model_copy(update={"operator": OperatorTimes(start_timeout_s=60.0, stop_timeout_s=30.0)})
        plain = SetupValues(x_um=5.0)

        async def grinding(say: Say = silence) -> Any:
            return await made(cell, hasty, clock, "part", plain, say)

        asked = {"part": "part", "setup": plain, "clock": clock, "say": silence}
        await failed(WriteRefused, "E-GRIND-NAME", grind_site(site, cell.site_path, machine_name="other", **asked))
        away = SetupValues(x_um=201.0)
        with pytest.raises(TrueflankError, match="E-GRIND-VALUE"):
            await made(cell, hasty, clock, "part", away)
        assert not store_of(site, cell.site_path).runs()
        assert cell.nck.selections == 0

        start = stands(cell)
        cell.nck.set_mode("JOG")
        refused = await failed(DeviceRefused, "E-GRIND-READY", grinding())
        assert "JOG" in refused.what
        cell.nck.set_mode("AUTO")
        assert cell.nck.selections == 0

        cell.operator.change(auto=False)
        await failed(DeadlineExceeded, "E-GRIND-NO-START", grinding())
        cell.nck.nc_start()  # too late: nobody listens any more, and the program must do nothing
        await clock.sleep(100.0)
        assert stands(cell) == start
        assert (cell.nck.channel_status, cell.shop.clamped) == (0, None)

        cell.operator.change(auto=True, load_delay_s=5000.0)
        late = await failed(DeadlineExceeded, "E-GRIND-NO-PROGRESS", grinding())
        assert "TRUEFLANK LOAD BLANK" in late.what
        assert clear(cell)
        assert cell.shop.ground is None
        assert cell.nck.get("R[86]") == 1.0  # the program still waits, and is asked to leave
        cell.nck.nc_start()
        await clock.sleep(10.0)
        assert (cell.nck.channel_status, cell.nck.get("R[90]")) == (0, 8.0)
        assert clear(cell)
        cell.nck.set("R[86]", 0.0, 7)
        cell.operator.change(load_delay_s=20.0)
        await cell.operator.stop()
        cell.operator.start()

        stopped = await failed(DeviceRefused, "E-GRIND-STOPPED", grinding(at_space(5, cell.nck.channel_reset)))
        assert "of 39 spaces" in stopped.what
        assert not cell.shop.ground.finished

        def fault() -> None:
            cell.nck.core.alarms.raise_(25201, "axis X1 drive fault", "reset")

        alarmed = await failed(DeviceRefused, "E-NC-ALARM", grinding(at_space(5, fault)))
        assert alarmed.fields["number"] == 25201
        assert clear(cell)  # asked to end, the program left between two spaces
        assert cell.nck.get("R[86]") == 0.0  # and what it needed was given back
        cell.nck.channel_reset()

        def ask_to_leave() -> None:
            cell.nck.set("R[86]", 1.0, 7)

        left = await failed(DeviceRefused, "E-GRIND-LEFT", grinding(at_space(5, ask_to_leave)))
        assert left.fields["done"] in (5, 6)
        assert clear(cell)
        assert cell.nck.channel_status == 0

        def shift() -> None:
            cell.nck.set("R[77]", 0.1, 7)

        changed = await failed(DeviceRefused, "E-GRIND-SETUP-CHANGED", grinding(at_space(5, shift)))
        assert changed.fields["number"] == 77

        last = Store(store_of(site, cell.site_path).root).runs()[-1]
        assert last.state == "failed"
        assert "ground-part" not in last.stages

    on_cell(tmp_path, story)
