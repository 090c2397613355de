"""A measured result file -> an axis' own table as it was measured: free positions, a curve for each direction.

For controls that take such tables. The mean of both directions is zero at the reference; the reversal stays.
"""

from __future__ import annotations

import numpy as np

from drivers.errors import Gap
from drivers.limits import VALUE_RESOLUTION
from drivers.types.results import MeasuredSet
from drivers.types.tables import CompensationTable
from drivers.units import deviation_scale
from gateway.table.conversion import FileDatum, curves
from gateway.table.projection import quantised


def as_measured(measured: MeasuredSet, axis: str, reference: float, datum: FileDatum) -> CompensationTable:
    """The table at the machine positions of the targets, um or arcsec. Raises Gap (E-COMP-MISSING, E-COMP-FREE)."""
    found = curves(measured, datum, modulo=False)
    plus = np.where(np.isnan(found.plus), found.minus, found.plus)
    minus = np.where(np.isnan(found.minus), found.plus, found.minus)
    low, high = float(found.positions[0]), float(found.positions[-1])
    if found.positions.size < 2 or not low <= reference <= high:
        raise Gap("E-COMP-FREE", axis, reference=f"{reference:g}", low=f"{low:g}", high=f"{high:g}")
    zero = float(np.interp(reference, found.positions, (plus + minus) / 2.0))
    resolution = VALUE_RESOLUTION * deviation_scale(found.unit)
    forward, reverse = (quantised(one - zero, resolution) for one in (plus, minus))
    return CompensationTable(
        kind="axis",
        input_axis=axis,
        output_axis=axis,
        minimum=low,
        maximum=high,
        step=0.0,
        deviations=forward,
        input_unit=found.unit,
        output_unit=found.unit,
        places=tuple(float(one) for one in found.positions),
        reverse=() if forward == reverse else reverse,
    )
