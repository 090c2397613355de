"""The live tables of axes where only a program can save them: it moves nothing; and the words for who starts it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from typing import Protocol

from drivers.errors import DeviceRefused, TrueflankError
from drivers.ports.devices import Tell
from drivers.programs import reading_plan
from drivers.types.orders import SignProof, TableQuestion
from drivers.types.stops import StopPlan, StopReached
from drivers.types.tables import LiveSet


class RunsStops(Protocol):
    """The part of a controller that reading needs."""

    name: str
    goes_on: bool

    async def prepare_reading(self, plans: Sequence[StopPlan]) -> None:
        """As `Controller.prepare_stops`, of plans without any stop: one program for all of them."""
        ...

    async def wait_stop(self, after: int, timeout_s: float) -> StopReached | None:
        """As `Controller.wait_stop`."""
        ...

    async def abort_program(self) -> None:
        """As `Controller.abort_program`."""
        ...

    async def saved_tables(self, axis: str, proof: SignProof | None = None) -> LiveSet:
        """As `Controller.saved_tables`."""
        ...


async def read_live(device: RunsStops, questions: Sequence[TableQuestion], tell: Tell) -> tuple[LiveSet, ...]:
    """Select one program for all axes, let a person start it, and read what it saved; one that waits is asked to end.

    One that waits for these very plans goes on with them, and nobody needs to start anything.
    Raises DeviceRefused (E-NC-READ-STOP) for a program that is not this one, (E-NC-NOT-SAVED) for one that ended
    early, and what the calls raise.
    """
    plans = tuple(dict.fromkeys(reading_plan(question) for question in questions))
    names = ", ".join(dict.fromkeys(question.axis for question in questions))
    await device.prepare_reading(plans)
    if not device.goes_on:
        tell("P-NC-READ", axis=names)
    try:
        reached = await device.wait_stop(0, max(question.start_s for question in questions))
        if reached is not None:
            told = f"stop {reached.counter} at {reached.target}"
            raise DeviceRefused("E-NC-READ-STOP", device.name, axis=names, found=told)
    except (TrueflankError, asyncio.CancelledError):
        with contextlib.suppress(TrueflankError):
            await device.abort_program()
        raise
    return tuple([await device.saved_tables(question.axis, question.proof) for question in questions])
