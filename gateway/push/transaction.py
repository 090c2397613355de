"""Tables into one controller: of each, old or new is enabled at every instant, whatever fails on the way.

Order: interlocks, then the live tables without changing any, interlocks again, first half, compare, release,
second half, activation, proof of effect. Nothing is written before the live tables are known to be those the
changes were made on. Several tables have one first half, one second half and one restart; each is compared, switched
and proved by itself. A failure after the first half was prepared leads back to the old tables once, or is held.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.types.tables import LiveSet
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import StoreError, VerifyError
from gateway.events import PushEnded
from gateway.interlocks import MAX_JUMP, Refusal
from gateway.interlocks.facts import no
from gateway.push import conversation
from gateway.push.asking import NOTHING, Asked, ask, refused, still_allowed, under_key, waiting
from gateway.push.beginning import Task, abort, begun
from gateway.push.context import PushContext
from gateway.push.effect import prove_all
from gateway.push.loading import Faults, TableLoad, load, release
from gateway.push.places import common_places
from gateway.push.plan import plan_hash
from gateway.push.readback import leave_out
from gateway.push.records import journal
from gateway.push.records.lock import machine_lock
from gateway.push.records.phases import PushEvent, PushPhase
from gateway.push.records.replaying import replaying
from gateway.push.records.steps import noted_step
from gateway.push.snapshot import already, snapshot
from gateway.push.undo.leasing import leased
from gateway.push.undo.restoring import all_back, still_held
from gateway.push.unexpected import foreseen, unheard
from gateway.push.work import Outcome, Work, note_all

_ENDED: dict[PushPhase, Outcome] = {
    PushPhase.COMMITTED: "committed",
    PushPhase.ROLLED_BACK: "rolled-back",
    PushPhase.CLOSED: "rolled-back",
}
Wish = tuple[TableChange, PushContext]
Stays = Callable[[Sequence[TableChange]], bool]
"""Whether these tables alone are predicted to leave the machine no worse than none of the transaction would."""


def _alone_is_fine(_changes: Sequence[TableChange]) -> bool:
    return True


async def push_table(change: TableChange, context: PushContext) -> PushRecord:
    """Push one table; the record's outcome says how it ended, its steps how it went.

    As `push_tables` of this one.
    """
    (record,) = await push_tables(((change, context),))
    return record


async def push_tables(wishes: Sequence[Wish], stays: Stays = _alone_is_fine) -> tuple[PushRecord, ...]:
    """Push tables of one machine in one transaction; a record for each, in order.

    Several are handed over together only where the control takes them so (`Capabilities.together`). When one fails,
    ``stays`` is asked whether the others may stay; if not, the whole transaction goes back.
    Reads and refusals change nothing. A context's key with the same plan again gives the earlier answer.
    Raises BusyError (E-PUSH-BUSY) when another push is under way, StoreError when the journal cannot be kept,
    and as long as nothing has been written the port's errors and Unexpected (E-PUSH-UNEXPECTED).
    """
    found: dict[int, PushRecord] = {}
    asked = {place: wish for place, wish in enumerate(wishes) if not wish[0].skipped}
    for place, (change, _) in enumerate(wishes):
        if change.skipped:
            why = (change.skipped,)
            found[place] = PushRecord(0, change.axis, outcome="skipped", steps=why, backup_path="", reasons=why)
    if asked:
        with foreseen(", ".join(dict.fromkeys(change.axis for change, _ in asked.values()))):
            quiet = [(change, unheard(context)) for change, context in asked.values()]
            found |= dict(zip(asked, await _pushed(quiet, stays), strict=True))
    return tuple(found[place] for place in range(len(wishes)))


async def _pushed(wishes: Sequence[Wish], stays: Stays) -> tuple[PushRecord, ...]:
    context = wishes[0][1]
    with machine_lock(journal.machine_folder(context.journals, context.machine.serial)):
        earlier = tuple(_same_again(change, one) for change, one in wishes)
        known = tuple(record for record in earlier if record is not None)
        if len(known) == len(wishes):
            return known
        if (waits := waiting(context)) is not None:
            return await _all_of(await leased(wishes, waits), stays, waits)
        places = common_places(wishes)
        answers = [await _answer(change, one, places[one.moved.name]) for change, one in wishes]
        if any(_against(asked) for asked in answers):
            return _all_refused(wishes, answers)
        tasks = [
            Task(change, one, asked.limits, agreeing_position=asked.agreeing_position or 0.0, marker=asked.marker)
            for (change, one), asked in zip(wishes, answers, strict=True)
        ]
        return await _all_of(tasks, stays)


async def _all_of(
    tasks: Sequence[Task], stays: Stays, waits: journal.JournalRead | None = None
) -> tuple[PushRecord, ...]:
    with begun(tasks, "table", waits) as works:
        ended = await _push(works, stays)
        for outcome in dict.fromkeys(ended[work] for work in works):
            names = ", ".join(work.change.name for work in works if ended[work] == outcome)
            PushEnded(names, outcome).tell(tasks[0].context.say)
        return tuple(work.record(ended[work], told=True) for work in works)


async def _answer(change: TableChange, context: PushContext, place: float | None) -> Asked:
    """What speaks against it; no place that suits all tables of the input axis does (E-INT-NOWHERE)."""
    asked = await ask(change, context, "table", place=place)
    if place is not None or asked.agreeing_position is None:
        return asked
    told = {"axis": change.axis, "limit": MAX_JUMP, "unit": change.new.deviation_unit}
    return replace(asked, agreeing_position=None, refusals=(*asked.refusals, *no("E-INT-NOWHERE", **told)))


def _against(asked: Asked) -> bool:
    return asked.agreeing_position is None or any(refusal.code != NOTHING for refusal in asked.refusals)


def _all_refused(wishes: Sequence[Wish], answers: Sequence[Asked]) -> tuple[PushRecord, ...]:
    """What speaks against one speaks against all: they would go together."""
    each = [tuple(one for one in asked.refusals if one.code != NOTHING) for asked in answers]
    rest = tuple({refusal.words: refusal for reasons in each for refusal in reasons}.values())
    return tuple(
        refused(context, change.axis, reasons or rest) for (change, context), reasons in zip(wishes, each, strict=True)
    )


def _same_again(change: TableChange, context: PushContext) -> PushRecord | None:
    """The answer already given under this key to this very plan, if that push ended."""
    plan = plan_hash(change, context.machine)
    found = next((part for part in under_key(context) if part.latest("plan") == plan), None)
    outcome = _ENDED.get(found.state.phase) if found is not None else None
    if found is None or outcome is None:
        return None
    steps = tuple(noted_step(one.kind, str(one.facts.get("utc", "")), {}) for one in found.entries)
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


async def _push(works: Sequence[Work], stays: Stays) -> dict[Work, Outcome]:
    try:
        with foreseen(_names(works)):
            bases = dict(zip(works, await snapshot(works), strict=True))
            brought = {work.context.moved.name: work.agreeing_position for work in works}
            reasons = {work: await still_allowed(work, bases[work], brought) for work in works}
    except TrueflankError as error:
        abort(works, error.message)
        raise
    there: dict[Work, Outcome] = {work: "already-applied" for work in works if already(work, bases[work])}
    abort(tuple(there), Message.of("W-PUSH-ALREADY"))
    left = tuple(work for work in works if work not in there)
    if not left or (any(reasons[work] for work in left) and not replaying(left[0].whole.journal)):
        return there | _refuse(left, reasons)
    _leave_out(left, there, bases)
    return there | await _exchange(left, bases, stays)


def _leave_out(left: Sequence[Work], there: dict[Work, Outcome], bases: dict[Work, LiveSet]) -> None:
    """A table that is live already is no part of what is sent: it stands beside as any other of its axis does."""
    for work in left:
        leave_out(work, there, bases[work])


def _refuse(works: Sequence[Work], reasons: dict[Work, tuple[Refusal, ...]]) -> dict[Work, Outcome]:
    every = tuple(reason for work in works for reason in reasons[work])
    for work in works:
        told = reasons[work] or every
        for reason in told:
            work.context.say("P-PUSH-REFUSED", axis=work.name, reason=reason.message)
        work.note(PushEvent.ABORTED, why=Message.of("W-PUSH-AGAINST", count=len(told)))
        work.steps += [reason.message for reason in told]
        work.because(*(reason.message for reason in told))
    return dict.fromkeys(works, "refused")


async def _exchange(works: Sequence[Work], bases: dict[Work, LiveSet], stays: Stays) -> dict[Work, Outcome]:
    """Write, and commit what is proved; what is not goes back, and with it all where the rest may not stay."""
    faults: Faults = {}
    ended: dict[Work, Outcome] = {}
    try:
        with foreseen(_names(works)):
            await _write(works, bases, faults, stays)
    except TrueflankError as failure:
        if all(work.marked is None for work in works):  # nothing was sent: nothing to take back
            abort(works, failure.message)
            raise
        return await all_back(works, failure.message)
    good = tuple(work for work in works if work not in faults)
    for work, fault in faults.items():
        ended |= await all_back((work,), fault.message)
    why = await _disturbed(good, ended) if faults else None
    return ended | (await all_back(good, why) if why else await _committed(good, ended))


async def _disturbed(good: Sequence[Work], ended: dict[Work, Outcome]) -> Message | None:
    """Why the tables that were proved are in doubt, after others of theirs went back; None if they are not.

    A way back switches an output axis' cross tables off and on again, so these are read once more.
    """
    if any(outcome != "rolled-back" for outcome in ended.values()):
        return Message.of("W-PUSH-REST-HELD")
    try:
        with foreseen(_names(good)):
            for work in good:
                live = await conversation.read_live(work.context) if work.beside else None
                if live is not None and not already(work, live):
                    return Message.of("W-PUSH-REST-LOST", name=work.name)
    except TrueflankError as error:
        return error.message
    return None


async def _committed(works: Sequence[Work], ended: dict[Work, Outcome]) -> dict[Work, Outcome]:
    """The marker, then one line of the journal for all. A failure before that leads back; raises StoreError."""
    try:
        with foreseen(_names(works)):
            await works[0].finish("committed")
            note_all(works, PushEvent.COMMITTED)
    except StoreError:
        raise
    except TrueflankError as failure:
        return await all_back(works, failure.message)
    await still_held({**ended, works[0]: "committed"})
    return dict.fromkeys(works, "committed")


def _names(works: Sequence[Work]) -> str:
    return ", ".join(work.name for work in works)


async def _write(works: Sequence[Work], bases: dict[Work, LiveSet], faults: Faults, stays: Stays) -> None:
    """Both halves and the proof of each. What fails of one table alone joins ``faults``, if the others may stay.

    Raises VerifyError (E-PUSH-LAYER, or the fault itself where it is the only table) when they may not.
    """
    loads = tuple(
        TableLoad(work, work.order(work.change.new, True, "table", work.whole.number), bases[work]) for work in works
    )
    faults |= await load(loads)
    _may_stay(works, faults, stays)
    passed = tuple(one for one in loads if one.work not in faults)
    for one in passed:
        tables = {other.work.change.new for other in passed}
        one.work.acting = tuple(table for table in one.work.beside if table in tables)
    await release(passed, tuple(one.order for one in loads))
    await prove_all([one.work for one in passed], bases, faults)
    _may_stay(works, faults, stays)


def _may_stay(works: Sequence[Work], faults: Faults, stays: Stays) -> None:
    if not faults:
        return
    good = [work.change for work in works if work not in faults]
    first = next(iter(faults.values()))
    if not good:
        raise first
    names, failed = ", ".join(change.name for change in good), _names(tuple(faults))
    if not stays(good):
        raise VerifyError("E-PUSH-LAYER", failed, failed=failed, names=names, why=first.message)
    works[0].context.say("P-PUSH-REST-STAYS", names=names, failed=failed, why=first.message)
