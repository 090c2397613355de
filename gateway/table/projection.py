"""A curve put on the controller's grid: the broken line nearest to it by least squares, zero at the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from drivers.errors import Gap
from gateway.domain.values import FloatArray

SAMPLES_PER_STEP = 24
Curve = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Grid:
    """Interpolation points minimum, minimum + step, ... maximum, in the axis unit."""

    minimum: float
    maximum: float
    step: float

    @property
    def intervals(self) -> int:
        """k = (maximum - minimum) / step; raises Gap (E-COMP-GRID) when the step does not divide the range."""
        ratio = (self.maximum - self.minimum) / self.step if self.step > 0.0 else float("nan")
        if not (ratio >= 0.5 and abs(ratio - round(ratio)) < 1e-6):
            raise Gap("E-COMP-GRID", "table", minimum=self.minimum, maximum=self.maximum, step=self.step)
        return round(ratio)

    @property
    def points(self) -> FloatArray:
        """All interpolation points, shape (k+1,)."""
        return self.minimum + self.step * np.arange(self.intervals + 1, dtype=np.float64)


def project(curve: Curve, grid: Grid, *, modulo: bool) -> FloatArray:
    """Values (k+1,) of the broken line on the grid that is nearest to the curve in the mean square.

    Point sampling cuts every arc on one side; this halves the largest error of interpolation. A curve that is a
    broken line on the grid comes back unchanged. With ``modulo`` first and last value are one.
    """
    at, k = _samples(grid), grid.intervals
    place = (at - grid.minimum) / grid.step
    left = np.clip(np.floor(place).astype(np.int64), 0, k - 1)
    share, unknowns = place - left, k if modulo else k + 1
    rows, columns = np.repeat(np.arange(at.size), 2), np.stack([left, left + 1], axis=1).ravel() % unknowns
    hats = scipy.sparse.csc_matrix(
        (np.stack([1.0 - share, share], axis=1).ravel(), (rows, columns)), (at.size, unknowns)
    )
    found = np.atleast_1d(np.asarray(scipy.sparse.linalg.spsolve((hats.T @ hats).tocsc(), hats.T @ curve(at))))
    return np.append(found, found[0]) if modulo else np.asarray(found)


def zeroed(values: FloatArray, grid: Grid, reference: float, *, modulo: bool) -> FloatArray:
    """Values less what the broken line has at the reference: a constant is the machine zero, not a table."""
    at = grid.minimum + np.mod(reference - grid.minimum, grid.maximum - grid.minimum) if modulo else reference
    return np.asarray(values - np.interp(at, grid.points, values))


def quantised(values: FloatArray, resolution: float) -> tuple[float, ...]:
    """Values rounded to whole multiples of the resolution, both in the deviation unit. Idempotent."""
    whole = np.round(values / resolution)
    return tuple(round(float(count) * resolution, 9) + 0.0 for count in whole)


def _samples(grid: Grid) -> FloatArray:
    """Evenly spread points inside every interval."""
    inside = (np.arange(SAMPLES_PER_STEP) + 0.5) / SAMPLES_PER_STEP
    at = (np.arange(grid.intervals)[:, None] + inside[None, :]).ravel()
    return np.asarray(grid.minimum + grid.step * at)
