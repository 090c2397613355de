"""Tables into one controller: of each, old or new is enabled at every instant, whatever fails on the way.

A push of several tables is one transaction: one number, one journal, one program of two halves, one restart. Each
table is compared, switched and proved by itself.

    preflight      interlocks with what is known; a refusal changes nothing
    snapshot       the live tables, read and kept; interlocks again, now with them in hand
    load           first half: back up, compare with what the changes were made on, disable, write, read back
    release        second half: enable each table that was read back as sent, then the restart
    effect         what the control says it applies, at a few positions
    commit         a last look at machine, marker and tables; the control's marker; one journal line for all tables

What fails leads where nothing is left in doubt:

    before the first order was staged    aborted: nothing was written, the error is raised
    one table, and the others may stay   that table goes back (`PartialCommitPolicy` is asked with the rest)
    anything else                        all go back, one after the other, each from its own back-up
    the way back itself                  held: off where a read-back says so, else reported as still on

Every line of the journal is on the disk before what it announces is done, so a later process knows at least as much as
was true (`gateway.push.phases`). A write is never repeated: after a time-out its outcome is read back.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.types.abilities import Marker, TableLimits
from drivers.types.tables import LiveSet, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import StoreError, VerifyError
from gateway.events import PushEnded
from gateway.interlocks import MAX_JUMP, Refusal, refuse
from gateway.push import controller_access, journal
from gateway.push.compare import table_facts
from gateway.push.context import PushContext, plan_hash
from gateway.push.effect import prove_effects, require_unchanged
from gateway.push.journal import ReplayedJournal, is_replaying, machine_lock, replayed_value
from gateway.push.load import (
    TableFaults,
    TableLoad,
    is_already_live,
    leave_out_live,
    load_tables,
    release_tables,
    take_snapshot,
)
from gateway.push.phases import PushEvent, PushPhase, step_with_facts
from gateway.push.preflight import (
    NOTHING,
    PreflightResult,
    TableRequest,
    common_positions,
    journals_under_key,
    pending_transaction,
    refusals_with_live,
    refused_record,
    run_preflight,
)
from gateway.push.recovery_findings import marker_before
from gateway.push.restore import keep_marker_held, roll_back_all
from gateway.push.state import (
    Outcome,
    Purpose,
    TableTransactionState,
    Transaction,
    mute_during_replay,
    note_together,
    number_seed,
    with_safe_logger,
    wrap_unexpected,
)

_EARLIER_OUTCOMES: dict[PushPhase, Outcome] = {
    PushPhase.COMMITTED: "committed",
    PushPhase.ROLLED_BACK: "rolled-back",
    PushPhase.CLOSED: "rolled-back",
}
PartialCommitPolicy = Callable[[Sequence[TableChange]], bool]
"""Whether these tables alone are predicted to leave the machine no worse than none of the transaction would."""


def _allow_partial_commit(_changes: Sequence[TableChange]) -> bool:
    return True


async def push_table(change: TableChange, context: PushContext) -> PushRecord:
    """Push one table; the record's outcome says how it ended, its steps how it went.

    As `push_tables` of this one.
    """
    (record,) = await push_tables(((change, context),))
    return record


async def push_tables(
    requests: Sequence[TableRequest], policy: PartialCommitPolicy = _allow_partial_commit
) -> tuple[PushRecord, ...]:
    """Push tables of one machine in one transaction; a record for each, in order.

    Several are handed over together only where the control takes them so (`Capabilities.together`). When one fails,
    ``policy`` is asked whether the others may stay; if not, the whole transaction goes back.
    Reads and refusals change nothing. A context's key with the same plan again gives the earlier answer.
    Raises BusyError (E-PUSH-BUSY) when another push is under way, StoreError when the journal cannot be kept,
    and as long as nothing has been written the port's errors and Unexpected (E-PUSH-UNEXPECTED).
    """
    found: dict[int, PushRecord] = {}
    asked = {place: wish for place, wish in enumerate(requests) if not wish[0].skipped}
    for place, (change, _) in enumerate(requests):
        if change.skipped:
            why = (change.skipped,)
            found[place] = PushRecord(0, change.axis, outcome="skipped", steps=why, backup_path="", reasons=why)
    if asked:
        with wrap_unexpected(", ".join(dict.fromkeys(change.axis for change, _ in asked.values()))):
            quiet = [(change, with_safe_logger(context)) for change, context in asked.values()]
            found |= dict(zip(asked, await _push_locked(quiet, policy), strict=True))
    return tuple(found[place] for place in range(len(requests)))


async def _push_locked(requests: Sequence[TableRequest], policy: PartialCommitPolicy) -> tuple[PushRecord, ...]:
    context = requests[0][1]
    with machine_lock(journal.machine_folder(context.journals, context.machine.serial)):
        earlier = tuple(_earlier_record(change, one) for change, one in requests)
        known = tuple(record for record in earlier if record is not None)
        if len(known) == len(requests):
            return known
        if (waits := pending_transaction(context)) is not None:
            return await _run_transaction(await resume_transaction(requests, waits), policy, waits)
        places = common_positions(requests)
        answers = [await _preflight_table(change, one, places[one.input_axis.name]) for change, one in requests]
        if any(_is_refused(asked) for asked in answers):
            return _refuse_all(requests, answers)
        tasks = [
            AdmittedTable(
                change, one, asked.limits, agreeing_position=asked.agreeing_position or 0.0, marker=asked.marker
            )
            for (change, one), asked in zip(requests, answers, strict=True)
        ]
        return await _run_transaction(tasks, policy)


async def _run_transaction(
    tasks: Sequence[AdmittedTable], policy: PartialCommitPolicy, waits: journal.JournalRead | None = None
) -> tuple[PushRecord, ...]:
    with open_transaction(tasks, "table", waits) as works:
        ended = await _push_admitted(works, policy)
        for outcome in dict.fromkeys(ended[work] for work in works):
            names = ", ".join(work.change.name for work in works if ended[work] == outcome)
            PushEnded(names, outcome).tell(tasks[0].context.say)
        return tuple(work.record(ended[work], told=True) for work in works)


async def _preflight_table(change: TableChange, context: PushContext, place: float | None) -> PreflightResult:
    """What speaks against it; no place that suits all tables of the input axis does (E-INT-NOWHERE)."""
    asked = await run_preflight(change, context, "table", place=place)
    if place is not None or asked.agreeing_position is None:
        return asked
    told = {"axis": change.axis, "limit": MAX_JUMP, "unit": change.new.deviation_unit}
    return replace(asked, agreeing_position=None, refusals=(*asked.refusals, *refuse("E-INT-NOWHERE", **told)))


def _is_refused(asked: PreflightResult) -> bool:
    return asked.agreeing_position is None or any(refusal.code != NOTHING for refusal in asked.refusals)


def _refuse_all(requests: Sequence[TableRequest], answers: Sequence[PreflightResult]) -> tuple[PushRecord, ...]:
    """What speaks against one speaks against all: they would go together."""
    each = [tuple(one for one in asked.refusals if one.code != NOTHING) for asked in answers]
    rest = tuple({refusal.words: refusal for reasons in each for refusal in reasons}.values())
    return tuple(
        refused_record(context, change.axis, reasons or rest)
        for (change, context), reasons in zip(requests, each, strict=True)
    )


def _earlier_record(change: TableChange, context: PushContext) -> PushRecord | None:
    """The answer already given under this key to this very plan, if that push ended."""
    plan = plan_hash(change, context.machine)
    found = next((part for part in journals_under_key(context) if part.latest("plan") == plan), None)
    outcome = _EARLIER_OUTCOMES.get(found.state.phase) if found is not None else None
    if found is None or outcome is None:
        return None
    steps = tuple(step_with_facts(one.kind, str(one.facts.get("utc", "")), {}) for one in found.entries)
    shown = tuple((float(one[0]), float(one[1]), float(one[2])) for one in found.latest("shown") or ())
    return PushRecord(
        found.number,
        change.axis,
        outcome=outcome,
        steps=steps,
        backup_path=str(found.latest("path") or ""),
        effect=shown,
        reasons=found.reasons if outcome == "rolled-back" else (),
    )


async def _push_admitted(
    works: Sequence[TableTransactionState], policy: PartialCommitPolicy
) -> dict[TableTransactionState, Outcome]:
    try:
        with wrap_unexpected(_names(works)):
            bases = dict(zip(works, await take_snapshot(works), strict=True))
            brought = {work.context.input_axis.name: work.agreeing_position for work in works}
            reasons = {work: await refusals_with_live(work, bases[work], brought) for work in works}
    except TrueflankError as error:
        abort(works, error.message)
        raise
    there: dict[TableTransactionState, Outcome] = {
        work: "already-applied" for work in works if is_already_live(work, bases[work])
    }
    abort(tuple(there), Message.of("W-PUSH-ALREADY"))
    left = tuple(work for work in works if work not in there)
    if not left or (any(reasons[work] for work in left) and not is_replaying(left[0].transaction.journal)):
        return there | _refuse(left, reasons)
    _leave_out(left, there, bases)
    return there | await _exchange(left, bases, policy)


def _leave_out(
    left: Sequence[TableTransactionState],
    there: dict[TableTransactionState, Outcome],
    bases: dict[TableTransactionState, LiveSet],
) -> None:
    """A table that is live already is no part of what is sent: it stands beside as any other of its axis does."""
    for work in left:
        leave_out_live(work, there, bases[work])


def _refuse(
    works: Sequence[TableTransactionState], reasons: dict[TableTransactionState, tuple[Refusal, ...]]
) -> dict[TableTransactionState, Outcome]:
    every = tuple(reason for work in works for reason in reasons[work])
    for work in works:
        told = reasons[work] or every
        for reason in told:
            work.context.say("P-PUSH-REFUSED", axis=work.name, reason=reason.message)
        work.note(PushEvent.ABORTED, why=Message.of("W-PUSH-AGAINST", count=len(told)))
        work.steps += [reason.message for reason in told]
        work.because(*(reason.message for reason in told))
    return dict.fromkeys(works, "refused")


async def _exchange(
    works: Sequence[TableTransactionState], bases: dict[TableTransactionState, LiveSet], policy: PartialCommitPolicy
) -> dict[TableTransactionState, Outcome]:
    """Write, and commit what is proved; what is not goes back, and with it all where the rest may not stay."""
    faults: TableFaults = {}
    ended: dict[TableTransactionState, Outcome] = {}
    try:
        with wrap_unexpected(_names(works)):
            await _write(works, bases, faults, policy)
    except TrueflankError as failure:
        if all(work.marked is None for work in works):  # nothing was sent: nothing to take back
            abort(works, failure.message)
            raise
        return await roll_back_all(works, failure.message)
    good = tuple(work for work in works if work not in faults)
    for work, fault in faults.items():
        ended |= await roll_back_all((work,), fault.message)
    why = await _reason_to_doubt(good, ended) if faults else None
    return ended | (await roll_back_all(good, why) if why else await _commit(good, ended, bases))


async def _reason_to_doubt(
    good: Sequence[TableTransactionState], ended: dict[TableTransactionState, Outcome]
) -> Message | None:
    """Why the tables that were proved are in doubt, after others of theirs went back; None if they are not.

    A way back switches an output axis' cross tables off and on again, so these are read once more.
    """
    if any(outcome not in ("rolled-back", "untouched") for outcome in ended.values()):
        return Message.of("W-PUSH-REST-HELD")
    try:
        with wrap_unexpected(_names(good)):
            for work in good:
                live = await controller_access.read_live_tables(work.context) if work.beside else None
                if live is not None and not is_already_live(work, live):
                    return Message.of("W-PUSH-REST-LOST", name=work.name)
    except TrueflankError as error:
        return error.message
    return None


async def _commit(
    works: Sequence[TableTransactionState],
    ended: dict[TableTransactionState, Outcome],
    bases: Mapping[TableTransactionState, LiveSet],
) -> dict[TableTransactionState, Outcome]:
    """A last look, the marker, one line of the journal for all. A failure before that leads back; raises StoreError."""
    try:
        with wrap_unexpected(_names(works)):
            await require_unchanged(works, bases)
            await works[0].finish_marker("committed")
            note_together(works, PushEvent.COMMITTED)
    except StoreError:
        raise
    except TrueflankError as failure:
        return await roll_back_all(works, failure.message)
    await keep_marker_held({**ended, works[0]: "committed"})
    return dict.fromkeys(works, "committed")


def _names(works: Sequence[TableTransactionState]) -> str:
    return ", ".join(work.name for work in works)


async def _write(
    works: Sequence[TableTransactionState],
    bases: dict[TableTransactionState, LiveSet],
    faults: TableFaults,
    policy: PartialCommitPolicy,
) -> None:
    """Both halves and the proof of each. What fails of one table alone joins ``faults``, if the others may stay.

    Raises VerifyError (E-PUSH-LAYER, or the fault itself where it is the only table) when they may not.
    """
    loads = tuple(
        TableLoad(work, work.order(work.change.new, True, "table", work.transaction.number), bases[work])
        for work in works
    )
    faults |= await load_tables(loads)
    _require_partial_commit(works, faults, policy)
    passed = tuple(one for one in loads if one.work not in faults)
    for one in passed:
        tables = {other.work.change.new for other in passed}
        one.work.acting = tuple(table for table in one.work.beside if table in tables)
    await release_tables(passed, tuple(one.order for one in loads))
    await prove_effects([one.work for one in passed], bases, faults)
    _require_partial_commit(works, faults, policy)


def _require_partial_commit(
    works: Sequence[TableTransactionState], faults: TableFaults, policy: PartialCommitPolicy
) -> None:
    if not faults:
        return
    good = [work.change for work in works if work not in faults]
    first = next(iter(faults.values()))
    if not good:
        raise first
    names, failed = ", ".join(change.name for change in good), _names(tuple(faults))
    if not policy(good):
        raise VerifyError("E-PUSH-LAYER", failed, failed=failed, names=names, why=first.message)
    works[0].context.say("P-PUSH-REST-STAYS", names=names, failed=failed, why=first.message)


# The transaction on the disk: number and journal at its begin, the journal set aside at its end.


@dataclass(frozen=True, slots=True)
class AdmittedTable:
    """One table that nothing speaks against: where its input axis must stand, and the control's marker until then."""

    change: TableChange
    context: PushContext
    limits: TableLimits
    agreeing_position: float
    marker: Marker | None = None


