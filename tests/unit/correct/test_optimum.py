"""The optimum against least squares and minimax worked out independently, by brute force over the flank itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from gateway.correct.flank.flank_model import flank_model, places_of_points
from gateway.correct.flank.tables import Table
from gateway.correct.solve.optimise import Optimum, optimise
from gateway.errors import ModelError
from gateway.gear.cycloid import DressingError
from gateway.gear.first_order import first_order
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model import transforms
from tests.sizes import few
from tests.unit.correct.machines import STEP_MM, machine, setup, setup_vector, specs

SEEDS = (1, 2, 5)


def _columns(grinding: Grinding, grid: FlankGrid) -> np.ndarray:
    """Flank of one unit of every table node and set-up value, by moving the ideal machine's commands (mm, rad)."""
    clean = replace(grinding, chain=grinding.chain.without_errors())
    k, z = np.broadcast_arrays(grid.ks[:, None], grid.zs[None, :])
    q = clean.commands(k, z)
    back = transforms.inverse(clean.chain.ideal(q))
    section = grid.gear.section(grid.thetas)
    angle = grid.gear.space_angle(grid.ks)

    def flank(axis: str, weight: np.ndarray) -> np.ndarray:
        h = 1e-3 if axis == "X" else 1e-6
        moved = [clean.chain.ideal({**q, axis: q[axis] + s * h}) @ back for s in (1, -1)]
        rate = (moved[0] - moved[1]) / (2.0 * h)
        e = np.empty(grid.shape)
        for i, a in enumerate(angle):
            c, s = np.cos(a), np.sin(a)
            for j, height in enumerate(grid.zs):
                p = np.stack([c * section.x - s * section.y, s * section.x + c * section.y], axis=-1)
                n = np.stack([c * section.nx - s * section.ny, s * section.nx + c * section.ny], axis=-1)
                d = p @ rate[i, j, :2, :2].T + rate[i, j, :2, 2] * height + rate[i, j, :2, 3]
                e[i, :, j] = np.sum(d * n, axis=-1) * weight[i, j]
        return e.ravel()

    columns = []
    for spec in specs(rounded=False):
        for m in range(spec.grid.free.size):
            one = Table.of(spec.grid, np.eye(spec.grid.free.size)[m])
            at = np.asarray(q[spec.grid.over])
            if spec.grid.free[m] != 0.0:
                columns.append(flank(spec.grid.out, np.broadcast_to(one(at), k.shape)))
    for axis in ("X", "C"):
        columns.append(flank(axis, np.ones(k.shape)))
    wheel = DressingError(offset=1.0).first_order(grid.section, grid.theta)
    columns.append(np.broadcast_to(wheel[None], grid.shape).ravel())
    return np.stack(columns, axis=1)


def _unturned(grid: FlankGrid, e: np.ndarray) -> np.ndarray:
    h = np.broadcast_to(grid.section.h[None], grid.shape).ravel()
    return e - np.outer(h, h @ e / (h @ h)).reshape(e.shape) if e.ndim == 2 else e - h * (h @ e / (h @ h))


def _independent(grinding: Grinding, grid: FlankGrid) -> tuple[np.ndarray, np.ndarray]:
    e0 = np.broadcast_to(first_order(grinding, grid.k, grid.theta, grid.z), grid.shape).ravel()
    J = _columns(grinding, grid)
    return _unturned(grid, J) * 1e-3 / np.maximum(np.max(np.abs(J), axis=0), 1e-12), _unturned(grid, e0)


@pytest.mark.parametrize("seed", few(SEEDS))
@pytest.mark.parametrize("disc", [False, True])
def test_rms_before_rounding_is_the_least_squares_optimum(seed: int, disc: bool) -> None:
    grinding, grid = machine(seed, disc)
    J, e0 = _independent(grinding, grid)
    rest = e0 + J @ np.linalg.lstsq(J, -e0, rcond=1e-9)[0]
    least = float(np.sqrt(np.mean(rest**2)))
    found = optimise(grinding, grid, specs(), setup())
    assert found.best.rms == pytest.approx(least, rel=1e-5)
    assert found.before.rms == pytest.approx(float(np.sqrt(np.mean(e0**2))), rel=1e-9)
    assert found.after.rms <= least + STEP_MM
    assert found.after.rms <= 1.08 * least


