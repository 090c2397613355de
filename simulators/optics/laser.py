"""A laser interferometer's counter: optical path to quadrature counts, as the uMD would send them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Laser, Setup
from simulators.optics.air import refractive_index
from simulators.optics.mountings import (
    AxisWatcher,
    Mounting,
    OpticsBench,
    angular_difference_mm,
    letters_of,
    linear_length_mm,
)
from simulators.optics.stops import Stops
from simulators.truth import AxisMotion, generator
from simulators.truth.drift import drifted_s

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
KNOT_S = 0.01
NM_PER_MM = 1e6
UM = 1e-3


@dataclass(frozen=True, slots=True)
class Counts:
    """A stretch of counter readings: sequence numbers and signed counts, each (n,)."""

    sequence: IntArray
    counts: IntArray


class LaserCounter:
    """One laser with its counter; it counts from its last sample up to the time it is asked for.

    The optical path is n * L mm of vacuum; one cycle is half a vacuum wavelength. The counter cannot see a
    broken beam: it just stands still, and what was missed stays missed.
    """

    def __init__(self, spec: Laser, bench: OpticsBench) -> None:
        self.spec = spec
        self._bench = bench
        seed = bench.truth.seed
        drawn = int(generator(seed, spec.name, "sense").choice((-1, 1)))
        self.sense = drawn if spec.sense == "seed" else spec.sense
        self._rng = generator(seed, spec.name, "samples")
        self._watcher = AxisWatcher(bench)
        self._mounting: Mounting | None = None
        self._stops: Stops | None = None
        self._zero: float | None = None
        self._shown_mm = 0.0
        self._next = 0

    @property
    def count_mm(self) -> float:
        """The optical path of one count in mm."""
        return self.spec.wavelength_nm / 2.0 / self.spec.counts_per_cycle / NM_PER_MM

    def skip_to(self, t: float) -> None:
        """Count from clock time t on: the instrument was just switched on."""
        self._next = int(t * self.spec.sample_hz) + 1

    def read(self, until: float) -> Counts:
        """All samples from the last asked for up to clock time `until` (s)."""
        sequence = np.arange(self._next, max(int(until * self.spec.sample_hz) + 1, self._next))
        self._next += len(sequence)
        if not len(sequence):
            return Counts(sequence, sequence)
        shown = self._shown(sequence / self.spec.sample_hz)
        return Counts(sequence, np.rint(self.sense * shown / self.count_mm).astype(np.int64))

    def _shown(self, times: FloatArray) -> FloatArray:
        mounting = self._bench.mounted(self.spec.name)
        if mounting is not self._mounting:
            self._remount(mounting)
        if mounting is None or mounting.optics == "rotary" or self.spec.name in self._bench.broken:
            self._zero = None
            return np.full(len(times), self._shown_mm)
        path = self._path(mounting, times)
        if self._zero is None:
            self._zero = float(path[0]) - self._shown_mm
        shown = path - self._zero
        self._shown_mm = float(shown[-1])
        return shown + self._rng.normal(0.0, self.spec.noise.sample * UM, len(times))

    def _remount(self, mounting: Mounting | None) -> None:
        self._mounting = mounting
        self._zero = None
        if mounting is not None:
            every = self._bench.stops_of_run(mounting.setup.axis)
            name = f"{self.spec.name} {mounting.number}"
            self._stops = Stops(self.spec.noise, every, self._bench.truth.seed, name)

    def _path(self, mounting: Mounting, times: FloatArray) -> FloatArray:
        """Optical path difference of each sample in mm: geometry at knots, index of air, offsets."""
        count = max(int(np.ceil((times[-1] - times[0]) / KNOT_S)) + 1, 2)
        knots = np.linspace(times[0], times[-1], count)
        motions = self._watcher.motions(_watched(mounting.setup), knots)
        length = self._length(mounting, motions, float(knots[-1]))
        length = length + self._offsets(motions[mounting.setup.axis], knots)
        return np.interp(times, knots, np.broadcast_to(length, len(knots)))

    def _length(self, mounting: Mounting, motions: dict[str, AxisMotion], t: float) -> FloatArray:
        setup = mounting.setup
        frames = self._bench.truth.frames(motions, t)
        if mounting.optics == "angular":
            return angular_difference_mm(setup, frames, _about(setup))
        index = air_index(self._bench, self.spec.wavelength_nm, t)
        return index * linear_length_mm(setup, frames)

    def _offsets(self, motion: AxisMotion, knots: FloatArray) -> FloatArray:
        if self._stops is None:
            return np.zeros(1)
        position = np.broadcast_to(motion.position, len(knots))
        drift = self.spec.noise.drift_per_h * drifted_s(knots) / 3600.0
        return (self._stops.offsets(position, float(knots[1] - knots[0])) + drift) * UM


def _watched(setup: Setup) -> str:
    return "".join(dict.fromkeys(letters_of(setup) + setup.axis))


def _about(setup: Setup) -> str:
    """The angle that angular optics show: the component's own, or the pitch when it is not an angle."""
    wanted = setup.component[1]
    return wanted if wanted in "ABC" else {"X": "B", "Y": "A", "Z": "B", "C": "C"}[setup.axis]


def air_index(bench: OpticsBench, wavelength_nm: float, t: float) -> float:
    """Refractive index of the air as it truly is at clock time t."""
    air = bench.truth.climate.true(t)
    return refractive_index(air.air_degc, air.pressure_hpa, air.humidity_pct, wavelength_nm)
