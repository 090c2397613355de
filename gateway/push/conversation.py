"""What a push asks of the controller through its port: facts, live tables, stops, and a program's end."""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable

from drivers.errors import TrueflankError
from drivers.types import Approach, ChannelStatus, LiveSet, Stop, StopPlan, StopReached, TableLimits
from gateway.domain import TableChange
from gateway.interlocks import PushFacts
from gateway.push.context import PushContext
from gateway.push.work import Purpose
from gateway.walk import Patience, walk

POLL_S = 0.5
AtStop = Callable[[Stop, StopReached], Awaitable[None]]


async def facts_at_start(
    context: PushContext,
    change: TableChange,
    purpose: Purpose,
    limits: TableLimits,
    agreeing_position: float | None,
    unchanged: bool | None = None,
    unfinished: tuple[str, ...] = (),
) -> PushFacts:
    """Fingerprint and state read now, with all else the interlocks want to know before anything is sent."""
    found = await context.controller.identify()
    state = await context.controller.state()
    return PushFacts(
        change=change,
        purpose=purpose,
        moment="start",
        typed_name=context.typed_name,
        site_name=context.site_name,
        expected=context.machine,
        found=found,
        state=state,
        limits=limits,
        reference=context.axis.reference,
        agreeing_position=agreeing_position,
        now_utc=context.clock.utc(),
        unchanged=unchanged,
        proof=context.proof,
        capture=context.capture,
        ambient_now=context.ambient_now,
        unfinished=unfinished,
        modes=context.modes,
        harmless_alarms=context.harmless_alarms,
        access_level_needed=context.access_level_needed,
    )


async def read_live(context: PushContext, position: float) -> LiveSet:
    """The live tables of the axis, saved by a program that visits one stop and changes no compensation.

    Raises what the port raises: DeadlineExceeded when nobody starts it, DeviceRefused on an alarm.
    """
    context.say("P-PUSH-READ", axis=context.axis.name)
    await visit(context, plan_of(context, "TFREAD", (Stop(position, approach_to(context, position)),)), _nothing)
    return await context.controller.saved_tables(context.axis.name)


async def _nothing(_stop: Stop, _reached: StopReached) -> None:
    return None


def plan_of(context: PushContext, name: str, stops: tuple[Stop, ...], setup: str = "") -> StopPlan:
    """A motion program of this axis."""
    axis = context.axis
    return StopPlan(
        name=f"{name}{axis.letter}",
        axis=axis.name,
        letter=axis.letter,
        unit=axis.unit,
        rotary=axis.rotary,
        stops=stops,
        feed=axis.feed,
        overrun=axis.overrun,
        dwell_s=axis.dwell_s,
        setup=setup,
        save_tables=True,
        encoder=axis.encoder,
    )


def stops_at(context: PushContext, positions: tuple[float, ...]) -> tuple[Stop, ...]:
    """Stops at these positions, each approached from inside the travel."""
    return tuple(
        Stop(position, approach_to(context, position), label=label) for label, position in enumerate(positions)
    )


def approach_to(context: PushContext, position: float) -> Approach:
    """The direction from which a stop is reached without leaving the travel.

    Coming up from below needs room for the overrun below; near the lower end the axis comes down.
    """
    axis = context.axis
    return -1 if not axis.modulo and position - axis.overrun < axis.travel[0] else 1


async def visit(context: PushContext, plan: StopPlan, at_stop: AtStop) -> list[StopReached]:
    """Send a motion program and be at each of its stops; `at_stop` is awaited while the axis stands.

    Raises what `gateway.walk.walk` raises; the program is then asked to end.
    """
    reached: list[StopReached] = []

    async def note(_index: int, stop: Stop, found: StopReached) -> None:
        reached.append(found)
        await at_stop(stop, found)

    patience = Patience(context.start_timeout_s, context.stop_timeout_s)
    await walk(context.controller, plan, note, patience)
    return reached


async def leave_program(context: PushContext) -> None:
    """Ask the program to end and wait until the channel is in reset; the operator's RESET does it too.

    Raises DeadlineExceeded when it does not end in the time a person needs.
    """
    with contextlib.suppress(TrueflankError):
        await context.controller.abort_program()
    async with context.clock.deadline(context.start_timeout_s, context.axis.name):
        told = False
        while not await _in_reset(context):
            if not told:
                context.say("P-PUSH-RESET", axis=context.axis.name)
            told = True
            await context.clock.sleep(POLL_S)


async def _in_reset(context: PushContext) -> bool:
    """Reading may be tried again while the control restarts."""
    try:
        return (await context.controller.state()).channel is ChannelStatus.RESET
    except TrueflankError as error:
        if not error.retryable:
            raise
        return False
