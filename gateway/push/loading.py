"""The two halves on the controller: disable all, load all and compare each; then enable those that are right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivers.errors import PointsDiffer, TableActs, TrueflankError
from drivers.ports.controller import SavesFirst
from drivers.types.orders import PushBatch, PushOrder, ReadBack
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.errors import VerifyError, WriteRefused
from gateway.events import FirstPartSelected, WholeTransactionSelected
from gateway.interlocks import refusals
from gateway.interlocks.facts import rest_of, value_at
from gateway.moving import shown, shown_there, tell_motion
from gateway.push import conversation
from gateway.push.asking import with_all
from gateway.push.byhand import room_of, stand_at
from gateway.push.compare import table_in
from gateway.push.readback import check_base, fault_of, keep_backup
from gateway.push.records.phases import PushEvent
from gateway.push.records.replaying import replaying
from gateway.push.work import Work


@dataclass(frozen=True, slots=True)
class TableLoad:
    """One table on its way; ``base`` is what must still be live when it is backed up (None for a restore)."""

    work: Work
    order: PushOrder
    base: LiveSet | None


Loads = tuple[TableLoad, ...]
Faults = dict[Work, VerifyError]
OFF = ("P-MOVE-SWITCH-OFF", "P-MOVE-OFF-STILL")
ON = ("P-MOVE-SWITCH-ON", "P-MOVE-ON-STILL")
"""What is said of tables that move their axis when they are switched, and of those that do not."""


async def load(loads: Loads) -> Faults:
    """First half. On return every table without a fault is in the controller, compared point by point, and disabled.

    A fault (E-PUSH-READBACK) is of one table alone; where all have one the first is raised. Raises VerifyError
    (E-PUSH-MARKER, E-PUSH-COUPLED, E-PUSH-LOST-UPDATE) and what the port raises: then nobody knows of any of them.
    """
    first, batch = loads[0].work, _batch(loads)
    context, whole = first.context, first.whole
    await conversation.within_places(context)
    await _stand(loads)
    await _alone(first)
    stood = _stood(first)
    for one in loads:
        told = {"coupled": one.work.coupled} if one.work.of else {}
        one.work.note(PushEvent.DISABLE, order=one.order.transaction, purpose=one.order.purpose, **told, **stood)
        one.work.marked, one.work.cut_short = one.order, True
    whole.sent.add(batch[0].transaction)
    whole.batch = batch
    conversation.ask_release(context)
    await context.controller.stage(batch)
    await _check_marker(first, batch[0])
    await tell_motion(context.controller, context.say)
    if context.controller.capabilities.switches_now:
        once = context.controller.capabilities.one_start
        _say_moves(OFF, loads, [await _acting(one) for one in loads])
        if once:
            await _say_switched_on(loads)
        selected = WholeTransactionSelected if once else FirstPartSelected
        selected(_names(loads), batch[0].transaction).tell(context.say)
    kept = await _kept_before(loads)
    for one in loads:
        one.work.begun = True
    return _compared(loads, await _loaded(loads), kept=kept)


def _batch(loads: Loads) -> PushBatch:
    return tuple(one.order for one in loads)


def _names(loads: Loads) -> str:
    return ", ".join(one.work.name for one in loads)


def _compared(loads: Loads, found: tuple[ReadBack, ...], *, kept: bool) -> Faults:
    """Every back-up first: whatever is found next, what was there is known of all."""
    faults: Faults = {}
    if not kept:
        for one, read in zip(loads, found, strict=True):
            keep_backup(one.work, one.order, read.backup)
        for one, read in zip(loads, found, strict=True):
            check_base(one.work, one.base, read.backup)
    for one, read in zip(loads, found, strict=True):
        fault = fault_of(one.work, one.order, read, read.backup)
        if fault is not None:
            faults[one.work] = fault
        else:
            one.work.note(PushEvent.LOADED, order=one.order.transaction, digest=read.found.digest)
    if len(faults) == len(loads):
        raise next(iter(faults.values()))
    return faults


async def _kept_before(loads: Loads) -> bool:
    """What stands there, kept and compared before anything is switched off or written; False where no road tells it.

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
            await conversation.leave_program(context)
        await loads[0].work.finish("none")
        for one in loads:
            one.work.marked = None
        raise
    return True


async def _alone(work: Work) -> None:
    """Nobody else may have come since the marker was last looked at. Raises BusyError (E-PUSH-ANOTHER)."""
    controller, whole = work.context.controller, work.whole
    if whole.before is None and not whole.sent and controller.capabilities.marker:
        whole.before = await controller.marker()
    await work.only_ours()


async def _acting(one: TableLoad) -> float:
    """By how much switching off will move the output axis where the input axis stands then, um or arcsec."""
    work, order, base = one.work, one.order, one.base
    if order.table.kind == "reversal":
        return float((work.restore_to.table if base is not None else work.change.new).deviations[0])
    if base is not None:
        return await _worth(work, order.table, table_in(base, order.table))
    axis = (await work.context.controller.state()).axes[work.axis]
    return axis.cross_compensation if order.table.kind == "cross" else axis.encoder_compensation


async def _worth(work: Work, table: CompensationTable, switched: LiveTable) -> float:
    """What a table, and those of its output that are switched with it, add up to at the agreeing position."""
    if table.kind == "reversal":
        return switched.table.deviations[0] if switched.enabled else 0.0
    own = value_at(switched.table, work.agreeing_position) if switched.enabled else 0.0
    others = [one.table for one in rest_of(work.base, table) if one.enabled] if work.base and work.coupled else []
    if not others or table.kind != "cross":
        return own
    places = {name: axis.position for name, axis in (await work.context.controller.state()).axes.items()}
    places[table.input_axis] = work.agreeing_position
    return own + sum(value_at(one, places.get(one.input_axis, one.minimum)) for one in others)


