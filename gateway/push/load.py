"""The two halves on the controller: disable all, write all and compare each; then enable those that are right.

The first half saves the live table, which is compared with the snapshot before anything is switched off or written
(a lost update ends the push there); how early it can be read depends on the connection: from the driver, from the
waiting program, or only together with the read-back. The program then moves to the position where old and new table
agree, disables, writes every point and reads it back. A table that differs from what was sent is a fault of that table
alone and is never enabled; a change of any other table ends the transaction. The second half enables the rest after
the interlocks were asked once more.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from drivers.errors import PointsDiffer, TableActs, TrueflankError
from drivers.message import Message
from drivers.ports.controller import SavesFirst
from drivers.terms import spoken
from drivers.types.orders import PushBatch, PushOrder, ReadBack
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.errors import VerifyError, WriteRefused
from gateway.events import FirstPartSelected, WholeTransactionSelected
from gateway.interlocks import ApprovedCurve, faults_of, mean_readings, other_cross_tables, refusals, value_at
from gateway.moves import position_text, shown_by_control, tell_motion
from gateway.push import controller_access
from gateway.push.compare import same_other_tables, same_set, same_table, table_facts, table_in, without_tables
from gateway.push.controller_access import bring_to_position, position_tolerance
from gateway.push.journal import is_replaying
from gateway.push.phases import PushEvent
from gateway.push.preflight import with_tables
from gateway.push.state import TableTransactionState
from gateway.table.comparison import differences


@dataclass(frozen=True, slots=True)
class TableLoad:
    """One table on its way; ``base`` is what must still be live when it is backed up (None for a restore)."""

    work: TableTransactionState
    order: PushOrder
    base: LiveSet | None


TableLoads = tuple[TableLoad, ...]
TableFaults = dict[TableTransactionState, VerifyError]
OFF_CODES = ("P-MOVE-SWITCH-OFF", "P-MOVE-OFF-STILL")
ON_CODES = ("P-MOVE-SWITCH-ON", "P-MOVE-ON-STILL")
"""What is said of tables that move their axis when they are switched, and of those that do not."""


async def load_tables(loads: TableLoads) -> TableFaults:
    """First half. On return every table without a fault is in the controller, compared point by point, and disabled.

    A fault (E-PUSH-READBACK) is of one table alone; where all have one the first is raised. Raises VerifyError
    (E-PUSH-MARKER, E-PUSH-COUPLED, E-PUSH-LOST-UPDATE) and what the port raises: then nobody knows of any of them.
    """
    first, batch = loads[0].work, _batch(loads)
    context, whole = first.context, first.transaction
    await controller_access.wait_in_safe_places(context)
    await _bring_axes(loads)
    await _require_no_other_push(first)
    stood = _marker_facts(first)
    for one in loads:
        told = {"coupled": one.work.coupled} if one.work.of else {}
        one.work.note(PushEvent.DISABLE, order=one.order.transaction, purpose=one.order.purpose, **told, **stood)
        one.work.marked, one.work.cut_short = one.order, True
    whole.sent.add(batch[0].transaction)
    whole.batch = batch
    controller_access.prompt_panel_release(context)
    await context.controller.stage(batch)
    await _check_marker(first, batch[0])
    await tell_motion(context.controller, context.say)
    if context.controller.capabilities.switches_now:
        once = context.controller.capabilities.one_start
        _say_moves(OFF_CODES, loads, [await _switch_off_motion(one) for one in loads])
        if once:
            await _say_switched_on(loads)
        selected = WholeTransactionSelected if once else FirstPartSelected
        selected(_names(loads), batch[0].transaction).tell(context.say)
    kept = await _save_and_compare_before(loads)
    for one in loads:
        one.work.begun = True
    return _compare_read_back(loads, await _wait_for_read_back(loads), kept=kept)


def _batch(loads: TableLoads) -> PushBatch:
    return tuple(one.order for one in loads)


def _names(loads: TableLoads) -> str:
    return ", ".join(one.work.name for one in loads)


def _compare_read_back(loads: TableLoads, found: tuple[ReadBack, ...], *, kept: bool) -> TableFaults:
    """Every back-up first: whatever is found next, what was there is known of all."""
    faults: TableFaults = {}
    if not kept:
        for one, read in zip(loads, found, strict=True):
            keep_backup(one.work, one.order, read.backup)
        for one, read in zip(loads, found, strict=True):
            check_base(one.work, one.base, read.backup)
    for one, read in zip(loads, found, strict=True):
        fault = read_back_fault(one.work, one.order, read, read.backup)
        if fault is not None:
            faults[one.work] = fault
        else:
            one.work.note(PushEvent.LOADED, order=one.order.transaction, digest=read.found.digest)
    if len(faults) == len(loads):
        raise next(iter(faults.values()))
    return faults


async def _save_and_compare_before(loads: TableLoads) -> bool:
    """Keep and compare what is live before anything is switched off or written; False where it cannot be read by then.

    The driver itself has read it, or the program stands after its back-up until it is told to go on.
    Raises VerifyError (E-PUSH-LOST-UPDATE); nothing was changed then, and there is nothing to take back.
    """
    context = loads[0].work.context
    controller = context.controller
    if isinstance(controller, SavesFirst) and controller.capabilities.one_start:
        backups = await controller.saved_first(_batch(loads), context.start_timeout_s)
    elif controller.capabilities.stops:
        return False
    else:
        backups = await controller.backup_of(_batch(loads))
    for one, backup in zip(loads, backups, strict=True):
        keep_backup(one.work, one.order, backup)
    try:
        for one, backup in zip(loads, backups, strict=True):
            check_base(one.work, one.base, backup)
    except VerifyError:
        if controller.capabilities.stops:
            await controller_access.end_program(context)
        await loads[0].work.finish_marker("none")
        for one in loads:
            one.work.marked = None
        raise
    return True


async def _require_no_other_push(work: TableTransactionState) -> None:
    """Nobody else may have come since the marker was last looked at. Raises BusyError (E-PUSH-ANOTHER)."""
    controller, whole = work.context.controller, work.transaction
    if whole.before is None and not whole.sent and controller.capabilities.marker:
        whole.before = await controller.marker()
    await work.require_own_marker()


async def _switch_off_motion(one: TableLoad) -> float:
    """By how much switching off will move the output axis where the input axis stands then, um or arcsec."""
    work, order, base = one.work, one.order, one.base
    if order.table.kind == "reversal":
        return float((work.restore_to.table if base is not None else work.change.new).deviations[0])
    if base is not None:
        return await _motion_at_position(work, order.table, table_in(base, order.table))
    axis = (await work.context.controller.state()).axes[work.axis]
    return axis.cross_compensation if order.table.kind == "cross" else axis.encoder_compensation


async def _motion_at_position(work: TableTransactionState, table: CompensationTable, switched: LiveTable) -> float:
    """What a table, and those of its output that are switched with it, add up to at the agreeing position."""
    if table.kind == "reversal":
        return switched.table.deviations[0] if switched.enabled else 0.0
    own = value_at(switched.table, work.agreeing_position) if switched.enabled else 0.0
    others = (
        [one.table for one in other_cross_tables(work.base, table) if one.enabled] if work.base and work.coupled else []
    )
    if not others or table.kind != "cross":
        return own
    places = {name: axis.position for name, axis in (await work.context.controller.state()).axes.items()}
    places[table.input_axis] = work.agreeing_position
    return own + sum(value_at(one, places.get(one.input_axis, one.minimum)) for one in others)


def _say_moves(codes: tuple[str, str], loads: TableLoads, amounts: Sequence[float]) -> None:
    """Each table that moves its axis when it is switched, um or arcsec; in one sentence those that move nothing."""
    still = []
    for one, amount in zip(loads, amounts, strict=True):
        work, table, most = one.work, one.order.table, round(abs(amount), 2)
        if most:
            told = {"amount": most, "deviation_unit": table.deviation_unit}
            place = {
                "input": table.input_axis,
                "place": position_text(work.agreeing_position),
                "unit": table.input_unit,
            }
            work.context.say(codes[0], axis=work.axis, table=work.change.name, **told, **place)
        else:
            still.append(work.change.name)
    if still:
        loads[0].work.context.say(codes[1], tables=", ".join(still))


def _marker_facts(work: TableTransactionState) -> dict[str, object]:
    """The marker from before the first order, for whoever recovers this."""
    before = work.transaction.before
    return (
        {} if before is None or work.transaction.sent else {"before": before.transaction, "before_state": before.state}
    )


async def _wait_for_read_back(loads: TableLoads) -> tuple[ReadBack, ...]:
    """What stood before and what stands now, once every point has been written, or was found to differ after that."""
    context = loads[0].work.context
    try:
        found = await context.controller.read_back(_batch(loads), context.start_timeout_s)
    except TrueflankError as error:
        for one in loads:
            one.work.cut_short = not isinstance(error, PointsDiffer)
            one.work.protected = one.work.protected or isinstance(error, TableActs)
        raise
    for one in loads:
        one.work.cut_short = False
    return found


async def _bring_axes(loads: TableLoads) -> None:
    """A program moves the axes where the tables agree; without programs the operator does."""
    for one in loads:
        if not one.work.context.controller.capabilities.stops:
            room = position_tolerance(one.order.table, one.work.restore_to.table)
            await bring_to_position(one.work.context, one.order.agreeing_position, room)


async def _check_marker(work: TableTransactionState, order: PushOrder) -> None:
    """The marker must stand in the controller before anything of the compensation changes."""
    controller = work.context.controller
    if not controller.capabilities.marker:
        return
    marker = await controller.marker()
    if marker is None or (marker.transaction, marker.state) != (order.transaction, "in-progress"):
        found = "nothing" if marker is None else f"{marker.transaction} {marker.state}"
        raise VerifyError("E-PUSH-MARKER", work.axis, axis=work.axis, wanted=order.transaction, found=found)
    work.transaction.acknowledged = True


async def release_tables(loads: TableLoads, batch: PushBatch | None = None) -> None:
    """Second half of those of the ``batch`` that passed: fingerprint and state once more, release, activation.

    Raises WriteRefused (E-PUSH-RELEASE) before the release, VerifyError (E-PUSH-SWITCH) after it.
    """
    context, passed = loads[0].work.context, _batch(loads)
    together = batch or passed
    await _bring_axes(loads)
    for one in loads:
        await _repeat_interlocks(one)
    for one in loads:
        one.work.note(PushEvent.ENABLE, order=one.order.transaction, enable=one.order.enable)
    await context.controller.activate(together, passed)
    await _prompt_release(loads)
    for one, enabled in zip(loads, await context.controller.confirm(passed, context.start_timeout_s), strict=True):
        if enabled != one.order.enable:
            raise VerifyError("E-PUSH-SWITCH", one.work.axis, wanted=one.order.enable, found=enabled)
        one.work.note(PushEvent.ENABLED if enabled else PushEvent.LEFT_DISABLED, order=one.order.transaction)
    await _wait_for_activation(loads, together)


async def _wait_for_activation(loads: TableLoads, together: PushBatch) -> None:
    """One restart puts all to work; a reversal alone acts from its program's own activation on."""
    acting = tuple(one for one in loads if one.order.enable)
    if not acting or all(order.table.kind == "reversal" for order in together):
        return
    context = loads[0].work.context
    if context.controller.capabilities.switches_now:
        restarted = tuple(one for one in acting if one.order.table.kind != "reversal")
        there = shown_by_control(context.controller, "restart")
        context.say("P-PUSH-ACTIVATE", axis=_names(restarted or acting), shown=there)
    await context.controller.restarted(_batch(acting), context.start_timeout_s)
    for one in acting:
        one.work.note(PushEvent.ACTIVATED, order=one.order.transaction)


