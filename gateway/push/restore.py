"""Back to the old table, once and under the same checks; where that is not possible, hold and say so.

A way back reads first. What is as before is left alone; what is neither old nor new is somebody else's and is left to a
person. The old table is written only if two readings agree on it, by the same two halves as a push. A control that
restarted with half a table in memory restarts once more with the old table while that is off.

A hold is the last resort and says only what was read: "held" once a read-back says off, until then "held-on", in the
journal before it is shown. What is on and is not known to be the old or the released new table is switched off.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.ports.controller import TellsUnstarted
from drivers.types.orders import DisableOrder, SwitchReading
from drivers.types.tables import LiveSet, LiveTable
from gateway.errors import BusyError, StoreError, VerifyError, WriteRefused
from gateway.interlocks import refusals
from gateway.push import controller_access, disable, journal
from gateway.push.compare import same_table, table_in
from gateway.push.load import (
    TableLoad,
    is_coupled,
    keep_backup,
    load_tables,
    read_live_sets,
    release_tables,
    sibling_enabled,
)
from gateway.push.phases import PushEvent, PushPhase
from gateway.push.state import Outcome, TableTransactionState, note_together, wrap_unexpected
from gateway.table.comparison import differences


async def roll_back(work: TableTransactionState, why: Message) -> Outcome:
    """Restore what was live before. "rolled-back" when it is proved to be so again, else as `hold`.

    "untouched" where the program of the load never began: nothing was changed and nobody has to read the tables.

    Raises StoreError when the journal cannot be written: then nothing more may be done. BusyError (E-PUSH-ANOTHER)
    with nothing touched when another gateway pushed before anything of this push arrived in the control.
    """
    work.because(why)
    try:
        with wrap_unexpected(work.axis):
            proved, loading = work.state.phase is PushPhase.MEASURED, work.state.phase is PushPhase.LOADING
            work.note(PushEvent.ROLLING_BACK, why=why)
            if proved:
                work.context.say("P-PUSH-PROOF-OFF", axis=work.name)
            else:
                work.context.say("P-PUSH-RESTORE", axis=work.name, why=why)
            if loading and await _never_started(work):
                await work.finish_marker("none")
                work.note(PushEvent.UNTOUCHED)
                return "untouched"
            await restore_table(work)
            await work.finish_marker("none")
            work.note(PushEvent.ROLLED_BACK)
    except BusyError as error:
        if not work.transaction.acknowledged:  # nothing of ours ever stood in the control
            work.note(PushEvent.ABORTED, why=error.message)
            raise
        return await hold(work, error.message)
    except TrueflankError as error:
        return await hold(work, error.message)
    return "rolled-back"


async def _never_started(work: TableTransactionState) -> bool:
    """Whether the control shows that the only program of this transaction never began, and an abort keeps it so."""
    whole, controller = work.transaction, work.context.controller
    if whole.never_started:
        return True
    only = {order.transaction for order in whole.batch}
    if not isinstance(controller, TellsUnstarted) or not only or whole.sent != only:
        return False
    await controller_access.reach_same_machine(work.context)
    await work.require_own_marker()
    await controller_access.end_program(work.context)
    await work.context.clock.sleep(SETTLE_S)
    whole.never_started = await controller.never_started(whole.batch)
    return whole.never_started


async def hold(work: TableTransactionState, why: Message) -> Outcome:
    """Stop here. "held" once a read-back says that the table is off; until then "held-on", noted and said at once.

    What is enabled and neither the old nor the new table is switched off, if a person or the panel lets it.
    The controller's marker says "held" either way, to whoever comes next.
    """
    work.because(why)
    order = disable.disable_order(work.change.new)
    found = await disable.read_switch(work.context, order)
    if _is_off(work, found):
        return await end_held(work, why, off=True)
    _announce_hold(work, why, off=False)
    off = await _switch_off_unknown(work, order)
    return await end_held(work, why, off=off, said=not off)


async def _switch_off_unknown(work: TableTransactionState, order: DisableOrder) -> bool:
    """Now that people know: wait for a control that restarts, read again, and switch off what is not whole."""
    found = await disable.read_switch_patiently(work.context, order)
    if _is_off(work, found):
        return True
    if await _is_whole(work) or not await _may_touch(work):
        return False
    return await disable.switch_off(work, found) and not work.protected


async def _may_touch(work: TableTransactionState) -> bool:
    """Whether no other gateway's push stands in the control: what is on is its then, and stays as it is."""
    try:
        with wrap_unexpected(work.axis):
            await work.require_own_marker()
    except BusyError:
        return False
    except TrueflankError:
        return True
    return True


