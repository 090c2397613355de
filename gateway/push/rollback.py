"""Committed pushes taken back as a transaction of their own: the tables from before them, under the same checks.

Each table to put back is known from the journal, so no sign is proved; but it is put back only over the very table
that its push wrote. What anybody else has written since is left alone and told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.types.tables import LiveSet, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import StoreError, VerifyError
from gateway.interlocks import PushFacts, Refusal, refusals, refuse
from gateway.push import controller_access, journal
from gateway.push.compare import same_table, table_in
from gateway.push.context import PushContext
from gateway.push.effect import prove_effects
from gateway.push.history import CommittedPush
from gateway.push.journal import machine_lock
from gateway.push.load import (
    TableFaults,
    TableLoad,
    leave_out_live,
    load_tables,
    read_live_sets,
    release_tables,
    take_snapshot,
)
from gateway.push.phases import PushEvent
from gateway.push.preflight import (
    PreflightResult,
    change_position,
    common_positions,
    group_transactions,
    refused_record,
    unfinished_journal_names,
)
from gateway.push.restore import roll_back_all
from gateway.push.state import Outcome, TableTransactionState, note_together, with_safe_logger, wrap_unexpected
from gateway.push.transaction import AdmittedTable, abort, open_transaction
from gateway.table.comparison import differences
from gateway.table.live_comparison import ThreeWay, compare_three_tables

RollbackRequest = tuple[CommittedPush, PushContext]


def rollback_change(done: CommittedPush) -> TableChange:
    """The change that takes a push back: from what it wrote to what was live before."""
    nothing = np.zeros(0)
    return TableChange(
        done.axis,
        done.new.table,
        new=done.old.table,
        old_enabled=done.new.enabled,
        base_digest="",
        targets=nothing,
        predicted=nothing,
        predicted_U=nothing,
    )


async def preflight_rollback(done: CommittedPush, context: PushContext, place: float | None = None) -> PreflightResult:
    """Every reason not to take it back now; reads only. The live table is compared once it is applied.

    ``place`` is where the input axis will stand, where other tables of the transaction have a say in it.
    """
    change = rollback_change(done)
    table = change.new
    limits = await context.controller.table_limits(change.axis, table.kind, table.index)
    if place is None:
        place = change_position(done.new, change, context)
    names = unfinished_journal_names(context)
    facts = await controller_access.read_facts(
        context, change, purpose="restore", limits=limits, agreeing_position=place, unfinished=names
    )
    return PreflightResult(limits, place, tuple(_reasons(facts)), marker=facts.marker)


async def preflight_rollbacks(undos: Sequence[RollbackRequest]) -> tuple[PreflightResult, ...]:
    """As `preflight_rollback`, of tables that go back in one transaction: their input axes have one place each."""
    places = common_positions([(rollback_change(done), context) for done, context in undos])
    return tuple([await preflight_rollback(done, context, places[context.input_axis.name]) for done, context in undos])


def group_rollbacks(undos: Sequence[RollbackRequest]) -> tuple[tuple[RollbackRequest, ...], ...]:
    """What goes back in one transaction each, as few as the control and its axes' places allow."""
    changes = [rollback_change(undo[0]) for undo in undos]
    requests = {id(change): undo for change, undo in zip(changes, undos, strict=True)}
    grouped = group_transactions([(change, undo[1]) for change, undo in zip(changes, undos, strict=True)])
    return tuple(tuple(requests[id(change)] for change, _ in group) for group in grouped)


def _reasons(facts: PushFacts) -> list[Refusal]:
    """The interlocks of a restore, and those that only a transaction asked for afresh must pass."""
    found = list(refusals(facts))
    if facts.unfinished:
        found += refuse("E-INT-UNFINISHED", journals=", ".join(facts.unfinished))
    if facts.request.audit_broken:
        found += refuse("E-INT-AUDIT-BROKEN", why=facts.request.audit_broken)
    if facts.missing:
        found += refuse("E-INT-JOURNAL-MISSING", numbers=", ".join(map(str, facts.missing)))
    if facts.mark.behind:
        found += refuse("E-INT-AUDIT-BEHIND", why=facts.mark.behind)
    marker = facts.marker
    if marker is not None and marker.state in ("in-progress", "held") and not facts.mark.ours:
        found += refuse("E-INT-MARKER", number=marker.transaction, state=marker.state)
    if facts.agreeing_position is None:
        limit, unit = facts.bounds.jump, facts.table.deviation_unit
        found += refuse("E-INT-NOWHERE", axis=facts.change.axis, limit=limit, unit=unit)
    return found


