"""Straightness about its reference line, parallelism, and squareness of two axes (ISO 230-1, -6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import asin, hypot
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import words
from drivers.units import rad_to_arcsec
from gateway.domain.values import COVERAGE, FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards.statistics import numbers

Reference = Literal["lsq", "end-point", "minimum-zone"]


@dataclass(frozen=True, slots=True)
class Straightness:
    """Line intercept + slope x position, what it leaves (m,), and the straightness value (its width)."""

    reference: Reference
    slope: float
    intercept: float
    residual: FloatArray
    value: float


def straightness(positions: ArrayLike, deviations: ArrayLike, reference: Reference = "minimum-zone") -> Straightness:
    """Straightness of deviations (m,) along positions (m,); the slope is deviation unit per position unit.

    Raises ModelError: E-EVAL-LINE without two different positions, E-EVAL-WORD, E-EVAL-NUMBER.
    """
    if reference not in _LINES:
        known = ", ".join(_LINES)
        raise ModelError("E-EVAL-WORD", "straightness", key="reference line", value=reference, known=known)
    x, y = numbers("positions", positions), numbers("deviations", deviations)
    fits = x.ndim == 1 and x.shape == y.shape and x.size >= 2
    if not fits or not (np.isfinite(x).all() and np.isfinite(y).all()) or float(np.ptp(x)) == 0.0:
        raise ModelError("E-EVAL-LINE", "straightness", positions=x.size, deviations=y.size)
    slope, intercept = _LINES[reference](x, y)
    residual = y - intercept - slope * x
    return Straightness(
        reference=reference, slope=slope, intercept=intercept, residual=residual, value=float(np.ptp(residual))
    )


@dataclass(frozen=True, slots=True)
class StraightnessRun:
    """Mean deviations (m,) of a run at positions (m,), both in one unit, with what is known of its uncertainty.

    ``u`` (m,) are standard uncertainties of the means, None: from what the line leaves. ``direction_u`` is the standard
    uncertainty of the direction itself in rad: instrument, tilt of what carries the artefact.
    """

    positions: FloatArray
    deviations: FloatArray
    u: FloatArray | None = None
    direction_u: float = 0.0

    def direction(self) -> tuple[float, float]:
        """Slope of the least-squares line in rad, and its standard uncertainty. Raises ModelError (E-EVAL-LINE)."""
        found = straightness(self.positions, self.deviations, "lsq")
        own = slope_u(self.positions, found.residual) if self.u is None else slope_u_of(self.positions, self.u)
        return found.slope, hypot(own, self.direction_u)


def least_squares_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope and intercept (at x = 0) of the least-squares line."""
    centre = x - x.mean()
    slope = float(centre @ (y - y.mean()) / (centre @ centre))
    return slope, float(y.mean() - slope * x.mean())


def end_point_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope and intercept (at x = 0) of the line through the first and last position."""
    first, last = int(np.argmin(x)), int(np.argmax(x))
    slope = float((y[last] - y[first]) / (x[last] - x[first]))
    return slope, float(y[first] - slope * x[first])


def minimum_zone_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope of the narrowest pair of parallel lines; intercept of the line midway between them.

    The narrowest pair lies on an edge of the upper or lower convex hull, so every edge is tried.
    """
    slopes = [*_hull_slopes(x, y), *_hull_slopes(x, -y, -1.0)]
    widths = [float(np.ptp(y - slope * x)) for slope in slopes]
    slope = slopes[int(np.argmin(widths))]
    level = y - slope * x
    return slope, float((level.max() + level.min()) / 2.0)


def _hull_slopes(x: FloatArray, y: FloatArray, sign: float = 1.0) -> list[float]:
    order = np.lexsort((y, x))
    hull: list[tuple[float, float]] = []
    for px, py in zip(x[order], y[order], strict=True):
        if hull and px == hull[-1][0]:
            continue
        while len(hull) > 1 and _turns_right(hull[-2], hull[-1], (px, py)):
            hull.pop()
        hull.append((float(px), float(py)))
    return [sign * (b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(hull)]


def _turns_right(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0.0


_LINES = {"lsq": least_squares_line, "end-point": end_point_line, "minimum-zone": minimum_zone_line}


@dataclass(frozen=True, slots=True)
class Parallelism:
    """Slope of the first run less that of the second, deviation unit per position unit, and its U (k = 2)."""

    slope: float
    U: float

    def over(self, length: float) -> float:
        """The change of distance over a length, in the deviation unit."""
        return abs(self.slope) * length


def parallel(first: tuple[ArrayLike, ArrayLike], second: tuple[ArrayLike, ArrayLike]) -> Parallelism:
    """Slope of the first run less that of the second; U from what both lines leave (NaN with two positions only).

    Each run is (positions, deviations).
    """
    runs = [straightness(x, y, "lsq") for x, y in (first, second)]
    u = [slope_u(x, run.residual) for (x, _y), run in zip((first, second), runs, strict=True)]
    return Parallelism(runs[0].slope - runs[1].slope, COVERAGE * hypot(*u))


def slope_u(positions: ArrayLike, residual: FloatArray) -> float:
    """Standard uncertainty of a least-squares slope from its residuals (m,); NaN for m < 3."""
    x = np.asarray(positions, dtype=np.float64)
    free = x.size - 2
    centred = x - x.mean()
    return float(np.sqrt(residual @ residual / free / (centred @ centred))) if free > 0 else float("nan")


def slope_u_of(positions: ArrayLike, u: FloatArray) -> float:
    """Standard uncertainty of a least-squares slope from that of each deviation (m,)."""
    x = np.asarray(positions, dtype=np.float64)
    centred = x - x.mean()
    return float(np.sqrt(np.sum((centred * u) ** 2)) / (centred @ centred))


# ---- Squareness of two axes from straightness runs against a square, or from face diagonals (ISO 230-1, -6).
#
# Each arm of an optical or mechanical square is a straight line; a run along an axis reads the distance from it. With
# both readings counted *up towards the inside* of the square and positions counted away from its corner, slopes b1, b2:
#
#     angle between the positive axes - 90 deg = (angle of the square - 90 deg) - (b1 + b2)
#
# A reading that counts up away from the inside turns the sign of its slope, and so does a position that grows towards
# the corner. A maker's rule "90 deg + theta2 - theta1 + error of the square" is the case in which the first reading
# counts inwards and the second outwards (HP 5528A user's guide, section 21: the same numbers give -5.2 arcsec by it,
# and +2.0 arcsec where both count inwards). No file tells the senses, so they are asked. The reference line is
# stated: minimum zone, least squares and end points are all allowed by ISO 230-1, and differ by what the axes are not
# straight.


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
        return words("S-EVAL-ANGLE-RIGHT", first=first, second=second)
    larger = above_90_arcsec > 0.0
    word, side = ("larger", "-") if larger else ("smaller", "+")
    size = f"{abs(above_90_arcsec):.2f} arcsec"
    return words("S-EVAL-ANGLE-BETWEEN", first=first, second=second, word=word, size=size, side=side)


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
