"""Back to the old table, once and under the same checks; where that is not possible, hold and say so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from drivers.errors import TrueflankError, words
from drivers.message import Message
from drivers.types.orders import DisableOrder, SwitchReading
from drivers.types.tables import LiveSet
from gateway.errors import BusyError, VerifyError, WriteRefused
from gateway.interlocks import refusals
from gateway.push import conversation
from gateway.push.compare import same_table, table_in
from gateway.push.loading import TableLoad, load, release
from gateway.push.readback import is_beside, is_coupled
from gateway.push.records import journal
from gateway.push.records.phases import PushEvent, PushPhase
from gateway.push.undo import disabling
from gateway.push.undo.confirming import SETTLE_S, confirm, second_readings
from gateway.push.unexpected import foreseen
from gateway.push.work import Outcome, Work
from gateway.table.comparison import differences


async def roll_back(work: Work, why: Message) -> Outcome:
    """Restore what was live before. "rolled-back" when it is proved to be so again, else as `hold`.

    Raises StoreError when the journal cannot be written: then nothing more may be done. BusyError (E-PUSH-ANOTHER)
    with nothing touched when another gateway pushed before anything of this push arrived in the control.
    """
    work.because(why)
    try:
        with foreseen(work.axis):
            proved = work.state.phase is PushPhase.MEASURED
            work.note(PushEvent.ROLLING_BACK, why=why)
            if proved:
                work.context.say("P-PUSH-PROOF-OFF", axis=work.name)
            else:
                work.context.say("P-PUSH-RESTORE", axis=work.name, why=why)
            await restore(work)
            await work.finish("none")
            work.note(PushEvent.ROLLED_BACK)
    except BusyError as error:
        if not work.whole.acknowledged:  # nothing of ours ever stood in the control
            work.note(PushEvent.ABORTED, why=error.message)
            raise
        return await hold(work, error.message)
    except TrueflankError as error:
        return await hold(work, error.message)
    return "rolled-back"


async def hold(work: Work, why: Message) -> Outcome:
    """Stop here. "held" once a read-back says that the table is off; until then "held-on", noted and said at once.

    What is enabled and neither the old nor the new table is switched off, if a person or the panel lets it.
    The controller's marker says "held" either way, to whoever comes next.
    """
    work.because(why)
    order = disabling.order_of(work.change.new)
    found = await disabling.read(work.context, order)
    if _is_off(work, found):
        return await held(work, why, off=True)
    _tell(work, why, off=False)
    off = await _made_off(work, order)
    return await held(work, why, off=off, said=not off)


async def _made_off(work: Work, order: DisableOrder) -> bool:
    """Now that people know: wait for a control that restarts, read again, and switch off what is not whole."""
    found = await disabling.read_in_time(work.context, order)
    if _is_off(work, found):
        return True
    if await _is_whole(work) or not await _may_touch(work):
        return False
    return await disabling.switch_off(work, found) and not work.protected


async def _may_touch(work: Work) -> bool:
    """Whether no other gateway's push stands in the control: what is on is its then, and stays as it is."""
    try:
        with foreseen(work.axis):
            await work.only_ours()
    except BusyError:
        return False
    except TrueflankError:
        return True
    return True


def _is_off(work: Work, found: SwitchReading | None) -> bool:
    return found is not None and found.off and not work.protected


async def held(work: Work, why: Message, *, off: bool, said: bool = False) -> Outcome:
    """The last word of a hold: ``off`` is what was read back; ``said`` already, so only the journal's end."""
    work.because(why)
    if said:
        work.note(PushEvent.HELD, why=why, backup=work.backup_path, on=not off)
    else:
        _tell(work, why, off=off)
    await work.finish("held")
    return "held" if off else "held-on"


def _tell(work: Work, why: Message, *, off: bool) -> None:
    """Journal first, then people: a PC that dies now leaves the louder word behind."""
    work.note(PushEvent.HELD, why=why, backup=work.backup_path, on=not off)
    code = "P-PUSH-HELD" if off else "P-PUSH-HELD-ON"
    work.context.say(code, axis=work.axis, why=why, backup=work.backup_path or "none yet")


async def _is_whole(work: Work) -> bool:
    """Whether what is enabled is known to be the old table as it was, or the new one that this push released.

    Read where no program is needed for it, else as it was read last; what cannot be told is not whole. Where the old
    table waits for the control's next start, nothing better can stand there.
    """
    found, can, old = work.seen, work.context.controller.capabilities, work.restore_to
    if not can.stops or not can.switches_now:
        try:
            with foreseen(work.axis):
                live = await conversation.read_loaded(work.context)
        except TrueflankError:
            return False
        found = table_in(live, work.change.new)
        if live.waits:
            return not differences(old.table, found.table, work.allowed)
    if found is None or not found.enabled:
        return False
    if old.enabled and not differences(old.table, found.table, work.allowed):
        return True
    released = PushEvent.ENABLE in journal.read(work.whole.journal.path).part(work.of).kinds
    return released and not differences(work.change.new, found.table, work.allowed)


