"""Squareness of two axes from straightness runs against a square, or from face diagonals (ISO 230-1, -6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import asin, hypot
from typing import Literal

from drivers.units import rad_to_arcsec
from gateway.errors import ModelError
from gateway.evaluate.geometry.straightness import StraightnessRun


@dataclass(frozen=True, slots=True)
class SquarenessRuns:
    """Slopes of the two runs, E_C0Y (above 0: the angle from X to Y is above 90 deg), its standard uncertainty; rad."""

    slope_x: float
    slope_y: float
    C0Y: float
    u: float


def from_runs(along_x: StraightnessRun, along_y: StraightnessRun, artefact_rad: float = 0.0) -> SquarenessRuns:
    """E_C0Y = artefact - (slope of EYX along X + slope of EXY along Y), the runs of any two axes against one square.

    ``artefact_rad`` is the square's own angle less 90 deg. Raises ModelError (E-EVAL-LINE).
    """
    (slope_x, u_x), (slope_y, u_y) = along_x.direction(), along_y.direction()
    return SquarenessRuns(slope_x, slope_y, artefact_rad - (slope_x + slope_y), hypot(u_x, u_y))


@dataclass(frozen=True, slots=True)
class ReversedSquare:
    """E_C0Y with its standard uncertainty and the square's own angle less 90 deg, all rad."""

    C0Y: float
    u: float
    own: float


def reversed_square(first: SquarenessRuns, turned: SquarenessRuns) -> ReversedSquare:
    """The machine and the square told apart: the square turned by 180 deg about an arm.

    Both evaluated without artefact angle they show C0Y - e and C0Y + e, so their mean is the machine's alone.
    """
    mean, own = (first.C0Y + turned.C0Y) / 2.0, (turned.C0Y - first.C0Y) / 2.0
    return ReversedSquare(mean, hypot(first.u, turned.u) / 2.0, own)


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
    if not length_x * length_y > 0.0:
        raise ModelError("E-EVAL-DIAGONALS", "squareness", d_pp=d_pp, d_pm=d_pm)
    cosine = (d_pp**2 - d_pm**2) / (4.0 * length_x * length_y)
    if abs(cosine) > 1.0:
        raise ModelError("E-EVAL-DIAGONALS", "squareness", d_pp=d_pp, d_pm=d_pm)
    return -asin(cosine)