async def roll_back_push(done: CommittedPush, context: PushContext) -> PushRecord:
    """Put back what was live before ``done``; as `roll_back_pushes` of this one."""
    (record,) = await roll_back_pushes(((done, context),))
    return record


async def roll_back_pushes(undos: Sequence[RollbackRequest]) -> tuple[PushRecord, ...]:
    """Put back what was live before each of these pushes, in one transaction; a record for each, in order.

    An outcome "committed" says that the older table is back. Whatever fails once something was sent leads all of them
    to the newer tables again ("rolled-back"), or is held. "refused" with nothing written when an interlock speaks
    against one of them, or a live table is not the one that its push wrote. Raises BusyError (E-PUSH-BUSY), StoreError,
    and the port's errors as long as nothing has been written.
    """
    with wrap_unexpected(_names_of(undos)):
        return await _roll_back_locked([(done, with_safe_logger(context)) for done, context in undos])


def _names_of(undos: Sequence[RollbackRequest]) -> str:
    return ", ".join(done.table for done, _ in undos)


async def _roll_back_locked(undos: Sequence[RollbackRequest]) -> tuple[PushRecord, ...]:
    context = undos[0][1]
    with machine_lock(journal.machine_folder(context.journals, context.machine.serial)):
        answers = await preflight_rollbacks(undos)
        if any(asked.refusals or asked.agreeing_position is None for asked in answers):
            return _refuse_all(undos, [asked.refusals for asked in answers])
        tasks = [
            AdmittedTable(
                rollback_change(done),
                one,
                asked.limits,
                agreeing_position=asked.agreeing_position or 0.0,
                marker=asked.marker,
            )
            for (done, one), asked in zip(undos, answers, strict=True)
        ]
        with open_transaction(tasks, "restore") as works:
            pairs = dict(zip(works, (done for done, _ in undos), strict=True))
            for work, done in pairs.items():
                work.note(PushEvent.UNDOES, undoes=done.transaction, enable=done.old.enabled)
            ended = await _roll_back_admitted(pairs)
            return tuple(work.record(ended[work]) for work in works)


def _refuse_all(undos: Sequence[RollbackRequest], each: Sequence[tuple[Refusal, ...]]) -> tuple[PushRecord, ...]:
    """What speaks against one speaks against all: they would go together."""
    rest = tuple({one.words: one for reasons in each for one in reasons}.values())
    return tuple(
        refused_record(context, done.axis, reasons or rest)
        for (done, context), reasons in zip(undos, each, strict=True)
    )


async def _roll_back_admitted(
    undos: dict[TableTransactionState, CommittedPush],
) -> dict[TableTransactionState, Outcome]:
    works = tuple(undos)
    try:
        with wrap_unexpected(_names(works)):
            bases = dict(zip(works, await take_snapshot(works), strict=True))
            live = {work: table_in(bases[work], work.change.new) for work in works}
            brought = {work.context.input_axis.name: work.agreeing_position for work in works}
            reasons = {work: await _still_allowed(work, bases[work], brought) for work in works}
    except TrueflankError as error:
        abort(works, error.message)
        raise
    there: dict[TableTransactionState, Outcome] = {
        work: "already-applied" for work in works if _is_there(undos[work].old, live[work], work.tolerance)
    }
    left = {work: done for work, done in undos.items() if work not in there}
    for work, done in left.items():
        seen = compare_with_push(live[work], done, work.tolerance)
        if seen.kind != "as-approved":
            foreign = refuse("E-PUSH-UNDO-FOREIGN", transaction=done.transaction, difference=seen.message)
            reasons[work] = (*foreign, *reasons[work])
    if there:
        note_together(
            tuple(there), PushEvent.COMMITTED
        )  # somebody has put them back: nothing is left to take back of them
    if any(reasons[work] for work in left):
        return there | _refuse(tuple(left), reasons)
    for work in left:
        leave_out_live(work, there, bases[work])
    return there | (await _exchange(left, bases) if left else {})


