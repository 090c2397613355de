"""The live tables of an axis where only a program can save them: one stop, and the words for who starts it."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Protocol

from drivers.errors import DeviceRefused, TrueflankError
from drivers.ports.devices import Tell
from drivers.types.orders import SignProof, TableQuestion
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import LiveSet

# The axis need not settle: nothing is measured at this stop.
DWELL_S = 0.1


class RunsStops(Protocol):
    """The part of a controller that reading needs."""

    name: str

    async def prepare_stops(self, plan: StopPlan) -> None:
        """As `Controller.prepare_stops`."""
        ...

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """As `Controller.wait_stop`."""
        ...

    async def release_stop(self, counter: int) -> None:
        """As `Controller.release_stop`."""
        ...

    async def abort_program(self) -> None:
        """As `Controller.abort_program`."""
        ...

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """As `Controller.saved_tables`."""
        ...


def plan_of(question: TableQuestion) -> StopPlan:
    """The program that saves the tables: one stop, as short as may be."""
    return StopPlan(
        name=f"TFREAD{question.letter}",
        axis=question.moved,
        letter=question.letter,
        unit=question.unit,
        rotary=question.rotary,
        stops=(Stop(question.place, question.approach),),
        feed=question.feed,
        overrun=question.overrun,
        dwell_s=DWELL_S,
        encoder=question.encoder,
        output_axis="" if question.axis == question.moved else question.axis,
    )


async def read_live(device: RunsStops, question: TableQuestion, tell: Tell) -> LiveSet:
    """Select that program, let a person start it, and read what it saved; a program that waits is asked to end.

    Raises DeviceRefused (E-NC-READ-STOP) for a program that ends early or is not this one, and what the calls raise.
    """
    await device.prepare_stops(plan_of(question))
    tell("P-NC-READ", axis=question.axis)
    try:
        reached = await device.wait_stop(0, question.start_s)
        if reached is None or reached.counter != 1:
            raise _astray(device, question, reached)
        await device.release_stop(reached.counter)
        beyond = await device.wait_stop(reached.counter, question.stop_s)
        if beyond is not None:
            raise _astray(device, question, beyond)
    except (TrueflankError, asyncio.CancelledError):
        with contextlib.suppress(TrueflankError):
            await device.abort_program()
        raise
    return await device.saved_tables(question.axis, question.proof)


def _astray(device: RunsStops, question: TableQuestion, found: StopReached | None) -> DeviceRefused:
    told = "its end before the stop" if found is None else f"stop {found.counter} at {found.target}"
    return DeviceRefused("E-NC-READ-STOP", device.name, axis=question.axis, found=told)
