"""Location of a rotary axis, position and orientation by ISO 230-1 letters, from artefact runs by least squares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import rad_to_arcsec
from gateway.domain import FloatArray
from gateway.errors import ModelError, NotIdentifiable

RotaryAxis = Literal["A", "B", "C"]
# Cyclic order (u, v, w): w is the axis; it leans as direction (+rotation about v, -rotation about u, 1).
FRAMES: Mapping[str, tuple[str, str, str]] = {"C": ("X", "Y", "Z"), "A": ("Y", "Z", "X"), "B": ("Z", "X", "Y")}
ROTATION = {"X": "A", "Y": "B", "Z": "C"}


@dataclass(frozen=True, slots=True)
class Circle:
    """Least-squares circle: centre (u, v), radius, residuals (k,) off it, covariance (3, 3) of u, v, radius."""

    u: float
    v: float
    radius: float
    residual: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True)
class Location:
    """Where an axis is: mm at the height asked for, arcsec for its lean; ``U`` (k = 2) by the same names.

    For C: EX0C, EY0C position, EA0C, EB0C orientation: the centre moves with height by X = EB0C z, Y = -EA0C z.
    """

    axis: RotaryAxis
    values: Mapping[str, float]
    U: Mapping[str, float] = field(default_factory=dict)
    flags: tuple[str, ...] = ()


def circle(points_mm: ArrayLike, u_mm: float | None = None) -> Circle:
    """The least-squares circle (geometric distances) through points (k, 2) of a partial or whole turn.

    A ball's radius and a tool's setting error go into the radius only. ``u_mm``: standard uncertainty of one
    coordinate; None takes it from the residuals. Raises NotIdentifiable (E-EVAL-CIRCLE).
    """
    p = np.asarray(points_mm, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 2 or p.shape[0] < 3 or not np.isfinite(p).all():
        raise NotIdentifiable("E-EVAL-CIRCLE", "circle", points=p.shape)
    found = _algebraic(p)
    for _ in range(50):
        design, off = _linearised(p, found)
        step = np.linalg.lstsq(design, off, rcond=None)[0]
        found = found + step
        if float(np.abs(step).max()) < 1e-12 * max(1.0, found[2]):
            break
    design, off = _linearised(p, found)
    free = max(p.shape[0] - 3, 1)
    variance = float(off @ off) / free if u_mm is None else u_mm**2
    u, v, radius = (float(value) for value in found)
    return Circle(u, v, radius, off, np.asarray(variance * np.linalg.inv(design.T @ design), dtype=np.float64))


def _algebraic(p: FloatArray) -> FloatArray:
    centre = p.mean(axis=0)
    q = p - centre
    design = np.column_stack([2.0 * q, np.ones(len(q))])
    if np.linalg.cond(design / max(float(np.abs(q).max()), 1e-300)) > 1e8 or not np.ptp(q, axis=0).any():
        raise NotIdentifiable("E-EVAL-CIRCLE", "circle", points=p.shape)
    a, b, c = np.linalg.lstsq(design, (q**2).sum(axis=1), rcond=None)[0]
    return np.array([centre[0] + a, centre[1] + b, np.sqrt(c + a**2 + b**2)])


def _linearised(p: FloatArray, found: FloatArray) -> tuple[FloatArray, FloatArray]:
    away = p - found[:2]
    distance = np.hypot(away[:, 0], away[:, 1])
    return np.column_stack([away / distance[:, None], np.ones(len(p))]), distance - found[2]


def from_ball(
    axis: RotaryAxis,
    runs: Sequence[tuple[float, ArrayLike]],
    *,
    height_mm: float = 0.0,
    u_mm: float | None = None,
) -> Location:
    """Location from ball (or bore) positions while the axis turns: runs of (height, points (k, 3) x y z in mm).

    Each run's centre is a least-squares circle in the plane across the axis; two heights or more also give the
    lean, as a straight line through the centres, and the position at `height_mm`. One height: position only.
    Raises NotIdentifiable (E-EVAL-CIRCLE), ModelError (E-EVAL-LOCATION).
    """
    u, v, _w = _frame(axis)
    columns = ["XYZ".index(u), "XYZ".index(v)]
    if not runs:
        raise ModelError("E-EVAL-LOCATION", "location", axis=axis, why="no run")
    rings = [circle(_three(points, axis)[:, columns], u_mm) for _height, points in runs]
    heights = np.array([height for height, _points in runs], dtype=np.float64)
    centres = np.array([(ring.u, ring.v) for ring in rings])
    variances = np.array([np.diag(ring.covariance)[:2] for ring in rings])
    return _located(axis, heights, centres, variances, height_mm)


def _three(points: ArrayLike, axis: str) -> FloatArray:
    p = np.asarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3:
        raise ModelError("E-EVAL-LOCATION", "location", axis=axis, why=f"points of shape {p.shape}, not (k, 3)")
    return p


def _frame(axis: str) -> tuple[str, str, str]:
    if axis not in FRAMES:
        raise ModelError("E-EVAL-LOCATION", "location", axis=axis, why="the axis is none of A, B, C")
    return FRAMES[axis]


def _located(axis: RotaryAxis, heights: FloatArray, centres: FloatArray, variances: FloatArray, at: float) -> Location:
    u, v, _w = _frame(axis)
    if np.ptp(heights) == 0.0:
        where, spread = centres.mean(axis=0), variances.mean(axis=0) / len(heights)
        values = {f"E{u}0{axis}": float(where[0]), f"E{v}0{axis}": float(where[1])}
        U = {name: 2.0 * float(np.sqrt(var)) for name, var in zip(values, spread, strict=True)}
        return Location(axis, values, U, ("one height: no orientation",))
    lines = [_line(heights - at, centres[:, i], variances[:, i]) for i in (0, 1)]
    (u0, u_slope, u_cov), (v0, v_slope, v_cov) = lines
    values = {
        f"E{u}0{axis}": u0,
        f"E{v}0{axis}": v0,
        f"E{ROTATION[u]}0{axis}": rad_to_arcsec(-v_slope),
        f"E{ROTATION[v]}0{axis}": rad_to_arcsec(u_slope),
    }
    sigmas = (u_cov[0], v_cov[0], rad_to_arcsec(v_cov[1]), rad_to_arcsec(u_cov[1]))
    U = {name: 2.0 * float(sigma) for name, sigma in zip(values, sigmas, strict=True)}
    return Location(axis, values, U, () if len(heights) > 2 else ("two heights: straightness of the axis is not seen",))


def _line(h: FloatArray, y: FloatArray, variance: FloatArray) -> tuple[float, float, tuple[float, float]]:
    """Weighted line: value at h = 0, slope, and their standard uncertainties."""
    weight = 1.0 / np.sqrt(np.maximum(variance, 1e-30))
    design = np.column_stack([np.ones_like(h), h]) * weight[:, None]
    found = np.linalg.lstsq(design, y * weight, rcond=None)[0]
    sigma = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    return float(found[0]), float(found[1]), (float(sigma[0]), float(sigma[1]))


def from_bar(
    axis: RotaryAxis,
    heights_mm: ArrayLike,
    first_um: tuple[ArrayLike, ArrayLike],
    second_um: tuple[ArrayLike, ArrayLike],
) -> Location:
    """Orientation against the linear axis along it, from indicator runs up a test bar.

    ``first_um``, ``second_um``: coordinate of the bar's surface (k,) along the first (C: X) and second (C: Y)
    cross direction, each as two runs with the rotary axis at 0 and 180 deg; their mean is free of the bar's
    own lean and run-out. Includes the straightness and squareness of the linear axis that carried the indicator.
    """
    u, v, _w = _frame(axis)
    h = np.asarray(heights_mm, dtype=np.float64)
    slopes = [_reversed_slope(h, runs, axis) for runs in (first_um, second_um)]
    values = {
        f"E{ROTATION[u]}0{axis}": rad_to_arcsec(-slopes[1][0]),
        f"E{ROTATION[v]}0{axis}": rad_to_arcsec(slopes[0][0]),
    }
    U = {name: 2.0 * rad_to_arcsec(slopes[i][1]) for name, i in zip(values, (1, 0), strict=True)}
    return Location(axis, values, U, ("orientation only, against the linear axis along it",))


def _reversed_slope(h: FloatArray, runs: tuple[ArrayLike, ArrayLike], axis: str) -> tuple[float, float]:
    """Slope (rad) of the mean of both runs and its standard uncertainty from the residuals."""
    one, two = (np.asarray(run, dtype=np.float64) for run in runs)
    if h.ndim != 1 or h.size < 2 or one.shape != h.shape or two.shape != h.shape or np.ptp(h) == 0.0:
        why = f"runs of {one.size} and {two.size} readings at {h.size} heights"
        raise ModelError("E-EVAL-LOCATION", "location", axis=axis, why=why)
    y = (one + two) / 2000.0
    centred = h - h.mean()
    power = float(centred @ centred)
    slope = float(centred @ y) / power
    residual = y - y.mean() - slope * centred
    free = h.size - 2
    return slope, float(np.sqrt(residual @ residual / free / power)) if free else float("nan")
