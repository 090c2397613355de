"""Serial chains of prismatic and revolute axes: where the wheel really stands in the work (mm, rad).

T maps child coordinates to parent coordinates; T_WT = inv(T_bed^work) T_bed^wheel. One axis is
L M E (errors "moving" with it) or L E M ("fixed" to its stator), M its motion, E = trans(dx, dy, dz) Rz(ec)
Ry(eb) Rx(ea) its six error motions at its own position, L its location error. A prismatic location error
tilts and shifts the path only; a revolute one is trans(X0, Y0, Z0) Rz(C0) Ry(B0) Rx(A0).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.types import FloatArray
from gateway.errors import ModelError
from gateway.model import se3

Motion = float | Callable[[FloatArray], FloatArray]
Positions = Mapping[str, ArrayLike]
Frame = Literal["work", "wheel"]

MOTIONS = ("dx", "dy", "dz", "ea", "eb", "ec")
LOCATIONS = ("X0", "Y0", "Z0", "A0", "B0", "C0")
KINDS = ("prismatic", "revolute")
FRAMES = ("moving", "fixed")


@dataclass(frozen=True, slots=True)
class Link:
    """A fixed joint: trans(xyz) Rz(c) Ry(b) Rx(a), mm and rad."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    abc: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _vector("xyz", self.xyz, "link")
        _vector("abc", self.abc, "link")

    def matrix(self) -> FloatArray:
        """The joint's homogeneous matrix (4, 4)."""
        return se3.rigid(se3.rpy(*self.abc), np.asarray(self.xyz, dtype=np.float64))


@dataclass(frozen=True, slots=True)
class Axis:
    """One moving axis with its errors.

    ``direction`` is made a unit vector. ``err`` maps dx, dy, dz (mm) and ea, eb, ec (rad) to a constant or to
    a function of the own position (mm or rad, any shape). ``loc`` maps X0, Y0, Z0 (mm), A0, B0, C0 (rad).
    """

    name: str
    kind: Literal["prismatic", "revolute"]
    direction: tuple[float, float, float]
    err: Mapping[str, Motion] = field(default_factory=dict)
    loc: Mapping[str, float] = field(default_factory=dict)
    err_frame: Literal["moving", "fixed"] = "moving"

    def __post_init__(self) -> None:
        where = f"axis {self.name}"
        _one_of("kind", self.kind, KINDS, where)
        _one_of("err_frame", self.err_frame, FRAMES, where)
        for key in self.err:
            _one_of("err", key, MOTIONS, where)
        for key in self.loc:
            _one_of("loc", key, LOCATIONS, where)
        _finite("loc", list(self.loc.values()), where)
        _finite("err", [value for value in self.err.values() if not callable(value)], where)
        unit = _vector("axis", self.direction, where)
        size = float(np.linalg.norm(unit))
        if size < 1e-9:
            raise ModelError("E-CHAIN-DIRECTION", where)
        object.__setattr__(self, "direction", tuple(float(v) for v in unit / size))

    def errors(self, q: FloatArray) -> FloatArray:
        """The six error motions (..., 6) = dx, dy, dz (mm), ea, eb, ec (rad) at positions (...)."""
        out = np.zeros((*q.shape, 6))
        for row, key in enumerate(MOTIONS):
            if key in self.err:
                out[..., row] = self._value(key, q)
        return out

    def location(self) -> FloatArray:
        """The location errors (6,) = X0, Y0, Z0 (mm), A0, B0, C0 (rad)."""
        return np.array([float(self.loc.get(key, 0.0)) for key in LOCATIONS])

    def ideal(self, q: FloatArray) -> FloatArray:
        """Motion without errors, (..., 4, 4)."""
        d = np.asarray(self.direction)
        if self.kind == "prismatic":
            return se3.trans(q[..., None] * d)
        return se3.rigid(se3.about(d, q), np.zeros(3))

    def actual(self, q: FloatArray) -> FloatArray:
        """Motion with all its errors, exact, (..., 4, 4)."""
        motion, error = self._located(q), self.error_matrix(q)
        located, before = (motion, se3.trans(np.zeros(3))) if self.kind == "prismatic" else motion_pair(self, q)
        return before @ (located @ error if self.err_frame == "moving" else error @ located)

    def error_matrix(self, q: FloatArray) -> FloatArray:
        """E = trans(dx, dy, dz) Rz(ec) Ry(eb) Rx(ea), (..., 4, 4)."""
        if not self.err:
            return np.eye(4)
        e = self.errors(q)
        return se3.rigid(se3.rpy(e[..., 3], e[..., 4], e[..., 5]), e[..., :3])
