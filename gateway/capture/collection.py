"""What a capture has gathered so far, stop by stop: averages, times, the datum, and where the count stood last."""

from __future__ import annotations

import contextlib
from copy import copy
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message, Quantity
from drivers.ports.instruments import Instrument, TypedInstrument
from drivers.types.sensing import Ambient
from drivers.types.stops import Stop
from drivers.types.tables import LiveSet
from drivers.types.values import CompensatedFor, FloatArray
from drivers.units import deviation_scale, deviation_unit, wrap_deg
from gateway.capture.checks import UnexpectedValue, check_ambient
from gateway.capture.readings import History, Readings, StopReading
from gateway.capture.rig import Rig
from gateway.capture.targets import expected_travel, jog_start
from gateway.config import AxisSection
from gateway.domain.equipment import SenseProof
from gateway.domain.values import COVERAGE
from gateway.errors import AmbientOutOfRange
from gateway.evaluate.optics import air, displacement
from gateway.evaluate.uncertainty.budget import (
    LATERAL_RANGE_MM,
    ROTARY_DEVICE_ARCSEC,
    UNKNOWN_OFF_20_K,
    linear_budget,
    misalignment_um,
)
from gateway.live import LiveDeviation, onlooker

MATCH = 0.1
# A quarter of the way is enough to know that the axis moved, and far above what it may wander while it stands.
MOVED_PART = 0.25
PROOF_PART = 0.01
READ = ("values", "times", "sigmas")  # what is kept of each reading
# So near is the target that a person named, mm or deg.
NEAR = 1e-3


@dataclass(frozen=True, slots=True)
class FirstReading:
    """The first reading of all: channel values (c,), the combined quantity and the target it was taken at."""

    values: FloatArray
    combined: float
    target: float


