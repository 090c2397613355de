"""Reference lines of a run, and what of it is datum, squareness and straightness (never counted twice)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain import FloatArray
from gateway.errors import ModelError


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


@dataclass(frozen=True, slots=True)
class StraightnessSplit:
    """Offset (value of the line at q = 0: datum), slope (squareness) and residual (m,): the error motion."""

    reference: str
    offset: float
    slope: float
    residual: FloatArray


def split_straightness(
    positions: ArrayLike, values: ArrayLike, reference: Literal["lsq", "ends"] = "lsq"
) -> StraightnessSplit:
    """Take the line out of a straightness run; LSQ and end-point slopes differ, so the record says which.

    Raises ModelError (E-MODEL-POINTS) without two different positions.
    """
    q, v = np.asarray(positions, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if q.shape != v.shape or q.size < 2 or float(np.ptp(q)) == 0.0:
        raise ModelError("E-MODEL-POINTS", "straightness", points=q.size, unknowns=2)
    slope, offset = (least_squares_line if reference == "lsq" else end_point_line)(q, v)
    return StraightnessSplit(reference, offset, slope, v - offset - slope * q)
