"""The only unit conversions: mm, um, inch, deg, arcsec, rad, degC, hPa."""

from __future__ import annotations

from math import pi
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", float, NDArray[np.float64])
AxisUnit = Literal["mm", "deg"]
DeviationUnit = Literal["um", "arcsec"]

UM_PER_MM = 1000.0
MM_PER_INCH = 25.4
ARCSEC_PER_DEG = 3600.0
ARCSEC_PER_RAD = ARCSEC_PER_DEG * 180.0 / pi
DEG_PER_RAD = 180.0 / pi
PA_PER_HPA = 100.0
KELVIN_OFFSET = 273.15


def mm_to_um(value: T) -> T:
    """Millimetres to micrometres."""
    return value * UM_PER_MM


def um_to_mm(value: T) -> T:
    """Micrometres to millimetres."""
    return value / UM_PER_MM


def deg_to_arcsec(value: T) -> T:
    """Degrees to seconds of arc."""
    return value * ARCSEC_PER_DEG


def arcsec_to_deg(value: T) -> T:
    """Seconds of arc to degrees."""
    return value / ARCSEC_PER_DEG


def deg_to_rad(value: T) -> T:
    """Degrees to radians."""
    return value / DEG_PER_RAD


def rad_to_deg(value: T) -> T:
    """Radians to degrees."""
    return value * DEG_PER_RAD


def rad_to_arcsec(value: T) -> T:
    """Radians to seconds of arc."""
    return value * ARCSEC_PER_RAD


def arcsec_of_path(path_mm: NDArray[np.float64], spacing_mm: float) -> NDArray[np.float64]:
    """Angle (n,) in arcsec of angular optics whose reflectors stand ``spacing_mm`` apart: arcsin(difference / spacing).

    ``path_mm`` (n,) is how much farther one reflector is than the other; NaN where no angle makes that difference.
    """
    sine = np.asarray(path_mm, np.float64) / spacing_mm
    return rad_to_arcsec(np.arcsin(np.where(np.abs(sine) <= 1.0, sine, np.nan)))


def arcsec_to_rad(value: T) -> T:
    """Seconds of arc to radians."""
    return value / ARCSEC_PER_RAD


def deviation_unit(axis_unit: AxisUnit) -> DeviationUnit:
    """The unit deviations carry on an axis of this unit: um for mm, arcsec for deg."""
    return "um" if axis_unit == "mm" else "arcsec"


def deviation_scale(axis_unit: AxisUnit) -> float:
    """How many deviation units make one axis unit: 1000 um per mm, 3600 arcsec per deg."""
    return UM_PER_MM if axis_unit == "mm" else ARCSEC_PER_DEG


def typed_unit(unit: str) -> str:
    """A unit that a person typed, as keys name it: µm, with either letter, is um."""
    return unit.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")


def wrap_deg(value: T) -> T:
    """Bring an angle difference to -180 .. 180 deg, the shortest way."""
    return (value + 180.0) % 360.0 - 180.0
