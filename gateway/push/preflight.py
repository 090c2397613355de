"""May these tables be pushed? Every reason at once, first from the machine alone, then with the live tables in hand.

Reads only. The same questions are asked by a push without apply, so that a person sees every refusal before the push.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.types.abilities import Capabilities, Marker, TableLimits
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.axes import AxisRecord
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.interlocks import MAX_JUMP, PushFacts, Refusal, people_needed, refusals, value_at, warnings
from gateway.push import compare, controller_access, journal
from gateway.push.compare import same_set, switch_position, table_in, with_table
from gateway.push.context import PushContext, plan_hash
from gateway.push.state import Purpose, TableTransactionState

NOTHING = "E-INT-NOTHING"


@dataclass(frozen=True, slots=True)
class PreflightResult:
    """The answer of the interlocks before anything is sent; ``warnings`` ask for a second person.

    ``marker`` is the control's as it stood then: while it stands, nobody else has pushed.
    """

    limits: TableLimits
    agreeing_position: float | None
    refusals: tuple[Refusal, ...]
    warnings: tuple[Refusal, ...] = ()
    people: int = 1
    marker: Marker | None = None


async def run_preflight(
    change: TableChange,
    context: PushContext,
    purpose: Purpose,
    live: LiveSet | None = None,
    place: float | None = None,
) -> PreflightResult:
    """Every reason not to push now, from the machine as it stands; reads only, for `push` without apply too.

    Whether the live tables are still those of the capture may take a program on the machine, so it is not asked;
    ``live`` are the live tables where they are known. ``place`` is where the input axis will stand, where other tables
    of one transaction have a say in it.
    """
    table = change.new
    limits = await context.controller.table_limits(change.axis, table.kind, table.index)
    if place is None:
        place = change_position(LiveTable(change.old, change.old_enabled), change, context)
    facts = await controller_access.read_facts(
        context,
        change,
        purpose=purpose,
        limits=limits,
        agreeing_position=place,
        live=live,
        unfinished=unfinished_journal_names(context),
        key_taken=_key_taken(change, context),
    )
    return _preflight_result(facts, limits, place)


def _preflight_result(facts: PushFacts, limits: TableLimits, place: float | None) -> PreflightResult:
    return PreflightResult(
        limits,
        place,
        refusals=refusals(facts),
        warnings=warnings(facts),
        people=people_needed(facts),
        marker=facts.marker,
    )


def change_position(old: LiveTable, change: TableChange, context: PushContext) -> float | None:
    """Where the input axis must stand for the switching of old and new."""
    return compare.switch_position(old, change.new, context.input_axis, context.controller.capabilities)


def _key_taken(change: TableChange, context: PushContext) -> str:
    """The key, when an earlier push under it was another plan."""
    found = journals_under_key(context)
    other = bool(found) and all(part.latest("plan") != plan_hash(change, context.machine) for part in found)
    return context.key if other else ""


def journals_under_key(context: PushContext) -> tuple[journal.JournalRead, ...]:
    """What the newest transaction with the context's key tells of its tables, ended or not; none without a key."""
    if not context.key:
        return ()
    folder = journal.machine_folder(context.journals, context.machine.serial)
    found = [one for one in (*journal.read_journals(folder / "done"), *journal.read_journals(folder)) if one.entries]
    with_key = (one.parts for one in reversed(found) if one.entries[0].facts.get("key") == context.key)
    return next(with_key, ())


def pending_transaction(context: PushContext) -> journal.JournalRead | None:
    """The transaction under the context's key that has not ended, where such a one is to go on; None else."""
    parts = journals_under_key(context) if context.resumes else ()
    whole = (parts[0].whole or parts[0]) if parts else None
    return whole if whole is not None and not whole.is_ended else None


def has_ended(context: PushContext) -> bool:
    """Whether a push under the context's key had ended already when it is taken up again: it has been told."""
    return is_resumed(context) and pending_transaction(context) is None


def is_resumed(context: PushContext) -> bool:
    """Whether a push under the context's key was begun before and is taken up again, ended or not."""
    return context.resumes and bool(journals_under_key(context))


def unfinished_journal_names(context: PushContext) -> tuple[str, ...]:
    """Names of journals of this machine that did not end."""
    folder = journal.machine_folder(context.journals, context.machine.serial)
    begun = context.log.begun if context.log is not None else None
    return tuple(found.path.name for found in journal.unfinished_journals(folder, begun))


def refused_record(context: PushContext, axis: str, reasons: tuple[Refusal, ...]) -> PushRecord:
    """The record of a push that wrote nothing, every reason one step."""
    for reason in reasons:
        context.say("P-PUSH-REFUSED", axis=axis, reason=reason.message)
    told = tuple(reason.message for reason in reasons)
    return PushRecord(0, axis, outcome="refused", steps=told, backup_path="", reasons=told)


