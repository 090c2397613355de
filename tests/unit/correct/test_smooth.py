"""Of tables that serve the flank alike the smoothest: judged by another gear, by the taper, by what it costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.correct.flank.flank_model import FlankModel, flank_model
from gateway.correct.flank.tables import Table, TableGrid
from gateway.correct.solve.constraints import TableSpec, smoothing_weight
from gateway.correct.solve.optimise import Norm, optimise
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import yk7350b
from gateway.model.motion import Fourier, Polynomial
from tests.unit.correct.machines import STEP_MM, STEP_RAD, TURN, setup, setup_vector
from tests.unit.gear.machines import DISC, RV40E

ALIKE_MM = 5e-6
ERRORS = {
    "EXC": Fourier(0.0, (0.0, 8e-4, 4e-4), (0.0, -6e-4)),
    "EYC": Fourier(0.0, (0.0, 5e-4), (0.0, 3e-4, 3e-4)),
    "EXZ": Polynomial((0.0, 0.0015), 0.0, 5.0),
}
OTHER = replace(RV40E, zc=RV40E.zc + 2, zp=RV40E.zp + 2)


def fine(*, rounded: bool = True) -> list[TableSpec]:
    """X(Z), X(C), C(C): more nodes around the turn than spaces, and a travel far beyond the face."""
    z, c = np.linspace(-150.0, 150.0, 31), np.deg2rad(np.arange(0.0, 361.0, 5.0))
    steps = {"X": STEP_MM * rounded, "C": STEP_RAD * rounded}
    grids = (TableGrid("X", "Z", z), TableGrid("X", "C", c, TURN), TableGrid("C", "C", c, TURN))
    return [TableSpec(grid, resolution=steps[grid.out], reference=0.0) for grid in grids]


def machine(gear: object = RV40E) -> tuple[Grinding, FlankGrid]:
    used = OTHER if gear is OTHER else DISC if gear is DISC else RV40E
    grinding = Grinding(yk7350b(ERRORS, c_frame="fixed"), used, 190.0 if used is DISC else 160.0)
    return grinding, flank_grid(used, profile=6, width=4)


def with_least_values(model: FlankModel) -> np.ndarray:
    """Table values and set-up values of the smallest squares that are as good, without any smoothness."""
    size = np.linalg.norm(model.rows, axis=0)
    scale = np.concatenate(
        [np.full(model.spans[one.name].stop - model.spans[one.name].start, 1.0) for one in model.blocks]
    )
    for one in model.blocks:
        scale[model.spans[one.name]] = 1.0 / max(float(np.max(size[model.spans[one.name]])), 1e-12)
    return np.asarray(scale * np.linalg.lstsq(model.rows * scale, -model.right, rcond=1e-10)[0])


def bends(table: Table) -> float:
    values = table.values[:-1]
    return float(np.max(np.abs(np.roll(values, -1) - 2.0 * values + np.roll(values, 1))))


@pytest.mark.parametrize("norm", ["rms", "max"])
def test_smooth_tables_cost_next_to_nothing_and_serve_another_gear(norm: Norm) -> None:
    grinding, grid = machine()
    found = optimise(grinding, grid, fine(), setup(), norm=norm, indifference_rms=ALIKE_MM)
    least = optimise(grinding, grid, fine(rounded=False), setup(rounded=False), norm=norm)
    cost = np.hypot(least.best.rms, ALIKE_MM) if norm == "rms" else 1.02 * least.best.rms + ALIKE_MM
    assert found.best.rms <= cost * (1.0 + 1e-9)
    assert found.after.rms <= found.best.rms + 0.25 * STEP_MM
    for name, step in (("X(C)", STEP_MM), ("C(C)", STEP_RAD)):
        assert bends(found.table(name)) < (4.5 if norm == "rms" else 6.5) * step
    other, judged = machine(OTHER)
    model = flank_model(other, judged, [one.grid for one in fine()], setup())
    values = [found.table(one.name).values[: one.grid.free.size] for one in fine()]
    smooth = model.rms(np.concatenate([*values, setup_vector(found.setup)]))
    own = flank_model(grinding, grid, [one.grid for one in fine()], setup())
    jagged = model.rms(with_least_values(own))
    before = model.rms(np.zeros(model.size))
    print(f"another gear: {1e3 * before:.3f} -> {1e3 * smooth:.4f} um, with the least values {1e3 * jagged:.4f}")
    assert smooth < 0.12 * before
    assert smooth < 0.5 * jagged


def test_beside_the_face_a_table_leads_back_to_what_acts_and_stays_there() -> None:
    grinding, grid = machine()
    acts = Table(fine()[0].grid, np.r_[np.zeros(25), 0.004 * np.ones(6)])
    found = optimise(grinding, grid, [replace(fine()[0], live=acts)], setup(), indifference_rms=ALIKE_MM)
    change = 1e3 * (found.table("X(Z)").values - acts.values)
    z = fine()[0].grid.nodes
    # 1.5 um at the ends of a face of 10 mm; as a correction of the work it has the same sign.
    assert change[np.abs(z) == 10.0] == pytest.approx([-3.0, 3.0], abs=0.15)
    assert np.all(change[np.abs(z) > 70.0] == 0.0)
    assert np.max(np.abs(np.diff(change))) <= 3.2
    beside = change[(z >= 20.0) & (z <= 70.0)]
    assert np.max(np.abs(np.diff(beside))) < 2.0
    assert np.all(np.diff(np.sign(beside[np.abs(beside) > 0.15])) == 0)


def test_few_spaces_on_a_fine_grid_leave_no_node_behind() -> None:
    """Eleven spaces, 72 values: between them the tables follow the errors, for the errors are smooth."""
    grinding, grid = machine(DISC)
    found = optimise(grinding, grid, fine(), setup(), indifference_rms=ALIKE_MM)
    assert found.unseen["X(C)"] != ()
    assert bends(found.table("X(C)")) < 5.5 * STEP_MM
    assert bends(found.table("C(C)")) < 5.5 * STEP_RAD


def test_the_weight_of_smoothness_costs_what_is_allowed() -> None:
    rng = np.random.default_rng(5)
    A, b = rng.normal(size=(30, 12)) * np.logspace(0.0, -4.0, 12), rng.normal(size=30)
    R, t = np.concatenate([np.diff(np.eye(12), 2, axis=0), 0.1 * np.eye(12)]), np.zeros(22)

    def cost(weight: float) -> tuple[float, float]:
        y = np.linalg.lstsq(np.concatenate([A, weight * R]), np.concatenate([-b, weight * t]), rcond=None)[0]
        return float(np.sum((A @ y + b) ** 2)), float(np.sum((R @ y) ** 2))

    exact = float(np.sum((A @ np.linalg.lstsq(A, -b, rcond=1e-15)[0] + b) ** 2))
    for allowed in (1e-3, 0.1, 1.0):
        weight = smoothing_weight(A, b, R, t, allowed)
        assert cost(weight)[0] - exact == pytest.approx(allowed, rel=1e-3)
        assert cost(2.0 * weight)[0] - exact > allowed
        assert cost(2.0 * weight)[1] < cost(weight)[1] < cost(0.5 * weight)[1]
