"""A capture PC at any set-up of the plan: what its instrument shows at every stop, saved as a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulators.cell.control import CellNck
from simulators.cell.results import STOP_S, CapturePc
from simulators.cellfile import CellAxis, Sensor, Setup
from simulators.optics import OpticsBench
from simulators.optics.readings import component_of, looks_along, reading
from simulators.optics.sensor import watched
from simulators.optics.stops import Stops
from simulators.truth import AxisMotion, Scatter, generator
from simulators.truth.drift import drifted_s
from simulators.truth.terms import curve

FloatArray = NDArray[np.float64]
AVERAGE_S = 1.0
SIGNS = "+-"


@dataclass(frozen=True, slots=True)
class SetupPc:
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
        unit = "arcsec" if looks_along(self.setup) in "ABC" else "um"
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
        stops = Stops(noise, self.bench.stops_of_run(self.setup.axis), seed, name)
        rng = generator(seed, name, "averages")
        zero = float(rng.uniform(-1.0, 1.0)) * spec.zero
        scatter = noise.sample / np.sqrt(spec.sample_hz * AVERAGE_S)
        passes = []
        for passed in range(2 * repetitions):
            stop = np.asarray([stops.offset(passed * count + place) for place in range(count)])
            drift = noise.drift_per_h * drifted_s(self._at(passed) + STOP_S * np.arange(count)) / 3600.0
            passes.append(stop + drift + rng.normal(0.0, scatter, count) + self._zero(zero))
        return passes

    def _zero(self, drawn: float) -> float:
        """The zero of a mounting is anybody's; where a gauge sets it, its error is the set-up's own."""
        return 0.0 if component_of(self.setup)[1] == "0" and self.setup.optics == "ball" else drawn

    def _pass(self, spec: Sensor, direction: int, t: float, scatter: FloatArray) -> FloatArray:
        """One way along the targets, without noise, (m,)."""
        axis, truth = self.axis, self.bench.truth
        motions = {letter: self._standing(letter) for letter in watched(self.setup) if self._known(letter)}
        encoder = np.asarray(self.nck.compensated_encoder(axis.name, self.targets, direction))
        sense = np.full_like(encoder, float(direction))
        motions[axis.letter] = AxisMotion(encoder, sense, sense, scatter)
        shown = reading(self.setup, truth.frames(motions, t), motions)
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
