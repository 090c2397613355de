"""An error motion that is no positioning: its optics proved before the first target, then captured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np

from drivers.errors import BeamObstructed, ConfigError, UnsupportedDevice
from drivers.message import Message, Quantity, digits, fixed
from drivers.ports.instruments import Instrument
from drivers.types.sensing import Ambient, SampleBlock
from drivers.types.stops import Stop, StopReached
from drivers.types.values import FloatArray
from drivers.units import ARCSEC_PER_DEG, UM_PER_MM, DeviationUnit
from gateway.capture.checks import UnexpectedValue
from gateway.capture.collection import Collection, RawCapture
from gateway.capture.corrections import temperature_note, with_capture_doubts
from gateway.capture.live import More, Visits, visit_all
from gateway.capture.readings import History, Readings, StopReading, Window
from gateway.capture.rig import SETTLE_TIMEOUT_S, Rig, step_of
from gateway.capture.targets import jog_plan, jog_start, measuring_plan, step_plan, targets_of
from gateway.domain.captures import Capture
from gateway.domain.equipment import SenseProof
from gateway.errors import CaptureError, Unstable
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.evaluate.optics import corrections
from gateway.live import LiveDeviation
from gateway.moves import leave_when_ended, walk_plan

# Captures an error motion that is no positioning: straightness, angle, or a location by an artefact.
#
# The reading hardly follows the axis, so it cannot say itself at which stop it was taken. A sample belongs to a stop
# when its instrument time lies after the arrival: the stream began after it was asked for, so instrument time counted
# from its first samples is never ahead of the gateway's. Nothing of the air is corrected.

UNITS: dict[DeviationUnit, dict[str, float]] = {
    "um": {"_um": 1.0, "_mm": UM_PER_MM},
    "arcsec": {"_arcsec": 1.0, "_deg": ARCSEC_PER_DEG},
}
LARGEST: dict[DeviationUnit, float] = {"um": 1000.0, "arcsec": 300.0}
TOUCHED = 2
# These belong to a laser or a calibrator: what they show is the travel itself.
NEVER = ("displacement_mm", "laser_deg", "device_deg")


@dataclass(frozen=True, slots=True)
class ErrorRig(Rig):
    """A rig for one error motion: readings times ``factor`` are its deviation in ``unit``.

    ``column`` is the channel's place; ``largest`` the greatest reading from the datum that optics still at their
    place can give; ``jog`` the plausibility move in the axis unit, ``step`` the known one of the optics that proves
    their sense, in ``unit`` (0: none). The axis' ``stable`` is in ``unit``.
    """

    unit: DeviationUnit = "um"
    column: int = 0
    factor: float = 1.0
    largest: float = LARGEST["um"]
    jog: float = 10.0
    optics: tuple[str, ...] = ("unknown",)
    step: float = 0.0

    @property
    def window(self) -> Window:
        """The settling window, its sigma in the unit of the deviation."""
        measure = self.axis.measure
        return Window(measure.settle_s, measure.average_s, measure.stable, SETTLE_TIMEOUT_S)

    @property
    def combine(self) -> History:
        """Channel columns (n, c) to deviations (n,) in `unit`."""
        return lambda values: self.factor * values[:, self.column]


def channel_of(instrument: Instrument, wanted: str, unit: DeviationUnit) -> tuple[int, float]:
    """Column and scale of the channel that reads this unit. Raises ConfigError (E-SETUP-CHANNEL)."""
    fitting = {name: scale for name in instrument.channels for end, scale in UNITS[unit].items() if name.endswith(end)}
    named = {name: scale for name, scale in fitting.items() if name not in NEVER and wanted in ("", name)}
    if len(named) != 1:
        channels, asked = ", ".join(instrument.channels) or "none", wanted or Message.of("W-CAP-ONLY-UNIT", unit=unit)
        raise ConfigError("E-SETUP-CHANNEL", instrument.name, wanted=asked, channels=channels, unit=unit)
    name, scale = next(iter(named.items()))
    return instrument.channels.index(name), scale


class ErrorReadings(Readings):
    """Readings whose windows begin only once the stream has reached the moment they were asked for."""

    def __init__(self, rig: ErrorRig) -> None:
        super().__init__(rig.instrument, rig.clock, rig.combine)
        self._opened_s = 0.0
        self._ahead_s: float | None = None

    async def __aenter__(self) -> Self:
        self._opened_s = self._clock.now()
        return await super().__aenter__()

    def _take(self, block: SampleBlock) -> None:
        """The first sample was taken after the stream was asked for: nothing later may bound how far time is ahead."""
        known = self.latest_s
        super()._take(block)
        if self._ahead_s is None and self.latest_s > known:
            self._ahead_s = float(self._blocks[-1].time_s[0]) - self._opened_s

    def datum(self) -> None:
        """Forget a break; what was known of the stream's delay goes with a restarted clock."""
        if self.restarted:
            self._opened_s, self._ahead_s = self._clock.now(), None
        super().datum()

    async def settled(
        self,
        window: Window,
        *,
        expect: tuple[float, float] | None = None,
        moved_from: tuple[float, float] | None = None,
    ) -> StopReading:
        """As `Readings.settled`, of samples taken after this call; Unstable when the stream stays behind."""
        await self._caught_up(window.timeout_s)
        return await super().settled(window, expect=expect, moved_from=moved_from)

    async def _caught_up(self, timeout_s: float) -> None:
        asked = self._clock.now()
        while self._ahead_s is None:
            await self._next_block(timeout_s)
        while self.latest_s < asked + self._ahead_s:
            if self._clock.now() - asked > timeout_s:
                late = Message.of("W-WAIT-LATE", age=fixed(asked + self._ahead_s - self.latest_s, 1))
                raise Unstable("E-CAP-UNSTABLE", self._instrument.name, missing=late, timeout_s=timeout_s)
            await self._next_block(timeout_s)


