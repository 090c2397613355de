"""Squareness of two axes from straightness runs against a square, or from face diagonals (ISO 230-1, -6).

Each arm of an optical or mechanical square is a straight line; a run along an axis reads the distance from it. With
both readings counted *up towards the inside* of the square and positions counted away from its corner, slopes b1, b2:

    angle between the positive axes - 90 deg = (angle of the square - 90 deg) - (b1 + b2)

A reading that counts up away from the inside turns the sign of its slope, and so does a position that grows towards
the corner. A maker's rule "90 deg + theta2 - theta1 + error of the square" is the case in which the first reading
counts inwards and the second outwards (HP 5528A user's guide, section 21: the same numbers give -5.2 arcsec by it, and
+2.0 arcsec where both count inwards). No file tells the senses, so they are asked. The reference line is stated:
minimum zone, least squares and end points are all allowed by ISO 230-1, and differ by what the axes are not straight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import asin, hypot
from typing import Literal

from drivers.units import rad_to_arcsec
from gateway.errors import ModelError
from gateway.evaluate.geometry.straightness import Reference, StraightnessRun, straightness


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


Counting = Literal["in", "out", "in-corner", "out-corner"]
COUNTINGS: Mapping[str, int] = {"in": 1, "out": -1, "in-corner": -1, "out-corner": 1}
"""Sign of a slope: the reading counts up to the inside or outside; -corner: positions grow towards the corner."""


def above_90(first: StraightnessRun, second: StraightnessRun, line: Reference, artefact_rad: float = 0.0) -> float:
    """Angle between the positive axes less 90 deg, rad, by another reference line; both readings counted inwards.

    Raises ModelError (E-EVAL-LINE).
    """
    slopes = (straightness(one.positions, one.deviations, line).slope for one in (first, second))
    return artefact_rad - sum(slopes)


def in_words(plane: str, above_90_arcsec: float) -> str:
    """The squareness of a plane as a sentence that no convention of signs can turn."""
    first, second = plane[0], plane[1]
    if above_90_arcsec == 0.0:
        return f"+{first} and +{second} stand at 90 deg"
    larger = above_90_arcsec > 0.0
    word, side = ("larger", "-") if larger else ("smaller", "+")
    size = f"{abs(above_90_arcsec):.2f} arcsec"
    return f"the angle between +{first} and +{second} is {word} than 90 deg by {size}: {second} leans to {side}{first}"


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