async def refusals_with_live(
    work: TableTransactionState, live: LiveSet, brought: Mapping[str, float]
) -> tuple[Refusal, ...]:
    """The same questions with the live tables in hand: the old table is what is really there.

    Other tables of the transaction on the same output count as live; ``brought`` is where input axes will stand.
    """
    old = table_in(live, work.change.new)
    change = replace(work.change, old=old.table, old_enabled=old.enabled)
    alone = change_position(old, change, work.context)
    facts = await controller_access.read_facts(
        work.context,
        change,
        purpose=work.transaction.purpose,
        limits=work.limits,
        agreeing_position=work.agreeing_position if work.of and alone is not None else alone,
        live=with_tables(live, work.beside),
        unchanged=is_base_live(work.context, work.change, live, work.tolerance),
        brought=brought,
    )
    if facts.agreeing_position is not None:
        work.agreeing_position = facts.agreeing_position
    return tuple(refusal for refusal in refusals(facts) if refusal.code != NOTHING)


def with_tables(live: LiveSet, tables: Sequence[CompensationTable]) -> LiveSet:
    """The set after these tables were put into it and switched on."""
    for table in tables:
        live = with_table(live, table)
    return live


def is_base_live(context: PushContext, change: TableChange, live: LiveSet, allowed: float) -> bool:
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
    expected = with_tables(known, pushed)
    return same_set(expected, live, allowed)


# Tables go into one transaction if each input axis has one position that suits all of them.

TableRequest = tuple[TableChange, PushContext]
MovedTable = tuple[TableChange, AxisRecord]
"""A table with its input axis: what moves while it is switched."""
_SLACK = 1e-9


def common_positions(requests: Sequence[TableRequest]) -> dict[str, float | None]:
    """As `positions_of`, of what is to be pushed."""
    return positions_of(*_moved_and_capabilities(requests))


def _moved_and_capabilities(requests: Sequence[TableRequest]) -> tuple[list[MovedTable], Capabilities]:
    return [(change, context.input_axis) for change, context in requests], requests[0][1].controller.capabilities


def positions_of(moved: Sequence[MovedTable], can: Capabilities) -> dict[str, float | None]:
    """Where each input axis must stand; None where no one place suits all its tables."""
    axes = {axis.name: axis for _, axis in reversed(moved)}
    names = dict.fromkeys(axis.name for _, axis in moved)
    return {
        name: common_position([change for change, axis in moved if axis.name == name], axes[name], can)
        for name in names
    }


def common_position(changes: Sequence[TableChange], axis: AxisRecord, can: Capabilities) -> float | None:
    """As `agreeing_position`, of several over one input axis: what suits one is tried on the others, nearest first."""
    change = changes[0]
    if len(changes) == 1 or not can.switches_now:
        return switch_position(LiveTable(change.old, change.old_enabled), change.new, axis, can)
    low, high = axis.room
    points = {place for change in changes for place in change.new.positions if low <= place <= high}
    tried = [float(np.clip(axis.reference, low, high)), *sorted(points, key=lambda one: abs(one - axis.reference))]
    return next((place for place in tried if _suits_all(changes, place)), None)


def _suits_all(changes: Sequence[TableChange], place: float) -> bool:
    """Whether switching all of them off and on there moves no output axis further than one table may."""
    for axis in {change.axis for change in changes}:
        mine = [change for change in changes if change.axis == axis and change.new.kind != "reversal"]
        off = sum(abs(value_at(one.old, place)) for one in mine if one.old_enabled)
        on = sum(abs(value_at(one.new, place)) for one in mine)
        if max(off, on) > MAX_JUMP + _SLACK:
            return False
    return True


def group_transactions(requests: Sequence[TableRequest]) -> tuple[tuple[TableRequest, ...], ...]:
    """The requests in their order, as `transaction_groups` of them."""
    if not requests:
        return ()
    moved, can = _moved_and_capabilities(requests)
    return tuple(tuple(requests[place] for place in group) for group in transaction_groups(moved, can))


def transaction_groups(moved: Sequence[MovedTable], can: Capabilities) -> tuple[tuple[int, ...], ...]:
    """Which tables go together, by their indices in ``moved``: as few transactions as control and positions allow.

    One table each where the control takes no batch (`Capabilities.together`); a table without any place of its own is
    left alone, so that it is refused alone.
    """
    groups: list[list[int]] = []
    for place in range(len(moved)):
        if groups and can.together and _fits([moved[one] for one in (*groups[-1], place)], can):
            groups[-1].append(place)
        else:
            groups.append([place])
    return tuple(tuple(group) for group in groups)


def _fits(moved: Sequence[MovedTable], can: Capabilities) -> bool:
    return all(place is not None for place in positions_of(moved, can).values())
