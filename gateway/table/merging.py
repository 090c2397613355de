"""A fitted curve merged with the live table on the control's grid: as much of it as grid and limits can hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.limits import Limits
from drivers.types.tables import CompensationTable
from gateway.axes import AxisRecord
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.model.components import KnownRange, is_periodic, value, without_waves
from gateway.table.comparison import acting
from gateway.table.projection import Grid, project, quantised, zeroed

TURN_DEG = 360.0


def merged(
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
    full = _merged(axis, component, old, acts, grid, resolution)
    calm = without_waves(component)
    if calm is component:
        return full
    plain = _merged(axis, calm, old, acts, grid, resolution)
    if float(np.max(np.abs(np.diff(full.deviations)))) > limit.slope * grid.step:
        return plain
    return full if left_over(component, full, acts) <= left_over(component, plain, acts) else plain


def left_over(component: Component, table: CompensationTable, acts: CompensationTable) -> float:
    """The range of the fitted curve over all it covers once a table is in."""
    at = travelled(component)
    return float(np.ptp(value(component, at) - (acting(table, at) - acting(acts, at))))


def _merged(
    axis: AxisRecord,
    component: Component,
    old: CompensationTable,
    acts: CompensationTable,
    grid: Grid,
    resolution: float,
) -> CompensationTable:
    values = project(lambda at: acting(acts, at) + held(component, at), grid, modulo=axis.modulo)
    values = zeroed(values, grid, axis.reference, modulo=axis.modulo)
    return replace(
        old,
        minimum=grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        deviations=quantised(values, resolution),
        modulo=axis.modulo,
        input_unit=axis.unit,
        output_unit=axis.unit,
        places=(),
        reverse=(),
    )


def held(component: Component, at: FloatArray) -> FloatArray:
    """What a table is given at places (n,): beyond the measured range the curve's last value, and no estimate of it.

    A control does the same beyond its tables' ends, so the table adds no step there. `check_reach` bounds how far.
    """
    known = KnownRange.of(component)
    if known.period is None and not all(known.has(float(one)) for one in (np.min(at), np.max(at))):
        at = np.clip(at, known.low, known.high)
    return value(component, at)


def travelled(component: Component) -> FloatArray:
    """Places (n,) all over what a component covers, fine enough for its waves."""
    low, high = component.domain
    return np.linspace(low, low + TURN_DEG if is_periodic(component) else high, 1441)
