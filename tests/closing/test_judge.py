"""The judge's floor against theory, against chance and against limits; the seeded machines against their class."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.correct.flank.compensability import tangential_cure
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_figure, flank_grid
from simulators.cellfile import CellFile, Clamping, Part, load_cell
from simulators.grinding import draw_clamping
from simulators.grinding.grinder import rotation_axis_frame
from simulators.truth import Truth
from tests.closing.judge import Floor, Machine, Values, b_left, b_left_on, floor, kept_floor, places, rms
from tests.closing.machines import ANGULAR_ARCSEC, GEARS, LINEAR_UM, gear_of, machine, written
from tests.closing.tables import SLOPE, Grid, Table
from tests.sizes import few
from tests.unit.simulators.motion import plain_cell

GRIDS = {"Z": Grid(0.0, 300.0, 10.0), "C": Grid(0.0, 360.0, 5.0, modulo=True)}
UM_PER_MM_ARCSEC = np.pi / 180.0 / 3.6


def with_errors(**errors: Any) -> Machine:
    """A machine with only these errors, its part 150 mm up and clamped true to the axis."""
    data, distance = GEARS["11-lobe disc"]
    truth: dict[str, dict[str, Any]] = {"motions": {}, "locations": {}}
    for name, value in errors.items():
        truth["motions" if name[0] == "E" else "locations"][name] = value
    part = {"gear": data, "grinding": {"centre_distance_mm": distance, "height_mm": 150.0, "stock_um": 60.0}}
    plain: Any = plain_cell()["axes"]
    axes = [*plain, {"name": "Y1", "letter": "Y", "kind": "linear", "travel": [-60.0, 60.0]}]
    cell = CellFile.model_validate(plain_cell(truth=truth, part=part, axes=axes))
    known = Truth(cell)
    assert cell.part is not None
    return Machine(known, cell.part, rotation_axis_frame(known, 150.0))


def wave(order: int, amplitude: float, phase: float = 0.0) -> list[dict[str, Any]]:
    return [{"kind": "harmonic", "order": order, "amplitude": amplitude, "phase_deg": phase}]


def seeded(seed: int) -> Machine:
    cell = machine(seed)
    truth = Truth(cell)
    assert cell.part is not None
    seat = rotation_axis_frame(truth, 150.0).then(draw_clamping(cell.part.clamping, cell.seed, "blank 3"))
    return Machine(truth, cell.part, seat, start_s=20000.0)


@pytest.fixture(scope="module")
def drawn() -> tuple[Machine, Floor]:
    found = seeded(7)
    return found, floor(found, GRIDS)


def test_the_flank_is_judged_where_the_gateway_says_and_by_the_same_figure() -> None:
    for data, _ in GEARS.values():
        part = Part.model_validate({"gear": data, "grinding": {"centre_distance_mm": 300.0}})
        at, grid = places(part), flank_grid(CycloidGear.of(data))
        np.testing.assert_allclose(at.t, grid.thetas, atol=1e-9)
        np.testing.assert_allclose(at.z, grid.zs)
        np.testing.assert_allclose(at.lever, grid.gear.section(at.t).h, atol=1e-9)
        flank = np.random.default_rng(3).normal(size=grid.shape) + 0.3 * at.lever[:, None]
        assert rms(at.turned_off(flank)) == pytest.approx(flank_figure(flank, at.lever[:, None]).rms)


def test_what_tables_and_set_up_values_can_cure_leaves_nothing() -> None:
    """And the answer is the one plain reasoning gives: what X must do at one place, and what the dresser must."""
    bend = [{"kind": "table", "positions": [0.0, 140.0, 150.0, 160.0, 300.0], "values": [0.0, -3.0, 0.0, 2.0, 0.0]}]
    found = with_errors(EXZ=bend, EXC=wave(3, 2.0), ECC=wave(1, 6.0), X0C=7.0, Y0C=-6.0, B0Z=5.0)
    assert rms(found.places.set_right(found.flank(Values()))) > 1.5
    best = floor(found, GRIDS)
    assert best.rms_um < 0.03
    assert not best.tight
    at = {"Z": 150.0, "C": 0.0}
    infeed = sum(one.at(np.asarray([at[one.over]]))[0] for one in best.values.tables if one.out == "X")
    wanted = -7.0 - 2.0 + 150.0 * 5.0 * UM_PER_MM_ARCSEC
    assert best.values.x_um + infeed == pytest.approx(wanted, abs=0.1)
    assert best.values.dressing_um == pytest.approx(-6.0, abs=0.1)


@pytest.mark.parametrize(("name", "of"), few([("EAC", "ny"), ("EBC", "nx")]))
def test_a_twist_from_space_to_space_stays_whole(name: str, of: str) -> None:
    """a(k) z n: no sum of tables over Z and over C makes a product whose factors both have no mean."""
    found = with_errors(**{name: wave(2, 5.0)})
    at = found.places
    # 150 mm up the same tilt is also a shift of every space, which tables may cure: in X all of it, in Y with eta.
    twist = 5.0 / np.sqrt(2.0) * rms(at.z) * rms(getattr(at, of)) * UM_PER_MM_ARCSEC
    shift = 5.0 / np.sqrt(2.0) * 150.0 * rms(at.ny) * UM_PER_MM_ARCSEC * b_left(found.part) * (of == "ny")
    assert floor(found, GRIDS).rms_um == pytest.approx(np.hypot(twist, shift), rel=0.01)


@pytest.mark.long
def test_no_part_corrected_by_chance_is_better(drawn: tuple[Machine, Floor]) -> None:
    found, best = drawn
    rng = np.random.default_rng(11)
    for size in (0.02, 0.1, 0.5, 3.0):
        for _ in range(3):
            tables = tuple(
                Table(one.out, one.over, one.grid, one.values + size * rng.normal(size=one.values.shape))
                for one in best.values.tables
            )
            x, dressing = best.values.x_um + size * rng.normal(), best.values.dressing_um + size * rng.normal()
            assert rms(found.flank(Values(x, dressing, tables))) > best.rms_um - 1e-4
    assert rms(found.flank(replace(best.values, x_um=best.values.x_um + 0.05))) > best.rms_um
    assert rms(found.flank(replace(best.values, dressing_um=best.values.dressing_um - 0.05))) > best.rms_um


@pytest.mark.long
def test_the_floor_does_not_depend_on_where_its_search_began(drawn: tuple[Machine, Floor]) -> None:
    found, best = drawn
    again = floor(found, GRIDS, start=Values(20.0, -15.0))
    assert again.rms_um == pytest.approx(best.rms_um, abs=1e-4)
    assert rms(found.places.set_right(found.flank(Values()))) > 2.0 * best.rms_um


@pytest.mark.long
def test_a_table_as_steep_as_it_may_be_holds_the_floor_up() -> None:
    """A ridge of 5 um beside the middle: X(Z) may rise 1 um per mm, so a part of it stays, and that is said."""
    ridge = {"kind": "table", "positions": [-5.0, 140.0, 150.0, 160.0, 320.0], "values": [0.0, 0.0, 25.0, 0.0, 0.0]}
    found = with_errors(EXZ=[ridge])
    best = floor(found, GRIDS)
    assert best.tight == ("X(Z)",)
    table = next(one for one in best.values.tables if one.name == "X(Z)")
    assert np.max(np.abs(np.diff(table.values))) <= SLOPE["X"] * 10.0 + 1e-6
    assert best.rms_um > 1.0


@pytest.mark.long
def test_the_work_s_eccentricity_is_kept_out_of_the_tables() -> None:
    true = with_errors()
    off = replace(true, seat=true.seat.then(draw_clamping(Clamping(eccentric_um=0.3), 5, "blank")))
    runout = rms(off.places.set_right(off.flank(Values())))
    assert 0.08 < runout < 0.3
    assert floor(off, GRIDS).rms_um < 0.15 * runout
    assert kept_floor(off, GRIDS).rms_um == pytest.approx(runout, rel=0.01)
    assert rms(off.places.trued(off.flank(Values()))) < 0.01 * runout


@pytest.mark.long
def test_of_a_tangential_error_38_percent_stay_on_the_disc_of_eleven() -> None:
    cell = load_cell("eleven")
    assert cell.part is not None
    data = cell.part.gear.model_dump()
    gear = CycloidGear.of(data)
    assert gear.zc == 11
    assert gear.pin < gear.limits().rrp_max
    assert b_left(cell.part) == pytest.approx(0.38, abs=0.005)
    assert b_left(cell.part) == pytest.approx(tangential_cure(gear, flank_grid(gear).thetas).eta, abs=1e-6)
    found = with_errors(EYC=wave(2, 3.0, 40.0))
    assert found.part.gear == cell.part.gear
    best = floor(found, GRIDS)
    assert best.rms_um == pytest.approx(0.38 * rms(found.flank(Values())), rel=0.02)
    assert b_left_on(found.flank(Values()), best.flank, found.places) == pytest.approx(0.38, abs=0.01)


@pytest.mark.parametrize("seed", [1, 2, 3, 6])
def test_a_seeded_machine_has_every_error_of_its_class(seed: int) -> None:
    cell = machine(seed)
    truth = Truth(cell)
    travels = {"X": np.linspace(-400.0, 0.0, 201), "Z": np.linspace(0.0, 300.0, 201), "C": np.arange(0.0, 360.0)}
    sizes = {
        f"E{to}{axis}": np.max(np.abs(truth.motion(f"E{to}{axis}", travels[axis]))) for axis in "XZC" for to in "XYZABC"
    }
    assert len(sizes) == 18
    assert min(sizes.values()) > 0.2
    assert max(size for name, size in sizes.items() if name[1] in "XYZ") < 1.2 * LINEAR_UM
    assert max(size for name, size in sizes.items() if name[1] in "ABC") < 1.2 * ANGULAR_ARCSEC
    assert all(0.0 < abs(truth.location(name)) <= 10.0 for name in ("B0Z", "A0C", "B0C", "X0C", "Y0C"))
    origin = rotation_axis_frame(truth, 150.0).origin[0]
    assert np.hypot(*origin[:2]) < 1e-4  # nothing that turns along with the table
    assert cell.part is not None
    assert cell.part.name == gear_of(seed)
    assert machine(seed + 20).truth != cell.truth


def test_a_seeded_machine_can_be_written_and_read(tmp_path: Path) -> None:
    cell = machine(3)
    assert load_cell(written(cell, tmp_path / "machine.toml")) == cell
