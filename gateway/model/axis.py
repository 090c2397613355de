"""One element of a chain: a fixed link, or an axis with its six error motions and its location error (mm, rad).

An axis is L M E (errors "moving" with it) or L E M (errors "fixed" to its stator): M its motion, E =
trans(dx, dy, dz) Rz(ec) Ry(eb) Rx(ea) taken at its own position, L its location error. The location error of a
prismatic axis tilts and shifts the path only; of a revolute axis it is trans(X0, Y0, Z0) Rz(C0) Ry(B0) Rx(A0).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.model import se3

Motion = float | Callable[[FloatArray], FloatArray]

MOTIONS = ("dx", "dy", "dz", "ea", "eb", "ec")
LOCATIONS = ("X0", "Y0", "Z0", "A0", "B0", "C0")
SMALLEST_DIRECTION = 1e-9
LARGEST_SHIFT = 1.0  # mm, of an error motion
LARGEST_TILT = 0.5  # rad: what is larger is a wrong unit or another machine, not an error


@dataclass(frozen=True, slots=True)
class FixedLink:
    """A fixed joint: trans(xyz) Rz(c) Ry(b) Rx(a), mm and rad."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    abc: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "xyz", _vector("xyz", self.xyz, "link"))
        object.__setattr__(self, "abc", _vector("abc", self.abc, "link"))

    def matrix(self) -> FloatArray:
        """The joint's homogeneous matrix (4, 4)."""
        return se3.rigid(se3.rpy(*self.abc), np.asarray(self.xyz))


@dataclass(frozen=True, slots=True)
class Axis:
    """One moving axis with its errors; ``direction`` is made a unit vector.

    ``err`` maps dx, dy, dz (mm) and ea, eb, ec (rad) to a constant or to a function of the axis' own position
    (mm or rad, array in, array out). ``loc`` maps X0, Y0, Z0 (mm) and A0, B0, C0 (rad) to numbers.
    Raises ModelError E-CHAIN-... for what is not an axis.
    """

    name: str
    kind: Literal["prismatic", "revolute"]
    direction: tuple[float, float, float]
    err: Mapping[str, Motion] = field(default_factory=dict)
    loc: Mapping[str, float] = field(default_factory=dict)
    err_frame: Literal["moving", "fixed"] = "moving"

    def __post_init__(self) -> None:
        where = f"axis {self.name}"
        if not self.name.isidentifier():
            raise ModelError("E-CHAIN-NAME", where, name=self.name)
        _one_of("kind", self.kind, ("prismatic", "revolute"), where)
        _one_of("err_frame", self.err_frame, ("moving", "fixed"), where)
        _errors_sound(self.err, self.loc, where)
        unit = np.asarray(_vector("axis", self.direction, where))
        size = float(np.linalg.norm(unit))
        if size < SMALLEST_DIRECTION:
            raise ModelError("E-CHAIN-DIRECTION", where, direction=self.direction)
        object.__setattr__(self, "direction", tuple((unit / size).tolist()))

    @property
    def vector(self) -> FloatArray:
        """Unit direction (3,) in the parent's frame."""
        return np.asarray(self.direction)

    def ideal(self, q: FloatArray) -> FloatArray:
        """Motion without errors at positions (...), shape (..., 4, 4)."""
        if self.kind == "prismatic":
            return se3.trans(q[..., None] * self.vector)
        return se3.rigid(se3.about(self.vector, q), np.zeros(3))

    def actual(self, q: FloatArray) -> FloatArray:
        """Motion with all errors, exact, at positions (...), shape (..., 4, 4)."""
        motion = self._path(q) if self.kind == "prismatic" else self.ideal(q)
        if self.err:
            error = error_matrix(self.errors(q))
            motion = motion @ error if self.err_frame == "moving" else error @ motion
        return motion if self.kind == "prismatic" else error_matrix(self.location()) @ motion

    def small_angle(self, q: FloatArray) -> FloatArray:
        """Motion with all errors, each error matrix I + hat(e), at positions (...), shape (..., 4, 4): no rotation."""
        if self.kind == "prismatic":
            location = self.location()
            direction = self.vector + se3.hat(location[3:]) @ self.vector
            motion = se3.trans(q[..., None] * direction + location[:3])
        else:
            motion = self.ideal(q)
        if self.err:
            error = small_error_matrix(self.errors(q))
            motion = motion @ error if self.err_frame == "moving" else error @ motion
        return motion if self.kind == "prismatic" else small_error_matrix(self.location()) @ motion

    def errors(self, q: FloatArray) -> FloatArray:
        """The six error motions at positions (...): (..., 6) = dx, dy, dz (mm), ea, eb, ec (rad)."""
        out = np.zeros((*q.shape, 6))
        for key in self.err:
            out[..., MOTIONS.index(key)] = self.value(key, q)
        return out

    def value(self, key: str, q: FloatArray) -> FloatArray:
        """One error motion (dx .. ec) at positions (...), same shape; checked to be finite."""
        motion = self.err.get(key, 0.0)
        if not callable(motion):
            return np.full(q.shape, float(motion))
        value = np.asarray(motion(q), dtype=np.float64)
        if value.shape not in (q.shape, ()) or not np.all(np.isfinite(value)):
            raise ModelError("E-CHAIN-MOTION", f"axis {self.name}", motion=key, shape=value.shape, wanted=q.shape)
        if key in MOTIONS[:3] and float(np.max(np.abs(value), initial=0.0)) > LARGEST_SHIFT:
            largest = float(np.max(np.abs(value)))
            raise ModelError("E-CHAIN-SHIFT", f"axis {self.name}", key=key, value=largest, limit=LARGEST_SHIFT)
        return np.broadcast_to(value, q.shape)

    def location(self) -> FloatArray:
        """The location error (6,) = X0, Y0, Z0 (mm), A0, B0, C0 (rad)."""
        return np.array([float(self.loc.get(key, 0.0)) for key in LOCATIONS])

    def location_twist(self, q: FloatArray) -> FloatArray:
        """What each location error does in the parent's frame to first order: (..., 6, 6), column per error."""
        out = np.zeros((*q.shape, 6, 6))
        out[...] = np.eye(6)
        if self.kind == "prismatic":
            out[..., :3, 3:] = -q[..., None, None] * se3.hat(self.vector)
            out[..., 3:, 3:] = 0.0
        return out

    def path(self) -> tuple[FloatArray, FloatArray]:
        """Tilted direction (3,) and shift (3,) of a prismatic axis: it moves by q times the one plus the other."""
        location = self.location()
        return se3.rpy(location[3], location[4], location[5]) @ self.vector, location[:3]

    def _path(self, q: FloatArray) -> FloatArray:
        direction, shift = self.path()
        return se3.trans(q[..., None] * direction + shift)


