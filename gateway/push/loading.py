"""The two halves on the controller: disable, load and compare; then, only if all is right, enable."""

from __future__ import annotations

from dataclasses import replace

from drivers.errors import PointsDiffer, TableActs, TrueflankError
from drivers.terms import spoken
from drivers.types.moves import movement_of
from drivers.types.orders import PushOrder
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.errors import VerifyError, WriteRefused
from gateway.interlocks import PushFacts, refusals
from gateway.interlocks.facts import rest_of, value_at
from gateway.moving import places_of, shown, standing_words, tell_motion
from gateway.push import conversation
from gateway.push.byhand import room_of, stand_at
from gateway.push.compare import same_rest, same_set, same_table, table_facts, table_in
from gateway.push.context import PushContext
from gateway.push.work import Work
from gateway.table.comparison import differences


async def load(work: Work, order: PushOrder, base: LiveSet | None) -> None:
    """First half. On return the table is in the controller, compared point by point, and disabled.

    ``base`` is what must still have been live when it was backed up; None for a restore.
    Raises VerifyError (E-PUSH-MARKER, E-PUSH-READBACK, E-PUSH-COUPLED, E-PUSH-LOST-UPDATE) and what the port
    raises.
    """
    context = work.context
    await within_places(context)
    await _stand(work, order)
    await _alone(work)
    work.note("DISABLE", order=order.transaction, purpose=order.purpose, **_stood(work))
    work.marked, work.cut_short = order, True
    work.sent.add(order.transaction)
    conversation.ask_release(context)
    await context.controller.stage((order,))
    await _check_marker(work, order)
    await tell_motion(context.controller, context.say)
    await _say_switch(work, order, base)
    context.say("P-PUSH-LOAD", axis=work.axis, transaction=order.transaction)
    kept = await _kept_before(work, order, base)
    work.begun = True
    backup, readback = await _loaded(work, order)
    if kept is None:
        keep_backup(work, order, backup)
        _compare(work, base, backup)
    _judge(work, order, backup, readback)
    work.note("LOADED", order=order.transaction, digest=readback.digest)


async def _kept_before(work: Work, order: PushOrder, base: LiveSet | None) -> LiveSet | None:
    """Where the driver itself has read what stands there: kept before anything is switched off; None elsewhere.

    Raises VerifyError (E-PUSH-LOST-UPDATE); nothing was changed then, and there is nothing to take back.
    """
    controller = work.context.controller
    if controller.capabilities.stops:
        return None
    (backup,) = await controller.backup_of((order,))
    keep_backup(work, order, backup)
    try:
        _compare(work, base, backup)
    except VerifyError:
        await work.finish("none")
        work.marked = None
        raise
    return backup


async def _alone(work: Work) -> None:
    """Nobody else may have come since the marker was last looked at. Raises BusyError (E-PUSH-ANOTHER)."""
    controller = work.context.controller
    if work.before is None and not work.sent and controller.capabilities.marker:
        work.before = await controller.marker()
    await work.only_ours()


async def _say_switch(work: Work, order: PushOrder, base: LiveSet | None) -> None:
    """By how much switching off will move the output axis where the input axis stands then."""
    if order.table.kind == "reversal":
        amount = work.restore_to.table.deviations[0] if base is not None else work.change.new.deviations[0]
    elif base is not None:
        amount = await _worth(work, order.table, table_in(base, order.table))
    else:
        axis = (await work.context.controller.state()).axes[work.axis]
        amount = axis.cross_compensation if order.table.kind == "cross" else axis.encoder_compensation
    _say_moves("P-MOVE-SWITCH-OFF", work, order, amount)


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


def _say_moves(code: str, work: Work, order: PushOrder, amount: float) -> None:
    told = {"amount": round(abs(amount), 2), "deviation_unit": order.table.deviation_unit}
    place = {"input": order.table.input_axis, "place": shown(work.agreeing_position), "unit": order.table.input_unit}
    work.context.say(code, axis=work.axis, table=order.table.name, **told, **place)


async def within_places(context: PushContext) -> None:
    """Wait until every axis stands in its safe place: a person brings back what does not.

    Raises DeadlineExceeded after a person's patience, WriteRefused (E-INT-NO-PLACE) where an axis has no safe place,
    and what the port raises.
    """
    places = places_of(context.controller)
    async with context.clock.deadline(context.start_timeout_s, context.axis.name):
        told = False
        while True:
            stands = movement_of((), await context.controller.state(), places).stands
            unknown = next((one for one in stands if one.place is None), None)
            if unknown is not None:
                raise WriteRefused("E-INT-NO-PLACE", context.axis.name, axis=unknown.axis)
            outside = [one for one in stands if not one.safe]
            if not outside:
                return
            if not told:
                context.say("P-MOVE-BRING", axes="; ".join(standing_words(one) for one in outside))
            told = True
            await context.clock.sleep(conversation.POLL_S)


def _stood(work: Work) -> dict[str, object]:
    """The marker from before the first order, for whoever recovers this."""
    before = work.before
    return {} if before is None or work.sent else {"before": before.transaction, "before_state": before.state}


async def _loaded(work: Work, order: PushOrder) -> tuple[LiveSet, LiveSet]:
    """What stood before and what stands now, once every point has been written, or was found to differ after that."""
    try:
        (found,) = await work.context.controller.read_back((order,), work.context.start_timeout_s)
    except TrueflankError as error:
        work.cut_short = not isinstance(error, PointsDiffer)
        work.protected = work.protected or isinstance(error, TableActs)
        raise
    work.cut_short = False
    return found.backup, found.found


