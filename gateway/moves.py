"""Axes brought to the stops of a plan: by the control's program or by hand, every motion said before it begins."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.errors import DeviceRefused, TrueflankError
from drivers.message import Message, Quantity
from drivers.ports.controller import Controller
from drivers.programs import ForeseesPlans, Moment, SaysMotion, ShowsMessages
from drivers.types.machine import AxisState, ChannelStatus
from drivers.types.moves import NEAR, AxisStands, Going, Movement, SafePlaces
from drivers.types.orders import SignProof, TableQuestion
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.values import Approach
from drivers.units import wrap_deg
from gateway.axes import AxisRecord
from gateway.errors import Incomplete
from gateway.events import ProgramSelected, SetupProgramSelected, StopDone
from gateway.live import onlooker
from gateway.say import Say, silence

# Walks a stop plan with the controller: every stop once, in order, each released only after its reading.

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


async def walk_plan(
    controller: Controller, plan: StopPlan, at_stop: AtStop, patience: Patience, say: Say = silence
) -> None:
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
            _check_stop(plan, index, stop, reached, counter)
            onlooker().stands({plan.axis: reached.target})
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


def leave_when_ended(controller: Controller, clock: Clock, plan: StopPlan, at_stop: AtStop) -> AtStop:
    """`at_stop`, left as soon as the program has ended meanwhile: what it waits for cannot come any more.

    Raises Incomplete then, besides what `at_stop` raises.
    """

    async def looks_on(index: int, stop: Stop, reached: StopReached) -> None:
        work = asyncio.ensure_future(at_stop(index, stop, reached))
        gone = asyncio.ensure_future(_wait_for_end(controller, clock))
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


async def _wait_for_end(controller: Controller, clock: Clock) -> None:
    """Wait until the channel is in reset at two looks. A road that does not answer says nothing: its next use tells."""
    seen = False
    while True:
        await clock.sleep(AGAIN_S if seen else LOOK_S)
        with contextlib.suppress(TrueflankError):
            now = await controller.state()
            onlooker().stands({name: one.position for name, one in now.axes.items()})
            before, seen = seen, now.channel is ChannelStatus.RESET
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


def _check_stop(plan: StopPlan, index: int, stop: Stop, reached: StopReached, counter: int) -> None:
    expected = (counter + 1, stop.repetition, stop.label, stop.approach)
    found = (reached.counter, reached.repetition, reached.label, reached.approach)
    if expected != found or abs(reached.target - stop.target) > POSITION_TOLERANCE:
        raise DeviceRefused(
            "E-WALK-ORDER",
            plan.axis,
            expected=f"stop {index}: {expected} at {stop.target}",
            found=f"{found} at {reached.target}",
        )


# Every motion said before the press: what goes from where to where, and where all other axes stand.
#
# Read from the control at that moment. What a program moves, and what it shows, the driver reads from its own blocks.


def safe_places_of(controller: Controller) -> SafePlaces:
    """The safe places that a controller keeps to; none where it knows of none."""
    return controller.places if isinstance(controller, SaysMotion) else SafePlaces()


async def tell_motion(controller: Controller, say: Say) -> None:
    """Say what the selected program will move and where every other axis stands. Raises as `Controller.state`."""
    if isinstance(controller, SaysMotion):
        say_motion(await controller.motion(), say)


def say_motion(motion: Movement, say: Say) -> None:
    """One event for each axis that goes, one for all that stand; pure but for ``say``."""
    stands = {one.axis: one for one in motion.stands}
    onlooker().stands({name: one.position for name, one in stands.items()})
    for going in motion.goes:
        _say_going(going, stands.get(going.axis), say)
    if not motion.goes:
        say("P-MOVE-NOTHING")
    goes = {going.axis for going in motion.goes}
    others = [one for one in motion.stands if one.axis not in goes]
    if others:
        say("P-MOVE-OTHERS", others=tuple(map(standing_message, others)))


def shown_by_control(controller: Controller, moment: Moment) -> Message | str:
    """What the control itself shows while it waits for a person, as a bracket behind our words; "" where nothing."""
    message = controller.message(moment) if isinstance(controller, ShowsMessages) else ""
    return Message.of("W-SHOWN-THERE", message=message) if message else ""


def standing_message(one: AxisStands) -> Message:
    """Where an axis stands, and whether that is within its safe place."""
    fields = {"axis": one.axis, "position": position(one.position), "unit": one.unit}
    if one.place is None:
        return Message("W-MOVE-NO-PLACE", fields)
    if math.isinf(one.place[0]) and math.isinf(one.place[1]):
        return Message("W-MOVE-ANY", fields)
    code = "W-MOVE-SAFE" if one.safe else "W-MOVE-OUTSIDE"
    return Message(code, {"low": position(one.place[0]), "high": position(one.place[1]), **fields})


def position_text(value: float) -> str:
    """A position as people read it: micrometres at most, no trailing zeros."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def position(value: float) -> Quantity:
    """A position for a message, with as many decimals as `position_text` has."""
    text = position_text(value)
    return Quantity(float(text), decimals=len(text.partition(".")[2]))


