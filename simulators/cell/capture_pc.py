"""The capture PC: measures with the instruments' own programs and saves their files.

`CapturePc` measures an axis as the laser maker's program does (.rtl, .rta). `SetupCapturePc` measures any set-up of the
plan: what its instrument shows at every stop, averaged and saved as a table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulators.cell.control import CellNck
from simulators.cellfile import CellAxis, Noise, Sensor, Setup
from simulators.optics import (
    OpticsBench,
    StopNoise,
    component_of,
    component_reading,
    line_of_sight,
    linear_length_mm,
    refractive_index,
    watched_axes,
)
from simulators.result_files import FileContent, write_result
from simulators.truth import AxisMotion, Scatter, Weather, curve, drift_time_s, generator

FloatArray = NDArray[np.float64]
STOP_S = 5.0
PPM = 1e-6
UM_PER_MM = 1000.0
WAVELENGTH_UM = 0.632990577


@dataclass(frozen=True, slots=True)
class CapturePc:
    """The capture program: it corrects air and material itself with its sensors, and stores deviations.

    Targets are those of the cell file's measuring section, evenly spaced; positions are from the first
    target, deviations relative to the first reading. What stays in them is the axis as it is on the laser's
    line, noise and outliers of the stops, and what the temperature sensors get wrong.
    """

    bench: OpticsBench
    nck: CellNck
    axis: CellAxis
    start_s: float
    start_utc: datetime

    def save(self, path: Path, repetitions: int) -> Path:
        """Measure and write .rtl (linear) or .rta (rotary)."""
        write_result(path, self._content(repetitions))
        return path

    @property
    def targets(self) -> FloatArray:
        """The cell file's targets in machine coordinates, (m,)."""
        given = (self.axis.measure or {}).get("targets", {})
        if given.get("positions"):
            return np.asarray(given["positions"], dtype=np.float64)
        return np.linspace(given["first"], given["last"], int(given["count"]))

    @property
    def _alpha(self) -> float:
        return float((self.axis.measure or {}).get("expansion_ppm_per_k", 11.5))

    def deviations(self, repetitions: int) -> FloatArray:
        """(m, n, 2) um or arcsec, + then - approach, relative to the first reading."""
        count = len(self.targets)
        noise = self._noise()
        stops = StopNoise(noise, 2 * count * repetitions, self.bench.truth.seed, f"file {self.axis.name}")
        scatter = Scatter(self.axis.scatter, self.bench.truth.seed, f"file scatter {self.axis.name}")
        found = np.full((count, repetitions, 2), np.nan)
        for passed in range(2 * repetitions):
            repetition, approach = divmod(passed, 2)
            offsets = np.asarray([stops.offset(passed * count + stop) for stop in range(count)])
            t = self.start_s + passed * count * STOP_S
            found[:, repetition, approach] = self._pass(1 - 2 * approach, t, scatter.drawn((count,))) + offsets
        return found - found[0, 0, 0]

    def _pass(self, direction: int, t: float, scatter: FloatArray) -> FloatArray:
        targets = self.targets
        encoder = np.asarray(self.nck.compensated_encoder(self.axis.name, targets, direction))
        setup = self.bench.setup_for(str((self.axis.measure or {}).get("component")), self.axis.letter)
        truth = self.bench.truth
        if self.axis.kind == "rotary" or setup is None:
            scale = 3600.0 if self.axis.kind == "rotary" else UM_PER_MM
            return (encoder - targets) * scale + truth.deviation(self.axis.name, encoder, direction, t) + scatter
        sense = np.full_like(encoder, float(direction))
        frames = truth.frames({self.axis.letter: AxisMotion(encoder, sense, sense, scatter)}, t)
        warm = 1.0 + self._alpha * PPM * (truth.climate.sensed(t).material_degc - 20.0)
        length = setup.away * linear_length_mm(setup, frames)
        first = self._start(direction, t) + scatter[0]
        return np.asarray(((length - length[0]) / warm - (targets - targets[0])) * UM_PER_MM + first)

    def _start(self, direction: int, t: float) -> float:
        """The first target's own deviation in this pass, which a length from it does not hold."""
        first = self.targets[:1]
        encoder = np.asarray(self.nck.compensated_encoder(self.axis.name, first, direction))
        own = self.bench.truth.deviation(self.axis.name, encoder, direction, t)
        return float((encoder - first)[0] * UM_PER_MM + own[0])

    def _noise(self) -> Noise:
        setup = next((s for s in self.bench.cell.setups if s.axis == self.axis.letter), None)
        name = setup.instrument if setup is not None else ""
        found = (spec for spec in self.bench.cell.instruments if spec.name == name)
        return getattr(next(found, None), "noise", Noise())

    def _content(self, repetitions: int) -> FileContent:
        length_s = 2 * repetitions * len(self.targets) * STOP_S
        climate = self.bench.truth.climate
        first, last = climate.sensed(self.start_s), climate.sensed(self.start_s + length_s)
        return FileContent(
            targets=self.targets - self.targets[0],
            deviations=self.deviations(repetitions),
            rotary=self.axis.kind == "rotary",
            start=first,
            end=last,
            started=self.start_utc,
            ended=self.start_utc + timedelta(seconds=length_s),
            expansion_ppm_per_k=self._alpha,
            env_factors=(env_factor(first, self._alpha), env_factor(last, self._alpha)),
            machine=self.bench.cell.site.name,
            serial=self.bench.cell.machine.serial,
            axis=self.axis.letter,
        )


