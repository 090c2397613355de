"""Arrays, coverage and units of what a run measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.units import AxisUnit, DeviationUnit, deviation_unit

FloatArray = NDArray[np.float64]


COVERAGE = 2.0
"""k of an expanded uncertainty U = k u; 95.45 % of a normal quantity (GUM 6.2)."""


COVERED = 0.9545
"""The share of a normal quantity within k = 2."""


def component_unit(name: str, axis_unit: AxisUnit) -> DeviationUnit:
    """The unit of an error by its ISO 230-1 name: um for EYX or X0C, arcsec for EAX or B0Z; of the axis else."""
    along = name[1:2] if name.startswith("E") else name[:1] if name[1:2] == "0" else ""
    if along and along in "XYZ":
        return "um"
    return "arcsec" if along and along in "ABC" else deviation_unit(axis_unit)
