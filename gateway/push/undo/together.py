"""Tables that were loaded as they should be, taken back by one program; each by itself where that does not go well."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.errors import TrueflankError, words
from drivers.message import Message
from gateway.errors import StoreError, VerifyError
from gateway.push import conversation
from gateway.push.compare import table_in
from gateway.push.loading import TableLoad, load, release
from gateway.push.records.phases import PushEvent, PushPhase
from gateway.push.snapshot import live_of
from gateway.push.undo.confirming import SETTLE_S
from gateway.push.undo.restoring import all_back, as_before, asked_to_restore, hold, still_held
from gateway.push.unexpected import foreseen
from gateway.push.work import Outcome, Work, note_all
from gateway.table.comparison import differences


async def taken_away(works: Sequence[Work], why: Message) -> dict[Work, Outcome]:
    """What was live before each table, by one program for all. Raises as `all_back`.

    For tables that the control holds whole. Whatever speaks against it before anything was sent leads to `all_back`,
    which reads afresh and leaves to a person what is neither old nor new; what fails after that is held.
    """
    names = ", ".join(work.name for work in works)
    can = works[0].context.controller.capabilities
    if not (can.stops and can.switches_now):
        return await all_back(works, why)
    try:
        with foreseen(names):
            measured = all(work.state.phase is PushPhase.MEASURED for work in works)
            for work in works:
                work.because(why)
                work.note(PushEvent.ROLLING_BACK, why=why)
            told = {} if measured else {"why": why}
            works[0].context.say("P-PUSH-PROOF-OFF" if measured else "P-PUSH-RESTORE", axis=names, **told)
            await _restored(works)
            await works[0].finish("none")
            note_all(works, PushEvent.ROLLED_BACK)
    except StoreError:
        raise
    except TrueflankError as failure:
        if any(work.marked is None or work.marked.purpose != "restore" for work in works):
            return await all_back(works, failure.message)  # the way back has not begun
        ended = {work: await hold(work, failure.message) for work in works}
        await still_held(ended)
        return ended
    return dict.fromkeys(works, "rolled-back")


async def _restored(works: Sequence[Work]) -> None:
    first = works[0]
    await conversation.reach(first.context)
    await first.only_ours()
    await conversation.leave_program(first.context)
    await first.context.clock.sleep(SETTLE_S)
    await first.only_ours()
    await _still_ours(works)
    number = first.fresh_number()
    loads = []
    for work in works:
        await asked_to_restore(work)
        old = work.restore_to
        loads.append(TableLoad(work, work.order(old.table, old.enabled, "restore", number), None))
        work.seen = None
    faults = await load(tuple(loads))
    if faults:
        raise next(iter(faults.values()))
    await release(tuple(loads))
    for work, live in zip(works, await live_of(works), strict=True):
        work.seen = table_in(live, work.change.new)
        if not as_before(work, live):
            found = work.seen.table
            different = differences(work.restore_to.table, found, work.allowed) or (words("W-LIVE-SWITCH"),)
            raise VerifyError("E-PUSH-NOT-RESTORED", work.axis, axis=work.axis, first=different[0])


async def _still_ours(works: Sequence[Work]) -> None:
    """Each is the table that was loaded, and two readings agree on what to go back to. Raises VerifyError."""
    unseen = [work for work in works if work.seen is None]
    for work, live in zip(unseen, await live_of(unseen) if unseen else (), strict=True):
        work.seen = table_in(live, work.change.new)
    for work in works:
        if not work.confirmed:
            why = Message.of("W-PUSH-TWO-READS")
            raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=why)
        waits = work.change.new.kind == "reversal"  # written at its stops alone
        if not waits and work.seen is not None and differences(work.change.new, work.seen.table, work.allowed):
            raise VerifyError("E-PUSH-FOREIGN", work.axis, axis=work.axis)
