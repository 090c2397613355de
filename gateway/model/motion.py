"""Error motions as functions of an axis' own position in mm and rad: from plain data or from fitted components."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.types.values import FloatArray
from drivers.units import arcsec_to_rad, rad_to_deg, um_to_mm
from gateway.domain.figures import Component
from gateway.errors import ModelError
from gateway.model.axis import Motion
from gateway.model.components import value

FULL_TURN = 2.0 * np.pi


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
    """Straight between points, held outside; repeats if ``period`` is given."""

    q: tuple[float, ...]
    v: tuple[float, ...]
    period: float | None = None

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        return np.asarray(np.interp(q, self.q, self.v, period=self.period))


@dataclass(frozen=True, slots=True)
class Sum:
    """Several motions at once."""

    parts: tuple[Motion, ...]

    def __call__(self, q: FloatArray) -> FloatArray:
        """Values at q, same shape."""
        total = np.zeros(np.shape(q))
        for part in self.parts:
            total = total + (part(q) if callable(part) else part)
        return total


def motion_of(data: object, where: str = "motion") -> Motion:
    """An error motion from plain data: a number, a callable, or a mapping with "type" poly, fourier or pl.

    Raises ModelError E-CHAIN-MOTION-DATA saying what is wrong.
    """
    if callable(data):
        return data
    if isinstance(data, (int, float, np.number)) and not isinstance(data, bool):
        return float(data)
    if not isinstance(data, Mapping) or data.get("type") not in _TYPES:
        raise ModelError("E-CHAIN-MOTION-DATA", where, why=f"neither a number nor one of {', '.join(_TYPES)}")
    rest = {key: part for key, part in data.items() if key != "type"}
    try:
        return _checked(_TYPES[str(data["type"])](rest), where)
    except (KeyError, TypeError, ValueError) as error:
        raise ModelError("E-CHAIN-MOTION-DATA", where, why=f"{type(error).__name__} {error}") from error


def motion_from(component: Component) -> Motion:
    """A fitted component (um or arcsec over mm or deg) as a motion in mm or rad over mm or rad.

    The second letter of its name says what it is: X, Y, Z a displacement, A, B, C a rotation (ISO 230-1).
    """
    to_unit: Callable[[FloatArray], FloatArray] = um_to_mm if component.name[1:2] in "XYZ" else arcsec_to_rad

    def motion(q: FloatArray) -> FloatArray:
        at = rad_to_deg(q) if component.axis_unit == "deg" else q
        return to_unit(value(component, at))

    return motion


def _polynomial(data: Mapping[str, Any]) -> Polynomial:
    return Polynomial(**{**data, "c": _floats(data["c"])})


def _fourier(data: Mapping[str, Any]) -> Fourier:
    return Fourier(**{"a0": 0.0, **data, "a": _floats(data.get("a", ())), "b": _floats(data.get("b", ()))})


def _piecewise(data: Mapping[str, Any]) -> PiecewiseLinear:
    return PiecewiseLinear(**{**data, "q": _floats(data["q"]), "v": _floats(data["v"])})


_TYPES: Mapping[str, Callable[[Mapping[str, Any]], Polynomial | Fourier | PiecewiseLinear]] = {
    "poly": _polynomial,
    "fourier": _fourier,
    "pl": _piecewise,
}


def _floats(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _checked(motion: Polynomial | Fourier | PiecewiseLinear, where: str) -> Motion:
    why = ""
    if isinstance(motion, Polynomial) and (not motion.c or motion.scale == 0.0):
        why = "a polynomial needs coefficients and a scale that is not 0"
    if isinstance(motion, Fourier) and not motion.period > 0.0:
        why = "the period must be above 0"
    if isinstance(motion, PiecewiseLinear) and (
        len(motion.q) != len(motion.v) or not motion.q or bool(np.any(np.diff(motion.q) <= 0.0))
    ):
        why = "points must ascend and have one value each"
    if why:
        raise ModelError("E-CHAIN-MOTION-DATA", where, why=why)
    return motion