def _say_moves(codes: tuple[str, str], loads: Loads, amounts: Sequence[float]) -> None:
    """Each table that moves its axis when it is switched, um or arcsec; in one sentence those that move nothing."""
    still = []
    for one, amount in zip(loads, amounts, strict=True):
        work, table, most = one.work, one.order.table, round(abs(amount), 2)
        if most:
            told = {"amount": most, "deviation_unit": table.deviation_unit}
            place = {"input": table.input_axis, "place": shown(work.agreeing_position), "unit": table.input_unit}
            work.context.say(codes[0], axis=work.axis, table=work.change.name, **told, **place)
        else:
            still.append(work.change.name)
    if still:
        loads[0].work.context.say(codes[1], tables=", ".join(still))


def _stood(work: Work) -> dict[str, object]:
    """The marker from before the first order, for whoever recovers this."""
    before = work.whole.before
    return {} if before is None or work.whole.sent else {"before": before.transaction, "before_state": before.state}


async def _loaded(loads: Loads) -> tuple[ReadBack, ...]:
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


async def _stand(loads: Loads) -> None:
    """A program moves the axes where the tables agree; without programs the operator does."""
    for one in loads:
        if not one.work.context.controller.capabilities.stops:
            room = room_of(one.order.table, one.work.restore_to.table)
            await stand_at(one.work.context, one.order.agreeing_position, room)


async def _check_marker(work: Work, order: PushOrder) -> None:
    """The marker must stand in the controller before anything of the compensation changes."""
    controller = work.context.controller
    if not controller.capabilities.marker:
        return
    marker = await controller.marker()
    if marker is None or (marker.transaction, marker.state) != (order.transaction, "in-progress"):
        found = "nothing" if marker is None else f"{marker.transaction} {marker.state}"
        raise VerifyError("E-PUSH-MARKER", work.axis, axis=work.axis, wanted=order.transaction, found=found)
    work.whole.acknowledged = True


async def release(loads: Loads, batch: PushBatch | None = None) -> None:
    """Second half of those of the ``batch`` that passed: fingerprint and state once more, release, activation.

    Raises WriteRefused (E-PUSH-RELEASE) before the release, VerifyError (E-PUSH-SWITCH) after it.
    """
    context, passed = loads[0].work.context, _batch(loads)
    together = batch or passed
    await _stand(loads)
    for one in loads:
        await _ask_again(one)
    for one in loads:
        one.work.note(PushEvent.ENABLE, order=one.order.transaction, enable=one.order.enable)
    await context.controller.activate(together, passed)
    await _ask_release(loads)
    for one, enabled in zip(loads, await context.controller.confirm(passed, context.start_timeout_s), strict=True):
        if enabled != one.order.enable:
            raise VerifyError("E-PUSH-SWITCH", one.work.axis, wanted=one.order.enable, found=enabled)
        one.work.note(PushEvent.ENABLED if enabled else PushEvent.LEFT_DISABLED, order=one.order.transaction)
    await _activated(loads, together)


async def _activated(loads: Loads, together: PushBatch) -> None:
    """One restart puts all to work; a reversal alone acts from its program's own activation on."""
    acting = tuple(one for one in loads if one.order.enable)
    if not acting or all(order.table.kind == "reversal" for order in together):
        return
    context = loads[0].work.context
    if context.controller.capabilities.switches_now:
        restarted = tuple(one for one in acting if one.order.table.kind != "reversal")
        there = shown_there(context.controller, "restart")
        context.say("P-PUSH-ACTIVATE", axis=_names(restarted or acting), shown=there)
    await context.controller.restarted(_batch(acting), context.start_timeout_s)
    for one in acting:
        one.work.note(PushEvent.ACTIVATED, order=one.order.transaction)


async def _ask_release(loads: Loads) -> None:
    """What the second press moves, where there is one; or a restart that switches, unless what is back acts anyhow."""
    context, told = loads[0].work.context, {"axis": _names(loads), "transaction": loads[0].order.transaction}
    if not context.controller.capabilities.switches_now:
        if any([(await conversation.read_loaded(one.work.context)).waits for one in loads]):
            context.say("P-PUSH-NEXT-START", **told)
        return
    if context.controller.capabilities.one_start:
        context.say("P-PUSH-RELEASED", **told)
        return
    await tell_motion(context.controller, context.say)
    await _say_switched_on(loads)
    context.say("P-PUSH-RELEASE", **told)


async def _say_switched_on(loads: Loads) -> None:
    on = tuple(one for one in loads if one.order.enable)
    _say_moves(ON, on, [await _worth(one.work, one.order.table, LiveTable(one.order.table, True)) for one in on])


async def _ask_again(one: TableLoad) -> None:
    work, order = one.work, one.order
    change = replace(work.change, new=order.table, old_enabled=order.enable)
    start = await conversation.facts_at_start(
        work.context,
        change,
        purpose=order.purpose,
        limits=work.limits,
        agreeing_position=order.agreeing_position,
        live=with_all(work.base, work.beside) if work.base is not None and one.base is not None else work.base,
    )
    found = refusals(replace(start, moment="release"))
    if found and not replaying(work.whole.journal):
        reasons = tuple(refusal.message for refusal in found)
        raise WriteRefused("E-PUSH-RELEASE", work.axis, count=len(found), reasons=reasons)
