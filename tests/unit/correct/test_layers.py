"""Both layers on whole machines: predicted is what happens, set-up is no table, advice, floor, and the way back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.correct.flank.flank_model import command_effects, places_of_grid, places_of_points, setup_tables
from gateway.correct.flank.mounting import WorkMounting, mounting_of, without_mounting
from gateway.correct.flank.tables import Table, TableGrid
from gateway.correct.part.from_gear import correct_from_gear, fit_places, visible
from gateway.correct.plan.layers import correct
from gateway.correct.plan.plan import live_table, table_record
from gateway.correct.solve.floor import floor
from gateway.errors import ModelError
from gateway.gear.first_order import bounded_first_order, flank_abg, linear_flank
from gateway.gear.flank import FlankGrid, flank_figure, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import TWENTY_ONE, yk7350b
from gateway.model.frames import chain_of
from gateway.model.motion import Fourier
from gateway.table.comparison import taken_by_cross
from tests.sizes import few
from tests.unit.correct.machines import PLAN, as_errors, corrected_flank, machine
from tests.unit.gear.machines import DISC, RV40E


@pytest.mark.parametrize("seed", few([1, 2, 3]))
def test_the_corrected_machine_grinds_what_was_predicted(seed: int) -> None:
    grinding, grid = machine(seed)
    found = correct(grinding, grid, PLAN)
    assert found.after.rms < 0.15 * found.before.rms
    assert found.checked.rms == pytest.approx(found.after.rms, abs=1e-6)
    assert found.checked.largest == pytest.approx(found.after.largest, abs=5e-6)
    assert {one.name for one in found.own} == {"X(X)", "Z(Z)", "C(C)"}
    for curve in found.axes:
        assert np.ptp(curve.own_layer) < 0.25 * np.ptp(curve.before)
    assert any("determined from the axis alone" in line for line in map(str, found.said))
    assert any("interaction" in line for line in map(str, found.said))


def test_another_build_of_machine_gets_its_own_signs() -> None:
    side = [{"kind": "revolute", "name": "C", "axis": [0, 0, 1], "err": {"dx": Fourier(0.0, (0.0, 0.004))}}]
    tool = [
        {"kind": "prismatic", "name": "X", "axis": [1, 0, 0]},
        {"kind": "prismatic", "name": "Z", "axis": [0, 0, 1], "err": {"dx": Fourier(0.0, (0.002,), (), 40.0)}},
    ]
    chain = chain_of({"work": [{**side[0], "err_frame": "fixed"}], "tool": tool})
    grid = flank_grid(RV40E, profile=6, width=4)
    plan = replace(PLAN, grids=(replace(PLAN.grids[0], minimum=0.0, maximum=200.0), *PLAN.grids[1:]))
    found = correct(Grinding(chain, RV40E, 160.0), grid, plan)
    table = next(one for one in found.cross if one.name == "X(Z)")
    # Here X carries the wheel: EXZ of plus is taken by plus, not by minus.
    relative = np.array(table.deviations)[1:4]
    truth = 2.0 * np.cos(2.0 * np.pi * np.array([-5.0, 0.0, 5.0]) / 40.0)
    np.testing.assert_allclose(relative, truth - truth[1], atol=0.15)
    assert found.after.rms < 0.1 * found.before.rms
    assert found.checked.rms == pytest.approx(found.after.rms, abs=1e-6)


@pytest.mark.parametrize("frame", ["moving", "fixed"])
def test_mounting_is_set_right_and_in_no_table(frame: str) -> None:
    u, v = 0.004, -0.002
    if frame == "moving":
        errors: dict[str, object] = {"EXC": u, "EYC": v, "EBC": 3e-5}
    else:
        errors = {"EXC": Fourier(0.0, (u,), (-v,)), "EYC": Fourier(0.0, (v,), (u,))}
    grinding = Grinding(yk7350b(errors, c_frame=frame), RV40E, 160.0)  # type: ignore[arg-type]
    grid = flank_grid(RV40E, profile=6, width=4)
    places = places_of_grid(grid)
    seat = mounting_of(grinding, places)
    assert (seat.x_mm, seat.y_mm) == pytest.approx((u, v), abs=1e-9)
    assert seat.b_rad == pytest.approx(3e-5 if frame == "moving" else 0.0, abs=1e-10)
    right = without_mounting(grinding, seat)
    assert np.max(np.abs(flank_abg(right, places.k, places.z))) < 1e-9
    found = correct(grinding, grid, PLAN)
    assert found.moved.eccentricity_um == pytest.approx((-4.0, 2.0), abs=1e-6)
    assert not any(any(one.deviations) for one in (*found.own, *found.cross))
    assert found.checked.rms < 1e-5


def test_a_counter_rotating_harmonic_is_no_mounting() -> None:
    errors = {"EXC": Fourier(0.0, (0.003,), (0.001,)), "EYC": Fourier(0.0, (-0.001,), (0.003,))}
    counter = {"EXC": errors["EXC"], "EYC": Fourier(0.0, (0.001,), (-0.003,))}
    grinding = Grinding(yk7350b(counter, c_frame="fixed"), RV40E, 160.0)
    grid = flank_grid(RV40E, profile=6, width=4)
    assert np.max(np.abs(mounting_of(grinding, places_of_grid(grid)).values)) < 1e-12
    found = correct(grinding, grid, PLAN)
    assert found.moved == WorkMounting()
    assert max(abs(d) for one in found.cross if one.name == "X(C)" for d in one.deviations) > 2.0


def test_what_acted_is_continued_in_both_layers() -> None:
    grinding, grid = machine(2)
    first = correct(grinding, grid, PLAN)
    again = correct(as_errors(first.machine), grid, PLAN, live=(*first.own, *first.cross))
    idle = {one.name for one in again.optimum.omitted if one.idle}
    renewed = {(one.kind, one.name): one for one in (*again.own, *again.cross)}
    for old in (*first.own, *first.cross):
        if (old.kind, old.name) not in renewed:
            assert old.name in idle
            continue
        new = renewed[old.kind, old.name]
        gap = np.abs(np.array(old.deviations) - np.array(new.deviations))
        assert np.max(gap) <= (0.21 if old.deviation_unit == "um" else 0.73)
    assert again.after.rms <= first.after.rms * 1.02
    assert again.before.rms == pytest.approx(first.checked.rms, rel=1e-3)


def test_the_floor_goes_down_step_by_step_and_no_correction_is_below_it() -> None:
    for seed, disc in ((1, False), (3, True)):
        grinding, grid = machine(seed, disc)
        f = floor(grinding, grid)
        assert f.before >= f.setup >= f.tables >= f.products > 0.0
        found = correct(grinding, grid, PLAN)
        assert f.products <= f.tables <= found.best.rms * (1.0 + 1e-6)
        assert (f.eta > 0.3) == disc
    assert floor(Grinding(yk7350b(), DISC, 190.0), flank_grid(DISC)).products == pytest.approx(0.0, abs=1e-15)


def test_alpha_is_told_in_arcsec_per_um() -> None:
    grinding, grid = machine(1)
    assert floor(grinding, grid).alpha_arcsec_per_um == pytest.approx(3.2, abs=0.3)


@pytest.mark.parametrize("seed", [1, 3])
def test_a_measured_gear_gives_back_what_the_machine_did(seed: int) -> None:
    grinding, grid = machine(seed)
    e = np.broadcast_to(bounded_first_order(grinding, grid.k, grid.theta, grid.z).second, grid.shape)
    noisy = e + np.random.default_rng(seed).normal(0.0, 2e-4, grid.shape)
    points = tuple(np.broadcast_to(part, grid.shape) for part in (grid.k, grid.theta, grid.z))
    fit = fit_places(places_of_points(grid.gear, *points), noisy)
    truth = flank_abg(grinding, fit.k, fit.z)
    assert fit.u == pytest.approx(2e-4, rel=0.15)
    pull = (fit.abg - truth) / fit.abg_u
    assert np.sqrt(np.mean(pull**2)) == pytest.approx(1.0, abs=0.15)
    found = correct_from_gear(grinding, points, noisy, PLAN)  # type: ignore[arg-type]
    assert found.visible.rank in (4, 8)
    assert any("EXX" in line and "combinations" in line for line in map(str, found.said))
    assert any("EZZ" in line and "no gear shows" in line for line in map(str, found.said))
    sat = mounting_of(grinding, places_of_points(grid.gear, *points))
    assert any("off centre" in line for line in map(str, found.said)) == (np.hypot(sat.x_mm, sat.y_mm) > 5e-4)
    assert found.mounting.values == pytest.approx(sat.values, abs=2e-4)
    assert found.optimum.after.rms < 0.2 * found.optimum.before.rms
    # Judged by the truth, not by the readings.
    setup = found.optimum.setup
    tables = [*found.optimum.tables, *setup_tables(grinding, setup)]
    true = (
        corrected_flank(without_mounting(grinding, found.mounting), grid, tables) + setup.dressing_mm * grid.section.ny
    )
    assert flank_figure(true, grid.section.h).rms < 0.12 * flank_figure(e, grid.section.h).rms


def test_a_gear_without_its_mounting_taken_off_warns_of_what_turns() -> None:
    grinding, grid = machine(1)
    e = np.broadcast_to(bounded_first_order(grinding, grid.k, grid.theta, grid.z).second, grid.shape)
    points = tuple(np.broadcast_to(part, grid.shape) for part in (grid.k, grid.theta, grid.z))
    found = correct_from_gear(grinding, points, e, replace(PLAN, mounting=False), u=2e-4)  # type: ignore[arg-type]
    assert found.mounting == WorkMounting()
    assert any("once per turn" in line for line in map(str, found.said))


def test_what_a_live_table_does_is_no_mounting() -> None:
    """EXC and EYC that turn against the table look off centre once X(C) has taken A: half of what is left."""
    size, grid = 0.004, flank_grid(RV40E, profile=6, width=4)
    errors = {"EXC": Fourier(0.0, (size,), (0.0,)), "EYC": Fourier(0.0, (0.0,), (-size,))}
    grinding = Grinding(yk7350b(errors, c_frame="fixed"), RV40E, 160.0)
    over = TableGrid("X", "C", np.deg2rad(np.arange(0.0, 361.0, 10.0)), 2.0 * np.pi)
    best = nearest_table(grinding, grid, over)
    e = corrected_flank(grinding, grid, [best])
    points = tuple(np.broadcast_to(part, grid.shape) for part in (grid.k, grid.theta, grid.z))
    live = [table_record(grinding.chain, best, "cross")]
    known, unknown = (
        correct_from_gear(grinding, points, e, PLAN, u=2e-4, live=one)  # type: ignore[arg-type]
        for one in (live, ())
    )
    assert np.hypot(known.mounting.x_mm, known.mounting.y_mm) < 1e-4
    assert np.hypot(unknown.mounting.x_mm, unknown.mounting.y_mm) > 1e-3


def test_of_several_tables_of_one_name_none_is_taken_alone() -> None:
    chain = yk7350b()
    nodes = np.linspace(-400.0, 0.0, 5)
    plus = table_record(chain, Table(TableGrid("X", "X", nodes), 1e-3 * np.arange(5.0)), "cross", direction=1)
    minus = table_record(
        chain, Table(TableGrid("X", "X", nodes), -1e-3 * np.arange(5.0)), "cross", direction=-1, index=1
    )
    finer = TableGrid("X", "X", np.linspace(-400.0, 0.0, 9))
    both = table_record(chain, Table(finer, 1e-3 * np.ones(9)), "cross", index=2)
    off = replace(both, deviations=(0.0,) * 9)
    at = np.array([-400.0, -350.0, -123.0, 0.0])
    pair = live_table(chain, "X", "X", [plus, minus, off])
    assert pair is not None
    np.testing.assert_allclose(pair(at), 0.0, atol=1e-12)  # half of the reversal to either side: the mean stays
    one = live_table(chain, "X", "X", [plus])
    assert one is not None
    np.testing.assert_allclose(one(at), 0.5e-3 * (at + 400.0) / 100.0, atol=1e-9)
    two_curves = live_table(chain, "X", "X", [replace(both, reverse=(1.0,) * 9)])
    assert two_curves is not None
    np.testing.assert_allclose(two_curves(at), 0.0, atol=1e-12)  # -(-1 + 1) / 2 um
    assert live_table(chain, "X", "Z", [plus, both]) is None
    for several in ([plus, both], [both, replace(both, index=3)], [plus, plus]):
        with pytest.raises(ModelError, match="E-CORRECT-SEVERAL"):
            live_table(chain, "X", "X", several)


def test_neither_factor_of_a_product_is_taken_alone() -> None:
    chain = yk7350b()
    nodes = np.linspace(-400.0, 0.0, 5)
    stroke = np.linspace(-10.0, 10.0, 5)
    by_x = table_record(chain, Table(TableGrid("X", "X", nodes), 1e-3 * np.arange(5.0)), "cross", index=0)
    by_z = table_record(chain, Table(TableGrid("X", "Z", stroke), 1e-3 * np.arange(5.0)), "cross", index=1)
    product = [replace(by_x, multiply_by=by_z.index + 1), by_z]
    for over in ("X", "Z"):  # the second table says nothing of it itself
        with pytest.raises(ModelError, match="E-CORRECT-FACTOR") as refused:
            live_table(chain, "X", over, product)
        assert "switch off both tables of the product" in refused.value.hint
    assert live_table(chain, "X", "X", [replace(by_x, multiply_by=2, deviations=(0.0,) * 5), by_z]) is not None
    at = np.linspace(-400.0, 0.0, 9)
    assert np.any(taken_by_cross([by_x, by_z], "X", at))
    assert not np.any(taken_by_cross([by_x, replace(by_z, multiply_by=by_x.index + 1)], "X", at))


def nearest_table(grinding: Grinding, grid: FlankGrid, over: TableGrid) -> Table:
    """The X(C) that takes A at every space."""
    q = np.ravel(grinding.commands(grid.ks, 0.0)["C"])
    A = flank_abg(grinding, grid.ks, 0.0)[:, 0]
    effect = command_effects(grinding, places_of_points(grid.gear, 0.0, 0.0, 0.0))["X"][0, 0]
    return Table.of(over, np.linalg.lstsq(over.weights(q), -A / effect, rcond=None)[0])


def test_few_points_say_what_they_do_not_tell_apart() -> None:
    places = places_of_points(RV40E, [0.0, 0.0, 0.0, 1.0], [-0.05, 0.01, 0.06, 0.05], 0.0)
    fit = fit_places(places, [0.001, 0.002, 0.001, 0.003], u=1e-4)
    assert np.all(np.isfinite(fit.abg[0]))
    assert np.all(np.isnan(fit.abg[1]))
    with pytest.raises(ModelError, match="E-CORRECT-BASIS"):
        fit_places(places_of_points(RV40E, [0.0, 1.0], 0.05, 0.0), [0.0, 0.0])
    with pytest.raises(ModelError, match="E-CORRECT-POINTS"):
        fit_places(places, [0.0, np.nan, 0.0, 0.0])
    with pytest.raises(ModelError, match="E-CORRECT-POINTS"):
        places_of_points(RV40E, [], [], [])


def test_the_observable_combinations_are_named() -> None:
    grid = flank_grid(RV40E, profile=5, width=3)
    fixed = visible(linear_flank(Grinding(yk7350b(c_frame="fixed"), RV40E, 160.0), grid, TWENTY_ONE))
    words = [one.words for one in fixed.combinations]
    assert "EXX + EXC - EXZ" in words or "EXX - EXZ + EXC" in words
    assert any("B0Z" in one and "B0C" in one and "- B0Z" in one and "+ B0C" in one for one in words)
    assert fixed.rank == 4
    assert {"EZX", "EZZ", "EZC", "EAZ", "EBZ"} < set(fixed.invisible)
    moving = visible(linear_flank(Grinding(yk7350b(), RV40E, 160.0), grid, TWENTY_ONE))
    assert moving.rank == 8
    assert "EXC" in [one.words for one in moving.combinations]


@settings(max_examples=4, deadline=None, derandomize=True)
@given(st.integers(min_value=0, max_value=10_000), st.sampled_from(["rms", "max"]))
def test_no_machine_gets_worse(seed: int, norm: str) -> None:
    never_worse(seed, norm)


@pytest.mark.long
@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.integers(min_value=0, max_value=10_000), st.sampled_from(["rms", "max"]))
def test_no_machine_of_many_gets_worse(seed: int, norm: str) -> None:
    never_worse(seed, norm)


def never_worse(seed: int, norm: str) -> None:
    grinding, grid = machine(seed, disc=bool(seed % 2))
    found = correct(grinding, grid, replace(PLAN, norm=norm))  # type: ignore[arg-type]
    better = (found.checked.rms, found.before.rms) if norm == "rms" else (found.checked.largest, found.before.largest)
    assert better[0] <= better[1]
    for table in (*found.own, *found.cross):
        step = 0.1 if table.deviation_unit == "um" else 0.36
        counts = np.array(table.deviations) / step
        np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
        assert table.at(np.array([0.0]))[0] == 0.0
