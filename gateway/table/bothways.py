"""A curve for each direction of travel in one table: the mean of both, and half of the reversal to either side.

For controls that hold such tables. The reversal is fitted along the travel, so one that changes with the place is
taken out too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.limits import Limits
from drivers.types.tables import CompensationTable
from gateway.axes import AxisRecord
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.model.components import is_periodic
from gateway.table.comparison import acting, apart
from gateway.table.limits import check, check_reach
from gateway.table.merging import held
from gateway.table.projection import Grid, project, quantised


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
        found = held(reversal, at) if reversal is not None else np.zeros_like(at)
        return np.asarray((apart(acts, at) + found) / 2.0)

    middle = np.asarray(
        project(lambda at: acting(acts, at), grid, modulo=axis.modulo) if mean is None else mean.deviations
    )
    aside = project(half, grid, modulo=axis.modulo)
    forward, reverse = quantised(middle + aside, resolution), quantised(middle - aside, resolution)
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
