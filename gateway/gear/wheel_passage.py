"""The wheel's passage along the stroke past one space: only the stroke axis moves, or with tables any axis (mm, rad).

Its contact line is where wheel and tooth touch at one position.

Without tables it is `gateway.model.stroke`, where every other axis stands. A table over the stroke moves other axes
with it, so the whole chain is worked out at the corrected commands, its velocity by central differences: like the
error motions there, and as exact, for an error of the velocity counts by its square.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import ProfileSection
from gateway.gear.grinding import Grinding, wheel_section, wheel_surface
from gateway.model import transforms
from gateway.model.chain import Positions, position
from gateway.model.stroke import STEP, Stroke, StrokePose, Twist, split
from gateway.model.transforms import Rotation, Vector, add, cross, rotation, scale, sub, transpose, turn, vector


@dataclass(frozen=True, slots=True)
class TabledPose:
    """The wheel in the work, T_WT, at given positions of the stroke; twist and its derivative as in `StrokePose`."""

    R: Rotation
    shift: Vector
    twist: Twist
    rate: Twist

    def point(self, entered: Vector) -> Vector:
        """Work points in the wheel's frame."""
        return turn(transpose(self.R), sub(entered, self.shift))

    def direction(self, entered: Vector) -> Vector:
        """Work directions in the wheel's frame."""
        return turn(transpose(self.R), entered)


@dataclass(frozen=True, slots=True)
class TabledStroke:
    """A stroke on which tables act; ``standing`` are the commands of every axis, the stroke's own counting nothing."""

    grinding: Grinding
    standing: Positions

    def enter(self, point: Vector, direction: Vector) -> tuple[Vector, Vector]:
        """Work points and directions as they are: nothing stands still between the work and the stroke."""
        return point, direction

    def pose(self, s: FloatArray) -> TabledPose:
        """The wheel at commands s (mm) of the stroke axis, of a shape that broadcasts with the standing commands."""
        below, at, above = self.grinding.actual(
            {**self.standing, self.grinding.stroke: np.stack([s - STEP, s, s + STEP])}
        )
        back = transforms.inverse(at)
        first = back @ (above - below) / (2.0 * STEP)
        second = back @ (above - 2.0 * at + below) / STEP**2 - first @ first
        return TabledPose(rotation(at[..., :3, :3]), vector(at[..., :3, 3]), _twist(first), _twist(second))

    def spread(self, shape: tuple[int, ...]) -> TabledStroke:
        """For points of that shape, flattened."""
        flat = {name: _flat(np.asarray(q), shape) for name, q in self.standing.items()}
        return replace(self, standing=flat)

    def at(self, which: NDArray[np.bool_]) -> TabledStroke:
        """Only for the points marked."""
        return replace(self, standing={name: np.asarray(q)[which] for name, q in self.standing.items()})


@dataclass(frozen=True, slots=True)
class PlainStroke:
    """A stroke without tables: the stroke axis alone moves."""

    stroke: Stroke

    def enter(self, point: Vector, direction: Vector) -> tuple[Vector, Vector]:
        """Work points and directions as seen from the stroke axis."""
        return self.stroke.enter(point, direction)

    def pose(self, s: FloatArray) -> StrokePose:
        """The axis at commands s (mm)."""
        return self.stroke.pose(s)

    def spread(self, shape: tuple[int, ...]) -> PlainStroke:
        """For points of that shape, flattened."""
        outer = self.stroke.outer
        if outer.ndim == 2:
            return self
        return PlainStroke(replace(self.stroke, outer=np.broadcast_to(outer, (*shape, 4, 4)).reshape(-1, 4, 4)))

    def at(self, which: NDArray[np.bool_]) -> PlainStroke:
        """Only for the points marked."""
        outer = self.stroke.outer
        return self if outer.ndim == 2 else PlainStroke(replace(self.stroke, outer=outer[which]))


Passage = PlainStroke | TabledStroke


def passage(grinding: Grinding, k: ArrayLike) -> Passage:
    """The stroke past spaces k."""
    q = grinding.commands(k, 0.0)
    if grinding.tables:
        return TabledStroke(grinding, q)
    return PlainStroke(split(grinding.chain, grinding.stroke, q))


