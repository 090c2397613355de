"""Where the road runs no programs: the operator jogs, in words, and the controller's state confirms it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from drivers.types.machine import AxisState
from drivers.types.orders import PushOrder
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import CompensationTable
from gateway import jogging
from gateway.interlocks.table import steepest
from gateway.push.context import PushContext

# Jogging is not exact: a place will do while the tables differ there by no more than this, um or arcsec.
WORTH = 0.25
NEAREST, FARTHEST = 0.01, 1.0
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
    jogged = jogging.Jogged(axis.name, axis.modulo, context.start_timeout_s)

    def ask() -> None:
        context.say("P-PUSH-JOG", axis=axis.name, position=position, room=round(room, 3), unit=axis.unit)

    return await jogging.stand_at(
        context.controller, context.clock, jogged=jogged, position=position, room=room, ask=ask
    )


async def visit_by_hand(context: PushContext, plan: StopPlan, at_stop: AtStop, order: PushOrder | None) -> None:
    """Be at each stop as the operator jogs there; the target reported is where the axis really stands.

    A stop's switch is `Controller.switch` of ``order``; a table of its that acts in one direction of travel is met in
    that: the axis is asked for before the stop first. Raises as `stand_at` and that call.
    """
    room, axis = room_of(order.table) if order is not None else FARTHEST, context.moved
    for number, stop in enumerate(plan.stops, start=1):
        if order is not None and order.table.direction:
            before = min(max(stop.target - stop.approach * axis.overrun, axis.room[0]), axis.room[1])
            await stand_at(context, before, FARTHEST)
        await stand_at(context, stop.target, room)
        if stop.switch is not None and order is not None:
            await context.controller.switch(order, stop.switch, context.start_timeout_s)
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
