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
from gateway.gear.grinding import Grinding, WheelSection, wheel_section, wheel_surface
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
    beta = contact_angle(section, passage(grinding, k).pose(position(q, grinding.stroke)).twist)
    point, normal = wheel_surface(section, beta)
    T = grinding.actual(q)
    return ContactLine(beta, se3.move(T, point), se3.apply(T[..., :3, :3], normal))


def contact_angle(section: WheelSection, twist: Twist) -> FloatArray:
    """beta of the contact condition n . (v + w x r) = 0, i.e. a cos beta + b sin beta + c = 0, nearest to 0."""
    v, w = twist.v, twist.w
    a = section.nx * (v[0] - w[2] * section.y) - section.ny * w[2] * section.R
    b = -section.nx * (v[2] + w[0] * section.y) - section.ny * w[0] * section.R
    c = section.ny * v[1]
    size = np.hypot(a, b)
    if np.any(size <= np.abs(c)):
        raise ModelError("E-GEAR-CONTACT", "grinding", count=int(np.count_nonzero(size <= np.abs(c))))
    sense = np.where(b < 0.0, 1.0, -1.0)
    return np.asarray(np.arctan2(sense * a, -sense * b) + np.arcsin(sense * c / size))