class Collection:
    """Arrays of one capture, (m, n, 2[, channels]); NaN where nothing was read yet."""

    def __init__(
        self,
        axis: AxisSection,
        targets: FloatArray,
        channels: tuple[str, ...],
        combine: History,
        proof: SenseProof,
        *,
        checks: tuple[int, ...] = (),
        already: CompensatedFor = "nothing",
    ) -> None:
        shape = (len(targets), axis.measure.repetitions, 2)
        self._axis = axis
        self._combine = combine
        self._already = already
        self._airs: tuple[Ambient, Ambient] | None = None
        # The channel that a lost beam sets back to zero; a calibrator's own encoder keeps counting.
        self._counting = channels.index("laser_deg") if "laser_deg" in channels else 0
        self.place(targets, checks)
        self._last_value = _reading_after_proof(axis, proof, combine, len(channels))
        self._last_stop: Stop | None = None
        self._offset = np.zeros(len(channels))
        self.values = np.full((*shape, len(channels)), np.nan)
        self.times = np.full(shape, np.nan)
        self.sigmas = np.full(shape, np.nan)
        self.counts: list[int] = []
        self.ambients: list[Ambient] = []
        self.ambient_times: list[float] = []
        self.notes: list[Message] = []
        self.datum: FirstReading | None = None
        # How often to read at rest, where the datum was taken.
        self.stands = 0
        self.standing: tuple[float, ...] = ()

    def place(self, targets: FloatArray, checks: tuple[int, ...]) -> None:
        """Where is measured, (m,) ascending, and which of these are check stops; nothing is read or forgotten."""
        self.targets, self.checks = targets, checks
        self._tolerance = _tolerance(self._axis, np.delete(targets, list(checks)))

    def with_targets(self, more: FloatArray) -> tuple[Collection, NDArray[np.int64]]:
        """The same with ``more`` places (k,) that nothing was read at yet, and their indices."""
        places = np.concatenate([self.targets, more])
        order = np.argsort(places, kind="stable")
        wide = copy(self)
        wide.place(places[order], tuple(int(np.flatnonzero(order == check)[0]) for check in self.checks))
        for name in READ:
            mine = getattr(self, name)
            setattr(wide, name, np.concatenate([mine, np.full((more.size, *mine.shape[1:]), np.nan)])[order])
        return wide, np.flatnonzero(order >= self.targets.size)

    def without(self, rows: NDArray[np.int64]) -> Collection:
        """The same without some of its places, none of them a check stop."""
        kept = np.setdiff1d(np.arange(self.targets.size), rows)
        less = copy(self)
        less.place(self.targets[kept], tuple(int(np.searchsorted(kept, check)) for check in self.checks))
        for name in READ:
            setattr(less, name, getattr(self, name)[kept].copy())
        return less

    def combined(self, values: FloatArray) -> float:
        """The one quantity of the axis from channel values (c,)."""
        return float(self._combine(values[None, :])[0])

    async def stand(self, stop: Stop, readings: Readings, rig: Rig) -> None:
        """Once, where the datum was taken: read at rest. Nobody is asked to type the same reading again."""
        count, self.stands = self.stands, 0
        if count and not isinstance(rig.instrument, TypedInstrument):
            seen = await readings.at_rest(rig.window, count, expect=self.expectation(stop))
            self.standing = tuple(self.combined(one.values) for one in seen)

    def expectation(self, stop: Stop) -> tuple[float, float] | None:
        """(value, tolerance) the instrument should show at a stop in its present count.

        Before the datum it is known from the sense proof for a linear axis, and None for a rotary one.
        """
        if self.datum is None:
            return self._from_proof(stop)
        far = self._axis.modulo and abs(stop.target - self.datum.target) > 360.0
        travel = stop.target - self.datum.target
        moved = wrap_deg(travel) if far else travel
        present = self.combined(self.datum.values - self._offset)
        return present + moved, self._tolerance

    def _from_proof(self, stop: Stop) -> tuple[float, float] | None:
        """Where the count must stand if nobody has touched it since the sense proof."""
        if self._axis.kind != "linear":
            return None
        travel = stop.target - jog_start(self._axis, self._axis.measure.jog)
        return self._last_value + travel, max(self._tolerance, PROOF_PART * abs(travel))

    def admit(self, air: Ambient, instrument: Instrument) -> None:
        """What cannot be corrected is refused before it is measured: raises as `surroundings.check`."""
        check_ambient(self._axis, air, instrument.compensated_for, instrument.name)

    def breathe(self, air: Ambient, instrument: str) -> None:
        """Air and material as they are now, for what is shown meanwhile; those that cannot correct are left out."""
        with contextlib.suppress(AmbientOutOfRange):
            check_ambient(self._axis, air, self._already, instrument)
            self._airs = (self._airs[0] if self._airs is not None else air, air)

    def doubt(self, read: float, wanted: float) -> UnexpectedValue | None:
        """A reading that is not the wanted one, with what it might be instead; None where it says nothing yet."""
        datum = wanted if self.datum is None else self.combined(self.datum.values - self._offset)
        stops = {} if self.datum is None else {float(t): datum + float(t) - self.datum.target for t in self.targets}
        return UnexpectedValue(
            read=read,
            wanted=wanted,
            datum=datum,
            tolerance=self._tolerance,
            rotary=self._axis.kind == "rotary",
            targets=stops,
        )

    def departure(self, stop: Stop, *, first: bool) -> tuple[float, float]:
        """(value, distance): what the count showed last, and how far it must have gone since then.

        The ``first`` stop of a program is always approached from its overrun.
        """
        if self._last_stop is None:
            travel = _approach_travel(self._axis, self.targets)
        else:
            overrun = self._axis.measure.overrun
            travel = max(self._least_way(self._last_stop, stop), overrun if first else 0.0)
        return self._last_value, MOVED_PART * travel

    def _least_way(self, before: Stop, here: Stop) -> float:
        """The least distance between two stops; a modulo axis may go the other way round."""
        way = expected_travel(before, here, self._axis.measure.overrun)
        return min(way, 360.0 - way) if self._axis.modulo and way > 180.0 else way

    def take(self, stop: Stop, reading: StopReading) -> None:
        """Keep a stop's reading, in the count of the datum."""
        values = reading.values + self._offset
        cell = (stop.label, stop.repetition, 0 if stop.approach == 1 else 1)
        self.values[cell] = values
        self.times[cell] = reading.time_s
        self.sigmas[cell] = float(np.max(reading.sigma))
        self.counts.append(reading.count)
        if self.datum is None:
            self.datum = FirstReading(values, self.combined(values), stop.target)
        onlooker().taken(self._axis.name, (stop.target, stop.repetition + 1, stop.approach), self.shown(stop))
        self._stands(stop, reading)

    def set_anew(self, stop: Stop, reading: StopReading) -> None:
        """After a lost beam: what reads at the datum now stands for what read there first.

        Raises nothing; the uncertainty of one more reading of the datum is the price, and is noted.
        """
        if self.datum is None:
            return
        lacking = self.datum.combined - self.combined(reading.values)
        self._offset = self._expected_count(reading.values, lacking)
        self._stands(stop, reading)

    def stop(self, cell: tuple[int, int, int]) -> Stop:
        """The stop whose reading stands in a cell (target, repetition, approach index)."""
        index, repetition, approach = cell
        return Stop(float(self.targets[index]), 1 if approach == 0 else -1, repetition, index)

    def told(self, cell: tuple[int, int, int]) -> dict[str, object]:
        """A cell as fields of a message."""
        index, repetition, approach = cell
        return {"place": f"{self.targets[index]:g}{'+-'[approach]}", "repetition": repetition + 1}

    def deviations(self) -> FloatArray:
        """What was read less its target, (m, n, 2) in the axis unit, but for a constant: to compare repetitions by."""
        read = self._combine(self.values.reshape(-1, self.values.shape[-1])).reshape(self.times.shape)
        zero = 0.0 if self.datum is None else self.datum.combined - self.datum.target
        off = read - self.targets[:, None, None] - zero
        return np.asarray(wrap_deg(off) if self._axis.modulo else off)

    def deviation(self, stop: Stop) -> float:
        """One of `deviations`: that of the reading at a stop."""
        cell = stop.label, stop.repetition, 0 if stop.approach == 1 else 1
        zero = 0.0 if self.datum is None else self.datum.combined - self.datum.target
        off = self.combined(self.values[cell]) - stop.target - zero
        return float(wrap_deg(off)) if self._axis.modulo else off

    def shown(self, stop: Stop) -> LiveDeviation:
        """The reading at a stop for people: corrected as its capture will be, by what is known now."""
        scale, unit = deviation_scale(self._axis.unit), deviation_unit(self._axis.unit)
        cell = stop.label, stop.repetition, 0 if stop.approach == 1 else 1
        scatter = self.sigmas[cell] * scale / sqrt(max(self.counts[-1], 1))
        raw = self.combined(self.values[cell])
        if self._axis.kind == "rotary":
            expanded = hypot(ROTARY_DEVICE_ARCSEC, COVERAGE * scatter)
            return LiveDeviation(self.deviation(stop) * scale, unit, expanded, raw)
        if self._airs is None or self.datum is None:
            return LiveDeviation(self.deviation(stop) * scale, unit, None, raw)
        value, expanded = provisional_um(
            self._axis,
            raw - self.datum.combined,
            stop.target,
            datum_mm=self.datum.target,
            span_mm=float(np.ptp(self.targets)),
            reading_u_um=scatter,
            ambient=self._airs,
            already=self._already,
        )
        return LiveDeviation(value, unit, expanded, raw)

    def asked(self) -> list[tuple[int, int, int]]:
        """Where the readings stand that a person wants again: a place within a thousandth of what was said."""
        found = []
        for target, repetition, approach in onlooker().asked_again(self._axis.name):
            for i in np.flatnonzero(np.abs(self.targets - target) < NEAR):
                every = range(self.times.shape[1]) if repetition == 0 else (repetition - 1,)
                found += [(int(i), j, 0 if approach == 1 else 1) for j in every if j < self.times.shape[1]]
        return found

    def size(self, change: float) -> Quantity:
        """A change of `deviations` with its unit."""
        value = float(f"{change * deviation_scale(self._axis.unit):.3g}")
        return Quantity(value, deviation_unit(self._axis.unit), signed=True)

    def level(self, cell: tuple[int, int, int], shift: float) -> None:
        """Take a shift of the combined quantity off a reading that is there."""
        self.values[cell] -= self._expected_count(self.values[cell], shift)

    def _expected_count(self, values: FloatArray, change: float) -> FloatArray:
        """What the counting channel (c,) must change for this change of the combined quantity."""
        unit = np.zeros_like(self._offset)
        unit[self._counting] = 1.0
        return np.asarray(unit * change / (self.combined(values + unit) - self.combined(values)))

    def _stands(self, stop: Stop, reading: StopReading) -> None:
        self._last_value, self._last_stop = self.combined(reading.values), stop

    def missing(self, stops: tuple[Stop, ...]) -> tuple[Stop, ...]:
        """Those of these stops that have no reading yet, in their order."""
        return tuple(s for s in stops if np.isnan(self.times[s.label, s.repetition, 0 if s.approach == 1 else 1]))


