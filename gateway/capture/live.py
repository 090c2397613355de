"""Captures one axis live: every target, repetition and approach once, as raw averages with their times.

A reading that does not settle is left out and taken again at the end, and so is one that is out of line with its
repetitions; a lost beam ends the program, and the next one sets the datum anew and goes on where the first stopped.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace

import numpy as np

from drivers.errors import BeamObstructed, TrueflankError
from drivers.message import Message, digits
from drivers.ports.instruments import Instrument, Recounting, RotaryCalibrator, TypedInstrument
from drivers.types.machine import ChannelStatus
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.values import FloatArray
from gateway.capture.checks import FROZEN_TARGETS, check_applied, explain_value
from gateway.capture.collection import Collection, RawCapture, raw_capture
from gateway.capture.readings import History, Readings
from gateway.capture.revisits import AddedTargets, Retake
from gateway.capture.rig import Rig, first_channel
from gateway.capture.targets import measuring_plan, targets_of, with_checks
from gateway.config import AxisSection
from gateway.domain.equipment import SenseProof
from gateway.errors import CaptureError, NotMoved, Scattering, Unstable
from gateway.events import BeamLost
from gateway.live import onlooker
from gateway.moves import leave_when_ended, walk_plan

# A set-up that does not settle at so many stops one after the other does not settle at all.
MOST_UNSETTLED = 3
DATUM_REPETITION = 9999
POLL_S = 0.5
AtStop = Callable[[int, Stop, StopReached], Awaitable[None]]


def combine_channels(axis: AxisSection, instrument: Instrument, sense: int) -> History:
    """The one quantity of the axis in its own unit: sense * displacement, or sense * laser - device."""
    if axis.kind == "linear":
        return lambda values: sense * first_channel(values)
    laser, device = instrument.channels.index("laser_deg"), instrument.channels.index("device_deg")
    return lambda values: sense * values[:, laser] - values[:, device]


More = Callable[[RawCapture], FloatArray]
"""Which places (k,) shall be targets too, from what is captured so far; none: it is enough."""


async def capture_axis(
    rig: Rig, proof: SenseProof, between: FloatArray | None = None, more: More | None = None
) -> RawCapture:
    """Measure an axis with a proven instrument, at its targets and at check stops ``between`` (k,) them.

    As long as ``more`` names places, these are measured before the set-up is left.

    Raises what `walk_plan` and `Readings` raise: BeamObstructed once every allowed recovery is used up, Unstable
    when a stop does not settle in any round either; CaptureError (E-CAP-APPLIED).
    """
    axis, clock = rig.axis, rig.clock
    targets, checks = with_checks(targets_of(axis), between)
    combine = combine_channels(axis, rig.instrument, proof.sense)
    found = Collection(
        axis=axis,
        targets=targets,
        channels=rig.instrument.channels,
        combine=combine,
        proof=proof,
        checks=checks,
        already=rig.instrument.compensated_for,
    )
    found.stands = axis.measure.standstill
    async with Readings(rig.instrument, clock, combine) as readings:
        plan = measuring_plan(axis, targets, "", checks=checks)
        visits = Visits(rig, found, readings)
        return await visit_all(visits, plan, more, lambda raw: check_applied(raw.live, visits.shown))


async def visit_all(
    visits: Visits, plan: StopPlan, more: More | None, judge: Callable[[RawCapture], None]
) -> RawCapture:
    """Every stop of a plan, then as long as ``more`` names places these; ``judge`` raises on what cannot be kept."""
    started = visits.rig.clock.utc().isoformat(timespec="seconds")
    await visits.all(plan, visits.first.size)
    while True:
        judge(raw := await _so_far(visits, started))
        places = np.empty(0) if more is None else more(raw)
        if not places.size:
            return raw
        await visits.widened(AddedTargets.of(visits.found, visits.rig.axis, places))


async def _so_far(visits: Visits, started: str) -> RawCapture:
    """What is captured by now, and the tables it was captured under."""
    rig, found, readings = visits.rig, visits.found, visits.readings
    found.ambients.append(air := await rig.instrument.ambient())
    onlooker().ambient(rig.instrument.name, air)
    found.ambient_times.append(readings.latest_s)
    live = await rig.controller.saved_tables(rig.axis.name)
    ended = rig.clock.utc().isoformat(timespec="seconds")
    events = tuple(Message.of("S-CAP-SAID", event=event) for event in dict.fromkeys(readings.events))
    raw = raw_capture(
        found,
        found.targets,
        channels=rig.instrument.channels,
        live=live,
        times=(started, ended),
        lost=readings.lost,
    )
    added = tuple(int(i) for i in np.flatnonzero(~np.isin(found.targets, visits.first)))
    return replace(raw, notes=(*raw.notes, *events), checks=found.checks, added=added)


class Visits:
    """Visits every stop of a plan, if need be in several programs."""

    def __init__(self, rig: Rig, found: Collection, readings: Readings) -> None:
        self.rig = rig
        self.found = found
        self.readings = readings
        self._recoveries = rig.axis.measure.beam_recoveries
        self._taken = 0
        self._per_pass = 1
        self._in_a_row = 0
        self._still = 0
        self.shown: list[tuple[float, float]] = []
        self.first = found.targets

    async def all(self, plan: StopPlan, per_pass: int) -> None:
        """Every stop read; raises BeamObstructed or Unstable when what is allowed did not suffice.

        What is out of line then is taken again, and stays as it is where that does not succeed.
        """
        self._per_pass = max(per_pass, 1)
        await self._all_read(plan)
        await self._out_of_line_again(plan)

    async def widened(self, wide: AddedTargets) -> Collection:
        """The collection with more targets, visited now; as it was where that does not succeed."""
        self.found, self._taken, self._per_pass = wide.found, 0, wide.added.size + wide.anchors.size
        try:
            await self._through(wide.plan, last_round=False)
        except (Unstable, BeamObstructed):
            await self._program_ended()
        self.found, told = wide.end()
        self.found.notes.extend(told)
        await self._out_of_line_again(wide.plan)
        return self.found

    async def _out_of_line_again(self, plan: StopPlan) -> None:
        again: Retake | None = None
        for number in range(1, self.rig.axis.measure.retakes + 1):
            again = Retake.of(self.found, again)
            if again is None:
                return
            self.rig.say("P-CAP-OUT-OF-LINE", axis=plan.axis, count=len(again.cells), round=number)
            await self._taken_again(plan, again)

    async def _taken_again(self, plan: StopPlan, again: Retake) -> None:
        again.begin(self.found)
        try:
            await self._through(replace(plan, name=f"TFAGAIN{plan.letter}", stops=again.stops), last_round=False)
        except (Unstable, BeamObstructed):
            await self._program_ended()
        self.found.notes.append(again.end(self.found))

    async def _all_read(self, plan: StopPlan) -> None:
        again = replace(plan, name=f"TFAGAIN{plan.letter}")
        rounds = self.rig.axis.measure.retakes
        await self._through(plan, last_round=not rounds)
        for number in range(1, rounds + 1):
            missing = self.found.missing(plan.stops)
            if not missing:
                return
            self.rig.say("P-CAP-RETAKE", axis=plan.axis, count=len(missing), round=number)
            self.found.notes.append(Message.of("S-CAP-UNSETTLED", count=len(missing)))
            await self._through(replace(again, stops=missing), last_round=number == rounds)

    async def _through(self, plan: StopPlan, *, last_round: bool) -> None:
        """One plan, begun anew at the datum after each lost beam."""
        part = plan
        while True:
            try:
                rig = self.rig
                at_stop = leave_when_ended(rig.controller, rig.clock, part, self._at_stop(last_round=last_round))
                await walk_plan(rig.controller, part, at_stop=at_stop, patience=rig.patience, say=rig.say)
                return
            except BeamObstructed:
                if not self._recoveries or self.found.datum is None:
                    raise
            await self._program_ended()
            part = self._resume(plan)

    async def _program_ended(self) -> None:
        """The program was asked to leave; another may be sent once the channel is in reset."""
        rig = self.rig
        async with rig.clock.deadline(rig.patience.stop_s, rig.axis.name):
            while (await rig.controller.state()).channel is not ChannelStatus.RESET:
                await rig.clock.sleep(POLL_S)

    def _resume(self, plan: StopPlan) -> StopPlan:
        self._recoveries -= 1
        datum = self.found.datum.target if self.found.datum is not None else plan.stops[0].target
        left = self.found.missing(plan.stops)
        BeamLost(plan.axis, len(left), len(plan.stops)).tell(self.rig.say)
        first = Stop(datum, 1, DATUM_REPETITION, 0)
        return replace(plan, name=f"TFDATUM{plan.letter}", stops=(first, *left), setup=self.rig.setup)

    def _at_stop(self, *, last_round: bool) -> AtStop:
        async def at_stop(index: int, stop: Stop, reached: StopReached) -> None:
            self.shown.append((reached.target, reached.encoder_compensation))
            if stop.repetition == DATUM_REPETITION:
                await self._set_datum_anew(stop)
                return
            if self.found.datum is None:
                self.readings.datum()
            try:
                await self._take(stop, first=index == 0)
                await self.found.stand(stop, self.readings, self.rig)
            except Unstable as error:
                self._explain(stop, error)
                if last_round or self.found.datum is None:
                    raise
                self._in_a_row += 1
                if self._in_a_row > MOST_UNSETTLED:
                    raise self._what_happened(error) from error
                self.rig.say("P-CAP-UNSETTLED", axis=self.rig.axis.name, target=stop.target)

        return at_stop

    def _what_happened(self, error: Unstable) -> TrueflankError:
        """A counter cannot see a broken beam: steady readings at wrong places say that counts were lost."""
        if isinstance(error, Scattering):
            return error
        self._in_a_row = 0
        return BeamObstructed("E-CAP-COUNT", self.rig.instrument.name, stops=MOST_UNSETTLED + 1)

    def _explain(self, stop: Stop, error: Unstable) -> None:
        """Raise what a reading that is not there really means, where that can be told."""
        axis, found = self.rig.axis.name, self.found
        self._still = self._still + 1 if isinstance(error, NotMoved) else 0
        if self._still >= FROZEN_TARGETS:
            self._still = 0
            raise BeamObstructed("E-CAP-FROZEN", axis, target=digits(stop.target, 6), count=FROZEN_TARGETS) from error
        read, wanted = error.fields.get("read"), error.fields.get("wanted")
        if not isinstance(read, float) or not isinstance(wanted, float):
            return
        if found.datum is None:
            at, seen = f"{stop.target:g}", f"{read:.6g}"
            raise CaptureError("E-CAP-DATUM", axis, target=at, read=seen, wanted=digits(wanted, 6)) from error
        doubt = found.doubt(read, wanted)
        known = None if doubt is None else explain_value(doubt, axis, stop.target)
        if known is not None:
            raise known from error

    async def _take(self, stop: Stop, *, first: bool) -> None:
        found = self.found
        air = await self.rig.instrument.ambient() if self._taken % self._per_pass == 0 else None
        if air is not None:
            onlooker().ambient(self.rig.instrument.name, air)
            found.breathe(air, self.rig.instrument.name)
        if air is not None and found.datum is None:
            found.admit(air, self.rig.instrument)
        expected = found.expectation(stop)
        if expected is not None and isinstance(self.rig.instrument, TypedInstrument):
            self.rig.instrument.expect(f"{self.rig.axis.name} {stop.target:g}", *expected)
        departed = found.departure(stop, first=first)
        found.take(stop, reading := await self.readings.settled(self.rig.window, expect=expected, moved_from=departed))
        if air is not None:
            found.ambients.append(air)
            found.ambient_times.append(reading.time_s)
        self._taken += 1
        self._in_a_row = 0
        self._still = 0

    async def _set_datum_anew(self, stop: Stop) -> None:
        if isinstance(self.rig.instrument, RotaryCalibrator):
            await self.rig.instrument.track()
        if isinstance(self.rig.instrument, Recounting):
            await self.rig.instrument.set_datum()
        self.readings.datum()
        self.found.set_anew(stop, await self.readings.settled(self.rig.window))
        self.found.notes.append(Message.of("S-CAP-NEW-DATUM", count=self._taken))
