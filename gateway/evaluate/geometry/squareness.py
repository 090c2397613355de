"""Squareness of two axes from straightness runs, face diagonals or body diagonals (ISO 230-1, -6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import asin
from typing import Literal

from numpy.typing import ArrayLike

from drivers.units import rad_to_arcsec
from gateway.errors import ModelError
from gateway.evaluate.geometry.straightness import straightness


@dataclass(frozen=True, slots=True)
class SquarenessRuns:
    """Slopes of the two runs and E_C0Y in rad; positive: the angle from X to Y is above 90 deg."""

    slope_x: float
    slope_y: float
    C0Y: float


def from_runs(x: ArrayLike, eyx: ArrayLike, y: ArrayLike, exy: ArrayLike, artefact_rad: float = 0.0) -> SquarenessRuns:
    """E_C0Y = artefact - (slope of EYX along X + slope of EXY along Y), all lengths in one unit.

    ``artefact_rad`` is the square's own angle less 90 deg.
    """
    slope_x, slope_y = straightness(x, eyx, "lsq").slope, straightness(y, exy, "lsq").slope
    return SquarenessRuns(slope_x, slope_y, artefact_rad - (slope_x + slope_y))


def reversed_square(first: SquarenessRuns, turned: SquarenessRuns) -> tuple[float, float]:
    """E_C0Y and the square's own angle less 90 deg, e, both rad: the square turned by 180 deg about an arm.

    Both evaluated without artefact angle they show C0Y - e and C0Y + e, so their mean is the machine's alone.
    """
    return (first.C0Y + turned.C0Y) / 2.0, (turned.C0Y - first.C0Y) / 2.0


Plane = Literal["XY", "XZ", "YZ"]
# The angle between the axes grows with +C0Y and +A0Z, but shrinks with +B0Z (right-hand rule about Y).
_GROWS: Mapping[str, tuple[str, float]] = {"XY": ("EC0Y", 1.0), "XZ": ("EB0Z", -1.0), "YZ": ("EA0Z", 1.0)}


@dataclass(frozen=True, slots=True)
class Squareness:
    """One squareness by its ISO 230-1 letter, in rad and arcsec."""

    name: str
    value_rad: float
    value_arcsec: float


def of_plane(plane: Plane, above_90_rad: float) -> Squareness:
    """The squareness of a plane whose axes stand `above_90_rad` above 90 deg. Raises E-EVAL-PLANE."""
    if plane not in _GROWS:
        raise ModelError("E-EVAL-PLANE", "squareness", plane=plane, known=", ".join(_GROWS))
    name, sign = _GROWS[plane]
    return Squareness(name, sign * above_90_rad, rad_to_arcsec(sign * above_90_rad))


def from_face_diagonals(d_pp: float, d_pm: float, length_x: float, length_y: float) -> float:
    """E_C0Y in rad from the two diagonals of a rectangle length_x by length_y (++ and +-).

    For another plane hand the result to `of_plane`. Raises ModelError (E-EVAL-DIAGONALS).
    """
    cosine = (d_pp**2 - d_pm**2) / (4.0 * length_x * length_y)
    if abs(cosine) > 1.0:
        raise ModelError("E-EVAL-DIAGONALS", "squareness", d_pp=d_pp, d_pm=d_pm)
    return -asin(cosine)
