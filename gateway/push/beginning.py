"""A transaction's begin and end on the disk: number, journal, what each table is, and the journal set aside."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.types.abilities import Marker, TableLimits
from drivers.types.tables import LiveTable
from gateway.domain.proposals import TableChange
from gateway.errors import StoreError
from gateway.push.compare import table_facts
from gateway.push.context import PushContext
from gateway.push.plan import plan_hash
from gateway.push.records import journal, numbering
from gateway.push.records.phases import PushEvent
from gateway.push.records.replaying import ReplayedJournal, foretold
from gateway.push.unexpected import quiet_in_replay
from gateway.push.work import Purpose, Transaction, Work, seed_of


@dataclass(frozen=True, slots=True)
class Task:
    """One table that nothing speaks against: where its input axis must stand, and the control's marker until then."""

    change: TableChange
    context: PushContext
    limits: TableLimits
    agreeing_position: float
    marker: Marker | None = None


@contextmanager
def begun(
    tasks: Sequence[Task], purpose: Purpose, waits: journal.JournalRead | None = None
) -> Iterator[tuple[Work, ...]]:
    """A new transaction for all these tables of one machine: number, journal, each table's first entry.

    With ``waits``, its journal, one that was begun before goes on. The journal is set aside once every table has ended.
    """
    context = tasks[0].context
    folder = journal.machine_folder(context.journals, context.machine.serial)
    journal.tidy(folder, context.log.begun if context.log is not None else None)
    number = waits.number if waits is not None else numbering.allocate(folder, seed_of(context))
    kept = ReplayedJournal.follow(waits) if waits is not None else journal.Journal.create(folder, number)
    before = tasks[0].marker
    whole = Transaction(folder, kept, number, purpose=purpose, before=before)
    works = tuple(_work(whole, task, tasks) for task in tasks)
    with closed_at_the_end(works):
        for work in works:
            _first(work)
        _announce(works)
        yield works


def _work(whole: Transaction, task: Task, tasks: Sequence[Task]) -> Work:
    change = task.change
    others = [other.change for other in tasks if other is not task]
    return Work(
        quiet_in_replay(task.context, whole.journal),
        whole,
        change=change,
        limits=task.limits,
        agreeing_position=task.agreeing_position,
        restore_to=LiveTable(change.old, change.old_enabled),
        of=change.name if len(tasks) > 1 else "",
        beside=tuple(other.new for other in others if other.axis == change.axis),
        along=tuple(other.new for other in others if other.axis != change.axis),
    )


def _first(work: Work) -> None:
    context, change = work.context, work.change
    work.note(
        PushEvent.LEASED,
        transaction=work.whole.number,
        purpose=work.whole.purpose,
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
        consent=_consent(context),
    )


def _consent(context: PushContext) -> str:
    """The same for every transaction that one consent leads to: its run and when that push began; else ""."""
    return f"{context.run_id} {context.consent_utc.isoformat()}" if context.run_id and context.consent_utc else ""


def _announce(works: Sequence[Work]) -> None:
    """The audit log knows of each table before anything is sent, and the journal names the log's line.

    Raises CorruptRecord, BusyError, StoreError: then nothing is sent.
    """
    try:
        for work in works:
            if work.context.log is not None:
                said = foretold(work.whole.journal, PushEvent.AUDITED, "audit")
                work.note(PushEvent.AUDITED, audit=said or work.context.log.begin(work.whole.number, work.change))
    except TrueflankError as error:
        abort(works, error.message)
        raise


def abort(works: Sequence[Work], why: Message) -> None:
    """Nothing was written for these tables, and nothing will be."""
    for work in works:
        work.note(PushEvent.ABORTED, why=why)


@contextmanager
def closed_at_the_end(works: Sequence[Work]) -> Iterator[None]:
    """Let go of the journal's file, and move the journal to `done` when the last entry of each table is final.

    A disk that refuses here changes nothing of how the push ended: the journal is read and moved later.
    """
    kept = works[0].whole.journal
    try:
        yield
    except asyncio.CancelledError:
        for work in works:
            if not work.state.phase.final:
                work.stopped()
        raise
    finally:
        kept.close()
    with contextlib.suppress(StoreError):
        if journal.read(kept.path).finished:
            journal.set_aside(kept.path)
