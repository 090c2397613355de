"""Sign proofs in a run: an axis' instrument mounted once, its sense proved, then the sign of every kind it sees."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

from drivers.carried import Carried, at_work
from drivers.ports.instruments import Recounting, RotaryCalibrator, TypedInstrument
from drivers.types.orders import SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.units import deviation_scale
from gateway.capture.live import combined
from gateway.capture.readings import Readings
from gateway.capture.rig import Rig, setup_of
from gateway.capture.sense import prove_sense, sense_plan
from gateway.config import AxisSection
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError, WriteRefused
from gateway.events import SignProofStarted
from gateway.push import PushContext, Reading, ReadStop, SignQuestion, Steps, prove_signs, trials_stay_off
from gateway.workflow.bench import Bench
from gateway.workflow.consents import proving, proving_again

# Switching a table moves the axis by micrometres: no motion is seen, so the reading waits longer instead.
SWITCH_SETTLE_S = 8.0


def provable(at: Bench, axis: AxisSection) -> bool:
    """Whether a push can prove a sign itself: an instrument sees the output axis, on a road that lets it."""
    controller = at.supervisor.controller
    if isinstance(controller, Carried) and (at_work().ends or not _typed(at, axis)):
        return False  # an instrument cannot be read while the axis stands at a stop of a program that was carried
    return bool(axis.measure.instrument) and controller.capabilities.proves_signs


def _typed(at: Bench, axis: AxisSection) -> bool:
    return bool(axis.measure.instrument) and isinstance(
        at.supervisor.instrument(axis.measure.instrument), TypedInstrument
    )


@dataclass(frozen=True, slots=True)
class Mounted:
    """An axis' instrument, mounted, its sense proved: it sees every sign of a table that moves this axis."""

    rig: Rig
    sense: int

    @asynccontextmanager
    async def reading(self) -> AsyncIterator[ReadStop]:
        """What it reads at a stop, from a new datum: between two proofs a push moves the axis at its own feed."""
        rig, axis = self.rig, self.rig.axis
        combine = combined(axis, rig.instrument, self.sense)
        still = rig.controller.capabilities.switches_now
        window = replace(rig.window, settle_s=SWITCH_SETTLE_S) if still else rig.window
        scale = deviation_scale(axis.unit)
        if isinstance(rig.instrument, RotaryCalibrator):
            await rig.instrument.hold()
            await rig.instrument.track()
        if isinstance(rig.instrument, Recounting):
            await rig.instrument.set_datum()
        async with Readings(rig.instrument, rig.clock, combine) as readings:

            async def read_stop(_stop: Stop) -> tuple[float, float]:
                reading = await readings.settled(window)
                value = float(combine(reading.values[None, :])[0])
                return value * scale, float(reading.sigma.max()) * scale / reading.count**0.5

            yield read_stop


@dataclass(slots=True)
class BenchEyes:
    """The instruments of a bench's axes, each mounted when its axis' turn has come; it stays until the next one's."""

    at: Bench
    last: Mounted | None = None

    def plans(self, axis: str) -> Sequence[StopPlan]:
        """The moves that prove the instrument's sense."""
        section = self.at.axis(axis)
        setup = "" if self.at.standing.holds(section) else setup_of(section)
        return () if self._seen_by_last(axis) else (sense_plan(section, setup),)

    async def on(self, axis: str) -> Reading:
        """Mount it and prove its sense. Raises WriteRefused (E-RUN-NO-PROOF) where there is none."""
        if self.last is None or not self._seen_by_last(axis):
            self.last = await _mount(self.at, self.at.axis(axis))
        return self.last.reading

    def _seen_by_last(self, axis: str) -> bool:
        return self.last is not None and self.last.rig.axis.name == axis


async def _mount(at: Bench, axis: AxisSection) -> Mounted:
    if not provable(at, axis):
        raise WriteRefused("E-RUN-NO-PROOF", axis.name)
    SignProofStarted(axis.name).tell(at.say)
    rig, stands = at.rig(axis), at.standing.holds(axis)
    if stands:
        at.say("P-STANDS", component=axis.measure.component, axis=axis.name)
    sense = (await prove_sense(rig, stands=stands)).sense
    at.standing.note(axis)
    return Mounted(rig, sense)


async def prove(
    at: Bench, wishes: Sequence[tuple[TableChange, PushContext]], eyes: BenchEyes
) -> tuple[SignProof | VerifyError, ...]:
    """Prove the sign of each table's kind on its output axis; what was proved is stored. Raises as `prove_signs`."""
    for change, _ in wishes:
        if not provable(at, at.axis(change.axis)):
            raise WriteRefused("E-RUN-NO-PROOF", change.axis)
    for change, context in wishes:
        if not trials_stay_off(
            context
        ):  # its table will act from the restart on: what needs the axis as it is comes before
            await eyes.on(change.axis)
    for change, _ in wishes:
        proving(at, change)
    found = await prove_signs([_question(at, change, context) for change, context in wishes], eyes)
    for proof in found:
        if isinstance(proof, SignProof):
            at.proofs.save(proof)
            at.say("P-SIGN-PROVED", axis=proof.output_axis, slope=f"{proof.slope:+.3f}")
    return found


def _question(at: Bench, change: TableChange, context: PushContext) -> SignQuestion:
    table, grid = change.new, at.axis(change.new.input_axis).table

    def again(steps: Steps) -> None:
        proving_again(at, change, mean=steps.mean, u=steps.u, count=len(steps.each))

    return SignQuestion(
        context,
        grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        kind=table.kind,
        index=table.index,
        direction=table.direction,
        again=again,
    )
