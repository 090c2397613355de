"""The wheel's motion against the work along one prismatic axis, with its exact velocity (mm, rad).

T_WT = B(s) A^-1 is split at the stroke axis, so that points of the work are carried to the wheel by
p = outer S(s) inner P, where only S depends on the stroke. S is the axis' motion (axis on the work side) or its
inverse (tool side). Vectors are kept as three separate arrays: each keeps the smallest shape that holds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.types import FloatArray
from gateway.model.axis import MOTIONS, Axis

Part = FloatArray | float
Vector = tuple[Part, Part, Part]
Matrix = tuple[Vector, Vector, Vector]

STEP = 1e-4  # mm: half the base of the difference quotients of the error motions


@dataclass(frozen=True, slots=True)
class Ray:
    """A work point moved by the chain: position, direction and velocities in the wheel's frame, as arrays.

    ``v``, ``w`` is the wheel's twist (body frame, per mm of command) against the work; ``dv``, ``dw`` its derivative.
    """

    point: Vector
    direction: Vector
    v: Vector
    w: Vector
    dv: Vector
    dw: Vector


@dataclass(frozen=True, slots=True)
class Stroke:
    """The split chain at fixed positions of all other axes; make it with `split`."""

    axis: Axis
    on_tool: bool
    inner: FloatArray
    outer: FloatArray

    def enter(self, point: FloatArray, direction: FloatArray) -> tuple[Vector, Vector]:
        """Work points and directions (..., 3) as seen from the stroke axis: done once, whatever the stroke."""
        rotation, shift = _parts(self.inner)
        p, u = _vector(point), _vector(direction)
        return add(turn(rotation, p), shift), turn(rotation, u)

    def carry(self, point: Vector, direction: Vector, s: FloatArray) -> Ray:
        """Entered points and directions seen from the wheel at stroke positions s (mm, any shape)."""
        e, e1, e2 = self._errors(s)
        R = _rpy(e[3], e[4], e[5])
        motion = _Moving(self.axis, self.on_tool, s, (e[0], e[1], e[2]), R)
        spin, slip = _body(R, e, e1)
        v, w = motion.twist(slip, spin)
        dw, dv = _body(R, e, e2)
        dv, dw = motion.rate(dv, dw)
        rotation, shift = _parts(self.outer)
        out = add(turn(rotation, motion.point(point)), shift)
        way = turn(rotation, motion.direction(direction))
        v, w = _frame(rotation, shift, v, w)
        dv, dw = _frame(rotation, shift, dv, dw)
        return Ray(out, way, v, w, dv, dw)

    def _errors(self, s: FloatArray) -> tuple[list[Part], list[Part], list[Part]]:
        """The six error motions, their first and second derivatives by central differences; constants stay scalar."""
        values: list[Part] = []
        first: list[Part] = []
        second: list[Part] = []
        three = None
        for key in MOTIONS:
            motion = self.axis.err.get(key, 0.0)
            if not callable(motion):
                for out, value in ((values, float(motion)), (first, 0.0), (second, 0.0)):
                    out.append(value)
                continue
            three = np.stack([s - STEP, s, s + STEP]) if three is None else three
            below, at, above = self.axis.value(key, three)
            values.append(at)
            first.append((above - below) / (2.0 * STEP))
            second.append((above - 2.0 * at + below) / STEP**2)
        return values, first, second
