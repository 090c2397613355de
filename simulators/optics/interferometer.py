"""The laser interferometer: refractive index of the air, and the counter that counts optical path.

The index is Ciddor's (1996) for moist air, in the form NIST publishes. The counter turns the path between
interferometer and reflector, seen in that air, into quadrature counts as the uMD sends them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Laser, Setup
from simulators.optics.mountings import (
    AxisWatcher,
    Mounting,
    OpticsBench,
    StopNoise,
    angular_difference_mm,
    letters_of,
    linear_length_mm,
)
from simulators.truth import AxisMotion, drift_time_s, generator

WATER_CRITICAL_K = 647.096
WATER_CRITICAL_PA = 22_064_000.0
WAGNER = (
    (-7.85951783, 1.0),
    (1.84408259, 1.5),
    (-11.7866497, 3.0),
    (22.6807411, 3.5),
    (-15.9618719, 4.0),
    (1.80122502, 7.5),
)
GAS_J_PER_MOL_K = 8.314472
WATER_KG_PER_MOL = 0.018015
CO2_PPM = 450.0


def saturation_pa(degc: float) -> float:
    """Saturation vapour pressure of water in Pa (Wagner's equation as quoted by the RCU10 manual)."""
    kelvin = degc + 273.15
    rest = 1.0 - kelvin / WATER_CRITICAL_K
    total = sum(factor * rest**power for factor, power in WAGNER)
    return WATER_CRITICAL_PA * exp(total * WATER_CRITICAL_K / kelvin)


def refractive_index(degc: float, hpa: float, humidity_pct: float, wavelength_nm: float) -> float:
    """Phase refractive index at a vacuum wavelength; 450 ppm CO2. Valid -40 .. 100 degC, 300 .. 1700 nm."""
    pa, kelvin = 100.0 * hpa, degc + 273.15
    vapour = _vapour_fraction(degc, pa, humidity_pct)
    packed = pa / (_compressibility(degc, pa, vapour) * GAS_J_PER_MOL_K * kelvin)
    dry_kg_per_mol = 0.0289635 + 1.2011e-8 * (CO2_PPM - 400.0)
    dry_reference = 101325.0 * dry_kg_per_mol / (0.9995922115 * GAS_J_PER_MOL_K * 288.15)
    dry = (1.0 - vapour) * packed * dry_kg_per_mol / dry_reference
    wet = vapour * packed * WATER_KG_PER_MOL / 0.00985938
    s = (1000.0 / wavelength_nm) ** 2
    return 1.0 + dry * _dry_refractivity(s) + wet * _wet_refractivity(s)


def _vapour_fraction(degc: float, pa: float, humidity_pct: float) -> float:
    enhancement = 1.00062 + 3.14e-8 * pa + 5.60e-7 * degc**2
    return humidity_pct / 100.0 * enhancement * saturation_pa(degc) / pa


def _compressibility(degc: float, pa: float, vapour: float) -> float:
    ratio = pa / (degc + 273.15)
    first = 1.58123e-6 - 2.9331e-8 * degc + 1.1043e-10 * degc**2
    mixed = (5.707e-6 - 2.051e-8 * degc) * vapour + (1.9898e-4 - 2.376e-6 * degc) * vapour**2
    return 1.0 - ratio * (first + mixed) + ratio**2 * (1.83e-11 - 0.765e-8 * vapour**2)


def _dry_refractivity(s: float) -> float:
    return 1e-8 * (5792105.0 / (238.0185 - s) + 167917.0 / (57.362 - s))


def _wet_refractivity(s: float) -> float:
    return 1.022e-8 * (295.235 + 2.6422 * s - 0.032380 * s**2 + 0.004028 * s**3)


# Optical path to counts.

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
KNOT_S = 0.01
NM_PER_MM = 1e6
UM = 1e-3


@dataclass(frozen=True, slots=True)
class CounterSamples:
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
        self._stops: StopNoise | None = None
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

    def read(self, until: float) -> CounterSamples:
        """All samples from the last asked for up to clock time `until` (s)."""
        sequence = np.arange(self._next, max(int(until * self.spec.sample_hz) + 1, self._next))
        self._next += len(sequence)
        if not len(sequence):
            return CounterSamples(sequence, sequence)
        shown = self._shown(sequence / self.spec.sample_hz)
        return CounterSamples(sequence, np.rint(self.sense * shown / self.count_mm).astype(np.int64))

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
            self._stops = StopNoise(self.spec.noise, every, self._bench.truth.seed, name)

    def _path(self, mounting: Mounting, times: FloatArray) -> FloatArray:
        """Optical path difference of each sample in mm: geometry at knots, index of air, offsets."""
        count = max(int(np.ceil((times[-1] - times[0]) / KNOT_S)) + 1, 2)
        knots = np.linspace(times[0], times[-1], count)
        motions = self._watcher.motions(_watched_axes(mounting.setup), knots)
        length = self._length(mounting, motions, float(knots[-1]))
        length = length + self._offsets(motions[mounting.setup.axis], knots)
        return np.interp(times, knots, np.broadcast_to(length, len(knots)))

    def _length(self, mounting: Mounting, motions: dict[str, AxisMotion], t: float) -> FloatArray:
        setup = mounting.setup
        frames = self._bench.truth.frames(motions, t)
        if mounting.optics == "angular":
            return angular_difference_mm(setup, frames, _angle_of_setup(setup))
        index = air_index(self._bench, self.spec.wavelength_nm, t)
        return index * linear_length_mm(setup, frames)

    def _offsets(self, motion: AxisMotion, knots: FloatArray) -> FloatArray:
        if self._stops is None:
            return np.zeros(1)
        position = np.broadcast_to(motion.position, len(knots))
        drift = self.spec.noise.drift_per_h * drift_time_s(knots) / 3600.0
        return (self._stops.offsets(position, float(knots[1] - knots[0])) + drift) * UM


def _watched_axes(setup: Setup) -> str:
    return "".join(dict.fromkeys(letters_of(setup) + setup.axis))


def _angle_of_setup(setup: Setup) -> str:
    """The angle that angular optics show: the component's own, or the pitch when it is not an angle."""
    wanted = setup.component[1]
    return wanted if wanted in "ABC" else {"X": "B", "Y": "A", "Z": "B", "C": "C"}[setup.axis]


def air_index(bench: OpticsBench, wavelength_nm: float, t: float) -> float:
    """Refractive index of the air as it truly is at clock time t."""
    air = bench.truth.climate.true(t)
    return refractive_index(air.air_degc, air.pressure_hpa, air.humidity_pct, wavelength_nm)
