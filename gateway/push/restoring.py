"""Back to the old table, once and under the same checks; where that is not possible, hold and say so."""

from __future__ import annotations

from dataclasses import replace

from drivers.errors import TrueflankError
from drivers.types import DisableOrder, LiveSet, SwitchReading
from gateway.errors import VerifyError, WriteRefused
from gateway.interlocks import refusals
from gateway.push import conversation, disabling, journal
from gateway.push.compare import differences, same_table, table_in
from gateway.push.loading import is_coupled, load, release
from gateway.push.work import Outcome, Work

SETTLE_S = 4.0


async def roll_back(work: Work, why: str) -> Outcome:
    """Restore what was live before. "rolled-back" when it is proved to be so again, else as `hold`.

    Raises StoreError when the journal cannot be written: then nothing more may be done.
    """
    work.note("ROLLING_BACK", why=why)
    work.context.say("P-PUSH-RESTORE", axis=work.axis, why=why)
    try:
        await _restore(work)
    except TrueflankError as error:
        return await hold(work, str(error))
    await work.finish("none")
    work.note("ROLLED_BACK")
    return "rolled-back"


async def hold(work: Work, why: str) -> Outcome:
    """Stop here. "held" once a read-back says that the table is off; until then "held-on", noted and said at once.

    What is enabled and neither the old nor the new table is switched off, if a person or the panel lets it.
    The controller's marker says "held" either way, to whoever comes next.
    """
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
    return not await _is_whole(work) and await disabling.switch_off(work, found) and not work.protected


def _is_off(work: Work, found: SwitchReading | None) -> bool:
    return found is not None and found.off and not work.protected


async def held(work: Work, why: str, *, off: bool, said: bool = False) -> Outcome:
    """The last word of a hold: ``off`` is what was read back; ``said`` already, so only the journal's end."""
    if said:
        work.note("HELD", why=why, backup=work.backup_path, on=not off)
    else:
        _tell(work, why, off=off)
    await work.finish("held")
    return "held" if off else "held-on"


def _tell(work: Work, why: str, *, off: bool) -> None:
    """Journal first, then people: a PC that dies now leaves the louder word behind."""
    work.note("HELD", why=why, backup=work.backup_path, on=not off)
    code = "P-PUSH-HELD" if off else "P-PUSH-HELD-ON"
    work.context.say(code, axis=work.axis, why=why, backup=work.backup_path or "none yet")


async def _is_whole(work: Work) -> bool:
    """Whether what is enabled is known to be the old table as it was, or the new one that this push released.

    Read where no program is needed for it, else as it was read last; what cannot be told is not whole.
    """
    found = work.seen
    if not work.context.controller.capabilities.programs:
        try:
            live = await conversation.read_live(work.context, work.agreeing_position)
        except TrueflankError:
            return False
        found = table_in(live, work.change.new)
    if found is None or not found.enabled:
        return False
    old = work.restore_to
    if old.enabled and not differences(old.table, found.table, work.allowed):
        return True
    released = "ENABLE" in journal.read(work.journal.path).kinds
    return released and not differences(work.change.new, found.table, work.allowed)


async def _restore(work: Work) -> None:
    """Read first: what is already as it was is left alone, what is neither old nor new is left to a person."""
    await conversation.reach(work.context)
    await conversation.leave_program(work.context)
    # What a failed load left under way must have come to rest before anything is read, compared or written.
    await work.context.clock.sleep(SETTLE_S)
    await _asked(work)
    live = await conversation.read_live(work.context, work.agreeing_position)
    found = work.seen = table_in(live, work.change.new)
    if as_before(work, live):
        return
    if found.enabled and differences(work.change.new, found.table, work.allowed):
        raise VerifyError("E-PUSH-FOREIGN", work.axis, axis=work.axis)
    _note_half(work, live)
    await play_back(work)


def _note_half(work: Work, live: LiveSet) -> None:
    """Half a table in memory, left by a load that stopped in its middle, is what acts from the next start on."""
    found = table_in(live, work.change.new).table
    known = (work.restore_to.table, work.change.new)
    if work.cut_short and all(differences(table, found, work.allowed) for table in known):
        work.note("TORN", torn=True)
        work.torn = True


def as_before(work: Work, live: LiveSet) -> bool:
    """Whether the table, its switch and the switches that hang together with it are as they were."""
    same = same_table(work.restore_to, table_in(live, work.change.new), work.allowed)
    return same and (work.change.layer == "EEC" or is_coupled(live, work) == work.coupled)


async def _asked(work: Work) -> None:
    """The interlocks of a restore. Raises WriteRefused (E-PUSH-REFUSED) with every reason."""
    change = replace(work.change, new=work.restore_to.table)
    context, place = work.context, work.agreeing_position
    facts = await conversation.facts_at_start(context, change, "restore", work.limits, place, live=work.base)
    found = refusals(facts)
    if found:
        reasons = "; ".join(refusal.words for refusal in found)
        raise WriteRefused("E-PUSH-REFUSED", work.axis, count=len(found), reasons=reasons)


async def play_back(work: Work) -> None:
    """Load the old table by a restore order, give its switch back, read all again.

    Raises VerifyError (E-PUSH-NOT-RESTORED and those of `load` and `release`) and what the port raises.
    """
    old = work.restore_to
    if work.torn and old.enabled:
        await _restart_with_old(work)
    order = work.order(old.table, old.enabled, "restore", work.fresh_number())
    work.seen = None
    await load(work, order, None)
    await release(work, order)
    live = await conversation.read_live(work.context, work.agreeing_position)
    work.seen = table_in(live, work.change.new)
    if not as_before(work, live):
        found = table_in(live, old.table).table
        different = differences(old.table, found, work.allowed) or ("the switch differs",)
        raise VerifyError("E-PUSH-NOT-RESTORED", work.axis, axis=work.axis, first=different[0])


async def _restart_with_old(work: Work) -> None:
    """The old table into memory and a restart while it is off.

    A control that takes tables over at its start may have done so from half a table, and enabling alone would let
    that act. Raises DeadlineExceeded when nobody restarts the control, and what `load` and `release` raise.
    """
    order = work.order(work.restore_to.table, False, "restore", work.fresh_number())
    await load(work, order, None)
    await release(work, order)
    work.context.say("P-PUSH-RESTART", axis=work.axis)
    await work.context.controller.wait_activated(order, work.context.start_timeout_s)
    work.note("RESTARTED", torn=False)
    work.torn = False
