"""One safeguarded Newton step of rays that meet the moving wheel, the wheel's angle eliminated (mm, rad)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.gear.cycloid import ProfileSection
from gateway.gear.grinding import Grinding
from gateway.gear.passage import Passage
from gateway.model.parts import Vector, add, cross, scale, sub
from gateway.model.stroke import STEP

LONGEST_STEP = 1.0  # mm of stroke in one step
SURE = 0.01  # mm: nearer than this to the profile point, the slope's sign tells on which side the valley lies
KINK = 4.0 * STEP  # mm: where the wheel's way has a kink, the difference quotients bend within half of this
FLATTEST = 0.05  # of the wheel's own curvature along the stroke: less is taken as this much


@dataclass(frozen=True, slots=True)
class FlankRays:
    """Nominal points and normals entered into the stroke's passage, flat arrays (N,)."""

    grinding: Grinding
    passage: Passage
    point: Vector
    normal: Vector

    def at(self, which: NDArray[np.bool_]) -> FlankRays:
        """Only the rays marked."""
        passage = self.passage.at(which)
        return replace(self, passage=passage, point=_pick(self.point, which), normal=_pick(self.normal, which))


@dataclass(frozen=True, slots=True)
class RayState:
    """Unknowns theta (rad), e (mm) and stroke height s (mm) with the bracket of s, flat arrays (N,)."""

    theta: FloatArray
    e: FloatArray
    s: FloatArray
    low: FloatArray
    high: FloatArray

    def at(self, which: NDArray[np.bool_]) -> RayState:
        """Only those marked."""
        return RayState(
            theta=self.theta[which], e=self.e[which], s=self.s[which], low=self.low[which], high=self.high[which]
        )


@dataclass(frozen=True, slots=True)
class _Seen:
    """The ray's end in wheel coordinates (axial, radial, around), with the wheel's velocity there.

    ``way`` is the ray's direction, ``speed`` the velocity of the wheel per mm of stroke, ``change`` its derivative.
    """

    y: FloatArray
    rho: FloatArray
    way: Vector
    speed: Vector
    change: Vector


def step(rays: FlankRays, state: RayState) -> tuple[RayState, FloatArray]:
    """One step for all rays; also (N,) how far e may have been from its end before the step (mm).

    Solves d_n + a de - f ds = 0 and f' = 0, f = n . v: e is least over s where f = 0. dn, dt are the distances of the
    ray's end from the profile point along its normal and tangent.
    """
    profile = rays.grinding.dressing.section(rays.grinding.gear, state.theta)
    seen = _look(rays, state)
    dn, dt = _on_profile(profile, seen.y - profile.y, seen.rho - (rays.grinding.E - profile.x))
    f, slide = _on_profile(profile, seen.speed[0], seen.speed[1])
    a, way_t = _on_profile(profile, seen.way[0], seen.way[1])
    bend, _ = _on_profile(profile, seen.change[0], seen.change[1] - seen.speed[2] ** 2 / seen.rho)
    turning = profile.curvature * slide
    across = turning * way_t - profile.nx * seen.way[2] * seen.speed[2] / seen.rho
    pull = f + turning * dt - across * dn / a
    grade = np.maximum(bend - turning * slide + across * f / a, FLATTEST * profile.nx / seen.rho)
    low, high = _bracket(state, pull, np.abs(dn) + np.abs(dt) < SURE)
    ds = _inside(state.s, -pull / grade, low, high)
    de = (f * ds - dn) / a
    dtheta = (dt + way_t * de - slide * ds) / profile.speed
    left = np.abs(de) + grade * ds**2 + np.abs(profile.curvature) * dt**2
    return RayState(theta=state.theta + dtheta, e=state.e + de, s=state.s + ds, low=low, high=high), left


def residual(rays: FlankRays, state: RayState) -> FloatArray:
    """What `step` brings to zero, (3, N): distances along normal and tangent (mm), and n . v (mm/mm)."""
    profile = rays.grinding.dressing.section(rays.grinding.gear, state.theta)
    seen = _look(rays, state)
    dn, dt = _on_profile(profile, seen.y - profile.y, seen.rho - (rays.grinding.E - profile.x))
    f, _ = _on_profile(profile, seen.speed[0], seen.speed[1])
    return np.stack([dn, dt, f])


def _look(rays: FlankRays, state: RayState) -> _Seen:
    grinding, sense = rays.grinding, rays.grinding.stroke_sense
    pose = rays.passage.pose(grinding.stroke_command(state.s))
    p = pose.point(add(rays.point, scale(state.e, rays.normal)))
    velocity = scale(sense, pose.twist.at(p))
    change = sub(pose.rate.at(p), scale(sense, cross(pose.twist.w, velocity)))
    rho = np.hypot(p[0], p[2])
    c, s = -p[0] / rho, p[2] / rho
    way = _around(pose.direction(rays.normal), c, s)
    return _Seen(p[1], rho, way, _around(velocity, c, s), _around(change, c, s))


def _around(v: Vector, c: FloatArray, s: FloatArray) -> Vector:
    """Axial, radial and circumferential parts of a vector at wheel angle beta (c = cos, s = sin)."""
    return v[1], s * v[2] - c * v[0], s * v[0] + c * v[2]


def _on_profile(profile: ProfileSection, axial: FloatArray, radial: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parts along the profile's normal (n_y, -n_x) and tangent (n_x, n_y) of the (y, rho) plane."""
    return axial * profile.ny - radial * profile.nx, axial * profile.nx + radial * profile.ny


def _bracket(state: RayState, pull: FloatArray, sure: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    left, right = sure & (pull < 0.0), sure & (pull > 0.0)
    return np.where(left, state.s, state.low), np.where(right, state.s, state.high)


def _inside(s: FloatArray, ds: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The Newton step, shortened; halving the bracket where the step would leave it, and about a kink."""
    ds = np.clip(ds, -LONGEST_STEP, LONGEST_STEP)
    out = (s + ds < low) | (s + ds > high) | (high - low < KINK)
    if np.any(out):
        both = np.isfinite(low) & np.isfinite(high)
        half = 0.5 * np.add(low, high, out=np.zeros_like(s), where=both)
        ds = np.where(out, np.where(both, half, np.clip(s + ds, low, high)) - s, ds)
    return ds


def _pick(v: Vector, which: NDArray[np.bool_]) -> Vector:
    return v[0][which], v[1][which], v[2][which]