async def _stand(work: Work, order: PushOrder) -> None:
    """A program moves the axis where the tables agree; without programs the operator does."""
    if not work.context.controller.capabilities.stops:
        await stand_at(work.context, order.agreeing_position, room_of(order.table, work.restore_to.table))


async def _check_marker(work: Work, order: PushOrder) -> None:
    """The marker must stand in the controller before anything of the compensation changes."""
    controller = work.context.controller
    if not controller.capabilities.marker:
        return
    marker = await controller.marker()
    if marker is None or (marker.transaction, marker.state) != (order.transaction, "in-progress"):
        found = "nothing" if marker is None else f"{marker.transaction} {marker.state}"
        raise VerifyError("E-PUSH-MARKER", work.axis, axis=work.axis, wanted=order.transaction, found=found)
    work.acknowledged = True


def keep_backup(work: Work, order: PushOrder, backup: LiveSet) -> None:
    """The text as read, durable before anything else; a restore's own back-up shows the table that failed.

    The transaction's own back-up confirms what to go back to where it agrees with what was live before.
    """
    name = f"backup-{work.axis}-{order.transaction:06d}{spoken().program_suffix}"
    path = work.kept(name, backup.native)
    if order.transaction != work.number:
        work.note("FAILED_TABLE", path=path, digest=backup.digest)
        return
    work.backup_path = path
    work.confirmed = agrees(work, backup)
    old = {"old": table_facts(work.restore_to.table), "old_enabled": work.restore_to.enabled}
    work.note("BACKUP", path=path, digest=backup.digest, confirmed=work.confirmed, **old)


def agrees(work: Work, backup: LiveSet) -> bool:
    """Whether a second reading says the same of what was live before: then, and only then, it may be restored."""
    if work.base is not None:
        return same_set(work.base, backup, work.allowed)
    same = same_table(work.restore_to, table_in(backup, work.change.new), work.allowed)
    return same and backup.digest == work.base_digest


def _compare(work: Work, base: LiveSet | None, backup: LiveSet) -> None:
    """Raises VerifyError (E-PUSH-LOST-UPDATE)."""
    if base is not None and not same_set(base, backup, work.allowed):
        before, found = base.digest[:12], backup.digest[:12]
        raise VerifyError("E-PUSH-LOST-UPDATE", work.axis, axis=work.axis, base=before, found=found)


def _judge(work: Work, order: PushOrder, backup: LiveSet, readback: LiveSet) -> None:
    axis, found = work.axis, table_in(readback, order.table)
    waits = order.table.kind == "reversal"  # one value, written only when it is released
    different = [] if waits else list(differences(order.table, found.table, work.allowed))
    if found.enabled:
        different.append("the compensation is still enabled")
    if different:
        raise VerifyError("E-PUSH-READBACK", axis, count=len(different), first=different[0])
    if not same_rest(backup, readback, order.table, work.allowed):
        raise VerifyError("E-PUSH-COUPLED", axis, axis=axis)


async def release(work: Work, order: PushOrder) -> None:
    """Second half: fingerprint and state once more, the release, consent at the machine, activation.

    Raises WriteRefused (E-PUSH-RELEASE) before the release, VerifyError (E-PUSH-SWITCH) after it.
    """
    context = work.context
    await _stand(work, order)
    await _ask_again(work, order)
    work.note("ENABLE", order=order.transaction, enable=order.enable)
    await context.controller.activate((order,), (order,))
    await tell_motion(context.controller, context.say)
    if order.enable:
        _say_moves("P-MOVE-SWITCH-ON", work, order, await _worth(work, order.table, LiveTable(order.table, True)))
    context.say("P-PUSH-RELEASE", axis=work.axis, transaction=order.transaction)
    (enabled,) = await context.controller.confirm((order,), context.start_timeout_s)
    if enabled != order.enable:
        raise VerifyError("E-PUSH-SWITCH", work.axis, wanted=order.enable, found=enabled)
    work.note("ENABLED" if enabled else "LEFT_DISABLED", order=order.transaction)
    if enabled and order.table.kind != "reversal":  # that one acts from the program's own activation on
        context.say("P-PUSH-ACTIVATE", axis=work.axis)
        await context.controller.restarted((order,), context.start_timeout_s)
        work.note("ACTIVATED", order=order.transaction)


async def _ask_again(work: Work, order: PushOrder) -> None:
    change = replace(work.change, new=order.table, old_enabled=order.enable)
    start = await conversation.facts_at_start(
        work.context,
        change,
        purpose=order.purpose,
        limits=work.limits,
        agreeing_position=order.agreeing_position,
        live=work.base,
    )
    found = refusals(_at_release(start))
    if found:
        reasons = "; ".join(refusal.words for refusal in found)
        raise WriteRefused("E-PUSH-RELEASE", work.axis, count=len(found), reasons=reasons)


def _at_release(facts: PushFacts) -> PushFacts:
    return replace(facts, moment="release")


def is_coupled(live: LiveSet, work: Work) -> bool:
    """Whether other cross tables of the output axis are on; never for an axis table, which leaves them alone."""
    return work.change.new.kind == "cross" and any(one.enabled for one in rest_of(live, work.change.new))
