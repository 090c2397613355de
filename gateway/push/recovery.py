"""After a crash: what an unfinished push left, what is offered, and the offer carried out on request only.

The verdict (`gateway.push.recovery_findings`) comes from what the journal announced and what the controller says now.
Reading changes no compensation, and nothing is written before a person asks for it:

    close      nothing was written, or it ended: the journal is set aside
    restore    old, new or half of it is there and off, or the new one acts unproved: back to the old table
    disable    something is on that no push stands for: off, and nothing else
    none       another machine, another gateway, a damaged journal, three attempts: a person decides

An interrupted rollback has two ends, so a person chooses: "finish" (the earlier table) or "undo" (the pushed one).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from drivers.errors import DeadlineExceeded, TransportError, TrueflankError
from drivers.message import Message
from drivers.types.abilities import Marker, TableLimits
from drivers.types.machine import ChannelStatus
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable, LiveSet
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import StoreError, VerifyError, WriteRefused
from gateway.interlocks import other_cross_tables
from gateway.push import controller_access, disable, journal
from gateway.push.compare import effect_positions, switch_position, table_in, tolerance, without_tables
from gateway.push.context import PushContext
from gateway.push.effect import prove_effect
from gateway.push.history import CommittedPush, TableExchange, all_pushes, table_exchange, tables_of
from gateway.push.journal import JournalRead, machine_lock
from gateway.push.phases import PushEvent
from gateway.push.recovery_findings import (
    MOST_TRIES,
    ControllerReading,
    FindingKind,
    PushFinding,
    is_announced,
    make_finding,
    marker_before,
    was_coupled,
)
from gateway.push.restore import end_held, hold, read_backups_again, restore_table, roll_back
from gateway.push.state import Outcome, Purpose, TableTransactionState, Transaction, with_safe_logger, wrap_unexpected
from gateway.push.transaction import close_at_end

Choice = Literal["offered", "finish", "undo"]
LiveReadings = dict[tuple[str, SignProof | None], LiveSet]
"""Live tables of an output axis; for a cross table by the proof that they were read by."""


def unfinished_tables(journals: Path, serial: str, begun: journal.BegunCheck | None = None) -> tuple[JournalRead, ...]:
    """The part of each table that did not end, oldest first; ``begun`` as in `unfinished_journals`."""
    every = journal.unfinished_journals(journal.machine_folder(journals, serial), begun)
    return tuple(part for found in every for part in found.parts if not part.is_ended)


async def inspect_unfinished(found: JournalRead, context: PushContext, read: LiveReadings | None = None) -> PushFinding:
    """Read the controller and say what an unfinished push left; changes no compensation.

    Looks at several tables share what they ``read``, as long as nothing is changed in between: one press, not one each.

    A controller that cannot be read, or whose program still waits, gives a finding that says so.
    """
    found, pushes = _read_again(found), known_pushes(context)
    without_controller = make_finding(found, None, 0.0, pushes=pushes)
    if without_controller.settled_by_the_journal:
        return without_controller
    try:
        with wrap_unexpected(context.axis.name):
            if context.machine.differences(await context.controller.identify()):
                return without_controller
            seen, allowed = await _read_controller(found, context, {} if read is None else read)
    except (TransportError, DeadlineExceeded):
        return without_controller
    except TrueflankError:
        return await _finding_when_unreadable(found, context, without_controller)
    return make_finding(found, seen, allowed, context.meant, pushes=pushes)


def known_pushes(context: PushContext) -> tuple[CommittedPush, ...]:
    """The pushes of the machine that tables are named by; none where a journal cannot be believed."""
    try:
        return all_pushes(context.journals, context.machine.serial)
    except StoreError:
        return ()


def _read_again(found: JournalRead) -> JournalRead:
    """A table's part of a journal, read anew: the recovery of another table of the transaction may have told of it."""
    several = found.whole is not None and found.path.exists()
    return journal.read(found.path).part(found.of) if several else found


async def _finding_when_unreadable(found: JournalRead, context: PushContext, otherwise: PushFinding) -> PushFinding:
    """Tables that cannot be read may be anything: unless the switch reads off, they are switched off."""
    if not is_announced(found, PushEvent.DISABLE):
        return otherwise
    reading = await disable.read_switch(context, disable.disable_order(tables_of(found, context.meant)[1]))
    if reading is not None and reading.off:
        return otherwise
    return replace(otherwise, kind=FindingKind.UNREADABLE, still_on=True)


async def _read_controller(
    found: JournalRead, context: PushContext, read: LiveReadings
) -> tuple[ControllerReading | None, float]:
    state = await context.controller.state()
    if state.channel is not ChannelStatus.RESET:
        context.say("P-PUSH-RESET", axis=context.axis.name)
        return None, 0.0
    _old, new = tables_of(found, context.meant)
    limits = await context.controller.table_limits(context.axis.name, new.kind, new.index)
    question = context.axis.name, context.proof if new.kind == "cross" else None
    if question not in read:
        read[question] = await controller_access.read_loaded_tables(context)
    live = read[question]
    marker = await context.controller.marker() if context.controller.capabilities.marker else None
    ours = marker is None or marker.transaction in journal.order_numbers(found) or _is_known_marker(context, marker)
    neighbours = _neighbours_on(without_tables(live, _sibling_tables(found, context)), new)
    return ControllerReading(table_in(live, new), neighbours, marker, ours, waits=live.waits), tolerance(limits, new)


