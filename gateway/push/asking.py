"""May these tables be pushed? Every reason at once, first as the machine stands, then with the live tables in hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from drivers.types.abilities import Marker, TableLimits
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.interlocks import PushFacts, Refusal, needed, refusals, warnings
from gateway.push import compare, conversation
from gateway.push.compare import same_set, table_in, with_table
from gateway.push.context import PushContext
from gateway.push.plan import plan_hash
from gateway.push.records import journal
from gateway.push.work import Purpose, Work

NOTHING = "E-INT-NOTHING"


@dataclass(frozen=True, slots=True)
class Asked:
    """The answer of the interlocks before anything is sent; ``warnings`` ask for a second person.

    ``marker`` is the control's as it stood then: while it stands, nobody else has pushed.
    """

    limits: TableLimits
    agreeing_position: float | None
    refusals: tuple[Refusal, ...]
    warnings: tuple[Refusal, ...] = ()
    people: int = 1
    marker: Marker | None = None


async def ask(
    change: TableChange,
    context: PushContext,
    purpose: Purpose,
    live: LiveSet | None = None,
    place: float | None = None,
) -> Asked:
    """Every reason not to push now, from the machine as it stands; reads only, for `push` without apply too.

    Whether the live tables are still those of the capture may take a program on the machine, so it is not asked;
    ``live`` are the live tables where they are known. ``place`` is where the input axis will stand, where other tables
    of one transaction have a say in it.
    """
    table = change.new
    limits = await context.controller.table_limits(change.axis, table.kind, table.index)
    if place is None:
        place = place_for(LiveTable(change.old, change.old_enabled), change, context)
    facts = await conversation.facts_at_start(
        context,
        change,
        purpose=purpose,
        limits=limits,
        agreeing_position=place,
        live=live,
        unfinished=unfinished_names(context),
        key_taken=_key_taken(change, context),
    )
    return _asked(facts, limits, place)


def _asked(facts: PushFacts, limits: TableLimits, place: float | None) -> Asked:
    return Asked(
        limits, place, refusals=refusals(facts), warnings=warnings(facts), people=needed(facts), marker=facts.marker
    )


def place_for(old: LiveTable, change: TableChange, context: PushContext) -> float | None:
    """Where the input axis must stand for the switching of old and new."""
    return compare.place_for(old, change.new, context.moved, context.controller.capabilities)


def _key_taken(change: TableChange, context: PushContext) -> str:
    """The key, when an earlier push under it was another plan."""
    found = under_key(context)
    other = bool(found) and all(part.latest("plan") != plan_hash(change, context.machine) for part in found)
    return context.key if other else ""


def under_key(context: PushContext) -> tuple[journal.JournalRead, ...]:
    """What the newest transaction with the context's key tells of its tables, ended or not; none without a key."""
    if not context.key:
        return ()
    folder = journal.machine_folder(context.journals, context.machine.serial)
    found = [one for one in (*journal.all_of(folder / "done"), *journal.all_of(folder)) if one.entries]
    with_key = (one.parts for one in reversed(found) if one.entries[0].facts.get("key") == context.key)
    return next(with_key, ())


def waiting(context: PushContext) -> journal.JournalRead | None:
    """The transaction under the context's key that has not ended, where such a one is to go on; None else."""
    parts = under_key(context) if context.resumes else ()
    whole = (parts[0].whole or parts[0]) if parts else None
    return whole if whole is not None and not whole.finished else None


def ended_before(context: PushContext) -> bool:
    """Whether a push under the context's key had ended already when it is taken up again: it has been told."""
    return goes_on(context) and waiting(context) is None


def goes_on(context: PushContext) -> bool:
    """Whether a push under the context's key was begun before and is taken up again, ended or not."""
    return context.resumes and bool(under_key(context))


def unfinished_names(context: PushContext) -> tuple[str, ...]:
    """Names of journals of this machine that did not end."""
    folder = journal.machine_folder(context.journals, context.machine.serial)
    begun = context.log.begun if context.log is not None else None
    return tuple(found.path.name for found in journal.left_open(folder, begun))


def refused(context: PushContext, axis: str, reasons: tuple[Refusal, ...]) -> PushRecord:
    """The record of a push that wrote nothing, every reason one step."""
    for reason in reasons:
        context.say("P-PUSH-REFUSED", axis=axis, reason=reason.message)
    told = tuple(reason.message for reason in reasons)
    return PushRecord(0, axis, outcome="refused", steps=told, backup_path="", reasons=told)


async def still_allowed(work: Work, live: LiveSet, brought: Mapping[str, float]) -> tuple[Refusal, ...]:
    """The same questions with the live tables in hand: the old table is what is really there.

    Other tables of the transaction on the same output count as live; ``brought`` is where input axes will stand.
    """
    old = table_in(live, work.change.new)
    change = replace(work.change, old=old.table, old_enabled=old.enabled)
    alone = place_for(old, change, work.context)
    facts = await conversation.facts_at_start(
        work.context,
        change,
        purpose=work.whole.purpose,
        limits=work.limits,
        agreeing_position=work.agreeing_position if work.of and alone is not None else alone,
        live=with_all(live, work.beside),
        unchanged=unchanged(work.context, work.change, live, work.allowed),
        brought=brought,
    )
    if facts.agreeing_position is not None:
        work.agreeing_position = facts.agreeing_position
    return tuple(refusal for refusal in refusals(facts) if refusal.code != NOTHING)


def with_all(live: LiveSet, tables: Sequence[CompensationTable]) -> LiveSet:
    """The set after these tables were put into it and switched on."""
    for table in tables:
        live = with_table(live, table)
    return live


def unchanged(context: PushContext, change: TableChange, live: LiveSet, allowed: float) -> bool:
    """Whether the live tables are those the change was made on, by their text or else by all they hold.

    Tables that this very run has pushed since are part of what is expected.
    """
    if live.digest == change.base_digest:
        return True
    base = change.base or (context.capture.live if context.capture is not None else None)
    if base is None or base.digest != change.base_digest or base.axis != live.axis:
        return False
    known = context.controller.tables_by(base, context.proof)
    pushed = [context.controller.table_by(one, 1, context.proof) for one in context.pushed]
    expected = with_all(known, pushed)
    return same_set(expected, live, allowed)
