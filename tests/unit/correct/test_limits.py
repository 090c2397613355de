"""Limits, the zero at the reference, the axis' own accuracy, live tables and what is left alone for its uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import TooManyPoints
from drivers.units import arcsec_to_rad
from gateway.correct.flank.flank_model import SetupUnknown
from gateway.correct.flank.noise import FitNoise, component_doubts, noise_patterns
from gateway.correct.flank.tables import Table, TableGrid
from gateway.correct.plan.layers import correct
from gateway.correct.solve.constraints import AxisBound, TableSpec, nearest_within_limits
from gateway.correct.solve.optimise import optimise
from gateway.errors import ModelError
from gateway.gear.first_order import ErrorParameter
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.components import standard_uncertainty
from gateway.model.error_model import yk7350b
from gateway.model.fit import fit_positioning
from gateway.model.motion import Fourier, Polynomial
from gateway.tooth import SetupValues
from tests.sizes import few
from tests.unit.correct.machines import PLAN, STEP_MM, TURN, corrected_flank, machine, setup, setup_vector, specs
from tests.unit.gear.machines import RV40E

GRID = flank_grid(RV40E, profile=6, width=5)
FAR = np.linspace(-80.0, 80.0, 33)  # 5 mm apart; the face reaches from -5 to 5


def test_least_squares_with_limits_keeps_them_and_is_optimal() -> None:
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(2)
    A, b = rng.normal(size=(40, 8)), rng.normal(size=40)
    box = 0.08
    G, g = np.concatenate([np.eye(8), -np.eye(8)]), np.full(16, box)
    x = nearest_within_limits(A, b, np.zeros(8), G, g)
    assert np.max(np.abs(x)) <= box * (1.0 + 1e-9)
    theirs = lsq_linear(A, -b, (-box, box), tol=1e-14)
    assert np.linalg.norm(A @ x + b) == pytest.approx(np.sqrt(2.0 * theirs.cost), rel=1e-9)
    with pytest.raises(ModelError, match="E-CORRECT-INFEASIBLE"):
        nearest_within_limits(A, b, np.zeros(8), np.stack([np.eye(8)[0], -np.eye(8)[0]]), np.array([-1.0, -1.0]))


@pytest.mark.parametrize("norm", ["rms", "max"])
def test_value_and_slope_limits_are_kept_after_rounding(norm: str) -> None:
    grinding = Grinding(yk7350b({"EXZ": Polynomial((0.0, 0.004, 0.006), 0.0, 5.0)}), RV40E, 160.0)
    z = np.linspace(-10.0, 10.0, 9)
    free = TableSpec(TableGrid("X", "Z", z), resolution=STEP_MM, reference=0.0)
    loose = optimise(grinding, GRID, [free], norm=norm)  # type: ignore[arg-type]
    assert np.max(np.abs(loose.tables[0].values)) > 0.004
    tight = replace(free, value=0.004, slope=0.0012)
    found = optimise(grinding, GRID, [tight], norm=norm)  # type: ignore[arg-type]
    values = found.tables[0].values
    assert np.max(np.abs(values)) <= 0.004 + 1e-12
    assert np.max(np.abs(np.diff(values)) / 2.5) <= 0.0012 + 1e-12
    assert loose.after.rms < found.after.rms < found.before.rms


def test_limits_that_leave_nothing_are_an_error() -> None:
    grinding, grid = machine(1)
    live = Table(specs()[0].grid, np.linspace(0.0, 0.08, 5))
    spec = replace(specs()[0], live=live, reference=None, change=0.001, value=0.01)
    with pytest.raises(ModelError, match="E-CORRECT-INFEASIBLE"):
        optimise(grinding, grid, [spec])
    with pytest.raises(ModelError, match="E-CORRECT-LIMIT"):
        TableSpec(specs()[0].grid, value=0.0)


def test_a_reference_between_nodes_is_zero_within_half_a_step() -> None:
    grinding, grid = machine(3)
    off = [replace(spec, reference=1.7 if spec.grid.over == "Z" else 0.2) for spec in specs()]
    found = optimise(grinding, grid, off, setup())
    for spec, smooth, table in zip(off, found.continuous, found.tables, strict=True):
        assert smooth(np.asarray(spec.reference)) == pytest.approx(0.0, abs=1e-12)
        assert abs(float(table(np.asarray(spec.reference)))) <= 0.5 * spec.resolution + 1e-12
    assert found.after.rms < 1.2 * found.best.rms


def test_the_axis_stays_within_its_bound() -> None:
    errors = {"EYC": Fourier(0.0, (0.0, 0.005))}
    grinding = Grinding(yk7350b(errors, c_frame="fixed"), RV40E, 160.0)
    open_ = correct(grinding, GRID, PLAN)
    bound = correct(grinding, GRID, replace(PLAN, bounds={"C": 10.0}))
    curve = {name: next(a for a in one.axes if a.axis == "C") for name, one in (("open", open_), ("bound", bound))}
    assert np.max(np.abs(curve["open"].predicted)) > 14.0
    assert np.max(np.abs(curve["bound"].predicted)) <= 10.0 + 1e-6
    assert open_.after.rms < bound.after.rms < bound.before.rms


def test_an_axis_already_beyond_its_bound_only_may_not_get_worse() -> None:
    at = np.linspace(0.0, TURN, 13)
    deviation = arcsec_to_rad(20.0) * np.sin(at)
    bound = AxisBound("C", at, deviation, arcsec_to_rad(5.0))
    spec = specs()[3]
    G, g = bound.rows(spec)
    assert np.all(g >= -1e-15)
    kept = np.zeros(spec.grid.free.size)
    assert np.all(G @ kept <= g + 1e-15)


@pytest.mark.parametrize("seed", few([1, 4]))
def test_tables_that_acted_are_kept_and_continued(seed: int) -> None:
    grinding, grid = machine(seed)
    wide = [replace(one, grid=replace(one.grid, nodes=FAR)) if one.grid.over == "Z" else one for one in specs()]
    fresh = optimise(grinding, grid, wide, setup())
    rng = np.random.default_rng(seed)
    live = [
        Table.of(s.grid, np.r_[0.0, np.rint(rng.normal(0.0, 10.0, s.grid.free.size - 1))] * s.resolution) for s in wide
    ]
    live = [Table(one.grid, one.values - one(np.asarray(0.0))) for one in live]
    acted = corrected_flank(grinding, grid, live)
    again = optimise(
        replace(grinding, chain=grinding.chain.without_errors()),
        grid,
        [replace(spec, live=one) for spec, one in zip(wide, live, strict=True)],
        setup(),
        deviation=acted,
    )
    assert again.before.rms == pytest.approx(grid_rms(acted, grid), rel=1e-9)
    assert again.best.rms == pytest.approx(fresh.best.rms, rel=1e-6)
    for one, two, spec in zip(again.continuous, fresh.continuous, wide, strict=True):
        seen = np.array([node not in again.unseen[spec.name] for node in spec.grid.nodes])
        np.testing.assert_allclose(one.values[seen], two.values[seen], atol=3e-6)
    # Where the flank says nothing the change leads back to what acted, which stays further off.
    for one, old, spec in zip(again.tables, live, wide, strict=True):
        unseen = np.array(again.unseen[spec.name])
        assert unseen.size == (FAR.size - 3 if spec.grid.over == "Z" else 0)
        for node in unseen[np.abs(unseen) > 40.0]:
            assert float(one(node)) == pytest.approx(float(old(node)), abs=1e-9)


def grid_rms(e: np.ndarray, grid: object) -> float:
    """RMS after one rotation."""
    from gateway.gear.flank import flank_figure

    return flank_figure(e, grid.section.h).rms  # type: ignore[attr-defined]


def test_what_corrects_less_than_its_uncertainty_is_left_alone_and_said() -> None:
    errors = {"EXZ": Polynomial((0.0, 0.003, 0.002), 0.0, 5.0), "EXC": Fourier(0.0, (0.0, 2e-4))}
    grinding = Grinding(yk7350b(errors, c_frame="fixed"), RV40E, 160.0)
    doubts: list[tuple[ErrorParameter | str, float]] = [
        (ErrorParameter("EXZ", Polynomial((0.0, 1.0), 0.0, 5.0)), 2e-4),
        (ErrorParameter("EXC", Fourier(0.0, (0.0, 1.0))), 4e-4),
    ]
    noise = noise_patterns(grinding, GRID, doubts)
    found = correct(grinding, GRID, replace(PLAN, noise=noise))
    names = {one.name for one in found.cross}
    assert "X(Z)" in names
    assert "X(C)" not in names
    told = next(one for one in found.optimum.omitted if one.name == "X(C)")
    assert told.gain < told.U
    assert any("X(C) is not proposed" in line for line in map(str, found.said))
    sure = correct(grinding, GRID, replace(PLAN, noise=FitNoise()))
    assert {"X(Z)", "X(C)"} <= {one.name for one in sure.cross}
    assert all(one.idle for one in sure.optimum.omitted)
    assert found.optimum.noise == pytest.approx(2e-4, rel=0.6)


def test_doubts_of_fitted_components_come_from_their_covariance() -> None:
    z = np.linspace(-10.0, 10.0, 21)
    rng = np.random.default_rng(3)
    fitted = fit_positioning(
        z, 3.0 * z / 10.0 + rng.normal(0.0, 0.3, z.size), 0.3, name="EXZ", axis="Z", axis_unit="mm", kind="linear"
    )
    doubts = component_doubts([fitted])
    total = sum(np.asarray(one.basis(z)) ** 2 for one, _ in doubts if isinstance(one, ErrorParameter) and one.basis)
    np.testing.assert_allclose(np.sqrt(total) * 1e3, standard_uncertainty(fitted, z), rtol=1e-6)
    assert noise_patterns(Grinding(yk7350b(), RV40E, 160.0), GRID, doubts).patterns is not None


def test_a_controller_with_too_few_points_is_told() -> None:
    with pytest.raises(TooManyPoints, match="12 reserved"):
        correct(machine(1)[0], GRID, replace(PLAN, reserved={"X(C)": 12}))


def test_pure_noise_is_not_corrected() -> None:
    clean = Grinding(yk7350b(), RV40E, 160.0)
    rng = np.random.default_rng(11)
    e = rng.normal(0.0, 5e-4, GRID.shape)
    found = optimise(clean, GRID, specs(), setup(), deviation=e, noise=FitNoise(point=5e-4))
    assert found.tables == ()
    assert found.setup == SetupValues()
    assert len(found.omitted) == 7
    signal = e + 0.003 * GRID.section.nx
    found = optimise(clean, GRID, specs(), setup(), deviation=signal, noise=FitNoise(point=5e-4))
    assert found.setup.x_mm == pytest.approx(0.003, abs=2e-4)
    assert found.tables == ()


def test_set_up_values_take_the_constants() -> None:
    grinding = Grinding(yk7350b({"EXX": 0.004, "EYZ": 0.006}), RV40E, 160.0)
    values = [SetupUnknown("X", STEP_MM), SetupUnknown("", STEP_MM)]
    found = optimise(grinding, GRID, specs(), values)
    assert setup_vector(found.setup) == pytest.approx([-0.004, 0.0, -0.006], abs=1e-9)
    assert all(not np.any(table.values) for table in found.tables)
    assert found.after.largest < 1e-9
