"""What a push asks of the controller through its port: facts, live tables, stops, and a program's end.

Reads may be repeated here, over a fresh connection where the old one broke. Nothing here writes a table.
"""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from drivers.errors import TransportError, TrueflankError, words
from drivers.ports.controller import ReadsTogether
from drivers.programs import ForeseesPlans
from drivers.types.abilities import Marker, TableLimits
from drivers.types.machine import AxisState, ChannelStatus
from drivers.types.moves import SafePlaces, movement_of
from drivers.types.orders import PushOrder, TableQuestion
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.values import Approach
from gateway import moves
from gateway.audience import Audience, kind_of
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError, WriteRefused
from gateway.events import ProgramSelected, received
from gateway.interlocks import MarkerCheck, PushFacts, steepest
from gateway.moves import Patience, approach_in, question, safe_places_of, standing_message, walk_plan
from gateway.push import journal
from gateway.push.context import AuditLog, PushContext, plan_hash
from gateway.push.state import Purpose

POLL_S = 0.5
CONNECT_WITHIN_S = 60.0
CONNECT_S = 10.0
CONNECT_PAUSE_S = 2.0
AtStop = Callable[[Stop, StopReached], Awaitable[None]]


async def read_facts(
    context: PushContext,
    change: TableChange,
    purpose: Purpose,
    limits: TableLimits,
    agreeing_position: float | None,
    *,
    live: LiveSet | None = None,
    unchanged: bool | None = None,
    unfinished: tuple[str, ...] = (),
    key_taken: str = "",
    brought: Mapping[str, float] = MappingProxyType({}),
) -> PushFacts:
    """Fingerprint, state and marker read now, with all else the interlocks want to know before anything is sent."""
    controller = context.controller
    found = await controller.identify()
    state = await controller.state()
    marker = await controller.marker() if controller.capabilities.marker else None
    return PushFacts(
        change=change,
        purpose=purpose,
        moment="start",
        request=context,
        can=controller.capabilities,
        found=found,
        state=state,
        limits=limits,
        agreeing_position=agreeing_position,
        now_utc=context.clock.utc(),
        uptime=context.clock.uptime(),
        unchanged=unchanged,
        unfinished=unfinished,
        live=live,
        marker=marker,
        mark=compare_marker(context, marker),
        plan=plan_hash(change, context.machine),
        key_taken=key_taken,
        missing=missing_journals(context),
        places=safe_places_of(controller),
        brought=brought,
    )


async def read_live_tables(context: PushContext) -> LiveSet:
    """The live tables of the output axis, cross tables as deviations; compensation stays as it is, nothing moves.

    Raises what the port raises: DeadlineExceeded when nobody starts the program, DeviceRefused on an alarm.
    """
    return await context.controller.live_tables(_table_question(context), context.say)


async def read_loaded_tables(context: PushContext) -> LiveSet:
    """As `read_live_tables`; a table that waits for the control's next start replaces the one that acts."""
    return await context.controller.live_tables(replace(_table_question(context), loaded=True), context.say)


def _table_question(context: PushContext) -> TableQuestion:
    patience = Patience(context.start_timeout_s, context.stop_timeout_s)
    return question(context.axis, patience, context.proof)


def table_questions(contexts: Sequence[PushContext]) -> tuple[TableQuestion, ...]:
    """What `read_all` asks of several axes of one machine, each output axis once by its own proof."""
    patience = Patience(contexts[0].start_timeout_s, contexts[0].stop_timeout_s)
    return tuple(question(context.axis, patience, context.proof) for context in contexts)


async def read_live_of_axes(contexts: Sequence[PushContext]) -> tuple[LiveSet, ...]:
    """As `read_live_tables`, of several axes of one machine in order; by one program where the control can."""
    first = contexts[0]
    if not isinstance(first.controller, ReadsTogether):
        return tuple([await read_live_tables(context) for context in contexts])
    return await first.controller.live_tables_of(table_questions(contexts), first.say)


@dataclass(frozen=True, slots=True)
class PlanAxes:
    """What a plan needs of its axes: the ``input_axis`` moves, ``output`` is corrected; and how fast axes may go."""

    input_axis: AxisRecord
    output: AxisRecord
    places: SafePlaces


def plan_axes(context: PushContext) -> PlanAxes:
    """As a push knows them."""
    return PlanAxes(context.input_axis, context.axis, safe_places_of(context.controller))


def make_stop_plan(
    along: PlanAxes,
    name: str,
    stops: tuple[Stop, ...],
    *,
    setup: str = "",
    cross_table: int | None = None,
    reversal: CompensationTable | None = None,
) -> StopPlan:
    """A motion program of the table's input axis that shows and saves what acts on the output axis; pure."""
    axis, output = along.input_axis, along.output
    feed = min(axis.feed, along.places.feed(axis.unit))
    return StopPlan(
        name=f"{name}{axis.letter}",
        axis=axis.name,
        letter=axis.letter,
        unit=axis.unit,
        rotary=axis.rotary,
        stops=stops,
        feed=feed,
        overrun=axis.overrun,
        dwell_s=axis.dwell_s,
        setup=setup,
        save_tables=True,
        encoder=output.encoder,
        encoder_said=output.encoder_said,
        output_axis="" if axis.name == output.name else output.name,
        cross_table=cross_table,
        reversal=reversal,
    )


