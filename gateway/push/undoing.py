"""A committed push taken back as a transaction of its own: the table from before it, under the same checks.

The table to put back is known from the journal, so no sign is proved; but it is put back only over the very table
that push wrote. What anybody else has written since is left alone and told.
"""

from __future__ import annotations

import numpy as np

from drivers.errors import TrueflankError, words
from drivers.types.tables import LiveSet, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.interlocks import PushFacts, Refusal, refusals
from gateway.interlocks.facts import no
from gateway.push import conversation
from gateway.push.asking import Asked, place_for, refused, unfinished_names
from gateway.push.beginning import Task, begun
from gateway.push.compare import effect_positions, same_table, table_in
from gateway.push.context import PushContext
from gateway.push.effect import prove_effect
from gateway.push.loading import TableLoad, load, release
from gateway.push.records import journal
from gateway.push.records.history import Committed
from gateway.push.records.lock import machine_lock
from gateway.push.snapshot import snapshot
from gateway.push.undo.restoring import roll_back
from gateway.push.unexpected import foreseen, unheard
from gateway.push.work import Outcome, Work
from gateway.table.comparison import differences
from gateway.table.threeway import ThreeWay, compare


def undoing(done: Committed) -> TableChange:
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


async def ask_undo(done: Committed, context: PushContext) -> Asked:
    """Every reason not to take it back now; reads only. The live table is compared once it is applied."""
    change = undoing(done)
    table = change.new
    limits = await context.controller.table_limits(change.axis, table.kind, table.index)
    place = place_for(done.new, change, context)
    names = unfinished_names(context)
    facts = await conversation.facts_at_start(
        context, change, purpose="restore", limits=limits, agreeing_position=place, unfinished=names
    )
    return Asked(limits, place, tuple(_reasons(facts)), marker=facts.marker)


def _reasons(facts: PushFacts) -> list[Refusal]:
    """The interlocks of a restore, and those that only a transaction asked for afresh must pass."""
    found = list(refusals(facts))
    if facts.unfinished:
        found += no("E-INT-UNFINISHED", journals=", ".join(facts.unfinished))
    if facts.request.audit_broken:
        found += no("E-INT-AUDIT-BROKEN", why=facts.request.audit_broken)
    if facts.missing:
        found += no("E-INT-JOURNAL-MISSING", numbers=", ".join(map(str, facts.missing)))
    if facts.mark.behind:
        found += no("E-INT-AUDIT-BEHIND", why=facts.mark.behind)
    marker = facts.marker
    if marker is not None and marker.state in ("in-progress", "held") and not facts.mark.ours:
        found += no("E-INT-MARKER", number=marker.transaction, state=marker.state)
    if facts.agreeing_position is None:
        limit, unit = facts.bounds.jump, facts.table.deviation_unit
        found += no("E-INT-NOWHERE", axis=facts.change.axis, limit=limit, unit=unit)
    return found


async def undo(done: Committed, context: PushContext) -> PushRecord:
    """Put back what was live before ``done``; the record's outcome says how it ended ("committed": it is back).

    "refused" with nothing written when an interlock speaks against it or the live table is not the one ``done``
    wrote. Raises BusyError (E-PUSH-BUSY), StoreError, and the port's errors as long as nothing has been written.
    """
    with foreseen(done.axis):
        return await _undone(done, unheard(context))


async def _undone(done: Committed, context: PushContext) -> PushRecord:
    folder = journal.machine_folder(context.journals, context.machine.serial)
    with machine_lock(folder):
        asked = await ask_undo(done, context)
        if asked.refusals or asked.agreeing_position is None:
            return refused(context, done.axis, asked.refusals)
        task = Task(
            undoing(done), context, asked.limits, agreeing_position=asked.agreeing_position, marker=asked.marker
        )
        with begun((task,), "restore") as (work,):
            work.note("UNDOES", undoes=done.transaction)
            return work.record(await _undo(work, done))


async def _undo(work: Work, done: Committed) -> Outcome:
    try:
        with foreseen(work.axis):
            (base,) = await snapshot((work,))
            live = table_in(base, work.change.new)
            reasons = await _still_allowed(work, base)
    except TrueflankError as error:
        work.note("ABORTED", why=str(error))
        raise
    if _there(done.old, live, work.allowed):
        work.note("ABORTED", why="the old table is already live")
        return "already-applied"
    seen = compare_live(live, done, work.allowed)
    if seen.kind != "as-approved":
        reasons = (*no("E-PUSH-UNDO-FOREIGN", transaction=done.transaction, difference=seen.words), *reasons)
    if reasons:
        work.note("ABORTED", why=f"reasons: {len(reasons)}")
        work.steps += refused(work.context, work.axis, reasons).steps
        return "refused"
    return await _exchange(work, done, base)


async def _exchange(work: Work, done: Committed, base: LiveSet) -> Outcome:
    try:
        with foreseen(work.axis):
            await _put_back(work, done, base)
            await work.finish("committed")
            work.note("COMMITTED")
    except TrueflankError as failure:
        if work.marked is None:  # nothing was sent: nothing to take back
            work.note("ABORTED", why=str(failure))
            raise
        return await roll_back(work, str(failure))
    return "committed"


async def _still_allowed(work: Work, base: LiveSet) -> tuple[Refusal, ...]:
    place = work.agreeing_position
    facts = await conversation.facts_at_start(
        work.context, work.change, purpose="restore", limits=work.limits, agreeing_position=place, live=base
    )
    return tuple(_reasons(facts))


async def _put_back(work: Work, done: Committed, base: LiveSet) -> None:
    old = done.old
    order = work.order(old.table, old.enabled, "restore", work.whole.number)
    loads = (TableLoad(work, order, base),)
    await load(loads)
    await release(loads)
    if old.enabled:
        axis = work.context.moved
        await prove_effect(work, effect_positions(old.table, work.restore_to, axis.room, axis.overrun), base)
        work.note("EFFECT", shown=[list(place) for place in work.effect])
        return
    found = table_in(await conversation.read_live(work.context), old.table)
    if not _there(old, found, work.allowed):
        different = differences(old.table, found.table, work.allowed) or (words("W-LIVE-SWITCH"),)
        raise VerifyError("E-PUSH-NOT-RESTORED", work.axis, axis=work.axis, first=different[0])


def _there(wanted: LiveTable, live: LiveTable, allowed: float) -> bool:
    """Whether it is live; one table never loaded is as good as another."""
    never = wanted.table.step <= 0 and live.table.step <= 0
    return (never and wanted.enabled == live.enabled) or same_table(wanted, live, allowed)


def compare_live(live: LiveTable, done: Committed, allowed: float) -> ThreeWay:
    """The live table against the one a push wrote and the one before it."""
    return compare(live, done.new, done.old, allowed)
