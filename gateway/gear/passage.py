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
from gateway.gear.grinding import Grinding, wheel_section, wheel_surface
from gateway.model import se3
from gateway.model.chain import Positions, position
from gateway.model.parts import Rotation, Vector, rotation, sub, transpose, turn, vector
from gateway.model.stroke import STEP, Stroke, StrokePose, Twist, split


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
        back = se3.inverse(at)
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
    return ContactLine(beta, se3.move(T, point), se3.apply(T[..., :3, :3], normal))


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
