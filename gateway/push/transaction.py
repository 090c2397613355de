"""One table into one controller: old or new is enabled at every instant, whatever fails on the way.

Order: interlocks, then the live tables without changing any, interlocks again, first half, compare, release,
second half, activation, proof of effect. Nothing is written before the live tables are known to be those the
change was made on. A failure after the first half was prepared leads back to the old table once, or is held.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from drivers.errors import TrueflankError
from drivers.terms import spoken
from drivers.types.abilities import Marker, TableLimits
from drivers.types.tables import LiveSet, LiveTable
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.interlocks import PushFacts, Refusal, needed, refusals, warnings
from gateway.push import conversation
from gateway.push.compare import (
    agreeing_position,
    effect_positions,
    same_set,
    same_table,
    table_facts,
    table_in,
    with_table,
)
from gateway.push.context import PushContext
from gateway.push.effect import prove_effect
from gateway.push.loading import is_coupled, load, release
from gateway.push.plan import plan_hash
from gateway.push.records import journal
from gateway.push.records.lock import machine_lock
from gateway.push.undo.restoring import roll_back
from gateway.push.unexpected import foreseen, unheard
from gateway.push.work import Outcome, Purpose, Work, begun

_NOTHING = "E-INT-NOTHING"
_ENDED: dict[str, Outcome] = {"COMMITTED": "committed", "ROLLED_BACK": "rolled-back", "CLOSED": "rolled-back"}


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


async def push_table(change: TableChange, context: PushContext) -> PushRecord:
    """Push one table; the record's outcome says how it ended, its steps how it went.

    Reads and refusals change nothing. The context's key with the same plan again gives the earlier answer.
    Raises BusyError (E-PUSH-BUSY) when another push is under way, StoreError when the journal cannot be kept,
    and as long as nothing has been written the port's errors and Unexpected (E-PUSH-UNEXPECTED).
    """
    if change.skipped:
        return PushRecord(0, change.axis, outcome="skipped", steps=(change.skipped,), backup_path="")
    with foreseen(change.axis):
        return await _pushed(change, unheard(context))


async def _pushed(change: TableChange, context: PushContext) -> PushRecord:
    folder = journal.machine_folder(context.journals, context.machine.serial)
    with machine_lock(folder):
        earlier = _same_again(change, context, folder)
        if earlier is not None:
            return earlier
        asked = await ask(change, context, "table")
        reasons = tuple(refusal for refusal in asked.refusals if refusal.code != _NOTHING)
        if reasons or asked.agreeing_position is None:
            return refused(context, change.axis, reasons)
        with begun(
            context,
            folder,
            change=change,
            purpose="table",
            limits=asked.limits,
            agreeing_position=asked.agreeing_position,
        ) as work:
            work.before = asked.marker
            return work.record(await _push(work))


def _same_again(change: TableChange, context: PushContext, folder: Path) -> PushRecord | None:
    """The answer already given under this key to this very plan, if that push ended."""
    found = journal.by_key(folder, context.key) if context.key else None
    if found is None or found.latest("plan") != plan_hash(change, context.machine):
        return None
    outcome = _ENDED.get(found.kinds[-1])
    if outcome is None:
        return None
    steps = tuple(f"{entry.facts.get('utc', '')} {entry.kind}" for entry in found.entries)
    shown = tuple((float(one[0]), float(one[1]), float(one[2])) for one in found.latest("shown") or ())
    return PushRecord(
        found.number,
        change.axis,
        outcome=outcome,
        steps=steps,
        backup_path=str(found.latest("path") or ""),
        effect=shown,
    )


async def ask(change: TableChange, context: PushContext, purpose: Purpose, live: LiveSet | None = None) -> Asked:
    """Every reason not to push now, from the machine as it stands; reads only, for `push` without apply too.

    Whether the live tables are still those of the capture may take a program on the machine, so it is not asked;
    ``live`` are the live tables where they are known.
    """
    table = change.new
    limits = await context.controller.table_limits(change.axis, table.kind, table.index)
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
    return agreeing_position(old, change.new, context.moved.reference, context.moved.room)


def _key_taken(change: TableChange, context: PushContext) -> str:
    """The key, when an earlier push under it was another plan."""
    folder = journal.machine_folder(context.journals, context.machine.serial)
    found = journal.by_key(folder, context.key) if context.key else None
    other = found is not None and found.latest("plan") != plan_hash(change, context.machine)
    return context.key if other else ""


def unfinished_names(context: PushContext) -> tuple[str, ...]:
    """Names of journals of this machine that did not end."""
    folder = journal.machine_folder(context.journals, context.machine.serial)
    begun = context.log.begun if context.log is not None else None
    return tuple(found.path.name for found in journal.left_open(folder, begun))


def refused(context: PushContext, axis: str, reasons: tuple[Refusal, ...]) -> PushRecord:
    """The record of a push that wrote nothing, every reason one step."""
    for reason in reasons:
        context.say("P-PUSH-REFUSED", axis=axis, reason=reason.words)
    return PushRecord(0, axis, outcome="refused", steps=tuple(reason.words for reason in reasons), backup_path="")


async def _push(work: Work) -> Outcome:
    try:
        with foreseen(work.axis):
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
        with foreseen(work.axis):
            await _write(work, base)
            await work.finish("committed")
            work.note("COMMITTED")
    except TrueflankError as failure:
        if work.marked is None:  # nothing was sent: nothing to take back
            work.note("ABORTED", why=str(failure))
            raise
        return await roll_back(work, str(failure))
    return "committed"


async def _write(work: Work, base: LiveSet) -> None:
    order = work.order(work.change.new, True, "table", work.number)
    await load(work, order, base)
    await release(work, order)
    axis = work.context.moved
    old = table_in(base, work.change.new)
    await prove_effect(work, effect_positions(work.change.new, old, axis.room, axis.overrun), base)
    work.note("EFFECT", shown=[list(place) for place in work.effect])


async def snapshot(work: Work) -> LiveSet:
    """The live tables, kept as read, before anything is disabled."""
    live = await conversation.read_live(work.context)
    keep(work, live)
    if work.context.on_live is not None:
        work.context = replace(work.context, alarms=work.context.on_live(live))
    return live


def keep(work: Work, live: LiveSet) -> None:
    """Keep the live tables' text, then note where; from here on the work knows what hangs together."""
    name = f"live-{work.axis}-{work.number:06d}{spoken().program_suffix}"
    work.backup_path = work.kept(name, live.native)
    work.base, work.coupled = live, is_coupled(live, work)
    work.restore_to = table_in(live, work.change.new)
    old = {"old": table_facts(work.restore_to.table), "old_enabled": work.restore_to.enabled}
    work.note("SNAPSHOT", path=work.backup_path, digest=live.digest, coupled=work.coupled, **old)