def _sibling_tables(found: JournalRead, context: PushContext) -> tuple[CompensationTable, ...]:
    """The other tables of the same transaction that move the same output axis."""
    every = [tables_of(part, context.meant)[1] for part in _other_parts(found)]
    return tuple(table for table in every if table.output_axis == context.axis.name)


def _other_parts(found: JournalRead) -> tuple[JournalRead, ...]:
    """The parts of those tables; without what was never sent, which is a neighbour like any other."""
    parts = found.whole.parts if found.whole is not None else ()
    return tuple(part for part in parts if part.of != found.of and part.said_last != PushEvent.ABORTED)


def _is_sibling_left_on(found: JournalRead, context: PushContext) -> bool:
    """Whether a table beside it has ended as one that acts: it is to be on again, whatever it reads now."""
    mine = [part for part in _other_parts(found) if part.is_ended and part.latest("axis") == context.axis.name]
    return any(_has_ended_on(part) for part in mine)


def _has_ended_on(part: JournalRead) -> bool:
    """Whether an ended table's switch is on: that of the new one where it was committed, else that of the old."""
    switch = part.latest("enable" if part.said_last == PushEvent.COMMITTED else "old_enabled")
    return part.said_last == PushEvent.COMMITTED if switch is None else bool(switch)


def _is_known_marker(context: PushContext, marker: Marker) -> bool:
    folder = journal.machine_folder(context.journals, context.machine.serial)
    return marker.transaction == 0 or journal.is_known_number(folder, marker.transaction)


def _neighbours_on(live: LiveSet, table: CompensationTable) -> bool:
    return table.kind == "cross" and any(one.enabled for one in other_cross_tables(live, table))


def _switch_position_of(found: JournalRead, context: PushContext) -> float:
    old, new = tables_of(found, context.meant)
    axis = context.input_axis
    place = switch_position(old, new, axis, context.controller.capabilities)
    return axis.reference if place is None else place


async def recover_table(
    found: JournalRead,
    context: PushContext,
    action: Choice = "offered",
    tell: Callable[[PushFinding], None] | None = None,
) -> PushRecord:
    """Look, and carry out what is offered: close, switch off, restore the old table; "finish" proves a new one.

    An interrupted rollback is finished ("finish": the earlier table acts) or undone ("undo": the pushed one acts) as
    the person chooses; switching off what must not act, and closing what was never begun, need no choice.
    ``tell`` hears what was found before anything is done about it.
    Raises WriteRefused (E-PUSH-NO-OFFER, E-PUSH-TRIES, E-INT-NAME, E-RECOVER-CHOOSE) with nothing written, BusyError,
    StoreError.
    """
    if context.typed_name != context.site_name:
        typed = context.typed_name or "nothing"
        raise WriteRefused("E-INT-NAME", found.path.name, typed=typed, wanted=context.site_name)
    with wrap_unexpected(context.axis.name):
        return await _recover_locked(found, with_safe_logger(context), action, tell)


async def _recover_locked(
    found: JournalRead,
    context: PushContext,
    action: Choice,
    tell: Callable[[PushFinding], None] | None,
) -> PushRecord:
    with machine_lock(journal.machine_folder(context.journals, context.machine.serial)):
        found = _read_again(found)
        read: LiveReadings = {}
        finding = await inspect_unfinished(found, context, read)
        if tell is not None:
            tell(finding)
        if finding.kind is FindingKind.TRIED:
            raise WriteRefused("E-PUSH-TRIES", found.path.name, count=MOST_TRIES, backup=finding.backup)
        may_finish = finding.back or (finding.kind is FindingKind.ENABLED and found.latest("purpose") == "table")
        never = found.purpose == "restore" and finding.action == "close"  # of it nothing was announced
        if finding.action == "none" or (action == "finish" and not may_finish and not never):
            raise WriteRefused("E-PUSH-NO-OFFER", found.path.name, finding=finding.said)
        if finding.choices and action == "offered":
            axis, old, new = finding.table or finding.axis, finding.old, finding.new
            raise WriteRefused("E-RECOVER-CHOOSE", found.path.name, axis=axis, old=old, new=new)
        if finding.kind is FindingKind.DISABLE_ORDER:
            return _close_disable_order(found, finding)
        limits = await _limits(found, context)
        forward = bool(finding.choices) and action == "finish"
        work = _table_state(found, context, _reopen_transaction(found, context), limits)
        if forward:
            _turn_forward(work, table_exchange(found, known_pushes(context), context.meant))
        work.loaded = next(iter(read.values()), None)
        with close_at_end((work,)):
            if finding.action == "restore" and not forward:
                alike = _parts_of_same_axis(found, context)
                theirs = [_table_state(part, context, work.transaction, await _limits(part, context)) for part in alike]
                await read_backups_again((work, *theirs))
            if forward:
                return work.record(await _finish_rollback(work, finding))
            return await _carry_out(work, finding, action)


