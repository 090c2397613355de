"""Serial chains of axes on a work side and a tool side: where the wheel stands in the work (mm, rad).

T maps child coordinates to parent coordinates, T_WT = inv(T_bed^work) T_bed^wheel. A twist is (delta, epsilon),
delta taken at the frame's origin; frame "work": T_act = (I + hat) T_id, frame "wheel": T_act = T_id (I + hat).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.values import FloatArray
from gateway.errors import ModelError
from gateway.model import se3
from gateway.model.axis import LOCATIONS, MOTIONS, Axis, FixedLink, Motion

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
        return se3.inverse(fold(self.work, q, actual=False)) @ fold(self.tool, q, actual=False)

    def actual(self, q: Positions) -> FloatArray:
        """T_WT with every error, exact, (..., 4, 4)."""
        return se3.inverse(fold(self.work, q, actual=True)) @ fold(self.tool, q, actual=True)

    def exact_twist(self, q: Positions, frame: Frame = "work") -> FloatArray:
        """SE(3) logarithm of T_act inv(T_id) ("work") or inv(T_id) T_act ("wheel"), (..., 6)."""
        act, back = self.actual(q), se3.inverse(self.ideal(q))
        return se3.log(act @ back if _known(frame) == "work" else back @ act)

    def twist(self, q: Positions, frame: Frame = "work") -> FloatArray:
        """First-order relative twist by the adjoint formula, (..., 6)."""
        tool = [_share(axis, at, q) for axis, at in _walk(self.tool, q)]
        work = [-_share(axis, at, q) for axis, at in _walk(self.work, q)]
        bed = np.asarray(sum(tool + work))
        end = fold(self.work if _known(frame) == "work" else self.tool, q, actual=False)
        return se3.carry(se3.inverse(end), bed)

    def influences(self, q: Positions, frame: Frame = "work") -> tuple[Influence, ...]:
        """First-order influence of each axis' errors; to keep arrays small each has its own broadcast shape."""
        tool, work = fold(self.tool, q, actual=False), fold(self.work, q, actual=False)
        end = work if _known(frame) == "work" else tool
        base = se3.adjoint(se3.inverse(end))
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
    local = se3.apply(axis.location_twist(at), axis.location())
    if axis.err:
        error = axis.errors(at)
        local = local + (se3.carry(axis.ideal(at), error) if axis.err_frame == "moving" else error)
    return se3.carry(parent, local)


def _influence(axis: Axis, parent: FloatArray, base: FloatArray, q: Positions) -> Influence:
    """``base`` carries bed twists to the result frame, with the sign of the side."""
    at = position(q, axis.name)
    stator = base @ se3.adjoint(parent)
    moved = stator @ se3.adjoint(axis.ideal(at)) if axis.err_frame == "moving" else stator
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


def _known(frame: Frame) -> Frame:
    if frame not in ("work", "wheel"):
        raise ModelError("E-CHAIN-WORD", "chain", key="frame", value=frame, known="work, wheel")
    return frame
