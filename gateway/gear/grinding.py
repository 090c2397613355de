"""A cycloid disc on a form grinder: commands and tables, wheel section and surface (mm, rad).

The wheel's axis is Y of its frame, its centre stands at (E, 0, z) of the space's own frame. Its dressed axial
section is the space profile: y_w = y_g(theta), R = E - x_g(theta). Surface r_T = (-R cos beta, y, R sin beta), normal
n_T = (n_x cos beta, n_y, -n_x sin beta): the outward normal of the gear, inward to the wheel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message
from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear, DressingError
from gateway.model import transforms
from gateway.model.chain import Chain, Positions, position

ALIGNED = 1e-6  # rad and mm/mm: how exactly the ideal machine must be a form grinder
PROFILE_SAMPLES = 721


class ActingTable(Protocol):
    """What a control adds to one axis' command: a table, or a product of two. Plain data, sent to other processes."""

    @property
    def out(self) -> str:
        """Name of the axis whose command changes."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the axes at whose commands it is read."""

    def added(self, q: Positions) -> FloatArray:
        """What is added (mm or rad) where the commands are q, of the broadcast shape of its inputs."""


@dataclass(frozen=True)
class Grinding:
    """One gear on one machine at one centre distance E (mm), with the wheel's dressing and the tables that act.

    ``infeed``, ``stroke`` and ``index`` name the chain's axes; every other axis stands at ``rest`` (0 if not given).
    ``tables`` add to the commands; all are read at the commands as they are without them.
    Raises ModelError E-GEAR-GRINDER if the ideal chain cannot bring the wheel to Rz(2 pi k/z_c) trans(E, 0, z),
    E-GEAR-WHEEL if the wheel would not reach or not see the space.
    """

    chain: Chain
    gear: CycloidGear
    E: float
    dressing: DressingError = field(default_factory=DressingError)
    infeed: str = "X"
    stroke: str = "Z"
    index: str = "C"
    rest: Mapping[str, float] = field(default_factory=dict)
    tables: tuple[ActingTable, ...] = ()

    def __post_init__(self) -> None:
        tip = self.gear.limits().r_tip
        if not (np.isfinite(self.E) and tip < self.E):
            raise ModelError("E-GEAR-DISTANCE", "grinding", E=self.E, limit=tip)
        if not grindable(self.gear):
            raise ModelError("E-GEAR-HIDDEN", "grinding", zc=self.gear.zc)
        _ = self._map

    def commands(self, k: ArrayLike, z: ArrayLike) -> dict[str, FloatArray]:
        """Axis positions for spaces k and wheel heights z (mm) that broadcast together."""
        x0, sx, _, _, c0, sc = self._map
        q = {axis.name: np.asarray(self.rest.get(axis.name, 0.0)) for axis in self.chain.axes}
        angle = self.gear.space_angle(k)
        q[self.infeed] = np.asarray((self.E - x0) * sx)
        q[self.stroke] = self.stroke_command(np.asarray(z, dtype=np.float64))
        q[self.index] = (angle - c0) * sc
        return q

    def stroke_command(self, z: FloatArray) -> FloatArray:
        """Commands of the stroke axis that bring the wheel to heights z (mm) of the work."""
        return np.asarray((z - self._map[2]) * self._map[3])

    def corrected(self, q: Positions) -> Positions:
        """Commands q with what the tables add to them."""
        found = dict(q)
        for table in self.tables:
            found[table.out] = position(found, table.out) + table.added(q)
        return found

    def actual(self, q: Positions) -> FloatArray:
        """T_WT at commands q with every error and every table, exact, (..., 4, 4)."""
        return self.chain.actual(self.corrected(q))

    def twist(self, q: Positions) -> FloatArray:
        """The same to first order: relative twist (..., 6) in the work, errors and tables added up."""
        total = self.chain.twist(q)
        if self.tables:
            effects = {one.axis.name: one.command() for one in self.chain.influences(q)}
            for table in self.tables:
                total = total + effects[table.out] * table.added(q)[..., None]
        return total

    @property
    def stroke_sense(self) -> float:
        """+1 if the stroke command counts like the wheel's height z in the work, else -1."""
        return self._map[3]

    @property
    def senses(self) -> tuple[float, float, float]:
        """Sense of infeed, stroke and index: d E/d command, d z/d command, d angle/d command (each +-1)."""
        return self._map[1], self._map[3], self._map[5]

    @cached_property
    def _map(self) -> tuple[float, float, float, float, float, float]:
        return _grinder_map(self)


