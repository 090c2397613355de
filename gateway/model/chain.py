"""Serial chains of axes with their error motions and location errors: where the wheel is in the work (mm, rad).

An axis is L M E (errors "moving" with it) or L E M (errors "fixed" to its stator): M its motion, E =
trans(dx, dy, dz) Rz(ec) Ry(eb) Rx(ea) taken at its own position, L its location error. The location error of a
prismatic axis tilts and shifts the path only; of a revolute axis it is trans(X0, Y0, Z0) Rz(C0) Ry(B0) Rx(A0).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message
from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.model import transforms

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
        return transforms.rigid(transforms.rpy(*self.abc), np.asarray(self.xyz))


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
        _check_choice("kind", self.kind, ("prismatic", "revolute"), where)
        _check_choice("err_frame", self.err_frame, ("moving", "fixed"), where)
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
            return transforms.trans(q[..., None] * self.vector)
        return transforms.rigid(transforms.about(self.vector, q), np.zeros(3))

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
            direction = self.vector + transforms.hat(location[3:]) @ self.vector
            motion = transforms.trans(q[..., None] * direction + location[:3])
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
            out[..., :3, 3:] = -q[..., None, None] * transforms.hat(self.vector)
            out[..., 3:, 3:] = 0.0
        return out

    def path(self) -> tuple[FloatArray, FloatArray]:
        """Tilted direction (3,) and shift (3,) of a prismatic axis: it moves by q times the one plus the other."""
        location = self.location()
        return transforms.rpy(location[3], location[4], location[5]) @ self.vector, location[:3]

    def _path(self, q: FloatArray) -> FloatArray:
        direction, shift = self.path()
        return transforms.trans(q[..., None] * direction + shift)


def error_matrix(e: FloatArray) -> FloatArray:
    """E = trans(dx, dy, dz) Rz(ec) Ry(eb) Rx(ea) of (..., 6), shape (..., 4, 4)."""
    return transforms.rigid(transforms.rpy(e[..., 3], e[..., 4], e[..., 5]), e[..., :3])


def small_error_matrix(e: FloatArray) -> FloatArray:
    """I + [[0, -ec, eb, dx], [ec, 0, -ea, dy], [-eb, ea, 0, dz], [0, 0, 0, 0]] of (..., 6), shape (..., 4, 4)."""
    return transforms.rigid(np.eye(3) + transforms.hat(e[..., 3:]), e[..., :3])


def _errors_sound(err: Mapping[str, Motion], loc: Mapping[str, float], where: str) -> None:
    for key in err:
        _check_choice("err", key, MOTIONS, where)
    for key in loc:
        _check_choice("loc", key, LOCATIONS, where)
    constants = {key: value for key, value in err.items() if not callable(value)}
    numbers = {**constants, **loc}
    _finite(Message.of("W-MODEL-ERR-LOC"), numbers.values(), where)
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


def _finite(key: str | Message, values: Iterable[object], where: str) -> None:
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating)) or not np.isfinite(value):
            raise ModelError("E-CHAIN-NUMBER", where, key=key, value=value)


def _check_choice(key: str, value: object, known: Collection[str], where: str) -> None:
    if value not in known:
        raise ModelError("E-CHAIN-WORD", where, key=key, value=value, known=", ".join(known))


# ---- Serial chains of axes on a work side and a tool side: where the wheel stands in the work (mm, rad).
#
# T maps child coordinates to parent coordinates, T_WT = inv(T_bed^work) T_bed^wheel. A twist is (delta, epsilon),
# delta taken at the frame's origin; frame "work": T_act = (I + hat) T_id, frame "wheel": T_act = T_id (I + hat).

Positions = Mapping[str, ArrayLike]
Frame = Literal["work", "wheel"]
Element = Axis | FixedLink

LETTERS = ("X", "Y", "Z", "A", "B", "C")


@dataclass(frozen=True, slots=True)
class Influence:
    """First-order effect of one axis' errors on the relative pose, by the adjoint formula.

    ``motions`` and ``location`` (..., 6, 6): column j is the twist per unit of error motion j (dx, dy, dz, ea,
    eb, ec) or of location error j (X0, Y0, Z0, A0, B0, C0).
    """

    axis: Axis
    q: FloatArray
    motions: FloatArray
    location: FloatArray

    def command(self) -> FloatArray:
        """Twist per mm or rad added to the axis' own command, (..., 6)."""
        unit = np.zeros(6)
        unit[slice(0, 3) if self.axis.kind == "prismatic" else slice(3, 6)] = self.axis.vector
        return np.asarray(self.location @ unit)


