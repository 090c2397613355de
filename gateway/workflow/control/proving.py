"""Sign proofs in a run: an axis' instrument mounted once, its sense proved, then the sign of every kind it sees."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

from drivers.carried import Carried, at_work
from drivers.ports.instruments import Recounting, RotaryCalibrator, TypedInstrument
from drivers.types.orders import SignProof
from drivers.types.stops import Stop
from drivers.types.tables import LiveSet
from drivers.units import deviation_scale
from gateway.capture.live import combined
from gateway.capture.readings import Readings
from gateway.capture.rig import Rig
from gateway.capture.sense import prove_sense
from gateway.config import AxisSection
from gateway.domain.proposals import TableChange
from gateway.errors import WriteRefused
from gateway.push import PushContext, ReadStop, prove_sign
from gateway.workflow.bench import Bench
from gateway.workflow.consents import proving

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


@dataclass(slots=True)
class Mounted:
    """An axis' instrument, mounted, its sense proved: it sees every sign of a table that moves this axis.

    ``live`` is what acts on the axis as the moves that proved the sense saved it; good for the first proof alone.
    """

    rig: Rig
    sense: int
    live: LiveSet | None

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


async def mount(at: Bench, axis: AxisSection) -> Mounted:
    """Mount the axis' instrument and prove its sense. Raises WriteRefused (E-RUN-NO-PROOF) where there is none."""
    if not provable(at, axis):
        raise WriteRefused("E-RUN-NO-PROOF", axis.name)
    at.say("P-SIGN", axis=axis.name)
    rig = at.rig(axis)
    sense = await prove_sense(rig)
    live = await rig.controller.saved_tables(axis.name) if rig.controller.capabilities.stops else None
    return Mounted(rig, sense.sense, live)


async def prove(at: Bench, change: TableChange, context: PushContext, eye: Mounted) -> SignProof:
    """Prove the sign of the table's kind with the output axis' instrument mounted. Raises as `prove_sign`."""
    table = change.new
    grid = at.axis(table.input_axis).table
    proving(at, change)
    live, eye.live = eye.live, None
    proof = await prove_sign(
        context,
        grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        reading=eye.reading,
        kind=table.kind,
        index=table.index,
        live=live,
    )
    at.proofs.save(proof)
    at.say("P-SIGN-PROVED", axis=eye.rig.axis.name, slope=f"{proof.slope:+.3f}")
    return proof