class ErrorCollection(Collection):
    """What is expected of a reading that hardly moves: that it stays within the range of its optics."""

    def __init__(self, rig: ErrorRig, targets: FloatArray) -> None:
        channels = rig.instrument.channels
        nothing = SenseProof(
            instrument=rig.instrument.name, axis=rig.axis.name, sense=1, scale=1.0, evidence=(0.0,) * len(channels)
        )
        super().__init__(rig.axis, targets, channels, rig.combine, nothing)
        self._counting = rig.column
        self._largest = rig.largest
        self._unit = rig.unit
        self._elsewhere = 0

    def expectation(self, stop: Stop) -> tuple[float, float] | None:  # noqa: ARG002 - every stop alike
        """(value, tolerance) around the datum; None before it."""
        if self.datum is None:
            return None
        return self.combined(self.datum.values - self._offset), self._largest

    def departure(self, stop: Stop, *, first: bool) -> tuple[float, float]:  # noqa: ARG002
        """Nothing must have moved."""
        return self._last_value, 0.0

    def deviations(self) -> FloatArray:
        """What was read, (m, n, 2): it hardly follows the axis."""
        return np.asarray(self._combine(self.values.reshape(-1, self.values.shape[-1])).reshape(self.times.shape))

    def shown(self, stop: Stop) -> LiveDeviation:
        """What was read at a stop, against the first reading; no budget of these optics is known here."""
        cell = stop.label, stop.repetition, 0 if stop.approach == 1 else 1
        raw = self.combined(self.values[cell])
        return LiveDeviation(raw - (raw if self.datum is None else self.datum.combined), self._unit, None, raw)

    def size(self, change: float) -> Quantity:
        """A change of `deviations` with its unit."""
        return Quantity(float(f"{change:.3g}"), self._unit, signed=True)

    def admit(self, air: Ambient, instrument: Instrument) -> None:
        """Any air will do."""

    def take(self, stop: Stop, reading: StopReading) -> None:
        """Keep a stop's reading: the optics are where they were."""
        self._elsewhere = 0
        super().take(stop, reading)

    def doubt(self, read: float, wanted: float) -> UnexpectedValue | None:
        """None for one reading that is far off: it is taken again.

        Raises CaptureError (E-SETUP-TOUCHED) at the second in a row: optics that stand elsewhere lean otherwise too.
        """
        self._elsewhere += 1
        if self._elsewhere < TOUCHED:
            return None
        shift = f"{read - wanted:+.6g}"
        raise CaptureError("E-SETUP-TOUCHED", self._axis.name, shift=shift, largest=digits(self._largest, 6))