@dataclass(frozen=True, slots=True)
class Chain:
    """A machine: elements from the bed outward to the work, and from the bed outward to the wheel.

    Positions ``q`` map every axis name to numbers or arrays (mm or rad) of shapes that broadcast together;
    results carry that shape in front. Raises ModelError E-CHAIN-... for a malformed chain or a missing position.
    """

    work: tuple[Element, ...]
    tool: tuple[Element, ...]

    def __post_init__(self) -> None:
        names = [axis.name for axis in self.axes]
        if not names:
            raise ModelError("E-CHAIN-EMPTY", "chain")
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ModelError("E-CHAIN-TWICE", "chain", names=", ".join(twice))

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The moving axes, work side first, from the bed outward."""
        return tuple(element for element in (*self.work, *self.tool) if isinstance(element, Axis))

    def axis(self, name: str) -> Axis:
        """The axis of that name."""
        for axis in self.axes:
            if axis.name == name:
                return axis
        raise ModelError("E-CHAIN-AXIS", "chain", name=name, known=", ".join(a.name for a in self.axes))

    def ideal(self, q: Positions) -> FloatArray:
        """T_WT without errors, (..., 4, 4)."""
        return transforms.inverse(fold(self.work, q, actual=False)) @ fold(self.tool, q, actual=False)

    def actual(self, q: Positions) -> FloatArray:
        """T_WT with every error, exact, (..., 4, 4)."""
        return transforms.inverse(fold(self.work, q, actual=True)) @ fold(self.tool, q, actual=True)

    def exact_twist(self, q: Positions, frame: Frame = "work") -> FloatArray:
        """SE(3) logarithm of T_act inv(T_id) ("work") or inv(T_id) T_act ("wheel"), (..., 6)."""
        act, back = self.actual(q), transforms.inverse(self.ideal(q))
        return transforms.log(act @ back if _check_axes(frame) == "work" else back @ act)

    def twist(self, q: Positions, frame: Frame = "work") -> FloatArray:
        """First-order relative twist by the adjoint formula, (..., 6)."""
        tool = [_share(axis, at, q) for axis, at in _walk(self.tool, q)]
        work = [-_share(axis, at, q) for axis, at in _walk(self.work, q)]
        bed = np.asarray(sum(tool + work))
        end = fold(self.work if _check_axes(frame) == "work" else self.tool, q, actual=False)
        return transforms.carry(transforms.inverse(end), bed)

    def influences(self, q: Positions, frame: Frame = "work") -> tuple[Influence, ...]:
        """First-order influence of each axis' errors; to keep arrays small each has its own broadcast shape."""
        tool, work = fold(self.tool, q, actual=False), fold(self.work, q, actual=False)
        end = work if _check_axes(frame) == "work" else tool
        base = transforms.adjoint(transforms.inverse(end))
        work_side = [_influence(axis, at, -base, q) for axis, at in _walk(self.work, q)]
        return (*work_side, *(_influence(axis, at, base, q) for axis, at in _walk(self.tool, q)))

    def with_errors(self, errors: Mapping[str, Motion]) -> Chain:
        """The same machine with errors set by their ISO 230-1 names, e.g. {"EXX": 0.005, "B0Z": 1e-5}."""
        wanted: dict[str, dict[str, Motion]] = {}
        for name, motion in errors.items():
            axis, key = self.error_place(name)
            wanted.setdefault(axis, {})[key] = motion
        return self._each(lambda axis: _with(axis, wanted.get(axis.name, {})))

    def without_errors(self) -> Chain:
        """The same machine, perfect."""
        return self._each(lambda axis: replace(axis, err={}, loc={}))

    def error_names(self) -> tuple[str, ...]:
        """ISO 230-1 names of all error motions and location errors this machine can have."""
        motions = [f"E{letter}{axis.name}" for axis in self.axes for letter in LETTERS]
        return (*motions, *(f"{key}{axis.name}" for axis in self.axes for key in LOCATIONS))

    def error_place(self, name: str) -> tuple[str, str]:
        """Axis name and key of an error: EXC -> (C, dx), B0Z -> (Z, B0)."""
        for axis in self.axes:
            if name.startswith("E") and name[1:2] in LETTERS and name[2:] == axis.name:
                return axis.name, MOTIONS[LETTERS.index(name[1])]
            if name[:2] in LOCATIONS and name[2:] == axis.name:
                return axis.name, name[:2]
        raise ModelError("E-CHAIN-ERROR-NAME", "chain", name=name, known=", ".join(a.name for a in self.axes))

    def error_column(self, name: str) -> tuple[str, str, int]:
        """Axis name, key and column in `Influence` of an error by its ISO 230-1 name."""
        axis, key = self.error_place(name)
        return axis, key, (MOTIONS if key in MOTIONS else LOCATIONS).index(key)

    def _each(self, change: Callable[[Axis], Axis]) -> Chain:
        def of(side: tuple[Element, ...]) -> tuple[Element, ...]:
            return tuple(change(element) if isinstance(element, Axis) else element for element in side)

        return Chain(of(self.work), of(self.tool))


