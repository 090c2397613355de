"""Straightness about the end-point, least-squares or minimum-zone line (ISO 230-1), and parallelism."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import hypot
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain.values import COVERAGE, FloatArray
from gateway.errors import ModelError
from gateway.evaluate.standards.readings import numbers

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