def stops_at(
    axis: AxisRecord, positions: tuple[float, ...], *, both: bool = False, direction: int = 0
) -> tuple[Stop, ...]:
    """Stops at these positions, each as `approach_to`, or from ``both`` sides one after the other."""
    if not both:
        sides_of = [(place, approach_to(axis, place, direction)) for place in positions]
        return tuple(Stop(place, side, label=label) for label, (place, side) in enumerate(sides_of))
    sides: tuple[Approach, Approach] = (1, -1)
    return tuple(Stop(place, side, label=label) for label, place in enumerate(positions) for side in sides)


def approach_to(axis: AxisRecord, position: float, direction: int = 0) -> Approach:
    """As `approach_in`; a table that acts in one ``direction`` of travel is met in that direction."""
    if direction:
        return 1 if direction > 0 else -1
    return approach_in(axis, position)


StartPrompt = tuple[str, Mapping[str, object]]
"""What asks a person for a press: a code and its fields."""


async def visit(
    context: PushContext, plan: StopPlan, at_stop: AtStop, order: PushOrder | None = None, ask: StartPrompt = ("", {})
) -> None:
    """Be at each stop of a plan; `at_stop` is awaited while the axis stands.

    By a program of ours, or by the operator's hand where the connection runs none; ``order`` names the table that
    stops switch there. ``ask`` is said in place of the program's own words, after what will move; a plan that goes on
    in the program that runs asks for nothing. Raises what `gateway.moves.walk_plan` and `visit_manually` raise.
    """

    async def note(_index: int, stop: Stop, found: StopReached) -> None:
        await at_stop(stop, found)

    def say(code: str, /, **fields: object) -> None:
        if kind_of(code) is Audience.MOVE:
            context.say(code, **fields)
        elif isinstance(received(code, fields), ProgramSelected) and ask[0]:
            context.say(ask[0], **ask[1])

    if context.controller.capabilities.stops:
        patience = Patience(context.start_timeout_s, context.stop_timeout_s)
        await walk_plan(context.controller, plan, note, patience=patience, say=say)
        return
    if ask[0]:
        context.say(ask[0], **ask[1])
    await visit_manually(context, plan, at_stop, order)


async def foresee(context: PushContext, plans: Sequence[StopPlan]) -> None:
    """As `ForeseesPlans.foresee`, where the controller makes one program of what follows."""
    if isinstance(context.controller, ForeseesPlans):
        await context.controller.foresee(plans)


async def reconnect(context: PushContext) -> None:
    """A fresh connection in place of one that broke; tried for a minute. Raises what `Device.open` raises."""
    end = context.clock.now() + CONNECT_WITHIN_S
    while True:
        await context.controller.close()
        try:
            await context.controller.open(CONNECT_S)
        except TransportError:
            if context.clock.now() + CONNECT_PAUSE_S >= end:
                raise
            await context.clock.sleep(CONNECT_PAUSE_S)
        else:
            return


def prompt_panel_release(context: PushContext) -> None:
    """Where a panel gives consent: say that its release is needed now, anew for each transaction."""
    if context.controller.capabilities.consent == "panel":
        context.say("P-PUSH-PANEL", axis=context.axis.name)


async def wait_in_safe_places(context: PushContext) -> None:
    """Wait until every axis stands in its safe place: a person brings back what does not.

    Raises DeadlineExceeded after a person's patience, WriteRefused (E-INT-NO-PLACE) where an axis has no safe place,
    and what the port raises.
    """
    places = safe_places_of(context.controller)
    async with context.clock.deadline(context.start_timeout_s, context.axis.name):
        told = False
        while True:
            stands = movement_of((), await context.controller.state(), places).stands
            unknown = next((one for one in stands if one.place is None), None)
            if unknown is not None:
                raise WriteRefused("E-INT-NO-PLACE", context.axis.name, axis=unknown.axis)
            outside = [one for one in stands if not one.safe]
            if not outside:
                return
            if not told:
                context.say("P-MOVE-BRING", axes=tuple(map(standing_message, outside)))
            told = True
            await context.clock.sleep(POLL_S)


async def reach_same_machine(context: PushContext) -> None:
    """The machine that is meant answers, over a fresh connection where the old one broke.

    What became of the last request is unknown then: only a connection of its own can tell. Raises VerifyError
    (E-PUSH-OTHER-MACHINE), TransportError.
    """
    try:
        found = await context.controller.identify()
    except TransportError:
        await reconnect(context)
        found = await context.controller.identify()
    different = context.machine.differences(found)
    if different:
        raise VerifyError("E-PUSH-OTHER-MACHINE", context.axis.name, differ=", ".join(different))


