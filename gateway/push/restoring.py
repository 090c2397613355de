"""Back to the old table, once and under the same checks; where that is not possible, hold and say so."""

from __future__ import annotations

from dataclasses import replace

from drivers.errors import TransportError, TrueflankError, words
from drivers.types import LiveSet
from gateway.errors import BusyError, VerifyError, WriteRefused
from gateway.interlocks import refusals
from gateway.push import conversation
from gateway.push.compare import differences, same_table, table_in
from gateway.push.loading import is_coupled, keep_backup, load, release
from gateway.push.unexpected import foreseen
from gateway.push.work import Outcome, Work


async def roll_back(work: Work, why: str) -> Outcome:
    """Restore what was live before. "rolled-back" when it is proved to be so again, else "held".

    Raises StoreError when the journal cannot be written: then nothing more may be done. BusyError (E-PUSH-ANOTHER)
    with nothing touched when another gateway pushed before anything of this push arrived in the control.
    """
    try:
        with foreseen(work.axis):
            work.note("ROLLING_BACK", why=why)
            work.context.say("P-PUSH-RESTORE", axis=work.axis, why=why)
            await _restore(work)
            await work.finish("none")
            work.note("ROLLED_BACK")
    except BusyError as error:
        if not work.acknowledged:  # nothing of ours ever stood in the control
            work.note("ABORTED", why=str(error))
            raise
        await hold(work, str(error))
        return "held"
    except TrueflankError as error:
        await hold(work, str(error))
        return "held"
    return "rolled-back"


async def hold(work: Work, why: str) -> None:
    """Stop here: note it, tell it, and let the controller's marker say so to whoever comes next."""
    work.note("HELD", why=why, backup=work.backup_path)
    work.context.say("P-PUSH-HELD", axis=work.axis, why=why, backup=work.backup_path or "none yet")
    await work.finish("held")


async def _restore(work: Work) -> None:
    """Read first: what is already as it was is left alone, what is neither old nor new is left to a person."""
    try:
        await work.same_machine()
    except TransportError:
        # What became of the last request is unknown: only a connection of its own can tell.
        await conversation.connect_again(work.context)
        await work.same_machine()
    await work.only_ours()
    await conversation.leave_program(work.context)
    await work.only_ours()
    await _asked(work)
    live = await conversation.read_live(work.context, work.agreeing_position)
    before = as_before(work, live)
    if before and not _doubted(work):
        return
    found = table_in(live, work.change.new)
    if not before and found.enabled and differences(work.change.new, found.table, work.allowed):
        raise VerifyError("E-PUSH-FOREIGN", work.axis, axis=work.axis)
    await confirm(work)
    _note_half(work, live)
    await play_back(work)


async def confirm(work: Work) -> None:
    """Two readings must agree on what to go back to: what was live before, and the back-up of the first half.

    The back-up may not have been read yet, because the push failed or the gateway died before: it is fetched now, by
    the transaction's number. Raises VerifyError (E-PUSH-UNCONFIRMED): nothing may be put back, compensation stays off.
    """
    if work.confirmed:
        return
    order = work.order(work.change.new, False, "restore", work.number)
    try:
        backup = await work.context.controller.backup_of(order)
    except TrueflankError as error:
        raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=str(error)) from error
    keep_backup(work, order, backup)
    if not work.confirmed:
        raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=words("W-PUSH-TWO-READS"))


def _note_half(work: Work, live: LiveSet) -> None:
    """Half a table in memory, left by a load that stopped in its middle, is what acts from the next start on."""
    found = table_in(live, work.change.new).table
    known = (work.restore_to.table, work.change.new)
    if work.cut_short and all(differences(table, found, work.allowed) for table in known):
        work.note("TORN", torn=True)
        work.torn = True


def _doubted(work: Work) -> bool:
    """Whether "as before" must be made true rather than believed.

    A file names the run that wrote it. What a mailbox shows may be an older picture of the table, and once a load has
    begun the older picture is the very thing that would hide it.
    """
    return work.begun and not work.context.controller.capabilities.programs


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
    await load(work, order, None)
    await release(work, order)
    live = await conversation.read_live(work.context, work.agreeing_position)
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
