"""What an angular error motion does to a reading beside the point it is meant for: (eps x r) along the reading."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drivers.units import arcsec_to_rad, mm_to_um
from gateway.domain import FloatArray

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
