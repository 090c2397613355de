"""A capture PC beside the machine: measures an axis through the laser maker's program and saves its file."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from simulators.cellfile import CellFile, Noise
from simulators.files import FileContent, write_result
from simulators.optics.air import refractive_index
from simulators.optics.stops import Stops
from simulators.truth import Truth, Weather

FloatArray = NDArray[np.float64]
STOP_S = 5.0


class Judged(Protocol):
    """What this needs of a cell."""

    file: CellFile
    truth: Truth
    clock: Clock

    def true_deviation(
        self, axis: str, positions: FloatArray, direction: int, t: float | None = None
    ) -> FloatArray:
        """True position - commanded, um or arcsec."""
        ...


def measured_file(cell: Judged, axis: str, path: Path, repetitions: int) -> Path:
    """Measure the targets of the cell file and save them from the first target's zero.

    The capture program corrects air and material itself; what stays is the axis as it is, the stops' noise
    and outliers, and the sensors' errors in temperature. Deviations are relative to the first reading.
    """
    spec = cell.file.axis(axis)
    targets, rotary = _targets(spec.measure or {}), spec.kind == "rotary"
    start, t0 = cell.clock.utc(), cell.clock.now()
    noise, serial = _instrument(cell.file, spec.letter)
    stops = Stops(noise, 2 * len(targets) * repetitions, cell.truth.seed, f"file {axis}")
    order = [(r, a) for r in range(repetitions) for a in (0, 1)]
    deviations = np.full((len(targets), repetitions, 2), np.nan)
    for passed, (repetition, approach) in enumerate(order):
        t = t0 + passed * len(targets) * STOP_S
        true = cell.true_deviation(axis, targets, 1 if approach == 0 else -1, t)
        numbers = np.arange(len(targets)) if approach == 0 else np.arange(len(targets))[::-1]
        offsets = np.asarray([stops.offset(passed * len(targets) + int(n)) for n in numbers])
        warm = _seen_expansion(cell, spec.expansion_ppm_per_k, targets - targets[0], t) if not rotary else 0.0
        deviations[:, repetition, approach] = true + offsets + warm
    deviations -= deviations[0, 0, 0]
    t1 = t0 + len(order) * len(targets) * STOP_S
    first, last = cell.truth.climate.sensed(t0), cell.truth.climate.sensed(t1)
    alpha = float((spec.measure or {}).get("expansion_ppm_per_k", 11.5))
    content = FileContent(
        targets - targets[0],
        deviations,
        rotary,
        first,
        last,
        start,
        cell.clock.utc(),
        alpha,
        (_factor(first, alpha), _factor(last, alpha)),
        cell.file.machine.model,
        serial,
        spec.letter,
    )
    write_result(path, content)
    return path
