"""How far along a ray the wheel begins: rays into the wheel's body, pose by pose, and the deepest of them (mm).

A ray starts at a point of the work and runs out of the material. In a pose's wheel frame its end q(e) lies outside
the wheel while F(e) = hypot(q_x, q_z) - R(q_y) > 0; the wheel begins where F = 0. What stays of the material is
the least such e over all poses: the most advanced pose has taken the rest. Poses are samples of a motion; between
them e is smooth in time, so the least value is the vertex of a parabola through the least sample and its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simulators.grinding.lobes import Rays
from simulators.grinding.wheel import WheelBody

FloatArray = NDArray[np.float64]
NEWTON = 5
RUINED_MM = -1.0
FACING = -0.05


@dataclass(frozen=True, slots=True)
class Poses:
    """The wheel in the work's frame over a stretch of motion: times (n,), rotations (n, 3, 3), origins (n, 3).

    ``shift`` (n,) is where the dressed profile sits along the wheel's axis, mm.
    """

    times: FloatArray
    rotation: FloatArray
    origin: FloatArray
    shift: FloatArray

    def part(self, which: slice | NDArray[np.bool_]) -> Poses:
        """Some of them."""
        return Poses(self.times[which], self.rotation[which], self.origin[which], self.shift[which])

    def moved(self, along_mm: float) -> Poses:
        """The same with the dressed profile moved along the wheel's axis."""
        return replace(self, shift=self.shift + along_mm) if along_mm else self


def deepest(body: WheelBody, poses: Poses, rays: Rays) -> FloatArray:
    """Least e over one pass of the wheel, (m,) mm; inf where the wheel never came near a ray."""
    rough = _estimate(body, poses, rays)
    best = np.argmin(rough, axis=0)
    last = len(poses.times) - 1
    around = np.clip(best + np.asarray([[-1], [0], [1]]), 0, last)
    start = np.take_along_axis(rough, around, axis=0)
    exact = _solved(body, poses, rays, around, start)
    least = _vertex(poses.times[around], exact)
    whole = np.all(np.isfinite(exact), axis=0) & (best > 0) & (best < last)
    return np.asarray(np.where(whole, least, np.min(exact, axis=0)))


def _estimate(body: WheelBody, poses: Poses, rays: Rays) -> FloatArray:
    """One Newton step from the ray's start at every pose, (n, m)."""
    point = (rays.points[None] - poses.origin[:, None]) @ poses.rotation
    way = rays.directions[None] @ poses.rotation
    value, slope = _outside(body, point, way, poses.shift[:, None])
    return _stepped(np.zeros_like(value), value, slope)


def _outside(body: WheelBody, q: FloatArray, way: FloatArray, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
    """F and dF/de for ends q (..., 3) that move along `way`."""
    rho = np.hypot(q[..., 0], q[..., 2])
    radius, grade = body.radius(q[..., 1] - shift)
    moving = (q[..., 0] * way[..., 0] + q[..., 2] * way[..., 2]) / rho
    return rho - radius, moving - grade * way[..., 1]


def _stepped(e: FloatArray, value: FloatArray, slope: FloatArray) -> FloatArray:
    facing = slope < FACING
    step = value / np.where(facing, slope, -1.0)
    return np.asarray(np.where(facing, np.maximum(e - step, RUINED_MM), np.inf))


def _solved(body: WheelBody, poses: Poses, rays: Rays, which: NDArray[np.int64], e: FloatArray) -> FloatArray:
    """The entry at these poses of each ray, which (3, m), from a first estimate."""
    turned = poses.rotation[which]
    point = np.einsum("pmi,pmij->pmj", rays.points[None] - poses.origin[which], turned)
    way = np.einsum("mi,pmij->pmj", rays.directions, turned)
    shift = poses.shift[which]
    for _ in range(NEWTON):
        known = np.where(np.isfinite(e), e, 0.0)
        value, slope = _outside(body, point + known[..., None] * way, way, shift)
        e = np.where(np.isfinite(e), _stepped(known, value, slope), np.inf)
    return e


def _vertex(t: FloatArray, e: FloatArray) -> FloatArray:
    """The least value of the parabolas through three samples (3, m), the middle one being the least."""
    left, right = t[0] - t[1], t[2] - t[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (e[0] - e[1]) / left, (e[2] - e[1]) / right
        bend = (high - low) / (right - left)
        grade = low - bend * left
        drop = grade**2 / (4.0 * bend)
        drop = np.where(np.isfinite(drop) & (bend > 0.0), drop, 0.0)
    return np.asarray(e[1] - drop)