def _is_off(work: TableTransactionState, found: SwitchReading | None) -> bool:
    return found is not None and found.off and not work.protected


async def end_held(work: TableTransactionState, why: Message, *, off: bool, said: bool = False) -> Outcome:
    """The last word of a hold: ``off`` is what was read back; ``said`` already, so only the journal's end."""
    work.because(why)
    if said:
        work.note(PushEvent.HELD, why=why, backup=work.backup_path, on=not off)
    else:
        _announce_hold(work, why, off=off)
    await work.finish_marker("held")
    return "held" if off else "held-on"


def _announce_hold(work: TableTransactionState, why: Message, *, off: bool) -> None:
    """Journal first, then people: a PC that dies now leaves the louder word behind."""
    work.note(PushEvent.HELD, why=why, backup=work.backup_path, on=not off)
    code = "P-PUSH-HELD" if off else "P-PUSH-HELD-ON"
    work.context.say(code, axis=work.axis, why=why, backup=work.backup_path or "none yet")


async def _is_whole(work: TableTransactionState) -> bool:
    """Whether what is enabled is known to be the old table as it was, or the new one that this push released.

    Read where no program is needed for it, else as it was read last; what cannot be told is not whole. Where the old
    table waits for the control's next start, nothing better can stand there.
    """
    found, can, old = work.seen, work.context.controller.capabilities, work.restore_to
    if not can.stops or not can.switches_now:
        try:
            with wrap_unexpected(work.axis):
                live = await controller_access.read_loaded_tables(work.context)
        except TrueflankError:
            return False
        found = table_in(live, work.change.new)
        if live.waits:
            return not differences(old.table, found.table, work.tolerance)
    if found is None or not found.enabled:
        return False
    if old.enabled and not differences(old.table, found.table, work.tolerance):
        return True
    released = PushEvent.ENABLE in journal.read(work.transaction.journal.path).part(work.of).kinds
    return released and not differences(work.change.new, found.table, work.tolerance)


async def restore_table(work: TableTransactionState) -> None:
    """What was live before is live again, read back. Raises as `write_old_table` and what the port raises.

    Read first: what is already as it was is left alone, what is neither old nor new is left to a person.
    """
    await controller_access.reach_same_machine(work.context)
    await work.require_own_marker()
    await controller_access.end_program(work.context)
    # What a failed load left under way must have come to rest before anything is read, compared or written.
    await work.context.clock.sleep(SETTLE_S)
    await work.require_own_marker()
    await require_restore_allowed(work)
    live = await _live_now(work)
    work.sibling_enabled = work.sibling_enabled or sibling_enabled(live, work)
    found = work.seen = table_in(live, work.change.new)
    before = is_as_before(work, live)
    if before and not live.waits and not _must_verify(work):
        return
    if not before and found.enabled and differences(work.change.new, found.table, work.tolerance):
        raise VerifyError("E-PUSH-FOREIGN", work.axis, axis=work.axis)
    await confirm_backup(work, found)
    _note_partial_write(work, live)
    await write_old_table(work)


async def _live_now(work: TableTransactionState) -> LiveSet:
    """What stands there now. Where a person must start a program to read it, what has just been read counts.

    What a mailbox shows costs nobody a press, and may have been an older picture.
    """
    loaded, work.loaded = work.loaded, None
    if loaded is not None and work.context.controller.capabilities.stops:
        return loaded
    return await controller_access.read_loaded_tables(work.context)


def _note_partial_write(work: TableTransactionState, live: LiveSet) -> None:
    """Half a table in memory, left by a load that stopped in its middle, is what acts from the next start on."""
    found = table_in(live, work.change.new).table
    known = (work.restore_to.table, work.change.new)
    if work.cut_short and all(differences(table, found, work.tolerance) for table in known):
        work.note(PushEvent.TORN, torn=True)
        work.partially_written = True


def _must_verify(work: TableTransactionState) -> bool:
    """Whether "as before" must be made true rather than believed.

    A file names the run that wrote it. What a mailbox shows may be an older picture of the table, and once a load has
    begun the older picture is the very thing that would hide it.
    """
    return work.begun and not work.context.controller.capabilities.stops