@contextmanager
def open_transaction(
    tasks: Sequence[AdmittedTable], purpose: Purpose, waits: journal.JournalRead | None = None
) -> Iterator[tuple[TableTransactionState, ...]]:
    """A new transaction for all these tables of one machine: number, journal, each table's first entry.

    With ``waits``, its journal, one that was begun before goes on. The journal is set aside once every table has ended.
    """
    context = tasks[0].context
    folder = journal.machine_folder(context.journals, context.machine.serial)
    journal.set_ended_aside(folder, context.log.begun if context.log is not None else None)
    number = waits.number if waits is not None else journal.allocate_number(folder, number_seed(context))
    kept = ReplayedJournal.follow(waits) if waits is not None else journal.Journal.create(folder, number)
    before = tasks[0].marker
    whole = Transaction(folder, kept, number, purpose=purpose, before=before)
    works = tuple(_table_state(whole, task, tasks) for task in tasks)
    with close_at_end(works):
        for work in works:
            _note_first_entry(work)
        _announce_to_audit(works)
        yield works


def _table_state(whole: Transaction, task: AdmittedTable, tasks: Sequence[AdmittedTable]) -> TableTransactionState:
    change = task.change
    others = [other.change for other in tasks if other is not task]
    return TableTransactionState(
        mute_during_replay(task.context, whole.journal),
        whole,
        change=change,
        limits=task.limits,
        agreeing_position=task.agreeing_position,
        restore_to=LiveTable(change.old, change.old_enabled),
        of=change.name if len(tasks) > 1 else "",
        beside=tuple(other.new for other in others if other.axis == change.axis),
        along=tuple(other.new for other in others if other.axis != change.axis),
    )