def error_matrix(e: FloatArray) -> FloatArray:
    """E = trans(dx, dy, dz) Rz(ec) Ry(eb) Rx(ea) of (..., 6), shape (..., 4, 4)."""
    return se3.rigid(se3.rpy(e[..., 3], e[..., 4], e[..., 5]), e[..., :3])


def small_error_matrix(e: FloatArray) -> FloatArray:
    """I + [[0, -ec, eb, dx], [ec, 0, -ea, dy], [-eb, ea, 0, dz], [0, 0, 0, 0]] of (..., 6), shape (..., 4, 4)."""
    return se3.rigid(np.eye(3) + se3.hat(e[..., 3:]), e[..., :3])


def _errors_sound(err: Mapping[str, Motion], loc: Mapping[str, float], where: str) -> None:
    for key in err:
        _one_of("err", key, MOTIONS, where)
    for key in loc:
        _one_of("loc", key, LOCATIONS, where)
    constants = {key: value for key, value in err.items() if not callable(value)}
    numbers = {**constants, **loc}
    _finite("err and loc", numbers.values(), where)
    for key, value in numbers.items():
        if key[0] in "eABC" and abs(float(value)) > LARGEST_TILT:
            raise ModelError("E-CHAIN-TILT", where, key=key, value=value, limit=LARGEST_TILT)
    for key, value in constants.items():
        if key in MOTIONS[:3] and abs(float(value)) > LARGEST_SHIFT:
            raise ModelError("E-CHAIN-SHIFT", where, key=key, value=value, limit=LARGEST_SHIFT)


def _vector(key: str, value: object, where: str) -> tuple[float, float, float]:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ModelError("E-CHAIN-NUMBER", where, key=key, value=value) from error
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ModelError("E-CHAIN-NUMBER", where, key=key, value=value)
    x, y, z = array.tolist()
    return (x, y, z)


def _finite(key: str, values: Iterable[object], where: str) -> None:
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating)) or not np.isfinite(value):
            raise ModelError("E-CHAIN-NUMBER", where, key=key, value=value)


def _one_of(key: str, value: object, known: Collection[str], where: str) -> None:
    if value not in known:
        raise ModelError("E-CHAIN-WORD", where, key=key, value=value, known=", ".join(known))
