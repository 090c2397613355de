"""The table of a sign proof: a triangle, zero at the reference and both ends, peak 3 um or 3 arcsec."""

from __future__ import annotations

from math import ceil, floor
from typing import Any

import numpy as np

from drivers.errors import TableError
from drivers.terms import TableKind
from drivers.types.tables import CompensationTable, reversal_of
from gateway.axes import AxisRecord

PEAK = 3.0


def triangle_for_axes(
    axis: AxisRecord,
    output: AxisRecord,
    minimum: float,
    maximum: float,
    step: float,
    kind: TableKind = "axis",
    index: int = 0,
) -> tuple[CompensationTable, float]:
    """The proof's table on the grid of the input ``axis``, and where its peak is; ``index`` is a cross table's number.

    Zero at the reference (and its two neighbours when it lies between points), at both ends and everywhere outside the
    longer side of the reference; a reversal is ``PEAK`` itself. Raises TableError (E-PUSH-TRIANGLE) when no peak fits.
    """
    if kind == "reversal":
        return reversal_of(output.name, output.unit, PEAK, output.encoder), float(np.mean(output.room))
    count = round((maximum - minimum) / step) + 1
    at = min(max((axis.reference - minimum) / step, 0.0), float(count - 1))
    below, above = (0, floor(at + 1e-9)), (ceil(at - 1e-9), count - 1)
    first, last = max(below, above, key=lambda side: side[1] - side[0])
    peak = _peak(axis.room, minimum, step=step, first=first, last=last)
    if not first < peak < last:
        grid: dict[str, Any] = {"minimum": minimum, "maximum": maximum, "step": step}
        raise TableError("E-PUSH-TRIANGLE", axis.name, axis=axis.name, **grid)
    values = np.interp(np.arange(count), [first, peak, last], [0.0, PEAK, 0.0])
    table = CompensationTable(
        kind,
        axis.name,
        output_axis=output.name,
        minimum=minimum,
        maximum=maximum,
        step=step,
        deviations=tuple(round(float(value), 3) for value in values),
        modulo=axis.modulo,
        index=output.encoder if kind == "axis" else index,
        input_unit=axis.unit,
        output_unit=output.unit,
    )
    return table, minimum + peak * step


def _peak(travel: tuple[float, float], minimum: float, step: float, first: int, last: int) -> int:
    """The grid point nearest to the middle of the side that the axis can reach."""
    low = max(first + 1, ceil((travel[0] - minimum) / step))
    high = min(last - 1, floor((travel[1] - minimum) / step))
    return min(max((first + last) // 2, low), high) if low <= high else first
