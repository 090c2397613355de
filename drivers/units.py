"""The only unit conversions, and the units that files and people name: lengths, angles, degC, hPa."""

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


TARGET_UNITS: dict[str, tuple[AxisUnit, float]] = {
    "mm": ("mm", 1.0),
    "um": ("mm", um_to_mm(1.0)),
    "m": ("mm", 1e3),
    "cm": ("mm", 10.0),
    "nm": ("mm", um_to_mm(1e-3)),
    "inch": ("mm", MM_PER_INCH),
    "uin": ("mm", MM_PER_INCH * 1e-6),
    "deg": ("deg", 1.0),
    "mdeg": ("deg", 1e-3),
    "rad": ("deg", rad_to_deg(1.0)),
    "mrad": ("deg", rad_to_deg(1e-3)),
    "urad": ("deg", rad_to_deg(1e-6)),
    "arcmin": ("deg", 1.0 / 60.0),
    "arcsec": ("deg", arcsec_to_deg(1.0)),
}
"""A unit's kind, and what one of it is in mm or deg."""
READING_UNITS: dict[str, tuple[AxisUnit, float]] = {
    "um": ("mm", 1.0),
    "mm": ("mm", mm_to_um(1.0)),
    "m": ("mm", mm_to_um(1000.0)),
    "cm": ("mm", mm_to_um(10.0)),
    "nm": ("mm", 1e-3),
    "inch": ("mm", mm_to_um(MM_PER_INCH)),
    "uin": ("mm", mm_to_um(MM_PER_INCH * 1e-6)),
    "arcsec": ("deg", 1.0),
    "arcmin": ("deg", 60.0),
    "deg": ("deg", deg_to_arcsec(1.0)),
    "mdeg": ("deg", deg_to_arcsec(1e-3)),
    "rad": ("deg", rad_to_arcsec(1.0)),
    "mrad": ("deg", rad_to_arcsec(1e-3)),
    "urad": ("deg", rad_to_arcsec(1e-6)),
}
"""A unit's kind, and what one of it is in um or arcsec."""
_SPELLINGS = {
    "um": "micron, microns, micrometer, micrometers, micrometre, micrometres, мкм, 微米",
    "mm": "мм, 毫米, millimeter, millimeters, millimetre, millimetres",
    "nm": "nanometer, nanometers, nanometre, nanometres, нм, 纳米",
    "m": "meter, meters, metre, metres",
    "inch": "in, in., inches, zoll, 英寸",
    "uin": "uinch, microinch, microinches",
    "deg": "°, grad, degree, degrees, 度, grado, grados, град",
    "arcsec": '", \N{DOUBLE PRIME}, 角秒, arcs, arc sec, arcseconds, arcsecond, arc-sec, asec, winkelsekunden',
    "arcmin": "arc min, arcminutes, arcminute, 角分",
    "mdeg": "millideg, millidegree, millidegrees, m°",
    "rad": "radian, radians",
    "urad": "microrad, microradian, microradians, um/m, µm/m, µrad, μm/m",
    "mrad": "millirad, milliradian, milliradians",
}
_NAMES = {word: unit for unit, words in _SPELLINGS.items() for word in words.split(", ")}


def unit_named(text: str) -> str:
    """The unit that a heading or a person names, as `TARGET_UNITS` has it; "" for what is no unit we know."""
    plain = typed_unit(text.strip().lower())
    plain = _NAMES.get(plain, plain)
    return plain if plain in TARGET_UNITS else ""


def wrap_deg(value: T) -> T:
    """Bring an angle difference to -180 .. 180 deg, the shortest way."""
    return (value + 180.0) % 360.0 - 180.0


def path_of_fringes_mm(fringes: T, wavelength_nm: float) -> T:
    """Way of a reflector, mm, over that many fringes of a wavelength (nm): N lambda / 2."""
    return fringes * (wavelength_nm * 1e-6 / 2.0)


LIGHT_M_S = 299_792_458.0


def light_frequency_hz(vacuum_nm: float) -> float:
    """Frequency of light of a vacuum wavelength, c / lambda."""
    return LIGHT_M_S / (1e-9 * vacuum_nm)


def fringe_rate_hz(feed_mm_min: T, wavelength_nm: float) -> T:
    """Fringes a second, 2 v / lambda, of a reflector in an interferometer at a feed (mm/min) by wavelength (nm).

    A counter whose greatest rate is less loses counts without a sign of it.
    """
    return 2.0 * (feed_mm_min / 60.0) / (wavelength_nm * 1e-6)


def followed_feed_mm_min(rate_hz: float, wavelength_nm: float) -> float:
    """The greatest feed, mm/min, that a counter of at most ``rate_hz`` fringes a second follows."""
    return rate_hz * wavelength_nm * 1e-6 / 2.0 * 60.0