@pytest.mark.parametrize(("seed", "disc"), few([(2, True), (1, False), (3, False)]))
def test_largest_before_rounding_is_the_minimax_optimum(seed: int, disc: bool) -> None:
    grinding, grid = machine(seed, disc)
    J, e0 = _independent(grinding, grid)
    n = J.shape[1]
    top = 1e3
    A = np.block([[J * top, -np.ones((e0.size, 1))], [-J * top, -np.ones((e0.size, 1))]])
    lp = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=A,
        b_ub=np.concatenate([-e0, e0]) * top,
        bounds=[(None, None)] * n + [(0.0, None)],
        method="highs",
    )
    least = float(lp.fun) / top
    found = optimise(grinding, grid, specs(), setup(), norm="max")
    assert found.best.largest == pytest.approx(least, rel=0.01)
    assert found.after.largest <= least + STEP_MM
    by_rms = optimise(grinding, grid, specs(), setup())
    assert found.best.largest <= by_rms.best.largest
    assert found.best.rms >= by_rms.best.rms


@pytest.mark.parametrize("seed", SEEDS)
def test_rounding_inside_beats_rounding_after(seed: int) -> None:
    grinding, grid = machine(seed)
    found = optimise(grinding, grid, specs(), setup())
    after = _rounded_after(grinding, grid)
    assert found.after.rms <= after * (1.0 + 1e-9)


def _rounded_after(grinding: Grinding, grid: FlankGrid) -> float:
    plain = optimise(grinding, grid, specs(rounded=False), setup(rounded=False))
    model = flank_model(grinding, grid, [one.grid for one in specs()], setup())
    x = np.zeros(model.size)
    for spec, table in zip(specs(), plain.tables, strict=True):
        x[model.spans[spec.name]] = np.rint(table.values[: spec.grid.free.size] / spec.resolution) * spec.resolution
    for unknown, value in zip(setup(), setup_vector(plain.setup), strict=True):
        x[model.spans[unknown.name]] = np.rint(value / unknown.resolution) * unknown.resolution
    return model.rms(x)


def _on_steps(found: Optimum) -> None:
    by_name = {spec.name: spec for spec in specs()}
    assert found.tables
    for table in found.tables:
        spec = by_name[table.grid.name]
        counts = table.values / spec.resolution
        np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
        assert table(np.asarray(0.0)) == 0.0


@pytest.mark.parametrize("norm", ["rms", "max"])
def test_values_are_whole_steps_and_zero_at_the_reference(norm: str) -> None:
    grinding, grid = machine(4)
    _on_steps(optimise(grinding, grid, specs(), setup(), norm=norm))  # type: ignore[arg-type]


def test_prediction_is_the_flank_of_the_model() -> None:
    grinding, grid = machine(6)
    found = optimise(grinding, grid, specs(), setup())
    model = flank_model(grinding, grid, [one.grid for one in specs()], setup())
    x = np.concatenate([*(t.values[: t.grid.free.size] for t in found.tables), setup_vector(found.setup)])
    np.testing.assert_allclose(model.deviation(x), found.deviation, atol=1e-15)
    assert model.rms(x) == pytest.approx(found.after.rms, rel=1e-9)


def test_scattered_points_give_what_the_grid_gives() -> None:
    grinding, grid = machine(7)
    e = first_order(grinding, grid.k, grid.theta, grid.z)
    e = np.broadcast_to(e, grid.shape) + np.random.default_rng(1).normal(0.0, 2e-4, grid.shape)
    k, t, z = (np.broadcast_to(part, grid.shape).ravel() for part in (grid.k, grid.theta, grid.z))
    order = np.random.default_rng(2).permutation(k.size)
    places = places_of_points(grid.gear, k[order], t[order], z[order])
    clean = replace(grinding, chain=grinding.chain.without_errors())
    one = optimise(clean, grid, specs(), setup(), deviation=e)
    two = optimise(clean, places, specs(), setup(), deviation=e.ravel()[order])
    assert two.best.rms == pytest.approx(one.best.rms, rel=1e-9)
    assert one.before.rms == pytest.approx(two.before.rms, rel=1e-12)


def test_bad_input_is_refused_by_name() -> None:
    grinding, grid = machine(1)
    with pytest.raises(ModelError, match="E-CORRECT-NORM"):
        optimise(grinding, grid, specs(), norm="median")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="E-CORRECT-POINTS"):
        optimise(grinding, grid, specs(), deviation=[1.0, 2.0])
    with pytest.raises(ModelError, match="E-CORRECT-TWICE"):
        optimise(grinding, grid, [specs()[0], specs()[0]])
    with pytest.raises(ModelError, match="E-CHAIN-AXIS"):
        optimise(grinding, grid, [replace(specs()[0], grid=replace(specs()[0].grid, out="Y"))])
    with pytest.raises(ModelError, match="E-CORRECT-NAME"):
        optimise(grinding, grid, specs()).table("Y(Z)")