async def _prompt_release(loads: TableLoads) -> None:
    """What the second press moves, where there is one; or a restart that switches, unless what is back acts anyhow."""
    context, told = loads[0].work.context, {"axis": _names(loads), "transaction": loads[0].order.transaction}
    if not context.controller.capabilities.switches_now:
        if any([(await controller_access.read_loaded_tables(one.work.context)).waits for one in loads]):
            context.say("P-PUSH-NEXT-START", **told)
        return
    if context.controller.capabilities.one_start:
        context.say("P-PUSH-RELEASED", **told)
        return
    await tell_motion(context.controller, context.say)
    await _say_switched_on(loads)
    context.say("P-PUSH-RELEASE", **told)


async def _say_switched_on(loads: TableLoads) -> None:
    on = tuple(one for one in loads if one.order.enable)
    _say_moves(
        ON_CODES,
        on,
        [await _motion_at_position(one.work, one.order.table, LiveTable(one.order.table, True)) for one in on],
    )


async def _repeat_interlocks(one: TableLoad) -> None:
    work, order = one.work, one.order
    change = replace(work.change, new=order.table, old_enabled=order.enable)
    start = await controller_access.read_facts(
        work.context,
        change,
        purpose=order.purpose,
        limits=work.limits,
        agreeing_position=order.agreeing_position,
        live=with_tables(work.base, work.beside) if work.base is not None and one.base is not None else work.base,
    )
    found = refusals(replace(start, moment="release"))
    if found and not is_replaying(work.transaction.journal):
        reasons = tuple(refusal.message for refusal in found)
        raise WriteRefused("E-PUSH-RELEASE", work.axis, count=len(found), reasons=reasons)


