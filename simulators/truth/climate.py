"""Air and material around the machine: what they are, and what the sensors say they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulators.cellfile import ClimateSection as ClimateSpec
from simulators.cellfile import Course
from simulators.truth.drift import drifted_s


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


def _from(course: Course, value: float, t: float) -> Course:
    """The same drift and wave, at ``value`` now."""
    return course.model_copy(update={"start": course.start + value - _value(course, t)})


def _value(course: Course, t: float) -> float:
    wave = course.wave * float(np.sin(2.0 * np.pi * t / course.wave_period_s))
    return course.start + course.per_h * drifted_s(t) / 3600.0 + wave