async def roll_back_all(works: Sequence[TableTransactionState], why: Message) -> dict[TableTransactionState, Outcome]:
    """Every one of these tables as it was, one after the other, whatever becomes of another. Raises as `roll_back`."""
    await read_backups_again(works)
    ended: dict[TableTransactionState, Outcome] = {}
    for work in works:
        try:
            ended[work] = await roll_back(work, why)
        except BusyError as error:
            for other in works:
                if other is not work and other not in ended:
                    other.note(PushEvent.ABORTED, why=error.message)
            raise
    await keep_marker_held(ended)
    return ended


async def keep_marker_held(ended: Mapping[TableTransactionState, Outcome]) -> None:
    """The marker of the whole says "held" where any table is: a later one that went back has written over it."""
    stuck = [work for work, outcome in ended.items() if outcome in ("held", "held-on")]
    if stuck and list(ended)[-1] not in stuck:
        await stuck[0].finish_marker("held")


def is_as_before(work: TableTransactionState, live: LiveSet) -> bool:
    """Whether the table, its switch and the switches that hang together with it are as they were."""
    same = same_table(work.restore_to, table_in(live, work.change.new), work.tolerance)
    return same and (work.change.new.kind != "cross" or is_coupled(live, work) == work.coupled)


async def require_restore_allowed(work: TableTransactionState) -> None:
    """The interlocks of a restore. Raises WriteRefused (E-PUSH-REFUSED) with every reason."""
    change = replace(work.change, new=work.restore_to.table)
    context, place = work.context, work.agreeing_position
    facts = await controller_access.read_facts(
        context, change, purpose="restore", limits=work.limits, agreeing_position=place, live=work.base
    )
    found = refusals(facts)
    if found:
        reasons = tuple(refusal.message for refusal in found)
        raise WriteRefused("E-PUSH-REFUSED", work.axis, count=len(found), reasons=reasons)


async def write_old_table(work: TableTransactionState) -> None:
    """TableLoad the old table by a restore order, give its switch back, read all again.

    Raises VerifyError (E-PUSH-NOT-RESTORED and those of `load_tables` and `release_tables`) and what the port raises.
    """
    old = work.restore_to
    if work.partially_written and old.enabled:
        await _restart_with_old(work)
    order = work.order(old.table, old.enabled, "restore", work.fresh_number())
    work.seen = None
    await load_tables((TableLoad(work, order, None),))
    await release_tables((TableLoad(work, order, None),))
    live = await controller_access.read_live_tables(work.context)
    work.seen = table_in(live, work.change.new)
    if not is_as_before(work, live):
        found = table_in(live, old.table).table
        different = differences(old.table, found, work.tolerance) or (Message.of("W-LIVE-SWITCH"),)
        raise VerifyError("E-PUSH-NOT-RESTORED", work.axis, axis=work.axis, first=different[0])


async def _restart_with_old(work: TableTransactionState) -> None:
    """The old table into memory and a restart while it is off.

    A control that takes tables over at its start may have done so from half a table, and enabling alone would let
    that act. Raises DeadlineExceeded when nobody restarts the control, and as `load_tables` and `release_tables`.
    """
    order = work.order(work.restore_to.table, False, "restore", work.fresh_number())
    await load_tables((TableLoad(work, order, None),))
    await release_tables((TableLoad(work, order, None),))
    work.context.say("P-PUSH-RESTART", axis=work.axis)
    await work.context.controller.restarted((order,), work.context.start_timeout_s)
    work.note(PushEvent.RESTARTED, torn=False)
    work.partially_written = False


# Nothing is restored on one reading alone: the snapshot and the back-up of the first half must agree.

SETTLE_S = 4.0


async def confirm_backup(work: TableTransactionState, found: LiveTable) -> None:
    """Two readings must agree on what to go back to: what was live before, and the back-up of the first half.

    The back-up may not have been read yet, because the push failed or the gateway died before: it is fetched now, by
    the transaction's number. Where ``found``, read now, still has the values from before, that is the second reading:
    nothing else would be put back than what stands there.
    Raises VerifyError (E-PUSH-UNCONFIRMED): nothing may be put back, compensation stays off.
    """
    if work.confirmed or not differences(work.restore_to.table, found.table, work.tolerance):
        return
    order = work.order(work.change.new, False, "restore", work.transaction.number)
    try:
        (backup,) = await work.context.controller.backup_of((order,))
    except TrueflankError as error:
        raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=error.message) from error
    keep_backup(work, order, backup)
    if not work.confirmed:
        raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=Message.of("W-PUSH-TWO-READS"))


