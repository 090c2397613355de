"""Off, and nothing else: what is switched on that should not be, read, switched off and read back.

Where a table is read as whole, old or new, it is left to a restore. All else that is enabled after a write was
announced must go off, wherever its axis stands: the rule of the agreeing position is waived for this alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from drivers.errors import TrueflankError
from drivers.message import Message, Quantity
from drivers.offline_exchange import OfflineExchange
from drivers.types.machine import ChannelStatus
from drivers.types.orders import DisableOrder, SwitchReading
from drivers.types.tables import CompensationTable
from gateway.domain.outcomes import SwitchRecord
from gateway.events import DisableMoves
from gateway.interlocks import Refusal, switching_refusals
from gateway.moves import tell_motion
from gateway.push import controller_access, journal
from gateway.push.context import PushContext
from gateway.push.journal import JournalRead, machine_lock
from gateway.push.phases import PushEvent
from gateway.push.state import TableTransactionState, number_seed, with_safe_logger, wrap_unexpected

DisableOutcome = Literal["off", "already-off", "still-on", "refused"]


@dataclass(frozen=True, slots=True)
class DisablePreflight:
    """What a disable order would do now: the switch, how far its axis will move, and every reason against it.

    ``reading`` is None when the control cannot be read.
    """

    order: DisableOrder
    unit: str
    reading: SwitchReading | None
    refusals: tuple[Refusal, ...] = ()


async def read_switch(context: PushContext, order: DisableOrder) -> SwitchReading | None:
    """The switch and what acts, from the machine that is meant; None where that cannot be told."""
    try:
        with wrap_unexpected(context.axis.name):
            await controller_access.reach_same_machine(context)
            return await context.controller.switch_reading(order)
    except TrueflankError:
        return None


async def read_switch_patiently(context: PushContext, order: DisableOrder) -> SwitchReading | None:
    """As `read`, but a control that restarts or a wire that is mended gets a minute to answer."""
    end = context.clock.now() + controller_access.CONNECT_WITHIN_S
    while True:
        found = await read_switch(context, order)
        if found is not None or context.clock.now() + controller_access.CONNECT_PAUSE_S >= end:
            return found
        await context.clock.sleep(controller_access.CONNECT_PAUSE_S)


def disable_order(table: CompensationTable, number: int = 0) -> DisableOrder:
    """The order that switches this table off."""
    return DisableOrder(number, table.kind, table.output_axis, table.index)


async def switch_off(work: TableTransactionState, before: SwitchReading | None) -> bool:
    """Journal, order, and what is read back afterwards; true once that says off. Raises StoreError alone.

    ``before`` is what was read last: how far the axis will move is said of it.
    """
    order = disable_order(work.change.new, work.fresh_number())
    _say_how_far(work.context, order, before)
    work.note(PushEvent.SWITCH_OFF, order=order.transaction)
    found, why = await _execute_order(work.context, order)
    if found is not None and found.off:
        work.note(PushEvent.OFF, order=order.transaction, acting=found.acting)
        return True
    work.note(PushEvent.STILL_ON, order=order.transaction, why=why)
    return False


async def _execute_order(context: PushContext, order: DisableOrder) -> tuple[SwitchReading | None, Message | None]:
    """The reading after the order, whatever became of it: an order without an answer is read back, never repeated."""
    try:
        with wrap_unexpected(context.axis.name):
            await controller_access.reach_same_machine(context)
    except TrueflankError as error:  # nothing was sent, and who does not answer cannot be read
        return None, error.message
    try:
        with wrap_unexpected(context.axis.name):
            if not context.controller.capabilities.off_anyhow:
                await controller_access.end_program(context)
            controller_access.prompt_panel_release(context)
            await context.controller.prepare_disable(order)
            await tell_motion(context.controller, context.say)
            if not context.controller.capabilities.switches_now:
                context.say("P-PUSH-DISABLE-START", axis=context.axis.name, table=order.name)
            elif context.controller.capabilities.stops:
                context.say("P-PUSH-DISABLE", axis=context.axis.name, table=order.name)
            found = await context.controller.wait_disabled(order, context.start_timeout_s)
    except TrueflankError as error:
        return await read_switch(context, order), error.message
    return found, None if found.off else _reading_message(found)


def _reading_message(found: SwitchReading) -> Message:
    switch = Message.of("W-SWITCH-ON" if found.enabled else "W-SWITCH-OFF")
    return Message.of("W-SWITCH-READS", switch=switch, acting=Quantity(found.acting, decimals=3, signed=True))


def _say_how_far(context: PushContext, order: DisableOrder, found: SwitchReading | None) -> None:
    if found is not None and not found.off and context.controller.capabilities.switches_now:
        acting, unit = round(found.acting, 3), _unit(context)
        DisableMoves(order.axis, order.name, acting, unit).tell(context.say)


def _unit(context: PushContext) -> str:
    return "arcsec" if context.axis.unit == "deg" else "um"


# Orders that a person gives, in a journal of their own or as the end of an unfinished push.


async def preflight_disable(order: DisableOrder, context: PushContext) -> DisablePreflight:
    """What `disable` would do, and every reason against it; reads only."""
    controller = context.controller
    found, state = await controller.identify(), await controller.state()
    in_reset = state.channel is ChannelStatus.RESET or controller.capabilities.off_anyhow
    reasons = switching_refusals(context.machine, found, order.axis, tuple(state.axes), in_reset=in_reset)
    reading = None if reasons and order.axis not in state.axes else await controller.switch_reading(order)
    return DisablePreflight(order, _unit(context), reading, reasons)


async def disable_table(order: DisableOrder, context: PushContext, found: JournalRead | None = None) -> SwitchRecord:
    """Switch a table off, in a journal of its own or going on in ``found``, that of the push it came from.

    Nothing is sent when it is off already ("already-off") or an interlock speaks against it ("refused"). What files
    brought back of a control is not what its switch reads now: there the program goes in any case. Raises BusyError
    (E-PUSH-BUSY), StoreError, and the port's errors as long as nothing has been sent.
    """
    context = with_safe_logger(context)
    with (
        wrap_unexpected(context.axis.name),
        machine_lock(journal.machine_folder(context.journals, context.machine.serial)),
    ):
        asked = await preflight_disable(order, context)
        if asked.refusals:
            return _record(
                order, "refused", asked=asked, after=None, reasons=tuple(reason.message for reason in asked.refusals)
            )
        fresh = not isinstance(context.controller, OfflineExchange)
        if fresh and asked.reading is not None and asked.reading.off and found is None:
            return _record(order, "already-off", asked=asked, after=asked.reading, reasons=())
        return await _disable_in_journal(order, context, found, asked)


async def _disable_in_journal(
    order: DisableOrder, context: PushContext, found: JournalRead | None, asked: DisablePreflight
) -> SwitchRecord:
    """Each entry is on the disk before what it announces; a journal of its own always ends."""
    folder = journal.machine_folder(context.journals, context.machine.serial)
    numbered = DisableOrder(journal.allocate_number(folder, number_seed(context)), order.kind, order.axis, order.index)
    kept = journal.Journal.reopen(found) if found else journal.Journal.create(folder, numbered.transaction)
    told = {"utc": context.clock.utc().isoformat(timespec="milliseconds"), "order": numbered.transaction}
    told |= {"of": found.of} if found and found.of else {}
    try:
        if found is None:
            facts = {"purpose": "disable", "axis": order.axis, "kind_of_table": order.kind, "index": order.index}
            kept.append(PushEvent.LEASED, serial=context.machine.serial, actor=context.actor, **facts, **told)
        _say_how_far(context, numbered, asked.reading)
        kept.append(PushEvent.SWITCH_OFF, **told)
        reading, why = await _execute_order(context, numbered)
        off, because = reading is not None and reading.off, {"why": why} if why else {}
        kept.append(PushEvent.OFF if off else PushEvent.STILL_ON, **because, **told)
        if found is None:
            kept.append(PushEvent.CLOSED if off else PushEvent.ABORTED, **because, **told)
        else:
            kept.append(PushEvent.HELD, on=not off, **because, **told)
    finally:
        kept.close()
    if found is None:
        journal.set_aside(kept.path)
    return _record(numbered, "off" if off else "still-on", asked=asked, after=reading, reasons=(why,) if why else ())


def _record(
    order: DisableOrder,
    outcome: DisableOutcome,
    asked: DisablePreflight,
    after: SwitchReading | None,
    reasons: tuple[Message, ...],
) -> SwitchRecord:
    before = asked.reading.acting if asked.reading is not None else None
    acting = after.acting if after is not None else None
    return SwitchRecord(
        order.transaction,
        order.axis,
        table=order.name,
        outcome=outcome,
        unit=asked.unit,
        before=before,
        after=acting,
        steps=reasons,
        reasons=reasons,
    )