# The snapshot: the tables that are live before anything is disabled, kept as text and noted in the journal.


async def take_snapshot(works: Sequence[TableTransactionState]) -> tuple[LiveSet, ...]:
    """The live tables, kept as read, before anything is disabled; of each output axis once."""
    known = [work.context.read for work in works]
    read = tuple(live for live in known if live is not None)
    if len(read) < len(works):
        read = await read_live_sets(works)
    for work, live in zip(works, read, strict=True):
        keep_snapshot(work, live)
        if work.context.on_live is not None:
            work.context = replace(work.context, alarms=work.context.on_live(live))
    return read


async def read_live_sets(works: Sequence[TableTransactionState]) -> tuple[LiveSet, ...]:
    """What is live on each table's output axis, read again; of each axis once, and together where possible."""
    asked = {(work.axis, work.context.sense): work.context for work in works}
    read = dict(zip(asked, await controller_access.read_live_of_axes(tuple(asked.values())), strict=True))
    return tuple(read[work.axis, work.context.sense] for work in works)


def keep_snapshot(work: TableTransactionState, live: LiveSet) -> None:
    """Keep the live tables' text, then note where; from here on the work knows what hangs together."""
    name = f"live-{work.name}-{work.transaction.number:06d}{spoken().program_suffix}"
    work.backup_path = work.keep_text(name, live.native)
    work.base, work.coupled = live, is_coupled(live, work)
    work.restore_to = table_in(live, work.change.new)
    old = {"old": table_facts(work.restore_to.table), "old_enabled": work.restore_to.enabled}
    work.note(PushEvent.SNAPSHOT, path=work.backup_path, digest=live.digest, coupled=work.coupled, **old)


