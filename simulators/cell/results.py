"""A capture PC beside the machine: measures an axis with the laser maker's program and saves its file."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulators.cell.control import CellNck
from simulators.cellfile import CellAxis, Noise
from simulators.files import FileContent, write_result
from simulators.optics import OpticsBench
from simulators.optics.air import refractive_index
from simulators.optics.mountings import linear_length_mm
from simulators.optics.stops import Stops
from simulators.truth import AxisMotion, Scatter, Weather

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
        stops = Stops(noise, 2 * count * repetitions, self.bench.truth.seed, f"file {self.axis.name}")
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
