"""Drift and climate: how far something has drifted, what the surroundings are, and what the sensors report of them.

A drift goes one way for half a day and then back, so a cell left running for days stays a cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import ClimateQuantity, DriftSection
from simulators.cellfile import ClimateSection as ClimateSpec

TURN_S = 12.0 * 3600.0

Seconds = TypeVar("Seconds", float, NDArray[np.floating[Any]])


def drift_time_s(t: Seconds) -> Seconds:
    """Seconds of drift at cell time ``t`` (s): as long as ``t`` up to 12 h, down again to -12 h at 36 h, and so on."""
    if not isinstance(t, np.ndarray):  # asked for one moment a thousand times as often as for many
        phase = (t + TURN_S) % (4.0 * TURN_S)
        turned = phase - TURN_S if phase < 2.0 * TURN_S else 3.0 * TURN_S - phase
        return float(t if abs(t) <= TURN_S else turned)
    if t.size and np.abs(t).max() <= TURN_S:
        return t
    phase = (t + TURN_S) % (4.0 * TURN_S)
    return np.where(np.abs(t) <= TURN_S, t, np.where(phase < 2.0 * TURN_S, phase - TURN_S, 3.0 * TURN_S - phase))


def drift_value(drift: DriftSection, t: float, material_degc: float) -> float:
    """How far this drift has come at cell time ``t`` (s) and this temperature, um or arcsec."""
    hours = t / 3600.0
    steady = drift.per_h * drift_time_s(t) / 3600.0 + drift.per_k * (material_degc - 20.0)
    bent = -drift.warm_up * float(np.expm1(-hours / drift.warm_up_h))
    return float(steady + bent + drift.wave * np.sin(2.0 * np.pi * hours / drift.wave_h))


@dataclass(frozen=True, slots=True)
class Weather:
    """The surroundings at one moment: degC, hPa, % relative humidity, degC."""

    air_degc: float
    pressure_hpa: float
    humidity_pct: float
    material_degc: float


QUANTITIES = ("air_degc", "pressure_hpa", "humidity_pct", "material_degc")


class Climate:
    """The surroundings over the cell's clock; a drift turns back after half a day, so they stay within bounds."""

    def __init__(self, spec: ClimateSpec) -> None:
        self._spec = spec
        self._now: tuple[float, Weather] | None = None  # asked for several times at each moment
        self.frozen_sensors: Weather | None = None

    def true(self, t: float) -> Weather:
        """What the surroundings are at clock time t (s)."""
        if self._now is None or self._now[0] != t:
            self._now = (t, self._at(t, 0.0))
        return self._now[1]

    def sensed(self, t: float) -> Weather:
        """What the sensors report: the truth and each sensor's own error."""
        return self.frozen_sensors or self._at(t, 1.0)

    def change(self, t: float, **wanted: float) -> None:
        """These quantities are this at clock time t (s), and drift on from there. Raises KeyError for another name."""
        known = {name: getattr(self._spec, name) for name in QUANTITIES}
        courses = {name: _from(known[name], value, t) for name, value in wanted.items()}
        self._spec, self._now = self._spec.model_copy(update=courses), None

    def _at(self, t: float, sensor: float) -> Weather:
        spec = self._spec
        courses = (spec.air_degc, spec.pressure_hpa, spec.humidity_pct, spec.material_degc)
        return Weather(*(_value(course, t) + sensor * course.sensor_error for course in courses))


def _from(course: ClimateQuantity, value: float, t: float) -> ClimateQuantity:
    """The same drift and wave, at ``value`` now."""
    return course.model_copy(update={"start": course.start + value - _value(course, t)})


def _value(course: ClimateQuantity, t: float) -> float:
    wave = course.wave * float(np.sin(2.0 * np.pi * t / course.wave_period_s))
    return course.start + course.per_h * drift_time_s(t) / 3600.0 + wave
