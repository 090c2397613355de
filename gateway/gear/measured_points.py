"""What an inspection machine touched as points of the nominal flank: frame, numbers and sides checked (mm, rad).

How far the part was turned when it was clamped is taken off the places of the points, not of their deviations: a flank
turned under the probe shows its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.message import Message, digits, fixed
from drivers.types.gears import GearInspection
from drivers.types.values import FloatArray
from drivers.units import UM_PER_MM
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_figure

# ---- Measured points against the nominal flank: their space, profile angle and normal deviation (mm, rad).

TABLE_POINTS = 121
NEWTON_STEPS = 20
CHUNK = 16384  # points looked at together
CONVERGED = 1e-13  # rad
FURTHEST = 1.0  # mm: a point further from every flank was not measured on this gear


@dataclass(frozen=True, slots=True)
class FlankPoints:
    """Points by their foot on the nominal flank: space k, profile angle theta, height z, deviation e (+ surplus)."""

    k: FloatArray
    theta: FloatArray
    z: FloatArray
    deviation: FloatArray


def flank_points(gear: CycloidGear, xyz: ArrayLike) -> FlankPoints:
    """Feet and normal deviations of measured points (N, 3) in the gear's frame (axis z, space 0 towards +x), in mm.

    Raises ModelError E-GEAR-POINT if points are not finite or lie more than `FURTHEST` from the flank.
    """
    points = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)
    if not np.all(np.isfinite(points)):
        raise ModelError("E-GEAR-POINT", "inspection", worst=Message.of("W-GEAR-NOT-NUMBER"), limit=FURTHEST)
    pitch = 2.0 * gear.half_pitch
    k = np.round(np.arctan2(points[:, 1], points[:, 0]) / pitch)
    turn = -k * pitch
    x = np.cos(turn) * points[:, 0] - np.sin(turn) * points[:, 1]
    y = np.sin(turn) * points[:, 0] + np.cos(turn) * points[:, 1]
    parts = [_foot(gear, x[i : i + CHUNK], y[i : i + CHUNK]) for i in range(0, x.size, CHUNK)]
    theta, deviation = (np.concatenate([part[which] for part in parts] or [x]) for which in (0, 1))
    worst = float(np.max(np.abs(deviation), initial=0.0))
    if worst > FURTHEST:
        raise ModelError("E-GEAR-POINT", "inspection", worst=worst, limit=FURTHEST)
    return FlankPoints(np.mod(k, gear.zc), theta, points[:, 2], deviation)


def _foot(gear: CycloidGear, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """theta of the nearest profile point and the signed distance along its normal."""
    table = np.linspace(-1.1 * gear.half_pitch, 1.1 * gear.half_pitch, TABLE_POINTS)
    coarse = gear.section(table)
    nearest = np.argmin((x[:, None] - coarse.x) ** 2 + (y[:, None] - coarse.y) ** 2, axis=1)
    theta = table[nearest]
    side = np.sign(theta) if gear.drot else np.ones_like(theta)
    for _ in range(NEWTON_STEPS):
        s = gear.section(theta)
        dn, dt = (x - s.x) * s.nx + (y - s.y) * s.ny, (y - s.y) * s.nx - (x - s.x) * s.ny
        move = dt / (s.speed * np.maximum(1.0 + s.curvature * dn, 0.1))
        theta = theta + move
        if gear.drot:
            theta = np.where(side * theta < 0.0, side * 1e-12, theta)
        if np.max(np.abs(move), initial=0.0) < CONVERGED:
            break
    s = gear.section(theta)
    return theta, (x - s.x) * s.nx + (y - s.y) * s.ny


Heights = Literal["lower-face", "middle"]
BESIDE_MM = 0.1  # beyond the face: edges are no sharper
NOMINAL_MM = 0.05  # from our nominal flank, of points that are called nominal
LEVEL_MM = 0.05  # heights nearer than this are one: no flank changes over less
SIDES = 0.01  # of the points, next to the bottom, may seem to lie on the other flank


@dataclass(frozen=True, slots=True)
class TouchedPoints:
    """Points with heights z from the middle of the face; spaces as the gear counts them, ``shift`` more than written.

    ``turned`` (rad) is what the part was turned by, and is turned back.
    """

    points: FlankPoints
    shift: int
    turned: float


def touched_points(gear: CycloidGear, found: GearInspection, heights: Heights = "lower-face") -> TouchedPoints:
    """Points of an inspection by their foot on the nominal flank.

    ``heights`` says what the inspection counts its heights from. Deviations are the machine's own where it gives
    them, its points are the nominal ones then. Raises ModelError: E-INSPECT-EMPTY, E-GEAR-POINT, E-INSPECT-HEIGHT,
    E-INSPECT-NOMINAL, E-INSPECT-NUMBERS, E-INSPECT-SIDES.
    """
    if not len(found):
        raise ModelError("E-INSPECT-EMPTY", found.source or "inspection")
    xyz = np.asarray(found.points_mm, dtype=np.float64) - _zero(gear, heights)
    points = flank_points(gear, xyz)
    _check_heights(gear, points.z, heights)
    if found.deviation_um is not None:
        xyz = _moved_out(gear, points, found.deviation_um)
        points = flank_points(gear, xyz)
    shift = _shift(gear, points.k, found.space)
    _check_sides(points.theta, found.flank)
    turned = flank_figure(points.deviation, gear.section(points.theta).h).rotation
    points = flank_points(gear, _turned_back(xyz, turned))
    return TouchedPoints(replace(points, z=_levels(points.z)), shift, turned)


def _zero(gear: CycloidGear, heights: Heights) -> FloatArray:
    """Where the middle of the face lies in the inspection's frame."""
    return np.array([0.0, 0.0, 0.5 * gear.b if heights == "lower-face" else 0.0])