async def capture_error(rig: ErrorRig, more: More | None = None) -> RawCapture:
    """Visit every stop with proven optics, and as long as ``more`` names places, these before the set-up is left.

    Raises as `capture_axis`, CaptureError (E-SETUP-DEAD).
    """
    axis = rig.axis
    targets = targets_of(axis)
    found = ErrorCollection(rig, targets)
    plan = measuring_plan(axis, targets, "")

    def judge(raw: RawCapture) -> None:
        """A reading that never changed comes from no sensor that is alive."""
        if float(np.ptp(raw.values[..., rig.column])) == 0.0 and not np.any(raw.window_sigma):
            raise CaptureError("E-SETUP-DEAD", rig.instrument.name, count=found.times.size)

    async with ErrorReadings(rig) as readings:
        return await visit_all(Visits(rig, found, readings), plan, more, judge)


def error_capture(
    rig: ErrorRig,
    raw: RawCapture,
    sense: Literal[1, -1],
    *,
    absolute: bool = False,
    proved: SenseProof | None = None,
) -> Capture:
    """Deviations in the rig's unit, zero at the first reading, or as read where the zero was set by a gauge.

    ``proved`` is how the sense that the site file says was proved.
    """
    told = Message.of("S-CAP-WAY-PROVED" if proved is not None else "S-CAP-WAY", sense=f"{sense:+d}")
    values = rig.factor * raw.values[..., rig.column]
    deviations = values if absolute else values - values[0, 0, 0]
    reading_u = float(np.sqrt(np.nanmean(raw.window_sigma**2) / max(raw.window_count, 1))) * abs(rig.factor)
    lost = (Message.of("S-CAP-LOST", count=raw.lost_samples),) if raw.lost_samples else ()
    capture = Capture(
        axis=rig.axis.name,
        component=rig.axis.measure.component,
        axis_unit=rig.axis.unit,
        targets=raw.targets,
        deviations=deviations,
        reading_u=reading_u,
        ambient_start=raw.ambient[0],
        ambient_end=raw.ambient[-1],
        corrections=corrections.begin("nothing"),
        live=raw.live,
        sense=proved,
        suspects=robust_means(raw.targets, deviations).suspects,
        source="live",
        started_utc=raw.started_utc,
        ended_utc=raw.ended_utc,
        notes=(
            *(*lost, *raw.notes, told),
            *temperature_note(raw.live, raw.targets),
        ),
        cycle=rig.axis.measure.cycle,
    )
    return with_capture_doubts(capture, rig.axis)


# Proves the optics of an error motion before its first target: kind, unit, light, and a jog they must survive.

# What a carriage or table can do over a jog, um or arcsec: 2.5 mrad of lean over 10 mm, a ball 0.3 mm off its axis.
JOG_CHANGE: dict[DeviationUnit, float] = {"um": 25.0, "arcsec": 30.0}
STEP_SHARE = 0.25  # of a step by hand: a shim's thickness, and how straight it is moved
BACK_AGAIN: dict[DeviationUnit, float] = {"um": 2.0, "arcsec": 2.0}


@dataclass(frozen=True, slots=True)
class MountingProof:
    """What the instrument said of its optics and read at start, start + ``jog`` and start again, in ``unit``.

    ``sense`` is the proof by a known step of the optics; None where the site file names no step.
    """

    instrument: str
    axis: str
    component: str
    optics: str
    unit: DeviationUnit
    jog: float
    evidence: tuple[float, ...]
    sense: SenseProof | None = None


async def prove_mounting(rig: ErrorRig) -> MountingProof:
    """Let the operator mount what MSG says, ask the instrument what it has, and jog the axis.

    A jog that does not come back is made once more: one reading out of line is no wrong mounting.
    Raises UnsupportedDevice (E-SETUP-OPTICS: other optics; E-SETUP-LIGHT: no valid reading with them;
    E-SETUP-JOG: it follows the travel or does not come back; E-SETUP-STEP: it does not follow a known step), Unstable.
    """
    told, seen = await _prove_by_jog(rig, rig.setup)
    if not _plausible(rig, seen):
        told, seen = await _prove_by_jog(rig, "")
    if not _plausible(rig, seen):
        raise _refuse_mounting(rig, seen)
    component = rig.axis.measure.component
    return MountingProof(
        instrument=rig.instrument.name,
        axis=rig.axis.name,
        component=component,
        optics=told,
        unit=rig.unit,
        jog=rig.jog,
        evidence=tuple(seen),
        sense=await _prove_by_step(rig, seen[-1]) if rig.step else None,
    )