def grindable(gear: CycloidGear, theta: ArrayLike | None = None) -> bool:
    """Can a form wheel see the whole space (n_x > 0)? ``theta`` restricts the question to those points."""
    at = np.linspace(-gear.half_pitch, gear.half_pitch, PROFILE_SAMPLES) if theta is None else theta
    return bool(np.all(gear.section(at).nx > 0.0))


@dataclass(frozen=True, slots=True)
class WheelSection:
    """Dressed axial section: axial coordinate y and radius R (mm), with the gear's normal (n_x, n_y) there."""

    y: FloatArray
    R: FloatArray
    nx: FloatArray
    ny: FloatArray


def wheel_section(gear: CycloidGear, E: float, theta: ArrayLike, dressing: DressingError | None = None) -> WheelSection:
    """Axial section of the wheel that grinds the space at centre distance E: y = y_g, R = E - x_g."""
    s = (dressing or DressingError()).section(gear, np.asarray(theta, dtype=np.float64))
    R = E - s.x
    if np.any(R <= 0.0):
        raise ModelError("E-GEAR-DISTANCE", "wheel", E=E, limit=float(np.max(s.x)))
    return WheelSection(s.y, R, s.nx, s.ny)


def wheel_surface(section: WheelSection, beta: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Points and normals (..., 3) of the wheel in its own frame at angles beta (rad)."""
    c, s = np.cos(beta), np.sin(beta)
    point = np.stack(np.broadcast_arrays(-section.R * c, section.y, section.R * s), axis=-1)
    normal = np.stack(np.broadcast_arrays(section.nx * c, section.ny, -section.nx * s), axis=-1)
    return point, normal


def _grinder_map(g: Grinding) -> tuple[float, float, float, float, float, float]:
    """Offsets and senses (x0, sx, z0, sz, c0, sc) of E, z and the space angle as functions of the commands."""
    kinds = {g.infeed: "prismatic", g.stroke: "prismatic", g.index: "revolute"}
    for name, kind in kinds.items():
        if g.chain.axis(name).kind != kind:
            raise ModelError("E-GEAR-GRINDER", "grinding", why=Message.of("W-GEAR-AXIS-KIND", name=name, kind=kind))
    rest = {axis.name: float(g.rest.get(axis.name, 0.0)) for axis in g.chain.axes}
    base = {**rest, g.infeed: 0.0, g.stroke: 0.0, g.index: 0.0}
    zero = g.chain.ideal(base)
    c0 = float(np.arctan2(zero[1, 0], zero[0, 0]))
    turned = _turn(-c0)
    moves = [turned @ (g.chain.ideal({**base, name: 1.0})) for name in (g.infeed, g.stroke, g.index)]
    zero = turned @ zero
    sx, sz = (_sense(moves[i][:3, 3] - zero[:3, 3], i) for i in (0, 1))
    sc = float(np.sign(np.arctan2(moves[2][1, 0], moves[2][0, 0])))
    wanted = (zero[:3, :3] - np.eye(3), moves[0][:3, :3] - np.eye(3), moves[2] - _turn(sc) @ zero, zero[1, 3])
    if max(float(np.max(np.abs(part))) for part in wanted) > ALIGNED:
        raise ModelError("E-GEAR-GRINDER", "grinding", why=Message.of("W-GEAR-WHEEL-AXIS"))
    return float(zero[0, 3]), sx, float(zero[2, 3]), sz, c0, sc


def _sense(move: FloatArray, which: int) -> float:
    """+-1 for a unit move along x (infeed, 0) or z (stroke, 1)."""
    along = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])[which]
    sense = float(np.sign(move @ along))
    if sense == 0.0 or float(np.max(np.abs(move - sense * along))) > ALIGNED:
        raise ModelError(
            "E-GEAR-GRINDER", "grinding", why=Message.of("W-GEAR-DIRECTION", found=move.tolist(), wanted=along.tolist())
        )
    return sense


def _turn(angle: float) -> FloatArray:
    return transforms.rigid(transforms.rpy(0.0, 0.0, angle), np.zeros(3))