def _say_going(going: Going, now: AxisStands | None, say: Say) -> None:
    start = now.position if now is not None else going.first
    slow, fast = going.feeds
    fields = {"axis": going.axis, "unit": going.unit, "start": position(start), "feed": _span(slow, fast)}
    if going.turns:
        say("P-MOVE-TURNS", **fields)
    elif going.goes_if_elsewhere and now is not None and _destination(going, now.position):
        say("P-MOVE-STANDS", axis=going.axis, unit=going.unit, place=position(going.last))
    elif going.low == going.high:
        say("P-MOVE-TO", end=position(going.last), **fields)
    else:
        ends = {"first": position(going.first), "low": position(going.low), "high": position(going.high)}
        say("P-MOVE-BETWEEN", end=position(going.last), **ends, **fields)
    if going.further:
        say("P-MOVE-FURTHER", axis=going.axis)


def _destination(going: Going, position: float) -> bool:
    off = position - going.last
    return abs(wrap_deg(off) if going.unit == "deg" else off) <= NEAR


def _span(slow: float, fast: float) -> Message | Quantity:
    if slow == fast:
        return Quantity(float(slow))
    return Message.of("S-MOVE-FEEDS", slow=Quantity(float(slow)), fast=Quantity(float(fast)))


# Where the road to a controller runs no programs: the operator brings the axis to each stop, the state confirms it.

POLL_S = 0.5
STILL = 1e-3
# A person who types the position in MDI is exact to the control's own resolution; by hand-wheel nearly so.
EXACT = 2e-3
Told = Callable[[], None]


@dataclass(frozen=True, slots=True)
class ManualAxis:
    """One axis that is moved by hand: its name, whether it turns endlessly, and how long a person may take in s."""

    axis: str
    modulo: bool
    patience_s: float


async def stand_at(
    controller: Controller,
    clock: Clock,
    jogged: ManualAxis,
    position: float,
    room: float,
    ask: Told,
    *,
    away: bool = False,
) -> AxisState:
    """Wait until the axis stands within ``room`` of a position; ``ask`` is called once if it does not stand there yet.

    ``away``: it must first be seen elsewhere, as a person does who mounts something and then moves the axis.
    Raises DeadlineExceeded after a person's patience, and what the port raises.
    """
    async with clock.deadline(jogged.patience_s, jogged.axis):
        told, gone, before = False, not away, float("nan")
        while True:
            seen = await _axis_position(controller, jogged.axis)
            there = seen is not None and _is_there(jogged, seen, position, room)
            gone = gone or (seen is not None and not there)
            if seen is not None and there and gone and abs(seen.position - before) <= STILL:
                return seen
            if not told and not (there and gone):
                ask()
                told = True
            before = seen.position if seen is not None else float("nan")
            await clock.sleep(POLL_S)


async def _axis_position(controller: Controller, axis: str) -> AxisState | None:
    try:
        return (await controller.state()).axes.get(axis)
    except TrueflankError as error:
        if not error.retryable:
            raise
        return None


def _is_there(jogged: ManualAxis, seen: AxisState, position: float, room: float) -> bool:
    off = seen.position - position
    return seen.in_position and abs(wrap_deg(off) if jogged.modulo else off) <= room


async def jog_through(
    controller: Controller,
    clock: Clock,
    plan: StopPlan,
    at_stop: AtStop,
    patience: Patience,
    say: Say,
) -> None:
    """Be at each stop of a plan as the operator brings the axis there; a set-up is mounted before the first.

    Raises what `stand_at` and ``at_stop`` raise.
    """
    jogged = ManualAxis(plan.axis, plan.rotary, patience.start_s)

    def ask(stop: Stop, setup: str) -> Told:
        side = Message.of("S-JOG-BELOW" if stop.approach > 0 else "S-JOG-ABOVE")
        fields = {"axis": plan.axis, "position": stop.target, "unit": plan.unit, "side": side, "room": EXACT}
        return lambda: say("P-JOG-SETUP" if setup else "P-JOG-STOP", setup=setup, **fields)

    for index, stop in enumerate(plan.stops):
        setup = plan.setup if index == 0 else ""
        seen = await stand_at(
            controller, clock, jogged=jogged, position=stop.target, room=EXACT, ask=ask(stop, setup), away=bool(setup)
        )
        onlooker().stands({plan.axis: seen.position})
        await at_stop(index, stop, _stop_reached(index, stop, seen))
        StopDone(plan.axis, plan.name, index + 1, len(plan.stops)).tell(say)


def _stop_reached(index: int, stop: Stop, seen: AxisState) -> StopReached:
    return StopReached(
        counter=index + 1,
        repetition=stop.repetition,
        label=stop.label,
        approach=stop.approach,
        target=seen.position,
        encoder_compensation=seen.encoder_compensation,
        cross_compensation=seen.cross_compensation,
    )
