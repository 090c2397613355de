"""Measured points against the nominal flank: their space, profile angle and normal deviation (mm, rad)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear

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
        raise ModelError("E-GEAR-POINT", "inspection", worst="not a number", limit=FURTHEST)
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
