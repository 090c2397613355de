"""A fitted curve merged with the live table on the control's grid: one mean curve, or one for each direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivers.errors import Gap
from drivers.limits import Limits
from drivers.types.tables import CompensationTable
from gateway.axes import AxisRecord
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.model.components import KnownRange, is_periodic, value, without_waves
from gateway.table.comparison import acting_mean, directional_difference
from gateway.table.limits import check, check_reach

TURN_DEG = 360.0


def merge_curve(
    axis: AxisRecord,
    component: Component,
    old: CompensationTable,
    acts: CompensationTable,
    grid: Grid,
    resolution: float,
    limit: Limits,
) -> CompensationTable:
    """The table of the whole curve, or of the curve without its short waves, whichever leaves the smaller range.

    A broken line that is too coarse for a wave beats with it, and a steep wave would break the limit of slopes.
    """
    full = _merge_part(axis, component, old, acts, grid, resolution)
    calm = without_waves(component)
    if calm is component:
        return full
    plain = _merge_part(axis, calm, old, acts, grid, resolution)
    if float(np.max(np.abs(np.diff(full.deviations)))) > limit.slope * grid.step:
        return plain
    return full if left_over(component, full, acts) <= left_over(component, plain, acts) else plain


def left_over(component: Component, table: CompensationTable, acts: CompensationTable) -> float:
    """The range of the fitted curve over all it covers once a table is in."""
    at = travel_places(component)
    return float(np.ptp(value(component, at) - (acting_mean(table, at) - acting_mean(acts, at))))


def _merge_part(
    axis: AxisRecord,
    component: Component,
    old: CompensationTable,
    acts: CompensationTable,
    grid: Grid,
    resolution: float,
) -> CompensationTable:
    values = project(lambda at: acting_mean(acts, at) + curve_for_grid(component, at), grid, modulo=axis.modulo)
    values = zero_at_reference(values, grid, axis.reference, modulo=axis.modulo)
    return replace(
        old,
        minimum=grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        deviations=round_to_resolution(values, resolution),
        modulo=axis.modulo,
        input_unit=axis.unit,
        output_unit=axis.unit,
        places=(),
        reverse=(),
    )


def curve_for_grid(component: Component, at: FloatArray) -> FloatArray:
    """What a table is given at places (n,): beyond the measured range the curve's last value, and no estimate of it.

    A control does the same beyond its tables' ends, so the table adds no step there. `check_reach` bounds how far.
    """
    known = KnownRange.of(component)
    if known.period is None and not all(known.has(float(one)) for one in (np.min(at), np.max(at))):
        at = np.clip(at, known.low, known.high)
    return value(component, at)


def travel_places(component: Component) -> FloatArray:
    """Places (n,) all over what a component covers, fine enough for its waves."""
    low, high = component.domain
    return np.linspace(low, low + TURN_DEG if is_periodic(component) else high, 1441)


# ---- A curve for each direction of travel in one table: the mean of both, and half of the reversal to either side.
#
# For controls that hold such tables. The reversal is fitted along the travel, so one that changes with the place is
# taken out too.


def with_directions(
    axis: AxisRecord,
    mean: CompensationTable | None,
    acts: CompensationTable,
    reversal: Component | None,
    grid: Grid,
    *,
    resolution: float,
) -> CompensationTable:
    """The table whose mean of both directions is ``mean``'s (None: what acts), and that takes out a reversal as well.

    ``reversal`` is B = (up - down) as it was measured while ``acts`` acted (None: what acts takes out of it stays as it
    is), in the deviation unit, as ``resolution``. On the grid of the axis. Raises Gap (E-COMP-REACH) where the reversal
    is not known over the table, and as `gateway.table.limits.check`.
    """
    if reversal is not None and not is_periodic(reversal):
        check_reach(reversal.domain, (grid.minimum, grid.maximum), axis.unit, axis.name)

    def half(at: FloatArray) -> FloatArray:
        found = curve_for_grid(reversal, at) if reversal is not None else np.zeros_like(at)
        return np.asarray((directional_difference(acts, at) + found) / 2.0)

    middle = np.asarray(
        project(lambda at: acting_mean(acts, at), grid, modulo=axis.modulo) if mean is None else mean.deviations
    )
    aside = project(half, grid, modulo=axis.modulo)
    forward, reverse = round_to_resolution(middle + aside, resolution), round_to_resolution(middle - aside, resolution)
    new = replace(
        acts,
        minimum=grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        deviations=forward,
        reverse=() if forward == reverse else reverse,
        places=(),
        modulo=axis.modulo,
    )
    for one in (1, -1):
        check(_one_way(new, one), _one_way(acts, one), Limits.of(axis.unit), axis.name)
    return new


def _one_way(table: CompensationTable, approach: int) -> CompensationTable:
    """What acts in one direction, as a plain table."""
    return replace(table, deviations=table.reverse if approach < 0 and table.reverse else table.deviations, reverse=())


# ---- A curve put on the controller's grid: the broken line nearest to it by least squares, zero at the reference.

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


def zero_at_reference(values: FloatArray, grid: Grid, reference: float, *, modulo: bool) -> FloatArray:
    """Values less what the broken line has at the reference: a constant is the machine zero, not a table."""
    at = grid.minimum + np.mod(reference - grid.minimum, grid.maximum - grid.minimum) if modulo else reference
    return np.asarray(values - np.interp(at, grid.points, values))


def round_to_resolution(values: FloatArray, resolution: float) -> tuple[float, ...]:
    """Values rounded to whole multiples of the resolution, both in the deviation unit. Idempotent."""
    whole = np.round(values / resolution)
    return tuple(round(float(count) * resolution, 9) + 0.0 for count in whole)


def _samples(grid: Grid) -> FloatArray:
    """Evenly spread points inside every interval."""
    inside = (np.arange(SAMPLES_PER_STEP) + 0.5) / SAMPLES_PER_STEP
    at = (np.arange(grid.intervals)[:, None] + inside[None, :]).ravel()
    return np.asarray(grid.minimum + grid.step * at)
