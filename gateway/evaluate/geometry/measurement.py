"""What one set-up measured of one error, its means for the fit, and angle errors that act on it by a lever (Abbe)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Any, Literal

import numpy as np

from drivers.message import Message, Quantity
from drivers.units import AxisUnit, DeviationUnit, arcsec_to_rad, mm_to_um
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray, component_unit
from gateway.errors import ModelError
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.model.components import estimated_beyond, near_value
from gateway.model.waves import fit_means

# An artefact may stand 1 mm off its axis and lean by a quarter of a degree; what is larger is another unit.
LARGEST: Mapping[DeviationUnit, float] = {"um": 1000.0, "arcsec": 1000.0}


@dataclass(frozen=True, slots=True)
class Measurement:
    """One set-up's deviations (m, n, 2) at targets (m,) in um or arcsec, and how it was mounted.

    ``component`` may end in -R (artefact turned over). ``systematic`` is the standard uncertainty that repetition
    does not show. ``turned_deg`` is where the rotary axis was parked, for a bar; ``stands`` where every axis stood when
    the set-up began, by letter.
    """

    component: str
    letter: str
    axis_unit: AxisUnit
    targets: FloatArray
    deviations: FloatArray
    reference: float = 0.0
    modulo: bool = False
    offset_mm: tuple[float, float, float] | None = None
    systematic: float = 0.0
    own_angle_arcsec: float | None = None
    turned_deg: float | None = None
    stands: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The error without the mark of a turned artefact."""
        return self.component.removesuffix("-R")

    @property
    def kind(self) -> Literal["linear", "rotary"]:
        """Of the axis that moved."""
        return "linear" if self.axis_unit == "mm" else "rotary"

    @property
    def is_motion(self) -> bool:
        """An error motion, no location error."""
        return self.name[1] != "0"


@dataclass(frozen=True, slots=True)
class Means:
    """Means (m,) of a measurement with their standard uncertainties."""

    of: Measurement
    mean: FloatArray
    u: FloatArray

    def less(self, what: FloatArray) -> Means:
        """The same with something (m,) taken off."""
        return replace(self, mean=self.mean - what)

    def fitted(self) -> Component:
        """The curve through the means, by the one rule (`fit_means`)."""
        one = self.of
        return fit_means(
            one.targets,
            self.mean,
            self.u,
            name=one.name,
            axis=one.letter,
            axis_unit=one.axis_unit,
            kind=one.kind,
            modulo=one.modulo,
        )


def _largest(one: Measurement) -> float:
    """The largest deviation; from the line that leaning optics show, where only what is left of it is the axis' own."""
    known = np.isfinite(one.deviations)
    values, at = one.deviations[known], np.broadcast_to(one.targets[:, None, None], known.shape)[known]
    across = one.kind == "linear" and component_unit(one.name, "mm") == "um" and one.name[1] != one.name[2]
    if across and np.ptp(at) > 0.0:
        values = values - np.polyval(np.polyfit(at, values, 1), at)
    return float(np.max(np.abs(values), initial=0.0))


def means_of(one: Measurement) -> Means:
    """Means of a measurement's readings, robust against drift of passes and readings out of line.

    Raises ModelError (E-EVAL-SIZE) for deviations that no machine tool has: another unit.
    """
    unit = component_unit(one.name, one.axis_unit)
    largest = _largest(one)
    if largest > LARGEST[unit]:
        fields: dict[str, Any] = {"largest": f"{largest:.3g}", "limit": f"{LARGEST[unit]:g}", "unit": unit}
        raise ModelError("E-EVAL-SIZE", one.letter, component=one.component, **fields)
    found = robust_means(one.targets, one.deviations)
    # One repetition one way tells nothing of its scatter: the instrument's own uncertainty stands for it.
    u = np.where(np.isfinite(found.u) & (found.u > 0.0), found.u, max(one.systematic, 1e-3))
    return Means(one, found.mean, np.asarray(u))


# ---- A line next to the functional line reads an angle times its lever (Abbe).

# (eps x r) along X, Y, Z: which rotation acts on which arm with which sign (right-handed, ISO 230-1).
_ARMS: Mapping[str, tuple[tuple[str, int, float], tuple[str, int, float]]] = {
    "X": (("B", 2, 1.0), ("C", 1, -1.0)),
    "Y": (("C", 0, 1.0), ("A", 2, -1.0)),
    "Z": (("A", 1, 1.0), ("B", 0, -1.0)),
}


def arms(along: str, axis: str, offset_mm: tuple[float, float, float]) -> dict[str, float]:
    """Lever of each angular error motion of an axis, um per arcsec, that moves a point at the offset along a letter."""
    found = {f"E{letter}{axis}": sign * offset_mm[place] for letter, place, sign in _ARMS[along]}
    return {name: float(mm_to_um(arcsec_to_rad(arm))) for name, arm in found.items() if arm}


def lever_um(levers: Mapping[str, float], angles_arcsec: Mapping[str, FloatArray], points: int) -> FloatArray:
    """What those levers add to the readings (m,), from the angles (m,) that are known."""
    total = np.zeros(points)
    for name, lever in levers.items():
        if name in angles_arcsec:
            total = total + lever * angles_arcsec[name]
    return total


def said_beyond(motion: Component, at: FloatArray) -> tuple[Message, ...]:
    """S-MODEL-NEAR where a motion is only estimated at some of the places (m,): it ends a little before them."""
    found = estimated_beyond(motion, at)
    if found is None:
        return ()
    known, place = found
    ends = {"low": Quantity(known.low), "high": Quantity(known.high), "unit": motion.axis_unit}
    return (Message.of("S-MODEL-NEAR", name=motion.name, position=Quantity(place), **ends),)


@dataclass(frozen=True, slots=True)
class Lever:
    """Levers of fitted angles, um per arcsec; ``open_um`` are standard uncertainties by the angles nobody measured."""

    levers: Mapping[str, float]
    angles: Mapping[str, Component]
    open_um: Mapping[str, float]

    @classmethod
    def of(
        cls,
        name: str,
        letter: str,
        offset_mm: tuple[float, float, float],
        *,
        angles: Mapping[str, Component],
        spans: Mapping[str, float],
        usual_arcsec: float,
    ) -> Lever:
        """That of an error motion E.. of an axis read at an offset; ``spans`` are assumed half widths (arcsec)."""
        levers = arms(name[1], letter, offset_mm)
        known = {key: angles[key] for key in levers if key in angles}
        missing = sorted(set(levers) - set(known))
        shares = {key: abs(levers[key]) * spans.get(key, usual_arcsec) / 3.0**0.5 for key in missing}
        return cls(levers, known, shares)

    def um(self, at: FloatArray) -> FloatArray:
        """What the known angles add at places (m,). Raises ModelError (E-MODEL-RANGE) as `near_value`."""
        return lever_um(self.levers, {key: near_value(one, at)[0] for key, one in self.angles.items()}, at.size)

    def u(self, at: FloatArray) -> FloatArray:
        """Its standard uncertainty (m,) by the fits of the angles, and where these begin a little later."""
        squares = [(self.levers[key] * near_value(one, at)[1]) ** 2 for key, one in self.angles.items()]
        return np.asarray(np.sqrt(np.sum(squares, axis=0))) if squares else np.zeros(at.size)

    def estimated(self, at: FloatArray) -> tuple[Message, ...]:
        """Each angle that is an estimate at some of the places: its name, range and the furthest place."""
        return tuple(said for one in self.angles.values() for said in said_beyond(one, at))

    @property
    def open_u(self) -> float:
        """Standard uncertainty by all angles nobody measured, um."""
        return hypot(*self.open_um.values())
