"""The sign proof in a run: the output axis' instrument mounted, its sense proved, then the sign of the table's kind."""

from __future__ import annotations

from dataclasses import replace

from drivers.types.orders import SignProof
from drivers.types.stops import Stop
from drivers.units import deviation_scale
from gateway.capture.live import combined
from gateway.capture.readings import Readings
from gateway.capture.sense import prove_sense
from gateway.config import AxisSection
from gateway.domain.proposals import TableChange
from gateway.errors import WriteRefused
from gateway.push import PushContext, prove_sign
from gateway.workflow.bench import Bench
from gateway.workflow.consents import proving

# Switching a table moves the axis by micrometres: no motion is seen, so the reading waits longer instead.
SWITCH_SETTLE_S = 8.0


def provable(at: Bench, axis: AxisSection) -> bool:
    """Whether a push can prove a sign itself: an instrument sees the output axis, and the table can be switched."""
    can = at.supervisor.controller.capabilities
    return bool(axis.measure.instrument) and can.switches_now


async def prove(at: Bench, change: TableChange, context: PushContext) -> SignProof:
    """Mount the output axis' instrument again, prove its sense, then the sign of the table's kind.

    Raises WriteRefused (E-RUN-NO-PROOF) where nothing can see the output axis.
    """
    axis, table = at.axis(change.axis), change.new
    if not provable(at, axis):
        raise WriteRefused("E-RUN-NO-PROOF", axis.name)
    at.say("P-SIGN", axis=axis.name)
    rig = at.rig(axis)
    sense = await prove_sense(rig)
    combine = combined(axis, rig.instrument, sense.sense)
    window = replace(rig.window, settle_s=SWITCH_SETTLE_S)
    scale = deviation_scale(axis.unit)
    async with Readings(rig.instrument, at.clock, combine) as readings:

        async def read_stop(_stop: Stop) -> tuple[float, float]:
            reading = await readings.settled(window)
            value = float(combine(reading.values[None, :])[0])
            return value * scale, float(reading.sigma.max()) * scale / reading.count**0.5

        grid = at.axis(table.input_axis).table
        proving(at, change)
        proof = await prove_sign(
            context,
            grid.minimum,
            maximum=grid.maximum,
            step=grid.step,
            read_stop=read_stop,
            kind=table.kind,
            index=table.index,
        )
    at.proofs.save(proof)
    at.say("P-SIGN-PROVED", axis=axis.name, slope=f"{proof.slope:+.3f}")
    return proof