def _turn_forward(work: TableTransactionState, both: TableExchange) -> None:
    """The work of a rollback that goes on: what it was to put there is what to go to, the pushed table what goes.

    The table to go to was the one before the push, and two readings agreed on it when that push was made.
    """
    work.change = replace(work.change, old=both.new.table, new=both.old.table, old_enabled=both.new.enabled)
    work.restore_to, work.confirmed = both.new, True


async def _finish_rollback(work: TableTransactionState, finding: PushFinding) -> Outcome:
    """The earlier table again, as the rollback was to leave it: "committed" once that is proved, else as `hold`."""
    work.note(PushEvent.RECOVERING, finding=finding.code, action="finish")
    try:
        with wrap_unexpected(work.axis):
            await restore_table(work)
            await work.finish_marker("committed")
            work.note(PushEvent.COMMITTED, enable=work.restore_to.enabled)
    except StoreError:
        raise
    except TrueflankError as error:
        return await hold(work, error.message)
    return "committed"


def _close_disable_order(found: JournalRead, finding: PushFinding) -> PushRecord:
    """A disable order leaves nothing half done: its journal ends as it stands."""
    kept = journal.Journal.reopen(found)
    try:
        kept.append(PushEvent.CLOSED, finding=finding.code)
    finally:
        kept.close()
    journal.set_aside(found.path)
    why = (finding.message,)
    return PushRecord(found.number, finding.axis, outcome="skipped", steps=why, backup_path="", reasons=why)


def _parts_of_same_axis(found: JournalRead, context: PushContext) -> list[JournalRead]:
    """Other tables of the transaction whose back-up stands in the same file: a way back writes over it."""
    left = [part for part in _other_parts(found) if not part.is_ended]
    return [part for part in left if tables_of(part, context.meant)[1].output_axis == context.axis.name]


def _reopen_transaction(found: JournalRead, context: PushContext) -> Transaction:
    folder = journal.machine_folder(context.journals, context.machine.serial)
    kept = journal.Journal.reopen(found)
    purpose: Purpose = "restore" if found.purpose == "restore" else "table"
    whole = Transaction(folder, kept, found.number, purpose=purpose, before=marker_before(found))
    whole.sent |= journal.order_numbers(found)
    return whole


async def _limits(found: JournalRead, context: PushContext) -> TableLimits:
    _old, new = tables_of(found, context.meant)
    return await context.controller.table_limits(context.axis.name, new.kind, new.index)


def _table_state(
    found: JournalRead, context: PushContext, whole: Transaction, limits: TableLimits
) -> TableTransactionState:
    old, new = tables_of(found, context.meant)
    nothing = np.zeros(0)
    base = str(found.latest("base_digest") or "")
    change = TableChange(
        context.axis.name,
        old.table,
        new=new,
        old_enabled=old.enabled,
        base_digest=base,
        targets=nothing,
        predicted=nothing,
        predicted_U=nothing,
    )
    place = _switch_position_of(found, context)
    work = TableTransactionState(
        context,
        whole,
        change=change,
        limits=limits,
        agreeing_position=place,
        restore_to=old,
        of=found.of,
        beside=_sibling_tables(found, context),
        coupled=was_coupled(found),
        sibling_enabled=_is_sibling_left_on(found, context),
    )
    work.state = found.state
    work.backup_path = str(found.latest("path") or "")
    work.marked = work.order(new, False, "restore", found.number)
    work.cut_short, work.partially_written = True, bool(found.latest("torn"))
    work.base_digest = next((str(one.facts["digest"]) for one in found.entries if one.kind == PushEvent.SNAPSHOT), "")
    work.confirmed, work.begun = bool(found.latest("confirmed")), True
    return work


async def _carry_out(work: TableTransactionState, finding: PushFinding, action: str) -> PushRecord:
    if finding.kind is FindingKind.DONE:
        return work.record("rolled-back" if finding.last != PushEvent.COMMITTED else "committed")
    if finding.action == "close":
        await work.finish_marker("none")
        work.note(PushEvent.CLOSED, finding=finding.code)
        return work.record("rolled-back")
    work.note(PushEvent.RECOVERING, finding=finding.code, action="disable" if finding.action == "disable" else action)
    if finding.action == "disable":
        reading = await disable.read_switch(work.context, disable.disable_order(work.change.new))
        return work.record(await end_held(work, finding.message, off=await disable.switch_off(work, reading)))
    if action != "finish":
        return work.record(await roll_back(work, Message.of("W-PUSH-UNFINISHED")))
    axis = work.context.input_axis
    base = await controller_access.read_live_tables(work.context)
    positions = effect_positions(work.change.new, work.restore_to, axis.room, axis.overrun)
    try:
        await prove_effect(work, positions, base)
    except VerifyError as error:
        work.seen = table_in(base, work.change.new)
        return work.record(await hold(work, error.message))
    await work.finish_marker("committed")
    work.note(PushEvent.COMMITTED)
    return work.record("committed")