def _reading_after_proof(axis: AxisSection, proof: SenseProof, combine: History, channels: int) -> float:
    """What the combined reading showed where the sense proof left the axis: its last, for a calibrator its first."""
    evidence = proof.evidence[-channels:] if axis.kind == "linear" else proof.evidence[:channels]
    return float(combine(np.asarray([evidence]))[0])


def _approach_travel(axis: AxisSection, targets: FloatArray) -> float:
    jog = axis.measure.jog if axis.kind == "linear" else 0.0
    return max(abs(float(targets[0]) - jog_start(axis, jog)), axis.measure.overrun)


def _tolerance(axis: AxisSection, targets: FloatArray) -> float:
    smallest = float(np.min(np.diff(targets))) if len(targets) > 1 else axis.measure.overrun
    return min(MATCH * smallest, axis.measure.overrun / 4.0)


# The deviation of one reading while others are still to come: corrected with the last air and material; pure.
#
# The capture corrects at its end with air and material linear in time between its first and last reading of them
# (`gateway.capture.corrections`). Meanwhile only the last ones are known, so what is shown may still change: by the
# change that air and material have made so far, which is a part of its uncertainty.


def provisional_um(
    axis: AxisSection,
    optical_mm: float,
    target_mm: float,
    *,
    datum_mm: float,
    span_mm: float,
    reading_u_um: float,
    ambient: tuple[Ambient, Ambient],
    already: CompensatedFor,
) -> tuple[float, float]:
    """Corrected deviation and its U (k = 2) in um of a reading on a linear axis.

    ``optical_mm`` is the reading from the datum, positive in the axis' plus direction, ``span_mm`` the length that is
    measured, ``ambient`` the first and the last reading of air and material. U is the budget of a laser over the
    length from the datum (device, material, expansion, and the cosine error of a beam that runs off over the span), the
    scatter of the reading, and what air and material have changed since the first one. Raises AmbientOutOfRange.
    """
    first, last = ambient
    setup = displacement.LinearSetup(
        datum_mm=datum_mm,
        dead_path_mm=axis.measure.dead_path_mm,
        expansion_ppm_per_k=axis.measure.expansion_ppm_per_k,
        beam=axis.measure.beam,
    )

    def corrected(now: Ambient) -> float:
        values, _ = displacement.linear_deviations(
            [optical_mm], [target_mm], setup, start=first, end=now, fraction=1.0, already=already
        )
        return float(values[0])

    value, length = corrected(last), abs(target_mm - datum_mm)
    off_20_k = air.material_degc(last) - air.REFERENCE_DEGC if last.material_degc else UNKNOWN_OFF_20_K
    budget = (
        linear_budget(length, expansion_ppm_per_k=axis.measure.expansion_ppm_per_k, off_20_k=off_20_k)
        if (length)
        else None
    )
    parts = (budget.device, budget.temperature, budget.expansion) if budget is not None else ()
    runs_off = misalignment_um(span_mm, LATERAL_RANGE_MM) * length / span_mm if span_mm else 0.0
    return value, hypot(*parts, runs_off, COVERAGE * reading_u_um, value - corrected(first))


