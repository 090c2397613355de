"""From a little truth to a proposal and back: what the table tests share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.units import AxisUnit
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.model.fit import fit_positioning
from gateway.table import Grid, MeasuredMeans, effective, propose
from tests.unit.table import truth as little

C_GRID, X_GRID = Grid(0.0, 360.0, 5.0), Grid(0.0, 400.0, 10.0)


def table(values: np.ndarray | None, grid: Grid, *, rotary: bool) -> CompensationTable:
    unit = "deg" if rotary else "mm"
    points = grid.points
    found = np.zeros_like(points) if values is None else values
    return CompensationTable(
        "axis", "A1", "A1", grid.minimum, grid.maximum, grid.step, tuple(float(v) for v in found), rotary, 0,
        unit, unit,
    )  # fmt: skip


def live(acting: CompensationTable, *, enabled: bool = True) -> LiveSet:
    return LiveSet("A1", LiveTable(acting, enabled), (), 0.0, "text", "digest")


def axis(*, rotary: bool, reference: float = 0.0) -> AxisRecord:
    travel = (0.0, 360.0) if rotary else (0.0, 400.0)
    unit: AxisUnit = "deg" if rotary else "mm"
    return AxisRecord("A1", "A", unit, rotary, rotary, travel, reference, feed=1000.0)


@dataclass(frozen=True)
class Round:
    """One capture, fit and proposal: ranges M of the truth before and after, and the change."""

    before: float
    after: float
    change: TableChange


def turn(world: little.Truth, seed: int, *, rotary: bool, acts: LiveSet | None = None) -> Round:
    grid = C_GRID if rotary else X_GRID
    known = acts or live(table(None, grid, rotary=rotary), enabled=False)
    now = effective(known.own)
    ends = (0.0, 345.0, 24) if rotary else (0.0, 400.0, 21)
    targets = little.unequal_targets(*ends, seed + 1000)
    x = little.capture(world, targets, seed + 5000, residual=lambda q: world.error(q) - now.at(q))
    summary = robust_means(targets, x)
    fitted = fit_positioning(
        targets, summary.mean, summary.u, name="EAA", axis="A1", axis_unit="deg" if rotary else "mm",
        kind="rotary" if rotary else "linear", modulo=rotary,
    )  # fmt: skip
    change = propose(
        axis(rotary=rotary), fitted, MeasuredMeans(targets, summary.mean, summary.u), known, grid,
        resolution=1e-3, reserved_points=100,
    )  # fmt: skip
    then = now if change.skipped else change.new
    dense = np.arange(0.0, 360.0 if rotary else 400.05, 0.1)
    ranges = [float(np.ptp(world.error(dense) - t.at(dense))) for t in (now, then)]
    return Round(ranges[0], ranges[1], change)