def _note_first_entry(work: TableTransactionState) -> None:
    context, change = work.context, work.change
    work.note(
        PushEvent.LEASED,
        transaction=work.transaction.number,
        purpose=work.transaction.purpose,
        axis=change.axis,
        serial=context.machine.serial,
        old=table_facts(change.old),
        old_enabled=change.old_enabled,
        new=table_facts(change.new),
        base_digest=change.base_digest,
        place=work.agreeing_position,
        plan=plan_hash(change, context.machine),
        key=context.key,
        actor=context.actor,
        approved_by=sorted({approval.actor for approval in context.approvals}),
        sign=context.sense,
        consent=_consent_id(context),
    )


def _consent_id(context: PushContext) -> str:
    """The same for every transaction that one consent leads to: its run and when that push began; else ""."""
    return f"{context.run_id} {context.consent_utc.isoformat()}" if context.run_id and context.consent_utc else ""


def _announce_to_audit(works: Sequence[TableTransactionState]) -> None:
    """The audit log knows of each table before anything is sent, and the journal names the log's line.

    Raises CorruptRecord, BusyError, StoreError: then nothing is sent.
    """
    try:
        for work in works:
            if work.context.log is not None:
                said = replayed_value(work.transaction.journal, PushEvent.AUDITED, "audit")
                work.note(PushEvent.AUDITED, audit=said or work.context.log.begin(work.transaction.number, work.change))
    except TrueflankError as error:
        abort(works, error.message)
        raise


