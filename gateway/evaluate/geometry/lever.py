"""What stands beside the line that counts reads an angle times its lever (Abbe); the lever as far as it is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot

import numpy as np

from drivers.message import Message
from drivers.units import arcsec_to_rad, mm_to_um
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.model.components import estimated_beyond, near_value

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
    ends = {"low": f"{known.low:g}", "high": f"{known.high:g}", "unit": motion.axis_unit}
    return (Message.of("S-MODEL-NEAR", name=motion.name, position=f"{place:g}", **ends),)


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