async def end_program(context: PushContext) -> None:
    """Ask the program to end and wait until the channel is in reset; the operator's RESET does it too.

    Raises DeadlineExceeded when it does not end in the time a person needs.
    """
    with contextlib.suppress(TrueflankError):
        await context.controller.abort_program()
    async with context.clock.deadline(context.start_timeout_s, context.axis.name):
        told = False
        while not await _is_in_reset(context):
            if not told:
                context.say("P-PUSH-RESET", axis=context.axis.name)
            told = True
            await context.clock.sleep(POLL_S)


async def _is_in_reset(context: PushContext) -> bool:
    """Reading may be tried again while the control restarts."""
    try:
        return (await context.controller.state()).channel is ChannelStatus.RESET
    except TrueflankError as error:
        if not error.retryable:
            raise
        return False


# Without programs the operator is asked to jog, and the controller's state confirms that the axis is there.

# Jogging is not exact: a position will do while the tables differ there by no more than this, um or arcsec.
ALLOWED_DIFFERENCE = 0.25
LEAST_TOLERANCE, LARGEST_TOLERANCE = 0.01, 1.0


def position_tolerance(*tables: CompensationTable) -> float:
    """How far from a place the axis may stand, in its unit, for the tables to mean the same there."""
    slope = max((steepest(table) for table in tables), default=0.0)
    return (
        min(max(ALLOWED_DIFFERENCE / slope, LEAST_TOLERANCE), LARGEST_TOLERANCE) if slope > 0.0 else LARGEST_TOLERANCE
    )


async def bring_to_position(context: PushContext, position: float, room: float) -> AxisState:
    """Ask for the input axis to be brought to a position, and wait until the state shows it standing there.

    Says nothing when it stands there already. Raises DeadlineExceeded after a person's patience, and what the
    port raises.
    """
    axis = context.input_axis
    jogged = moves.ManualAxis(axis.name, axis.modulo, context.start_timeout_s)

    def ask() -> None:
        context.say("P-PUSH-JOG", axis=axis.name, position=position, room=round(room, 3), unit=axis.unit)

    return await moves.stand_at(context.controller, context.clock, jogged=jogged, position=position, room=room, ask=ask)


async def visit_manually(context: PushContext, plan: StopPlan, at_stop: AtStop, order: PushOrder | None) -> None:
    """Be at each stop as the operator jogs there; the target reported is where the axis really stands.

    A stop's switch is `Controller.switch` of ``order``; a table of its that acts in one direction of travel is met in
    that: the axis is asked for before the stop first. Raises as `stand_at` and that call.
    """
    room, axis = position_tolerance(order.table) if order is not None else LARGEST_TOLERANCE, context.input_axis
    for number, stop in enumerate(plan.stops, start=1):
        if order is not None and order.table.direction:
            before = min(max(stop.target - stop.approach * axis.overrun, axis.room[0]), axis.room[1])
            await bring_to_position(context, before, LARGEST_TOLERANCE)
        await bring_to_position(context, stop.target, room)
        if stop.switch is not None and order is not None:
            await context.controller.switch(order, stop.switch, context.start_timeout_s)
        await at_stop(stop, await _stop_reached(context, stop, number))


async def _stop_reached(context: PushContext, stop: Stop, number: int) -> StopReached:
    axes = (await context.controller.state()).axes
    moved, output = axes[context.input_axis.name], axes[context.axis.name]
    return StopReached(
        counter=number,
        repetition=stop.repetition,
        label=stop.label,
        approach=stop.approach,
        target=moved.position,
        encoder_compensation=output.encoder_compensation,
        cross_compensation=output.cross_compensation,
    )


# The control's marker proves that a store is older than the control: an audit log that was cut or restored, a journal
# that is gone, or a push by another gateway.


def compare_marker(context: PushContext, marker: Marker | None) -> MarkerCheck:
    """The marker (None: the connection keeps none) against journals and audit log. Raises StoreError."""
    if marker is None:
        return MarkerCheck()
    log = context.log
    if not marker.transaction:
        return MarkerCheck(lost=log.last_mark() if log is not None else 0)
    folder = journal.machine_folder(context.journals, context.machine.serial)
    known = journal.is_known_number(folder, marker.transaction)
    if log is None:
        return MarkerCheck(known)
    if not journal.is_own_number(folder, marker.transaction):
        return MarkerCheck(known, stranger=0 if known else marker.transaction)
    return MarkerCheck(known, _audit_gap(log, folder, marker))


def missing_journals(context: PushContext) -> tuple[int, ...]:
    """Transactions that the audit log says began here and whose journals are gone."""
    if context.log is None:
        return ()
    folder = journal.machine_folder(context.journals, context.machine.serial)
    return tuple(sorted(context.log.announced() - journal.journal_numbers(folder)))


def _audit_gap(log: AuditLog, folder: Path, marker: Marker) -> str:
    """How the log falls short of a marker that this store has left."""
    if marker.head is not None and not log.holds(marker.head):
        return words("W-MARK-HEAD", transaction=marker.transaction, head=f"{marker.head:016x}")
    # A restore has a number of its own inside the transaction that it takes back.
    outer = journal.sending_transaction(folder, marker.transaction) or marker.transaction
    known = log.begun(marker.transaction) or log.begun(outer)
    return "" if known else words("W-MARK-UNKNOWN", transaction=marker.transaction)