async def read_backups_again(works: Sequence[TableTransactionState]) -> None:
    """The back-ups of all tables of a transaction before the first way back replaces the files they stand in.

    What cannot be had is told when that table's turn comes. Raises StoreError alone.
    """
    if len(works) < 2 or all(work.confirmed for work in works):
        return
    context = works[0].context
    with contextlib.suppress(TrueflankError), wrap_unexpected(context.axis.name):
        await controller_access.reach_same_machine(context)
        await works[0].require_own_marker()
        await controller_access.end_program(context)
        await context.clock.sleep(SETTLE_S)
    for work in works:
        if not work.confirmed:
            await _read_backup_again(work)


async def _read_backup_again(work: TableTransactionState) -> None:
    order = work.order(work.change.new, False, "restore", work.transaction.number)
    try:
        with wrap_unexpected(work.axis):
            (backup,) = await work.context.controller.backup_of((order,))
    except TrueflankError:
        return
    keep_backup(work, order, backup)


# Trial tables that were loaded as sent go back by one program; if that fails before it is sent, each goes by itself.


async def roll_back_batch(works: Sequence[TableTransactionState], why: Message) -> dict[TableTransactionState, Outcome]:
    """What was live before each table, by one program for all. Raises as `roll_back_all`.

    For tables that the control holds whole. Whatever speaks against it before anything was sent leads to
    `roll_back_all`, which reads again and leaves to a person what is neither old nor new; a later failure is held.
    """
    names = ", ".join(work.name for work in works)
    can = works[0].context.controller.capabilities
    if not (can.stops and can.switches_now):
        return await roll_back_all(works, why)
    try:
        with wrap_unexpected(names):
            measured = all(work.state.phase is PushPhase.MEASURED for work in works)
            for work in works:
                work.because(why)
                work.note(PushEvent.ROLLING_BACK, why=why)
            told = {} if measured else {"why": why}
            works[0].context.say("P-PUSH-PROOF-OFF" if measured else "P-PUSH-RESTORE", axis=names, **told)
            await _restore_batch(works)
            await works[0].finish_marker("none")
            note_together(works, PushEvent.ROLLED_BACK)
    except StoreError:
        raise
    except TrueflankError as failure:
        if any(work.marked is None or work.marked.purpose != "restore" for work in works):
            return await roll_back_all(works, failure.message)  # the way back has not begun
        ended = {work: await hold(work, failure.message) for work in works}
        await keep_marker_held(ended)
        return ended
    return dict.fromkeys(works, "rolled-back")


async def _restore_batch(works: Sequence[TableTransactionState]) -> None:
    first = works[0]
    await controller_access.reach_same_machine(first.context)
    await first.require_own_marker()
    await controller_access.end_program(first.context)
    await first.context.clock.sleep(SETTLE_S)
    await first.require_own_marker()
    await _require_own_tables(works)
    number = first.fresh_number()
    loads = []
    for work in works:
        await require_restore_allowed(work)
        old = work.restore_to
        loads.append(TableLoad(work, work.order(old.table, old.enabled, "restore", number), None))
        work.seen = None
    faults = await load_tables(tuple(loads))
    if faults:
        raise next(iter(faults.values()))
    await release_tables(tuple(loads))
    for work, live in zip(works, await read_live_sets(works), strict=True):
        work.seen = table_in(live, work.change.new)
        if not is_as_before(work, live):
            found = work.seen.table
            different = differences(work.restore_to.table, found, work.tolerance) or (Message.of("W-LIVE-SWITCH"),)
            raise VerifyError("E-PUSH-NOT-RESTORED", work.axis, axis=work.axis, first=different[0])


async def _require_own_tables(works: Sequence[TableTransactionState]) -> None:
    """Each is the table that was loaded, and two readings agree on what to go back to. Raises VerifyError."""
    unseen = [work for work in works if work.seen is None]
    for work, live in zip(unseen, await read_live_sets(unseen) if unseen else (), strict=True):
        work.seen = table_in(live, work.change.new)
    for work in works:
        if not work.confirmed:
            why = Message.of("W-PUSH-TWO-READS")
            raise VerifyError("E-PUSH-UNCONFIRMED", work.axis, axis=work.axis, why=why)
        waits = work.change.new.kind == "reversal"  # written at its stops alone
        if not waits and work.seen is not None and differences(work.change.new, work.seen.table, work.tolerance):
            raise VerifyError("E-PUSH-FOREIGN", work.axis, axis=work.axis)