async def restore(work: Work) -> None:
    """What was live before is live again, read back. Raises as `play_back` and what the port raises.

    Read first: what is already as it was is left alone, what is neither old nor new is left to a person.
    """
    await conversation.reach(work.context)
    await work.only_ours()
    await conversation.leave_program(work.context)
    # What a failed load left under way must have come to rest before anything is read, compared or written.
    await work.context.clock.sleep(SETTLE_S)
    await work.only_ours()
    await asked_to_restore(work)
    live = await _there(work)
    work.again = work.again or is_beside(live, work)
    found = work.seen = table_in(live, work.change.new)
    before = as_before(work, live)
    if before and not live.waits and not _doubted(work):
        return
    if not before and found.enabled and differences(work.change.new, found.table, work.allowed):
        raise VerifyError("E-PUSH-FOREIGN", work.axis, axis=work.axis)
    await confirm(work, found)
    _note_half(work, live)
    await play_back(work)


async def _there(work: Work) -> LiveSet:
    """What stands there now. Where a person must start a program to read it, what has just been read counts.

    What a mailbox shows costs nobody a press, and may have been an older picture.
    """
    loaded, work.loaded = work.loaded, None
    if loaded is not None and work.context.controller.capabilities.stops:
        return loaded
    return await conversation.read_loaded(work.context)


def _note_half(work: Work, live: LiveSet) -> None:
    """Half a table in memory, left by a load that stopped in its middle, is what acts from the next start on."""
    found = table_in(live, work.change.new).table
    known = (work.restore_to.table, work.change.new)
    if work.cut_short and all(differences(table, found, work.allowed) for table in known):
        work.note(PushEvent.TORN, torn=True)
        work.torn = True


def _doubted(work: Work) -> bool:
    """Whether "as before" must be made true rather than believed.

    A file names the run that wrote it. What a mailbox shows may be an older picture of the table, and once a load has
    begun the older picture is the very thing that would hide it.
    """
    return work.begun and not work.context.controller.capabilities.stops


async def all_back(works: Sequence[Work], why: Message) -> dict[Work, Outcome]:
    """Every one of these tables as it was, one after the other, whatever becomes of another. Raises as `roll_back`."""
    await second_readings(works)
    ended: dict[Work, Outcome] = {}
    for work in works:
        try:
            ended[work] = await roll_back(work, why)
        except BusyError as error:
            for other in works:
                if other is not work and other not in ended:
                    other.note(PushEvent.ABORTED, why=error.message)
            raise
    await still_held(ended)
    return ended


async def still_held(ended: Mapping[Work, Outcome]) -> None:
    """The marker of the whole says "held" where any table is: a later one that went back has written over it."""
    stuck = [work for work, outcome in ended.items() if outcome in ("held", "held-on")]
    if stuck and list(ended)[-1] not in stuck:
        await stuck[0].finish("held")


def as_before(work: Work, live: LiveSet) -> bool:
    """Whether the table, its switch and the switches that hang together with it are as they were."""
    same = same_table(work.restore_to, table_in(live, work.change.new), work.allowed)
    return same and (work.change.new.kind != "cross" or is_coupled(live, work) == work.coupled)


async def asked_to_restore(work: Work) -> None:
    """The interlocks of a restore. Raises WriteRefused (E-PUSH-REFUSED) with every reason."""
    change = replace(work.change, new=work.restore_to.table)
    context, place = work.context, work.agreeing_position
    facts = await conversation.facts_at_start(
        context, change, purpose="restore", limits=work.limits, agreeing_position=place, live=work.base
    )
    found = refusals(facts)
    if found:
        reasons = tuple(refusal.message for refusal in found)
        raise WriteRefused("E-PUSH-REFUSED", work.axis, count=len(found), reasons=reasons)


async def play_back(work: Work) -> None:
    """TableLoad the old table by a restore order, give its switch back, read all again.

    Raises VerifyError (E-PUSH-NOT-RESTORED and those of `load` and `release`) and what the port raises.
    """
    old = work.restore_to
    if work.torn and old.enabled:
        await _restart_with_old(work)
    order = work.order(old.table, old.enabled, "restore", work.fresh_number())
    work.seen = None
    await load((TableLoad(work, order, None),))
    await release((TableLoad(work, order, None),))
    live = await conversation.read_live(work.context)
    work.seen = table_in(live, work.change.new)
    if not as_before(work, live):
        found = table_in(live, old.table).table
        different = differences(old.table, found, work.allowed) or (words("W-LIVE-SWITCH"),)
        raise VerifyError("E-PUSH-NOT-RESTORED", work.axis, axis=work.axis, first=different[0])


async def _restart_with_old(work: Work) -> None:
    """The old table into memory and a restart while it is off.

    A control that takes tables over at its start may have done so from half a table, and enabling alone would let
    that act. Raises DeadlineExceeded when nobody restarts the control, and what `load` and `release` raise.
    """
    order = work.order(work.restore_to.table, False, "restore", work.fresh_number())
    await load((TableLoad(work, order, None),))
    await release((TableLoad(work, order, None),))
    work.context.say("P-PUSH-RESTART", axis=work.axis)
    await work.context.controller.restarted((order,), work.context.start_timeout_s)
    work.note(PushEvent.RESTARTED, torn=False)
    work.torn = False
