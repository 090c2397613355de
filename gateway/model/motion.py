"""Error motions as functions of an axis' own position in mm and rad: from plain data or from fitted components."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.message import Message
from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, deg_to_rad, rad_to_deg, um_to_mm
from gateway.domain.figures import Component
from gateway.errors import ModelError
from gateway.model.chain import Motion
from gateway.model.components import KnownRange, value

FULL_TURN = 2.0 * np.pi
SAME = 1e-6  # of a turn
WIDEST_GAP = FULL_TURN / 6.0
NEXT_GAP = 1.5  # the last gap of a turn may be so much wider than the widest other one
ENDS_ALIKE = 0.1  # of all that an axis deviates by: places a turn apart may differ by warmth and instruments


@dataclass(frozen=True, slots=True)
class Polynomial:
    """sum c_i ((q - q0) / scale)^i."""

    c: tuple[float, ...]
    q0: float = 0.0
    scale: float = 1.0

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        x = (q - self.q0) / self.scale
        total = np.full_like(x, self.c[-1])
        for coefficient in self.c[-2::-1]:
            total *= x
            total += coefficient
        return total


@dataclass(frozen=True, slots=True)
class Fourier:
    """a0 + sum_k a_k cos(2 pi k q / period) + b_k sin(2 pi k q / period), k from 1."""

    a0: float
    a: tuple[float, ...] = ()
    b: tuple[float, ...] = ()
    period: float = FULL_TURN

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        orders = max(len(self.a), len(self.b))
        a, b = (np.pad(part, (0, orders - len(part))) for part in (self.a, self.b))
        turn = np.exp(1j * FULL_TURN / self.period * q)
        total = np.zeros_like(turn)
        for order in range(orders - 1, -1, -1):
            total = (total + (a[order] - 1j * b[order])) * turn
        return np.asarray(self.a0 + total.real)


@dataclass(frozen=True, slots=True)
class PiecewiseLinear:
    """Straight between points (n,), one value each; repeats if ``period`` is given, else it ends with them.

    Beyond its points it raises ModelError (E-MODEL-RANGE). Where that has a name and a unit, `motion_of` gives it.
    """

    q: tuple[float, ...]
    v: tuple[float, ...]
    period: float | None = None

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        at, nodes, values = np.asarray(q, dtype=np.float64), np.asarray(self.q), np.asarray(self.v)
        if self.period is not None:
            at = nodes[0] + np.mod(at - nodes[0], self.period)
            if nodes[-1] < nodes[0] + self.period * (1.0 - SAME):
                nodes, values = np.append(nodes, nodes[0] + self.period), np.append(values, values[0])
        else:
            at = KnownRange("motion", float(nodes[0]), float(nodes[-1]), "mm").inside(at)
        if nodes.size == 1:
            return np.full(at.shape, values[0])
        left = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, nodes.size - 2)
        share = (at - nodes[left]) / (nodes[left + 1] - nodes[left])
        return np.asarray((1.0 - share) * values[left] + share * values[left + 1])


Plain = Polynomial | Fourier | PiecewiseLinear


@dataclass(frozen=True, slots=True)
class BoundedMotion:
    """A motion in mm or rad that is known over a range alone: elsewhere it raises ModelError (E-MODEL-RANGE)."""

    motion: Plain
    known: KnownRange

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        return self.motion(self.known.inside(q))


@dataclass(frozen=True, slots=True)
class FittedMotion:
    """A fitted component (um or arcsec over mm or deg) as a motion in mm or rad over mm or rad; raises as `value`."""

    component: Component

    @property
    def known(self) -> KnownRange:
        """The range of the fit, in mm or rad."""
        found = KnownRange.of(self.component)
        if found.unit == "mm":
            return found
        low, high = (float(deg_to_rad(one)) for one in (found.low, found.high))
        return KnownRange(found.name, low, high, unit="rad", period=None if found.period is None else FULL_TURN)

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        at = rad_to_deg(q) if self.component.axis_unit == "deg" else q
        found = value(self.component, at)
        return um_to_mm(found) if self.component.name[1:2] in "XYZ" else arcsec_to_rad(found)


@dataclass(frozen=True, slots=True)
class MotionSum:
    """Several motions at once."""

    parts: tuple[Motion, ...]

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        total = np.zeros(np.shape(q))
        for part in self.parts:
            total = total + (part(q) if callable(part) else part)
        return total


def travel_of(motion: Motion, low: float, high: float) -> tuple[float, float]:
    """What of an axis' travel (mm or rad) a motion is known over: all of it for a constant or a formula.

    Raises ModelError (E-MODEL-RANGE) where nothing of it is known.
    """
    if isinstance(motion, MotionSum):
        for part in motion.parts:
            low, high = travel_of(part, low, high)
    if isinstance(motion, BoundedMotion | FittedMotion):
        return motion.known.within(low, high)
    return low, high


def motion_of(data: object, where: str = "motion", *, name: str = "", turning: bool = False) -> Motion:
    """An error motion from plain data: a number, a callable, or a mapping with "type" poly, fourier or pl.

    A broken line (pl) is known between its points, one around a whole turn of a ``turning`` axis everywhere. With
    "range" (low, high) a formula is known over that range alone; without it everywhere. ``name`` is that of errors.
    Raises ModelError E-CHAIN-MOTION-DATA saying what is wrong.
    """
    if callable(data):
        return data
    if isinstance(data, (int, float, np.number)) and not isinstance(data, bool):
        return float(data)
    if not isinstance(data, Mapping) or data.get("type") not in _TYPES:
        raise ModelError("E-CHAIN-MOTION-DATA", where, why=Message.of("W-MODEL-NEITHER", types=", ".join(_TYPES)))
    rest = {key: part for key, part in data.items() if key not in ("type", "range")}
    try:
        found = _check_keys(_TYPES[str(data["type"])](rest), where)
        return _with_range(found, data.get("range"), name or where, turning=turning)
    except (KeyError, TypeError, ValueError) as error:
        raise ModelError("E-CHAIN-MOTION-DATA", where, why=f"{type(error).__name__} {error}") from error


def motion_from(component: Component) -> Motion:
    """A fitted component (um or arcsec over mm or deg) as a motion in mm or rad over mm or rad.

    The second letter of its name says what it is: X, Y, Z a displacement, A, B, C a rotation (ISO 230-1).
    """
    return FittedMotion(component)


def _with_range(motion: Plain, limits: Any, name: str, *, turning: bool) -> Motion:
    if isinstance(motion, PiecewiseLinear):
        if motion.period is None and turning and limits is None:
            motion = _periodic_line(motion)
        if motion.period is not None:
            return motion
        limits = limits if limits is not None else (motion.q[0], motion.q[-1])
        if limits[0] < motion.q[0] or limits[1] > motion.q[-1]:
            raise ValueError("the range is wider than the points")
    if limits is None:
        return motion
    low, high = _floats(limits)
    if not low < high and not isinstance(motion, PiecewiseLinear):
        raise ValueError("the range must ascend")
    return BoundedMotion(motion, KnownRange(name, low, high, "rad" if turning else "mm"))


def _periodic_line(motion: PiecewiseLinear) -> PiecewiseLinear:
    """The same line; it repeats if its points lie around a whole turn and its ends, where they meet, agree."""
    q, v = np.asarray(motion.q), np.asarray(motion.v)
    span = float(q[-1] - q[0])
    if abs(span - FULL_TURN) <= SAME * FULL_TURN:
        closes = abs(float(v[-1] - v[0])) <= ENDS_ALIKE * float(np.ptp(v))
        return PiecewiseLinear(motion.q, motion.v, FULL_TURN) if closes else motion
    widest = float(np.max(np.diff(q), initial=0.0))
    closing = FULL_TURN - span
    if 0.0 < closing <= min(WIDEST_GAP, NEXT_GAP * widest):
        return PiecewiseLinear(motion.q, motion.v, FULL_TURN)
    return motion


def _polynomial(data: Mapping[str, Any]) -> Polynomial:
    return Polynomial(**{**data, "c": _floats(data["c"])})


def _fourier(data: Mapping[str, Any]) -> Fourier:
    return Fourier(**{"a0": 0.0, **data, "a": _floats(data.get("a", ())), "b": _floats(data.get("b", ()))})


def _piecewise(data: Mapping[str, Any]) -> PiecewiseLinear:
    return PiecewiseLinear(**{**data, "q": _floats(data["q"]), "v": _floats(data["v"])})


_TYPES: Mapping[str, Callable[[Mapping[str, Any]], Plain]] = {
    "poly": _polynomial,
    "fourier": _fourier,
    "pl": _piecewise,
}


def _floats(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _check_keys(motion: Plain, where: str) -> Plain:
    why: str | Message = ""
    if isinstance(motion, Polynomial) and (not motion.c or motion.scale == 0.0):
        why = Message.of("W-MODEL-POLYNOMIAL")
    if isinstance(motion, Fourier) and not motion.period > 0.0:
        why = Message.of("W-MODEL-PERIOD")
    if isinstance(motion, PiecewiseLinear) and (
        len(motion.q) != len(motion.v) or not motion.q or bool(np.any(np.diff(motion.q) <= 0.0))
    ):
        why = Message.of("W-MODEL-POINTS")
    elif isinstance(motion, PiecewiseLinear) and motion.period is not None:
        most = motion.period * (1.0 + SAME)
        why = "" if 0.0 <= motion.q[-1] - motion.q[0] <= most > 0.0 else Message.of("W-MODEL-ONE-PERIOD")
    if why:
        raise ModelError("E-CHAIN-MOTION-DATA", where, why=why)
    return motion