def abort(works: Sequence[TableTransactionState], why: Message) -> None:
    """Nothing was written for these tables, and nothing will be."""
    for work in works:
        work.note(PushEvent.ABORTED, why=why)


@contextmanager
def close_at_end(works: Sequence[TableTransactionState]) -> Iterator[None]:
    """Let go of the journal's file, and move the journal to `done` when the last entry of each table is final.

    A disk that refuses here changes nothing of how the push ended: the journal is read and moved later.
    """
    kept = works[0].transaction.journal
    try:
        yield
    except asyncio.CancelledError:
        for work in works:
            if not work.state.phase.final:
                work.note_stop()
        raise
    finally:
        kept.close()
    with contextlib.suppress(StoreError):
        if journal.read(kept.path).is_ended:
            journal.set_aside(kept.path)


# A transaction that waited for carried files goes on with what its journal recorded.


async def resume_transaction(
    requests: Sequence[tuple[TableChange, PushContext]], waits: journal.JournalRead
) -> list[AdmittedTable]:
    """The tasks of a transaction that goes on, as its journal has them: nothing spoke against them then."""
    controller = requests[0][1].controller
    marker = marker_before(waits) or (await controller.marker() if controller.capabilities.marker else None)
    tasks: list[AdmittedTable] = []
    for change, context in requests:
        limits = await controller.table_limits(change.axis, change.new.kind, change.new.index)
        place = float(waits.part(change.name if len(requests) > 1 else "").entries[0].facts["place"])
        tasks.append(AdmittedTable(change, context, limits, agreeing_position=place, marker=marker))
    return tasks
