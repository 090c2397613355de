"""The wheel's motion against the work along one prismatic axis, with its exact velocity (mm, rad).

Work points reach the wheel's frame by p = outer X(s) inner P, where only X depends on the stroke command s: the
axis' motion S if the axis carries the work, its inverse if it carries the wheel. S = trans(f) R with f = s d + t0 +
delta (errors moving) or trans(delta) R trans(s d + t0) (errors fixed).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.model import transforms
from gateway.model.chain import MOTIONS, Axis, Chain, Element, Positions, fold
from gateway.model.transforms import (
    Rotation,
    Vector,
    add,
    cross,
    rotation,
    rpy_rows,
    scale,
    sub,
    transpose,
    turn,
    vector,
)

STEP = 1e-4  # mm: half the base of the difference quotients of the error motions
ZERO = np.zeros(())
NOWHERE: Vector = (ZERO, ZERO, ZERO)


@dataclass(frozen=True, slots=True)
class Twist:
    """Linear and angular velocity of the wheel against the work per mm of command, in the wheel's frame."""

    v: Vector
    w: Vector

    def at(self, point: Vector) -> Vector:
        """Velocity of a point fixed to the wheel."""
        return add(self.v, cross(self.w, point))

    def seen(self, T: FloatArray) -> Twist:
        """The same twist in the frame into which T (..., 4, 4) carries: Ad(T)."""
        R, p = rotation(T[..., :3, :3]), vector(T[..., :3, 3])
        w = turn(R, self.w)
        return Twist(add(turn(R, self.v), cross(p, w)), w)


@dataclass(frozen=True, slots=True)
class StrokePose:
    """The stroke axis at given positions: its rotation R, path g, offset delta; twist and its derivative."""

    stroke: Stroke
    R: Rotation
    path: Vector
    offset: Vector
    twist: Twist
    rate: Twist

    def point(self, entered: Vector) -> Vector:
        """Entered work points (see `Stroke.enter`) in the wheel's frame."""
        outer = self.stroke.outer
        moved = self._back(entered) if self.stroke.on_tool else self._forth(entered)
        return add(turn(rotation(outer[..., :3, :3]), moved), vector(outer[..., :3, 3]))

    def direction(self, entered: Vector) -> Vector:
        """Entered work directions in the wheel's frame."""
        R = transpose(self.R) if self.stroke.on_tool else self.R
        return turn(rotation(self.stroke.outer[..., :3, :3]), turn(R, entered))

    def _forth(self, p: Vector) -> Vector:
        if self.stroke.moving:
            return add(turn(self.R, p), add(self.path, self.offset))
        return add(turn(self.R, add(p, self.path)), self.offset)

    def _back(self, p: Vector) -> Vector:
        if self.stroke.moving:
            return turn(transpose(self.R), sub(p, add(self.path, self.offset)))
        return sub(turn(transpose(self.R), sub(p, self.offset)), self.path)


@dataclass(frozen=True, slots=True)
class Stroke:
    """The chain split at one prismatic axis, every other axis standing still; made by `split`."""

    axis: Axis
    on_tool: bool
    inner: FloatArray
    outer: FloatArray

    @property
    def moving(self) -> bool:
        """True if the axis' errors ride with it."""
        return self.axis.err_frame == "moving"

    def enter(self, point: Vector, direction: Vector) -> tuple[Vector, Vector]:
        """Work points and directions as seen from the stroke axis, whatever the stroke."""
        R, shift = rotation(self.inner[..., :3, :3]), vector(self.inner[..., :3, 3])
        return add(turn(R, point), shift), turn(R, direction)

    def pose(self, s: FloatArray) -> StrokePose:
        """The axis at commands s (mm, any shape)."""
        value, first, second = self._errors(s)
        direction, shift = self.axis.path()
        d = vector(direction)
        path = add(scale(s, d), vector(shift))
        offset, R = (value[0], value[1], value[2]), rpy_rows(value[3], value[4], value[5])
        twist = self._twist(R, path, offset, _spin(value, first), (first[0], first[1], first[2]), d)
        rate = self._twist(R, path, offset, _spin(value, second), (second[0], second[1], second[2]), NOWHERE)
        return StrokePose(stroke=self, R=R, path=path, offset=offset, twist=twist, rate=rate)

    def _twist(self, R: Rotation, path: Vector, offset: Vector, spin: Vector, slip: Vector, d: Vector) -> Twist:
        """Body twist of S for the tool side; minus its bed twist for the work side; in the wheel's frame."""
        back = transpose(R)
        if self.moving:
            body = Twist(turn(back, add(slip, d)), spin)
        else:
            body = Twist(add(add(turn(back, slip), cross(spin, path)), d), spin)
        if self.on_tool:
            return body.seen(self.outer)
        shift = add(path, offset) if self.moving else add(turn(R, path), offset)
        w = turn(R, body.w)
        v = add(turn(R, body.v), cross(shift, w))
        return Twist(scale(-1.0, v), scale(-1.0, w)).seen(self.outer)

    def _errors(self, s: FloatArray) -> tuple[list[FloatArray], list[FloatArray], list[FloatArray]]:
        """Six error motions, first and second derivative by central differences; constants stay scalars."""
        nodes = np.stack([s - STEP, s, s + STEP])
        value, first, second = [], [], []
        for key in MOTIONS:
            if callable(self.axis.err.get(key)):
                below, at, above = self.axis.value(key, nodes)
                value.append(at)
                first.append((above - below) / (2.0 * STEP))
                second.append((above - 2.0 * at + below) / STEP**2)
            else:
                value.append(self.axis.value(key, ZERO))
                first.append(ZERO)
                second.append(ZERO)
        return value, first, second


def split(chain: Chain, name: str, q: Positions) -> Stroke:
    """The actual chain split at prismatic axis ``name``, all other axes standing at q (their errors included)."""
    axis = chain.axis(name)
    if axis.kind != "prismatic":
        raise ModelError("E-CHAIN-STROKE", f"axis {name}", name=name)
    on_tool = axis in chain.tool
    before, after = _about_axis(chain.tool if on_tool else chain.work, axis)
    other = fold(chain.work if on_tool else chain.tool, q, actual=True)
    first, last = fold(before, q, actual=True), fold(after, q, actual=True)
    if on_tool:
        return Stroke(axis, on_tool, transforms.inverse(first) @ other, transforms.inverse(last))
    return Stroke(axis, on_tool, last, transforms.inverse(other) @ first)


def _about_axis(side: tuple[Element, ...], axis: Axis) -> tuple[tuple[Element, ...], tuple[Element, ...]]:
    at = next(i for i, element in enumerate(side) if element is axis)
    return side[:at], side[at + 1 :]


def _spin(angles: list[FloatArray], rates: list[FloatArray]) -> Vector:
    """Body angular velocity of Rz(c) Ry(b) Rx(a) for rates (a', b', c')."""
    a, b = angles[3], angles[4]
    da, db, dc = rates[3:]
    sa, ca, cb = np.sin(a), np.cos(a), np.cos(b)
    return da - dc * np.sin(b), db * ca + dc * cb * sa, dc * cb * ca - db * sa