def already(work: Work, live: LiveSet) -> bool:
    """Whether the wanted table is live and enabled."""
    wanted = LiveTable(work.change.new, enabled=True)
    return same_table(wanted, table_in(live, work.change.new), work.allowed)


async def _still_allowed(work: Work, live: LiveSet) -> tuple[Refusal, ...]:
    """The same questions with the live tables in hand: the old table is what is really there."""
    old = table_in(live, work.change.new)
    change = replace(work.change, old=old.table, old_enabled=old.enabled)
    facts = await conversation.facts_at_start(
        work.context,
        change,
        purpose=work.purpose,
        limits=work.limits,
        agreeing_position=place_for(old, change, work.context),
        live=live,
        unchanged=unchanged(work.context, work.change, live, work.allowed),
    )
    if facts.agreeing_position is not None:
        work.agreeing_position = facts.agreeing_position
    return tuple(refusal for refusal in refusals(facts) if refusal.code != _NOTHING)


def unchanged(context: PushContext, change: TableChange, live: LiveSet, allowed: float) -> bool:
    """Whether the live tables are those the change was made on, by their text or else by all they hold.

    Tables that this very run has pushed since are part of what is expected.
    """
    if live.digest == change.base_digest:
        return True
    base = change.base or (context.capture.live if context.capture is not None else None)
    if base is None or base.digest != change.base_digest or base.axis != live.axis:
        return False
    expected = context.controller.tables_by(base, context.proof)
    for table in context.pushed:
        expected = with_table(expected, table)
    return same_set(expected, live, allowed)