def _refuse(
    works: Sequence[TableTransactionState], reasons: dict[TableTransactionState, tuple[Refusal, ...]]
) -> dict[TableTransactionState, Outcome]:
    every = tuple({one.words: one for work in works for one in reasons[work]}.values())
    for work in works:
        told = reasons[work] or every
        record = refused_record(work.context, work.axis, told)
        work.note(PushEvent.ABORTED, why=Message.of("W-PUSH-AGAINST", count=len(told)))
        work.steps += record.steps
        work.because(*record.reasons)
    return dict.fromkeys(works, "refused")


async def _exchange(
    undos: dict[TableTransactionState, CommittedPush], bases: dict[TableTransactionState, LiveSet]
) -> dict[TableTransactionState, Outcome]:
    works = tuple(undos)
    try:
        with wrap_unexpected(_names(works)):
            await _put_back(undos, bases)
            await works[0].finish_marker("committed")
            note_together(works, PushEvent.COMMITTED)
    except StoreError:
        raise
    except TrueflankError as failure:
        if all(work.marked is None for work in works):  # nothing was sent: nothing to take back
            abort(works, failure.message)
            raise
        return await roll_back_all(works, failure.message)
    return dict.fromkeys(works, "committed")


async def _still_allowed(
    work: TableTransactionState, base: LiveSet, brought: Mapping[str, float]
) -> tuple[Refusal, ...]:
    facts = await controller_access.read_facts(
        work.context,
        work.change,
        purpose="restore",
        limits=work.limits,
        agreeing_position=work.agreeing_position,
        live=base,
        brought=brought,
    )
    return tuple(_reasons(facts))


async def _put_back(
    undos: dict[TableTransactionState, CommittedPush], bases: dict[TableTransactionState, LiveSet]
) -> None:
    """Both halves, the proof of each table that acts again, and what is read of all at the end.

    Raises VerifyError where one is not as it should be: then all go to the newer tables again.
    """
    loads = tuple(
        TableLoad(work, work.order(done.old.table, done.old.enabled, "restore", work.transaction.number), bases[work])
        for work, done in undos.items()
    )
    faults = await load_tables(loads)
    _demand_none(faults)
    acting = {work.change.new for work, done in undos.items() if done.old.enabled}
    for work in undos:
        work.acting = tuple(table for table in work.beside if table in acting)
    await release_tables(loads)
    proved = [work for work, done in undos.items() if done.old.enabled]
    if proved:
        await prove_effects(proved, bases, faults)
        _demand_none(faults)
    off = [work for work in undos if work not in proved]
    for work, live in zip(off, await read_live_sets(off) if off else (), strict=True):
        old, found = undos[work].old, table_in(live, undos[work].old.table)
        if not _is_there(old, found, work.tolerance):
            different = differences(old.table, found.table, work.tolerance) or (Message.of("W-LIVE-SWITCH"),)
            raise VerifyError("E-PUSH-NOT-RESTORED", work.axis, axis=work.axis, first=different[0])


def _demand_none(faults: TableFaults) -> None:
    if faults:
        raise next(iter(faults.values()))


def _names(works: Sequence[TableTransactionState]) -> str:
    return ", ".join(work.name for work in works)


def _is_there(wanted: LiveTable, live: LiveTable, allowed: float) -> bool:
    """Whether it is live; one table never loaded is as good as another."""
    never = wanted.table.step <= 0 and live.table.step <= 0
    return (never and wanted.enabled == live.enabled) or same_table(wanted, live, allowed)


def compare_with_push(live: LiveTable, done: CommittedPush, allowed: float) -> ThreeWay:
    """The live table against the one a push wrote and the one before it."""
    return compare_three_tables(live, done.new, done.old, allowed)