def fold(side: tuple[Element, ...], q: Positions, *, actual: bool) -> FloatArray:
    """Product of the elements of one side, (..., 4, 4), with or without their errors."""
    T = np.eye(4)
    for element in side:
        if isinstance(element, FixedLink):
            T = T @ element.matrix()
        else:
            at = position(q, element.name)
            T = T @ (element.actual(at) if actual else element.ideal(at))
    return T


def position(q: Positions, name: str) -> FloatArray:
    """The positions given for one axis, as an array; ModelError E-CHAIN-POSITION if there are none."""
    at = np.asarray(q.get(name, np.nan), dtype=np.float64)
    if not np.all(np.isfinite(at)):
        raise ModelError("E-CHAIN-POSITION", f"axis {name}", name=name, given=", ".join(q))
    return at


def _walk(side: tuple[Element, ...], q: Positions) -> Iterator[tuple[Axis, FloatArray]]:
    """Each axis of one side with the ideal pose of its parent in the bed frame."""
    T = np.eye(4)
    for element in side:
        if isinstance(element, FixedLink):
            T = T @ element.matrix()
        else:
            yield element, T
            T = T @ element.ideal(position(q, element.name))


def _share(axis: Axis, parent: FloatArray, q: Positions) -> FloatArray:
    """First-order twist of one axis' errors in the bed frame, (..., 6)."""
    at = position(q, axis.name)
    local = transforms.apply(axis.location_twist(at), axis.location())
    if axis.err:
        error = axis.errors(at)
        local = local + (transforms.carry(axis.ideal(at), error) if axis.err_frame == "moving" else error)
    return transforms.carry(parent, local)


def _influence(axis: Axis, parent: FloatArray, base: FloatArray, q: Positions) -> Influence:
    """``base`` carries bed twists to the result frame, with the sign of the side."""
    at = position(q, axis.name)
    stator = base @ transforms.adjoint(parent)
    moved = stator @ transforms.adjoint(axis.ideal(at)) if axis.err_frame == "moving" else stator
    return Influence(axis, at, moved, stator @ axis.location_twist(at))


def _with(axis: Axis, values: Mapping[str, Motion]) -> Axis:
    motions = {key: value for key, value in values.items() if key in MOTIONS}
    location = dict(axis.loc)
    for key, value in values.items():
        if key in LOCATIONS:
            if callable(value):
                raise ModelError("E-CHAIN-NUMBER", f"axis {axis.name}", key=key, value="a function")
            location[key] = value
    return replace(axis, err={**axis.err, **motions}, loc=location)


def _check_axes(frame: Frame) -> Frame:
    if frame not in ("work", "wheel"):
        raise ModelError("E-CHAIN-WORD", "chain", key="frame", value=frame, known="work, wheel")
    return frame
