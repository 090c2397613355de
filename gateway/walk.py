"""Walks a stop plan with the controller: every stop once, in order, each released only after its reading."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.errors import DeviceRefused, TrueflankError
from drivers.ports.controller import Controller
from drivers.programs import ForeseesPlans
from drivers.types.machine import ChannelStatus
from drivers.types.orders import SignProof, TableQuestion
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.values import Approach
from gateway.axes import AxisRecord
from gateway.errors import Incomplete
from gateway.events import ProgramSelected, SetupProgramSelected, StopDone
from gateway.moving import tell_motion
from gateway.say import Say, silence

AtStop = Callable[[int, Stop, StopReached], Awaitable[None]]
POSITION_TOLERANCE = 1e-4
# A reading that settles is there before the first look; two looks apart tell a reset from a moment between two states.
LOOK_S, AGAIN_S = 5.0, 1.0


@dataclass(frozen=True, slots=True)
class Patience:
    """Seconds of the gateway's clock: for a person to start, and for one move to end."""

    start_s: float
    stop_s: float


def approach_in(axis: AxisRecord, place: float) -> Approach:
    """The direction from which a stop is reached without leaving the travel.

    Coming up from below needs room for the overrun below; near the lower end the axis comes down.
    """
    return -1 if not axis.modulo and place - axis.overrun < axis.room[0] else 1


def question(axis: AxisRecord, patience: Patience, proof: SignProof | None = None) -> TableQuestion:
    """Which tables act on ``axis``; a program that must be run for it moves nothing."""
    return TableQuestion(
        axis=axis.name,
        letter=axis.letter,
        unit=axis.unit,
        rotary=axis.rotary,
        encoder=axis.encoder,
        start_s=patience.start_s,
        proof=proof,
    )


async def walk(controller: Controller, plan: StopPlan, at_stop: AtStop, patience: Patience, say: Say = silence) -> None:
    """Send the plan's program and visit its stops.

    `at_stop` is awaited while the axis stands; the hand-shake counter is echoed after it returns.
    Raises Incomplete when the program ends early, DeviceRefused when its stops are not the plan's, and
    whatever the wire or `at_stop` raises; on any of these the waiting program is asked to end.
    """
    await controller.prepare_stops(plan)
    counter = 0
    try:
        await _tell_start(controller, plan, say)
        for index, stop in enumerate(plan.stops):
            timeout_s = patience.start_s if index == 0 else patience.stop_s
            reached = await controller.wait_stop(counter, timeout_s)
            if reached is None:
                raise Incomplete("E-WALK-ENDED", plan.axis, done=index, total=len(plan.stops))
            _check(plan, index, stop, reached, counter)
            await at_stop(index, stop, reached)
            counter = reached.counter
            await controller.release_stop(counter)
            StopDone(plan.axis, plan.name, index + 1, len(plan.stops)).tell(say)
        if await controller.wait_stop(counter, patience.stop_s) is not None:
            raise DeviceRefused("E-WALK-ORDER", plan.axis, expected="the end", found="another stop")
    except (TrueflankError, asyncio.CancelledError):
        with contextlib.suppress(TrueflankError):
            await controller.abort_program()
        raise


def watched(controller: Controller, clock: Clock, plan: StopPlan, at_stop: AtStop) -> AtStop:
    """`at_stop`, left as soon as the program has ended meanwhile: what it waits for cannot come any more.

    Raises Incomplete then, besides what `at_stop` raises.
    """

    async def looks_on(index: int, stop: Stop, reached: StopReached) -> None:
        work = asyncio.ensure_future(at_stop(index, stop, reached))
        gone = asyncio.ensure_future(_gone(controller, clock))
        try:
            await asyncio.wait((work, gone), return_when=asyncio.FIRST_COMPLETED)
            if not work.done():
                raise Incomplete("E-WALK-ENDED", plan.axis, done=index, total=len(plan.stops))
        finally:
            for one in (work, gone):
                one.cancel()
            await asyncio.gather(work, gone, return_exceptions=True)
        work.result()

    return looks_on


async def _gone(controller: Controller, clock: Clock) -> None:
    """Wait until the channel is in reset at two looks. A road that does not answer says nothing: its next use tells."""
    seen = False
    while True:
        await clock.sleep(AGAIN_S if seen else LOOK_S)
        with contextlib.suppress(TrueflankError):
            before, seen = seen, (await controller.state()).channel is ChannelStatus.RESET
            if before and seen:
                return


async def _tell_start(controller: Controller, plan: StopPlan, say: Say) -> None:
    """What moves and what a person does for it; nothing where the program goes on by itself: that was said before."""
    goes_on = isinstance(controller, ForeseesPlans) and controller.goes_on
    if goes_on and not plan.setup:
        return
    await tell_motion(controller, say)
    if goes_on:
        say("P-MOUNT", axis=plan.axis, setup=plan.setup)
    elif plan.setup:
        SetupProgramSelected(plan.axis, plan.name, plan.setup).tell(say)
    else:
        ProgramSelected(plan.axis, plan.name).tell(say)


def _check(plan: StopPlan, index: int, stop: Stop, reached: StopReached, counter: int) -> None:
    expected = (counter + 1, stop.repetition, stop.label, stop.approach)
    found = (reached.counter, reached.repetition, reached.label, reached.approach)
    if expected != found or abs(reached.target - stop.target) > POSITION_TOLERANCE:
        raise DeviceRefused(
            "E-WALK-ORDER",
            plan.axis,
            expected=f"stop {index}: {expected} at {stop.target}",
            found=f"{found} at {reached.target}",
        )
