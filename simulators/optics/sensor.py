"""A straightness or angle instrument over time: geometry, its own errors, and light that may be lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Sensor, Setup
from simulators.optics.mountings import SETTLED, AxisWatcher, Mounting, OpticsBench, letters_of
from simulators.optics.readings import component_of, reading
from simulators.optics.stops import Stops
from simulators.truth import AxisMotion, generator
from simulators.truth.drift import drifted_s
from simulators.truth.terms import Curve, curve

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
UNITS = {"straightness": "um", "angle": "arcsec"}
# Drift and warming move a machine that stands still by less than 5 nm in this time; noise is ten times that.
STANDS_S = 3.0
# What the optics of a set-up are called by the instrument that can tell.
TOLD = {"angular": "angular", "level": "angular", "linear": "linear", "rotary": "rotary"}


@dataclass(frozen=True, slots=True)
class SensorReadings:
    """A stretch of samples, each (n,): clock time in s, value in um or arcsec, whether there is light."""

    time_s: FloatArray
    value: FloatArray
    beam: BoolArray


class SensorReader:
    """One instrument, sampled from its last sample up to the time it is asked for.

    With the wrong optics, without any, or beyond its range no light returns until `restore_beam` or a new
    mounting; the value then stays what it was.
    """

    def __init__(self, spec: Sensor, bench: OpticsBench) -> None:
        self.spec = spec
        self._bench = bench
        seed = bench.truth.seed
        self._rng = generator(seed, spec.name, "samples")
        self._watcher = AxisWatcher(bench)
        self._mounting: Mounting | None = None
        self._stops: Stops | None = None
        self._own: dict[str, Curve] = {}
        self._stood: tuple[dict[str, AxisMotion], float, FloatArray] | None = None
        self._zero = 0.0
        self._shown = 0.0
        self._next = 0
        self.beam_lost = False

    @property
    def unit(self) -> str:
        """um or arcsec."""
        return UNITS[self.spec.kind]

    @staticmethod
    def told(mounting: Mounting | None) -> str:
        """What the instrument sees itself mounted with: linear, angular, rotary, straightness, or unknown."""
        return TOLD.get(mounting.optics, "straightness") if mounting is not None else "unknown"

    def skip_to(self, t: float) -> None:
        """Sample from clock time t on: the instrument was just switched on."""
        self._next = int(t * self.spec.sample_hz) + 1

    def restore_beam(self) -> None:
        """The reading is good again."""
        self.beam_lost = False

    def read(self, until: float) -> SensorReadings:
        """All samples from the last asked for up to clock time `until` (s)."""
        sequence = np.arange(self._next, max(int(until * self.spec.sample_hz) + 1, self._next))
        self._next += len(sequence)
        times = sequence / self.spec.sample_hz
        mounting = self._bench.mounted(self.spec.name)
        if mounting is not self._mounting:
            self._remount(mounting)
        if not len(times) or mounting is None or mounting.optics != mounting.setup.optics:
            return SensorReadings(times, np.full(len(times), self._shown), np.zeros(len(times), dtype=np.bool_))
        return self._lit(times, self._value(mounting.setup, times))

    def _remount(self, mounting: Mounting | None) -> None:
        self._mounting = mounting
        self._stood = None
        self.beam_lost = mounting is None
        if mounting is not None:
            seed, name = self._bench.truth.seed, f"{self.spec.name} {mounting.number}"
            self._stops = Stops(self.spec.noise, self._bench.stops_of_run(mounting.setup.axis), seed, name)
            absolute = component_of(mounting.setup)[1] == "0" and mounting.setup.optics == "ball"
            drawn = float(generator(seed, name, "zero").uniform(-1.0, 1.0))
            self._zero = 0.0 if absolute else drawn * self.spec.zero

    def _value(self, setup: Setup, times: FloatArray) -> FloatArray:
        motions = self._watcher.motions(watched(setup), times)
        moved = self._bench.steps.get(setup.component, 0.0) * (-1.0 if setup.reversed else 1.0)
        value = self._geometry(setup, motions, float(times[-1])) + self._zero + moved
        drift = self.spec.noise.drift_per_h * drifted_s(times) / 3600.0
        noise = self._rng.normal(0.0, self.spec.noise.sample, len(times))
        return value + drift + noise + self._offsets(motions[setup.axis], len(times))

    def _geometry(self, setup: Setup, motions: dict[str, AxisMotion], t: float) -> FloatArray:
        """What the optics show at these motions with the instrument's own error; kept while the machine stands."""
        if self._stood is not None and t - self._stood[1] < STANDS_S and _same(self._stood[0], motions):
            return self._stood[2]
        frames = self._bench.truth.frames(motions, t)
        value = reading(setup, frames, motions) + self._own_error(setup, motions[setup.axis].position)
        self._stood = (motions, t, value) if len(value) == 1 else None
        return value

    def _own_error(self, setup: Setup, place: FloatArray) -> FloatArray:
        axis = self._bench.cell.axis(setup.axis)
        if axis.letter not in self._own:
            rotary, name = axis.kind == "rotary", f"{self.spec.name} own error"
            own = curve(
                self.spec.own_error, axis.travel, rotary=rotary, seed=self._bench.truth.seed, name=name, redraw=False
            )
            self._own[axis.letter] = own
        return self._own[axis.letter](np.mod(place, 360.0) if axis.kind == "rotary" else place)

    def _offsets(self, motion: AxisMotion, count: int) -> FloatArray:
        position = np.broadcast_to(motion.position, count)
        return self._stops.offsets(position, 1.0 / self.spec.sample_hz) if self._stops is not None else np.zeros(count)

    def _lit(self, times: FloatArray, value: FloatArray) -> SensorReadings:
        blocked = self.spec.name in self._bench.broken
        lost = np.logical_or.accumulate((np.abs(value) > self.spec.range) | blocked | self.beam_lost)
        self.beam_lost = bool(lost[-1])
        shown = np.where(lost, self._shown, value)
        self._shown = float(shown[-1])
        return SensorReadings(times, shown, ~lost)


def _same(before: dict[str, AxisMotion], now: dict[str, AxisMotion]) -> bool:
    """Whether every axis stands where it stood."""
    return all(_stands(one, now[letter]) for letter, one in before.items())


def _stands(before: AxisMotion, now: AxisMotion) -> bool:
    if len(now.position) > 1 or abs(now.position[0] - before.position[0]) > SETTLED:
        return False
    names = ("direction", "windup", "scatter")
    return all(bool(getattr(now, name)[0] == getattr(before, name)[0]) for name in names)


def watched(setup: Setup) -> str:
    """The axes whose error motions reach this reading."""
    chain = "XZC" if setup.optics in {"ball", "bar"} else letters_of(setup)
    return "".join(dict.fromkeys(chain + setup.axis))