async def _prove_by_step(rig: ErrorRig, before: float) -> SenseProof:
    """A person moves the optics by a known step in the plus direction and back again: the reading must follow.

    Raises UnsupportedDevice (E-SETUP-STEP): another way or by another amount, or it does not come back.
    """
    there_at, back_at = [await _after(rig, moved) for moved in (rig.step, 0.0)]
    there, back = there_at - before, there_at - back_at
    if max(abs(there - rig.step), abs(back - rig.step)) > STEP_SHARE * rig.step + _repeats(rig):
        told: dict[str, Any] = {"step": f"{rig.step:+g} {rig.unit}", "there": f"{there:+.2f} {rig.unit}"}
        told |= {"component": rig.axis.measure.component, "back": f"{-back:+.2f} {rig.unit}"}
        raise UnsupportedDevice("E-SETUP-STEP", rig.instrument.name, **told)
    return SenseProof(
        instrument=rig.instrument.name,
        axis=rig.axis.name,
        sense=1,
        scale=0.5 * (there + back) / rig.step,
        evidence=(before, there_at, back_at),
    )


async def _after(rig: ErrorRig, moved: float) -> float:
    """The reading once a person has moved the optics to ``moved`` from where they were mounted."""
    seen: list[float] = []
    async with ErrorReadings(rig) as readings:

        async def at_stop(_index: int, _stop: Stop, _reached: StopReached) -> None:
            readings.datum()
            reading = await _valid_reading(rig, readings)
            seen.append(float(rig.combine(reading.values[None, :])[0]))

        plan = step_plan(rig.axis, jog_start(rig.axis, rig.jog), step_of(rig.axis, moved))
        looks_on = leave_when_ended(rig.controller, rig.clock, plan, at_stop)
        await walk_plan(rig.controller, plan, at_stop=looks_on, patience=rig.patience, say=rig.say)
    return seen[-1]


async def _prove_by_jog(rig: ErrorRig, setup: str) -> tuple[str, list[float]]:
    """What the instrument says of its optics, and its three readings; ``setup`` is what MSG says ("": nothing)."""
    seen: list[float] = []
    told: list[str] = []
    async with ErrorReadings(rig) as readings:

        async def at_stop(index: int, _stop: Stop, _reached: StopReached) -> None:
            if index == 0:
                told.append(await _optics(rig))
                readings.datum()
            reading = await _valid_reading(rig, readings)
            seen.append(float(rig.combine(reading.values[None, :])[0]))

        plan = jog_plan(rig.axis, jog_start(rig.axis, rig.jog), rig.jog, setup)
        looks_on = leave_when_ended(rig.controller, rig.clock, plan, at_stop)
        await walk_plan(rig.controller, plan, at_stop=looks_on, patience=rig.patience, say=rig.say)
    return told[0], seen


async def _valid_reading(rig: ErrorRig, readings: ErrorReadings) -> StopReading:
    """A settled reading; without a valid one what is mounted is not what was asked for, or not aligned."""
    try:
        return await readings.settled(rig.window)
    except BeamObstructed as error:
        component = rig.axis.measure.component
        raise UnsupportedDevice("E-SETUP-LIGHT", rig.instrument.name, component=component) from error


async def _optics(rig: ErrorRig) -> str:
    kind = (await rig.instrument.optics()).kind
    if kind not in rig.optics:
        wanted = " or ".join(known for known in rig.optics if known != "unknown")
        component = rig.axis.measure.component
        raise UnsupportedDevice("E-SETUP-OPTICS", rig.instrument.name, found=kind, wanted=wanted, component=component)
    return kind


def _plausible(rig: ErrorRig, seen: list[float]) -> bool:
    return abs(seen[1] - seen[0]) <= JOG_CHANGE[rig.unit] and abs(seen[2] - seen[0]) <= _repeats(rig)


def _repeats(rig: ErrorRig) -> float:
    return max(BACK_AGAIN[rig.unit], 5.0 * rig.axis.measure.stable)


def _refuse_mounting(rig: ErrorRig, seen: list[float]) -> UnsupportedDevice:
    return UnsupportedDevice(
        "E-SETUP-JOG",
        rig.instrument.name,
        jog=f"{rig.jog:g} {rig.axis.unit}",
        component=rig.axis.measure.component,
        there=f"{seen[1] - seen[0]:+.3f} {rig.unit}",
        limit=f"{JOG_CHANGE[rig.unit]:g} {rig.unit}",
        back=f"{seen[2] - seen[0]:+.3f} {rig.unit}",
        repeats=f"{_repeats(rig):g} {rig.unit}",
    )