def _twist(change: FloatArray) -> Twist:
    """Linear and angular part of (..., 4, 4) = inv(T) dT/ds."""
    turning = 0.5 * (change[..., :3, :3] - np.swapaxes(change[..., :3, :3], -1, -2))
    return Twist(vector(change[..., :3, 3]), (turning[..., 2, 1], turning[..., 0, 2], turning[..., 1, 0]))


def _flat(q: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    return np.broadcast_to(q, shape).ravel()


@dataclass(frozen=True, slots=True)
class ContactLine:
    """Where wheel and tooth touch at one stroke position: beta (...,), points and normals (..., 3) in the work."""

    beta: FloatArray
    points: FloatArray
    normals: FloatArray


def contact_line(grinding: Grinding, k: ArrayLike, s: ArrayLike, theta: ArrayLike) -> ContactLine:
    """Contact points of the actual machine at stroke s (mm): n_W . d r_W/ds = 0, solved in closed form.

    k, s and theta broadcast together. All contact lines of a stroke together are the actual flank.
    """
    section = wheel_section(grinding.gear, grinding.E, theta, grinding.dressing)
    q = grinding.commands(k, s)
    beta = contact_condition(grinding, k, s, theta).angle()
    point, normal = wheel_surface(section, beta)
    T = grinding.actual(q)
    return ContactLine(beta, transforms.move(T, point), transforms.apply(T[..., :3, :3], normal))


@dataclass(frozen=True, slots=True)
class ContactCondition:
    """n . (v + w x r) of the wheel's surface as a function of its angle: a cos beta + b sin beta + c, mm per mm."""

    a: FloatArray
    b: FloatArray
    c: FloatArray

    def spread(self, shape: tuple[int, ...]) -> ContactCondition:
        """The same for every place of that shape."""
        a, b, c = (np.broadcast_to(one, shape) for one in (self.a, self.b, self.c))
        return ContactCondition(a, b, c)

    def at(self, beta: ArrayLike) -> FloatArray:
        """Its value at wheel angles (rad) that broadcast with it; zero where wheel and tooth touch."""
        return np.asarray(self.a * np.cos(beta) + self.b * np.sin(beta) + self.c)

    def angle(self) -> FloatArray:
        """The angle (rad) nearest to 0 where it is zero. Raises ModelError E-GEAR-CONTACT where it never is."""
        size = np.hypot(self.a, self.b)
        if np.any(size <= np.abs(self.c)):
            raise ModelError("E-GEAR-CONTACT", "grinding", count=int(np.count_nonzero(size <= np.abs(self.c))))
        sense = np.where(self.b < 0.0, 1.0, -1.0)
        return np.asarray(np.arctan2(sense * self.a, -sense * self.b) + np.arcsin(sense * self.c / size))


def contact_condition(grinding: Grinding, k: ArrayLike, s: ArrayLike, theta: ArrayLike) -> ContactCondition:
    """The contact condition of the actual machine at stroke s (mm) for profile angles; k, s and theta broadcast."""
    section = wheel_section(grinding.gear, grinding.E, theta, grinding.dressing)
    q = grinding.commands(k, s)
    twist = passage(grinding, k).pose(position(q, grinding.stroke)).twist
    v, w = twist.v, twist.w
    return ContactCondition(
        a=section.nx * (v[0] - w[2] * section.y) - section.ny * w[2] * section.R,
        b=-section.nx * (v[2] + w[0] * section.y) - section.ny * w[0] * section.R,
        c=section.ny * v[1],
    )


# ---- One safeguarded Newton step of rays that meet the moving wheel, the wheel's angle eliminated (mm, rad).

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
class _RayEnd:
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


def _look(rays: FlankRays, state: RayState) -> _RayEnd:
    grinding, sense = rays.grinding, rays.grinding.stroke_sense
    pose = rays.passage.pose(grinding.stroke_command(state.s))
    p = pose.point(add(rays.point, scale(state.e, rays.normal)))
    velocity = scale(sense, pose.twist.at(p))
    change = sub(pose.rate.at(p), scale(sense, cross(pose.twist.w, velocity)))
    rho = np.hypot(p[0], p[2])
    c, s = -p[0] / rho, p[2] / rho
    way = _cylindrical_parts(pose.direction(rays.normal), c, s)
    return _RayEnd(p[1], rho, way, _cylindrical_parts(velocity, c, s), _cylindrical_parts(change, c, s))


def _cylindrical_parts(v: Vector, c: FloatArray, s: FloatArray) -> Vector:
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
