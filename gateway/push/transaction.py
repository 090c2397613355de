"""One table into one controller: old or new is enabled at every instant, whatever fails on the way.

Order: interlocks, then the live tables by a program that changes none, interlocks again, first half, compare,
release, second half, activation, proof of effect. Nothing is written before the live tables are known to be
those of the capture. A failure after the first half was sent leads back to the old table once, or is held.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import TrueflankError
from drivers.types import LiveSet, LiveTable, TableLimits
from gateway.domain import PushRecord, TableChange
from gateway.interlocks import Refusal, refusals
from gateway.push import conversation, journal
from gateway.push.compare import agreeing_position, effect_positions, same_set, same_table
from gateway.push.context import PushContext
from gateway.push.loading import load, prove_effect, release
from gateway.push.lock import machine_lock
from gateway.push.restoring import roll_back
from gateway.push.work import Outcome, Purpose, Work, begun

_NOTHING = "E-INT-NOTHING"


@dataclass(frozen=True, slots=True)
class Asked:
    """The answer of the interlocks before anything is sent."""

    limits: TableLimits
    agreeing_position: float | None
    refusals: tuple[Refusal, ...]


async def push_table(change: TableChange, context: PushContext) -> PushRecord:
    """Push one table; the record's outcome says how it ended, its steps how it went.

    Reads and refusals change nothing. Raises BusyError (E-PUSH-BUSY) when another push holds the machine,
    StoreError when the journal cannot be kept, and the port's errors as long as nothing has been written.
    """
    if change.skipped:
        return PushRecord(0, change.axis, "skipped", (change.skipped,), "")
    folder = journal.machine_folder(context.journals, context.machine.serial)
    with machine_lock(folder):
        asked = await ask(change, context, "table")
        reasons = tuple(refusal for refusal in asked.refusals if refusal.code != _NOTHING)
        if reasons or asked.agreeing_position is None:
            return refused(context, change.axis, reasons)
        with begun(context, folder, change, "table", asked.limits, asked.agreeing_position) as work:
            return work.record(await _push(work))


async def ask(change: TableChange, context: PushContext, purpose: Purpose) -> Asked:
    """Every reason not to push now, from the machine as it stands; reads only, for `push` without apply too.

    Whether the live tables are still those of the capture takes a program on the machine, so it is not asked.
    """
    limits = await context.controller.table_limits(change.axis)
    axis = context.axis
    old = LiveTable(change.old, change.old_enabled)
    place = agreeing_position(old, change.new, axis.reference, axis.travel)
    open_ones = unfinished_names(context)
    facts = await conversation.facts_at_start(context, change, purpose, limits, place, unfinished=open_ones)
    return Asked(limits, place, refusals(facts))


def unfinished_names(context: PushContext) -> tuple[str, ...]:
    """Names of journals of this machine that did not end."""
    folder = journal.machine_folder(context.journals, context.machine.serial)
    return tuple(found.path.name for found in journal.all_of(folder) if not found.finished)


def refused(context: PushContext, axis: str, reasons: tuple[Refusal, ...]) -> PushRecord:
    """The record of a push that wrote nothing, every reason one step."""
    for reason in reasons:
        context.say("P-PUSH-REFUSED", axis=axis, reason=reason.words)
    return PushRecord(0, axis, "refused", tuple(reason.words for reason in reasons), "")


async def _push(work: Work) -> Outcome:
    try:
        base = await snapshot(work)
        reasons = await _still_allowed(work, base)
    except TrueflankError as error:
        work.note("ABORTED", why=str(error))
        raise
    if already(work, base):
        work.note("ABORTED", why="the table is already live and enabled")
        return "already-applied"
    if reasons:
        for reason in reasons:
            work.context.say("P-PUSH-REFUSED", axis=work.axis, reason=reason.words)
        work.note("ABORTED", why=f"{len(reasons)} reason(s)")
        work.steps += [reason.words for reason in reasons]
        return "refused"
    try:
        await _write(work, base)
    except TrueflankError as failure:
        return await roll_back(work, str(failure))
    work.note("COMMITTED")
    return "committed"


async def _write(work: Work, base: LiveSet) -> None:
    order = work.order(work.change.new, True, "table", work.number)
    await load(work, order, base)
    await release(work, order)
    axis = work.context.axis
    await prove_effect(work, effect_positions(work.change.new, base.eec, axis.travel, axis.overrun), base)
    work.note("EFFECT", shown=[list(place) for place in work.effect])


async def snapshot(work: Work) -> LiveSet:
    """The live tables, kept as read, before anything is disabled."""
    live = await conversation.read_live(work.context, work.agreeing_position)
    keep(work, live)
    return live


def keep(work: Work, live: LiveSet) -> None:
    """Keep the live tables' text, then note where."""
    name = f"live-{work.axis}-{work.number:06d}.mpf"
    work.backup_path = str(work.context.folder.write_text(name, live.native))
    work.note("SNAPSHOT", path=work.backup_path, digest=live.digest)


def already(work: Work, live: LiveSet) -> bool:
    """Whether the wanted table is live and enabled."""
    return same_table(LiveTable(work.change.new, enabled=True), live.eec, work.allowed)


async def _still_allowed(work: Work, live: LiveSet) -> tuple[Refusal, ...]:
    facts = await conversation.facts_at_start(
        work.context,
        work.change,
        work.purpose,
        work.limits,
        work.agreeing_position,
        unchanged=unchanged(work.context, work.change, live, work.allowed),
    )
    return tuple(refusal for refusal in refusals(facts) if refusal.code != _NOTHING)


def unchanged(context: PushContext, change: TableChange, live: LiveSet, allowed: float) -> bool:
    """Whether the live tables are those the change was made on, by their text or else by all they hold."""
    if live.digest == change.base_digest:
        return True
    base = context.capture.live if context.capture is not None else None
    return base is not None and base.digest == change.base_digest and same_set(base, live, allowed)