def is_already_live(work: TableTransactionState, live: LiveSet) -> bool:
    """Whether the wanted table is live and enabled."""
    wanted = LiveTable(work.change.new, enabled=True)
    return same_table(wanted, table_in(live, work.change.new), work.tolerance)


# Two read-backs of each table: the back-up from before the write, kept first, and what the control contains after it.


def keep_backup(work: TableTransactionState, order: PushOrder, backup: LiveSet) -> None:
    """The text as read, durable before anything else; a restore's own back-up shows the table that failed.

    The transaction's own back-up confirms what to go back to where it agrees with what was live before.
    """
    name = f"backup-{work.name}-{order.transaction:06d}{spoken().program_suffix}"
    path = work.keep_text(name, backup.native)
    if order.transaction != work.transaction.number:
        work.note(PushEvent.FAILED_TABLE, path=path, digest=backup.digest)
        return
    work.backup_path = path
    work.confirmed = confirms_old_table(work, backup)
    old = {"old": table_facts(work.restore_to.table), "old_enabled": work.restore_to.enabled}
    work.note(PushEvent.BACKUP, path=path, digest=backup.digest, confirmed=work.confirmed, **old)


def confirms_old_table(work: TableTransactionState, backup: LiveSet) -> bool:
    """Whether a second reading says the same of what was live before: then, and only then, it may be restored."""
    if work.base is not None:
        return same_set(work.base, backup, work.tolerance)
    same = same_table(work.restore_to, table_in(backup, work.change.new), work.tolerance)
    return same and backup.digest == work.base_digest