# The raw record of a capture: averages as the instrument gave them.


@dataclass(frozen=True, slots=True)
class RawCapture:
    """Averages as the instrument gave them, sense not yet applied.

    ``values`` shape (m, n, 2, channels): target, repetition, approach + then -; ``time_s`` (m, n, 2) in
    instrument time; ``window_sigma`` (m, n, 2) of the combined quantity in the axis unit.
    ``ambient`` is the environment at the start of each one-way pass and after the last. ``notes`` tell what
    was taken again. ``checks`` are indices of targets that are check stops only, ``added`` those of targets that came
    later than the others. ``standing`` are readings at rest.
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
    notes: tuple[Message, ...] = ()
    checks: tuple[int, ...] = ()
    added: tuple[int, ...] = ()
    standing: tuple[float, ...] = ()


def raw_capture(
    found: Collection,
    targets: FloatArray,
    channels: tuple[str, ...],
    live: LiveSet,
    times: tuple[str, str],
    lost: int,
) -> RawCapture:
    """What was collected as a record; ``times`` are start and end in UTC."""
    started, ended = times
    return RawCapture(
        targets=targets,
        channels=channels,
        values=found.values,
        time_s=found.times,
        window_sigma=found.sigmas,
        window_count=int(np.median(found.counts)),
        ambient=tuple(found.ambients),
        ambient_time_s=np.asarray(found.ambient_times),
        live=live,
        started_utc=started,
        ended_utc=ended,
        lost_samples=lost,
        notes=tuple(found.notes),
        standing=found.standing,
    )