def env_factor(air: Weather, alpha: float) -> float:
    """Half the wavelength in this air in um, shortened by the material's expansion, as such files hold it."""
    index = refractive_index(air.air_degc, air.pressure_hpa, air.humidity_pct, WAVELENGTH_UM * 1000.0)
    return WAVELENGTH_UM / 2.0 / index / (1.0 + alpha * PPM * (air.material_degc - 20.0))


AVERAGE_S = 1.0
SIGNS = "+-"


@dataclass(frozen=True, slots=True)
class SetupCapturePc:
    """One set-up measured in the standard cycle: every target from below and from above, as often as asked.

    ``targets`` (m,) in machine coordinates. ``stands`` tells where other axes stand meanwhile, by letter; the others
    stand where the machine left them. Noise, outliers, own error, drift and mounting are the instrument's, as live.
    """

    bench: OpticsBench
    nck: CellNck
    setup: Setup
    targets: FloatArray
    start_s: float
    stands: Mapping[str, float] = field(default_factory=dict)

    @property
    def axis(self) -> CellAxis:
        """The axis that moves."""
        return self.bench.cell.axis(self.setup.axis)

    def save(self, path: Path, repetitions: int) -> Path:
        """Write target, direction, repetition, deviation, the last in um or arcsec as its heading says."""
        target = "target_deg" if self.axis.kind == "rotary" else "target_mm"
        unit = "arcsec" if line_of_sight(self.setup) in "ABC" else "um"
        rows = [f"{target},direction,repetition,deviation_{unit}", *self._rows(self.deviations(repetitions))]
        path.write_text("\n".join(rows) + "\n", encoding="utf-8")
        return path

    def _rows(self, found: FloatArray) -> list[str]:
        places = [(r, way, m) for r in range(found.shape[1]) for way in (0, 1) for m in range(len(found))]
        told = [(self.targets[m], SIGNS[way], r + 1, found[m, r, way]) for r, way, m in places]
        return [f"{at:.6f},{sign},{r},{value:.5f}" for at, sign, r, value in told if np.isfinite(value)]

    def deviations(self, repetitions: int) -> FloatArray:
        """(m, n, 2) um or arcsec, + then - approach; NaN without light.

        Relative to the first reading, but for a ball whose zero was set by a gauge.
        """
        spec = next(one for one in self.bench.cell.instruments if one.name == self.setup.instrument)
        if not isinstance(spec, Sensor):
            return self._positioning(repetitions)
        found = np.full((len(self.targets), repetitions, 2), np.nan)
        size, name = self.axis.scatter, f"file scatter {self.setup.component} {self.axis.name}"
        scatter = Scatter(size, self.bench.truth.seed, name).drawn((2 * repetitions, len(self.targets)))
        for passed, offsets in enumerate(self._offsets(spec, repetitions)):
            repetition, way = divmod(passed, 2)
            found[:, repetition, way] = self._pass(spec, 1 - 2 * way, self._at(passed), scatter[passed]) + offsets
        found[np.abs(found) > spec.range] = np.nan
        absolute = component_of(self.setup)[1] == "0" and self.setup.optics == "ball"
        return found if absolute else found - found[0, 0, 0]

    def _positioning(self, repetitions: int) -> FloatArray:
        measure = {**(self.axis.measure or {}), "component": self.setup.component}
        measure["targets"] = {"positions": self.targets.tolist()}
        axis = self.axis.model_copy(update={"measure": measure})
        utc = self.nck.core.clock.utc()
        return CapturePc(bench=self.bench, nck=self.nck, axis=axis, start_s=self.start_s, start_utc=utc).deviations(
            repetitions
        )

    def _at(self, passed: int) -> float:
        return self.start_s + passed * len(self.targets) * STOP_S

    def _offsets(self, spec: Sensor, repetitions: int) -> list[FloatArray]:
        """What each pass reads beside the machine, (m,): noise of stops and averages, drift, the mounting's zero."""
        name, count, noise = f"file {spec.name} {self.setup.component}", len(self.targets), spec.noise
        seed = self.bench.truth.seed
        stops = StopNoise(noise, self.bench.stops_of_run(self.setup.axis), seed, name)
        rng = generator(seed, name, "averages")
        zero = float(rng.uniform(-1.0, 1.0)) * spec.zero
        scatter = noise.sample / np.sqrt(spec.sample_hz * AVERAGE_S)
        passes = []
        for passed in range(2 * repetitions):
            stop = np.asarray([stops.offset(passed * count + place) for place in range(count)])
            drift = noise.drift_per_h * drift_time_s(self._at(passed) + STOP_S * np.arange(count)) / 3600.0
            passes.append(stop + drift + rng.normal(0.0, scatter, count) + self._zero(zero))
        return passes

    def _zero(self, drawn: float) -> float:
        """The zero of a mounting is anybody's; where a gauge sets it, its error is the set-up's own."""
        return 0.0 if component_of(self.setup)[1] == "0" and self.setup.optics == "ball" else drawn

    def _pass(self, spec: Sensor, direction: int, t: float, scatter: FloatArray) -> FloatArray:
        """One way along the targets, without noise, (m,)."""
        axis, truth = self.axis, self.bench.truth
        motions = {letter: self._standing(letter) for letter in watched_axes(self.setup) if self._known(letter)}
        encoder = np.asarray(self.nck.compensated_encoder(axis.name, self.targets, direction))
        sense = np.full_like(encoder, float(direction))
        motions[axis.letter] = AxisMotion(encoder, sense, sense, scatter)
        shown = component_reading(self.setup, truth.frames(motions, t), motions)
        rotary = axis.kind == "rotary"
        own = curve(
            spec.own_error, axis.travel, rotary=rotary, seed=truth.seed, name=f"{spec.name} own error", redraw=False
        )
        return np.asarray(shown + own(np.mod(encoder, 360.0) if rotary else encoder))

    def _known(self, letter: str) -> bool:
        return any(axis.letter == letter for axis in self.bench.cell.axes)

    def _standing(self, letter: str) -> AxisMotion:
        """An axis that does not move: where it was told to stand, come to from below, or where it is."""
        name = self.bench.cell.axis(letter).name
        if letter not in self.stands:
            place, sense = self.nck.encoder(name, np.asarray([self.nck.core.clock.now()]))
            return AxisMotion(place, sense, sense)
        place = np.asarray(self.nck.compensated_encoder(name, np.asarray([self.stands[letter]]), 1))
        return AxisMotion(place, np.ones(1), np.ones(1))
