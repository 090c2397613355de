"""How far something has drifted: half a day one way, then back, so that a cell left running for days stays a cell."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile.terms import DriftSection

TURN_S = 12.0 * 3600.0

Seconds = TypeVar("Seconds", float, NDArray[np.floating[Any]])


def drifted_s(t: Seconds) -> Seconds:
    """Seconds of drift at cell time ``t`` (s): as long as ``t`` up to 12 h, down again to -12 h at 36 h, and so on."""
    if not isinstance(t, np.ndarray):  # asked for one moment a thousand times as often as for many
        phase = (t + TURN_S) % (4.0 * TURN_S)
        turned = phase - TURN_S if phase < 2.0 * TURN_S else 3.0 * TURN_S - phase
        return float(t if abs(t) <= TURN_S else turned)
    if t.size and np.abs(t).max() <= TURN_S:
        return t
    phase = (t + TURN_S) % (4.0 * TURN_S)
    return np.where(np.abs(t) <= TURN_S, t, np.where(phase < 2.0 * TURN_S, phase - TURN_S, 3.0 * TURN_S - phase))


def drifted(drift: DriftSection, t: float, material_degc: float) -> float:
    """How far this drift has come at cell time ``t`` (s) and this temperature, um or arcsec."""
    hours = t / 3600.0
    steady = drift.per_h * drifted_s(t) / 3600.0 + drift.per_k * (material_degc - 20.0)
    bent = -drift.warm_up * float(np.expm1(-hours / drift.warm_up_h))
    return float(steady + bent + drift.wave * np.sin(2.0 * np.pi * hours / drift.wave_h))
