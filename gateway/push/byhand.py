"""Where the road runs no programs: the operator jogs, in words, and the controller's state confirms it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from drivers.errors import TrueflankError
from drivers.types import AxisState, CompensationTable, PushOrder, Stop, StopPlan, StopReached
from drivers.units import wrap_deg
from gateway.interlocks.table import steepest
from gateway.push.context import AxisFacts, PushContext

POLL_S = 0.5
# Jogging is not exact: a place will do while the tables differ there by no more than this, um or arcsec.
WORTH = 0.25
NEAREST, FARTHEST = 0.01, 1.0
STILL = 1e-3
AtStop = Callable[[Stop, StopReached], Awaitable[None]]


def room_of(*tables: CompensationTable) -> float:
    """How far from a place the axis may stand, in its unit, for the tables to mean the same there."""
    slope = max((steepest(table) for table in tables), default=0.0)
    return min(max(WORTH / slope, NEAREST), FARTHEST) if slope > 0.0 else FARTHEST


async def stand_at(context: PushContext, position: float, room: float) -> AxisState:
    """Ask for the input axis to be brought to a position, and wait until the state shows it standing there.

    Says nothing when it stands there already. Raises DeadlineExceeded after a person's patience, and what the
    port raises.
    """
    axis = context.moved
    async with context.clock.deadline(context.start_timeout_s, axis.name):
        told, before = False, float("nan")
        while True:
            seen = await _seen(context, axis)
            if seen is not None and _is_there(axis, seen, position, room) and abs(seen.position - before) <= STILL:
                return seen
            if not told and (seen is None or not _is_there(axis, seen, position, room)):
                context.say("P-PUSH-JOG", axis=axis.name, position=position, room=round(room, 3), unit=axis.unit)
                told = True
            before = seen.position if seen is not None else float("nan")
            await context.clock.sleep(POLL_S)


async def _seen(context: PushContext, axis: AxisFacts) -> AxisState | None:
    try:
        return (await context.controller.state()).axes.get(axis.name)
    except TrueflankError as error:
        if not error.retryable:
            raise
        return None


def _is_there(axis: AxisFacts, seen: AxisState, position: float, room: float) -> bool:
    away = seen.position - position
    return seen.in_position and abs(wrap_deg(away) if axis.modulo else away) <= room


async def visit_by_hand(context: PushContext, plan: StopPlan, at_stop: AtStop, order: PushOrder | None) -> None:
    """Be at each stop as the operator jogs there; the target reported is where the axis really stands.

    A stop's switch is `Controller.switch_table` of ``order``. Raises as `stand_at` and that call.
    """
    room = room_of(order.table) if order is not None else FARTHEST
    for number, stop in enumerate(plan.stops, start=1):
        await stand_at(context, stop.target, room)
        if stop.switch is not None and order is not None:
            await context.controller.switch_table(order, stop.switch, context.start_timeout_s)
        await at_stop(stop, await _reached(context, stop, number))


async def _reached(context: PushContext, stop: Stop, number: int) -> StopReached:
    axes = (await context.controller.state()).axes
    moved, output = axes[context.moved.name], axes[context.axis.name]
    return StopReached(
        counter=number,
        repetition=stop.repetition,
        label=stop.label,
        approach=stop.approach,
        target=moved.position,
        encoder_compensation=output.encoder_compensation,
        cross_compensation=output.cross_compensation,
    )