def check_base(work: TableTransactionState, base: LiveSet | None, backup: LiveSet) -> None:
    """Raises VerifyError (E-PUSH-LOST-UPDATE)."""
    if base is not None and not same_set(base, backup, work.tolerance):
        before, found = base.digest[:12], backup.digest[:12]
        raise VerifyError("E-PUSH-LOST-UPDATE", work.axis, axis=work.axis, base=before, found=found)


def read_back_fault(
    work: TableTransactionState, order: PushOrder, read: ReadBack, backup: LiveSet
) -> VerifyError | None:
    """How the table differs from what was sent (E-PUSH-READBACK), or fails the independent check (E-PUSH-CHECK).

    None where it is as sent, off, and right by `gateway.interlocks.checker`. What is restored is not checked by that.

    Raises VerifyError (E-PUSH-COUPLED) where anything else changed, which is no fault of one table: the others of the
    transaction are not looked at here, each is compared by itself.
    """
    axis, found = work.axis, table_in(read.found, order.table)
    waits = order.table.kind == "reversal"  # one value, written only when it is released
    different = [] if waits else list(differences(order.table, found.table, work.tolerance))
    if found.enabled:
        different.append(Message.of("W-PUSH-STILL-ENABLED"))
    if not read.agreed and not different:
        different.append(Message.of("W-PUSH-CONTROL-DIFFERS"))
    if different:
        return VerifyError("E-PUSH-READBACK", axis, count=len(different), first=different[0])
    wrong = () if order.purpose == "restore" else faults_of(found.table, _approved_curve(work, order, backup))
    if wrong:
        return VerifyError("E-PUSH-CHECK", axis, table=order.table.called, count=len(wrong), first=wrong[0])
    before, now = without_tables(backup, work.siblings), without_tables(read.found, work.siblings)
    if not same_other_tables(before, now, order.table, work.tolerance, beside=work.siblings):
        raise VerifyError("E-PUSH-COUPLED", axis, axis=axis)
    return None


def _approved_curve(work: TableTransactionState, order: PushOrder, backup: LiveSet) -> ApprovedCurve:
    """What the independent checker holds a table against: the approved one, what acted, and the very readings."""
    stood, capture = table_in(backup, work.change.new), work.context.capture
    acted = stood.table if stood.enabled else None
    own = order.purpose == "table" and capture is not None and capture.axis == work.axis
    acting: CompensationTable | None = None
    measured: tuple[tuple[float, float], ...] = ()
    if own and capture is not None and capture.live is not None:
        measured = mean_readings(capture.targets.tolist(), capture.deviations.tolist())
        acting = capture.live.own.table if capture.live.own.enabled else None
    reference = work.context.input_axis.reference
    return ApprovedCurve(
        table=work.change.new,
        acted=acted,
        reference=reference,
        allowed=work.tolerance,
        measured=measured,
        acting=acting,
    )


def is_coupled(live: LiveSet, work: TableTransactionState) -> bool:
    """Whether other cross tables of the output axis are on, none of this transaction; never for an axis table."""
    return other_tables_enabled(live, work.change.new, work.beside)


def other_tables_enabled(live: LiveSet, table: CompensationTable, beside: Sequence[CompensationTable]) -> bool:
    """Whether cross tables of the output of a cross ``table`` are on that are none of those ``beside`` it."""
    return table.kind == "cross" and any(one.enabled for one in other_cross_tables(without_tables(live, beside), table))


def sibling_enabled(live: LiveSet, work: TableTransactionState) -> bool:
    """Whether a cross table of the same output and transaction is on: whoever switches this one leaves it on."""
    beside = {one.index for one in work.beside if one.kind == "cross"}
    return work.change.new.kind == "cross" and any(one.enabled and one.table.index in beside for one in live.cross)


def leave_out_live(work: TableTransactionState, there: Iterable[TableTransactionState], base: LiveSet) -> None:
    """Tables that are as wanted are no part of what is sent: they stand beside as any other of the axis do."""
    gone = [other.change.new for other in there]
    work.beside = tuple(table for table in work.beside if table not in gone)
    work.coupled = is_coupled(base, work)
