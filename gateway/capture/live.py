"""Captures one axis live: every target, repetition and approach once, as raw averages with their times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.ports import Instrument
from drivers.types import Ambient, FloatArray, LiveSet, Stop, StopReached
from drivers.units import wrap_deg
from gateway.capture.readings import History, Reading, Readings
from gateway.capture.rig import Rig
from gateway.capture.sense import first_channel
from gateway.capture.targets import expected_travel, jog_start, measuring_plan, positions
from gateway.config import AxisSection
from gateway.domain import SenseProof
from gateway.walk import walk

MATCH = 0.1


@dataclass(frozen=True, slots=True)
class RawCapture:
    """Averages as the instrument gave them, sense not yet applied.

    ``values`` shape (m, n, 2, channels): target, repetition, approach + then -; ``time_s`` (m, n, 2) in
    instrument time; ``window_sigma`` (m, n, 2) of the combined quantity in the axis unit.
    ``ambient`` is the environment at the start of each one-way pass and after the last.
    """

    targets: FloatArray
    channels: tuple[str, ...]
    values: FloatArray
    time_s: FloatArray
    window_sigma: FloatArray
    window_count: int
    ambient: tuple[Ambient, ...]
    ambient_time_s: FloatArray
    live: LiveSet
    started_utc: str
    ended_utc: str
    lost_samples: int


def combined(axis: AxisSection, instrument: Instrument, sense: int) -> History:
    """The one quantity of the axis in its own unit: sense * displacement, or sense * laser - device."""
    if axis.kind == "linear":
        return lambda values: sense * first_channel(values)
    laser, device = instrument.channels.index("laser_deg"), instrument.channels.index("device_deg")
    return lambda values: sense * values[:, laser] - values[:, device]


async def capture_axis(rig: Rig, proof: SenseProof) -> RawCapture:
    """Measure an axis with a proven instrument; raises what `walk` and `Readings` raise."""
    axis, instrument, clock = rig.axis, rig.instrument, rig.clock
    targets = positions(axis.measure.targets, axis.reference) if axis.measure.targets else np.empty(0)
    plan = measuring_plan(axis, targets, "", name=f"TFMEAS{axis.letter}")
    shape = (len(targets), axis.measure.repetitions, 2)
    values = np.full((*shape, len(instrument.channels)), np.nan)
    times, sigmas = np.full(shape, np.nan), np.full(shape, np.nan)
    combine = combined(axis, instrument, proof.sense)
    window, tolerance = rig.window, _tolerance(axis, targets)
    ambients: list[Ambient] = []
    ambient_times: list[float] = []
    counts: list[int] = []
    datum: list[tuple[float, float]] = []
    last = [_standing(axis, proof, combine, len(instrument.channels))]
    started = clock.utc().isoformat(timespec="seconds")
    async with Readings(instrument, clock, combine) as readings:

        async def at_stop(index: int, stop: Stop, _reached: StopReached) -> None:
            if index == 0:
                readings.datum()
            if index % len(targets) == 0:
                ambients.append(await instrument.ambient())
            reading = await readings.settled(
                window,
                expect=_expected(axis, datum, stop.target, tolerance),
                moved_from=(last[-1], (expected_travel(plan, index) or _approach_travel(axis, targets)) / 4.0),
            )
            value = float(combine(reading.values[None, :])[0])
            if not datum:
                datum.append((value, stop.target))
            if index % len(targets) == 0:
                ambient_times.append(reading.time_s)
            last.append(value)
            _keep(reading, stop)

        def _keep(reading: Reading, stop: Stop) -> None:
            cell = (stop.label, stop.repetition, 0 if stop.approach == 1 else 1)
            values[cell] = reading.values
            times[cell] = reading.time_s
            sigmas[cell] = float(np.max(reading.sigma))
            counts.append(reading.count)

        await walk(rig.controller, plan, at_stop, rig.patience, rig.say)
        ambients.append(await instrument.ambient())
        ambient_times.append(readings.latest_s)
        lost = readings.lost
    live = await rig.controller.saved_tables(axis.name)
    ended = clock.utc().isoformat(timespec="seconds")
    return RawCapture(
        targets,
        instrument.channels,
        values,
        times,
        sigmas,
        int(np.median(counts)),
        tuple(ambients),
        np.asarray(ambient_times),
        live,
        started,
        ended,
        lost,
    )


def _standing(axis: AxisSection, proof: SenseProof, combine: History, channels: int) -> float:
    """What the combined reading showed where the sense proof left the axis: its last, for a calibrator its first."""
    evidence = proof.evidence[-channels:] if axis.kind == "linear" else proof.evidence[:channels]
    return float(combine(np.asarray([evidence]))[0])


def _approach_travel(axis: AxisSection, targets: FloatArray) -> float:
    jog = axis.measure.jog if axis.kind == "linear" else 0.0
    return max(abs(float(targets[0]) - jog_start(axis, jog)), axis.measure.overrun)


def _tolerance(axis: AxisSection, targets: FloatArray) -> float:
    smallest = float(np.min(np.diff(targets))) if len(targets) > 1 else axis.measure.overrun
    return min(MATCH * smallest, axis.measure.overrun / 4.0)


def _expected(
    axis: AxisSection, datum: list[tuple[float, float]], target: float, tolerance: float
) -> tuple[float, float] | None:
    if not datum:
        return None
    value, start = datum[0]
    travel = wrap_deg(target - start) if axis.modulo and abs(target - start) > 360.0 else target - start
    return value + travel, tolerance