def _check_heights(gear: CycloidGear, z: FloatArray, heights: Heights) -> None:
    reach = 0.5 * gear.b + BESIDE_MM
    if float(np.max(np.abs(z))) > reach:
        low, high = f"{np.min(z):.2f}", f"{np.max(z):.2f}"
        raise ModelError("E-INSPECT-HEIGHT", "inspection", heights=heights, low=low, high=high, reach=fixed(reach, 2))


def _moved_out(gear: CycloidGear, points: FlankPoints, deviation_um: FloatArray) -> FloatArray:
    """Where the machine's own deviations put its nominal points, (N, 3)."""
    far = float(np.max(np.abs(points.deviation)))
    if far > NOMINAL_MM or not np.all(np.isfinite(deviation_um)):
        raise ModelError("E-INSPECT-NOMINAL", "inspection", far=fixed(far, 3), limit=digits(NOMINAL_MM, 6))
    section = gear.space(points.theta, points.k)
    e = np.asarray(deviation_um, dtype=np.float64) / UM_PER_MM
    return np.column_stack([section.x + e * section.nx, section.y + e * section.ny, points.z])


def _turned_back(xyz: FloatArray, by: float) -> FloatArray:
    cos, sin = np.cos(by), np.sin(by)
    x, y, z = xyz.T
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, z])


def _shift(gear: CycloidGear, k: FloatArray, written: NDArray[np.int64]) -> int:
    """How many spaces further round the gear a number lies than the inspection says; the same for all points."""
    apart = np.mod(k - written, gear.zc).astype(np.int64)
    shift = int(np.bincount(apart).argmax())
    if np.any(apart != shift):
        count = int(np.count_nonzero(apart != shift))
        raise ModelError("E-INSPECT-NUMBERS", "inspection", count=count, spaces=gear.zc)
    return shift


def _check_sides(theta: FloatArray, flank: NDArray[np.int64]) -> None:
    """The left flank of a space is its counter-clockwise side, theta > 0."""
    wrong = int(np.count_nonzero(np.sign(theta) != flank))
    if wrong > SIDES * theta.size:
        raise ModelError("E-INSPECT-SIDES", "inspection", count=wrong, points=theta.size)


def _levels(z: FloatArray) -> FloatArray:
    """Heights with those of one line made one: each group's mean."""
    order = np.argsort(z, kind="stable")
    group, first = np.zeros(z.size, dtype=np.intp), z[order[0]]
    for place, index in enumerate(order[1:], start=1):
        new = z[index] - first > LEVEL_MM
        first = z[index] if new else first
        group[order[place]] = group[order[place - 1]] + new
    return np.asarray((np.bincount(group, weights=z) / np.bincount(group))[group])
