"""The two halves on the controller: disable, load and compare; then, only if all is right, enable."""

from __future__ import annotations

from dataclasses import replace

from drivers.errors import TrueflankError
from drivers.types import LiveSet, PushOrder
from gateway.errors import VerifyError, WriteRefused
from gateway.interlocks import PushFacts, refusals
from gateway.interlocks.facts import rest_of
from gateway.push import conversation
from gateway.push.byhand import room_of, stand_at
from gateway.push.compare import differences, same_rest, same_set, table_facts, table_in
from gateway.push.work import Work

# The control's own comparison comes after the last point: these say that it got there.
RAN_THROUGH = ("E-NC-MISMATCH", "E-MBX-MISMATCH")
# The control refuses to write a table that is on: whatever the switch reads, it is on.
PROTECTED = "E-MBX-PROTECTED"


async def load(work: Work, order: PushOrder, base: LiveSet | None) -> None:
    """First half. On return the table is in the controller, compared point by point, and disabled.

    ``base`` is what must still have been live when it was backed up; None for a restore.
    Raises VerifyError (E-PUSH-MARKER, E-PUSH-READBACK, E-PUSH-COUPLED, E-PUSH-LOST-UPDATE) and what the port
    raises.
    """
    context = work.context
    await _stand(work, order)
    work.note("DISABLE", order=order.transaction, purpose=order.purpose)
    work.marked, work.cut_short = order, True
    await context.controller.prepare_push(order)
    await _check_marker(work, order)
    context.say("P-PUSH-LOAD", axis=work.axis, transaction=order.transaction)
    backup, readback = await _loaded(work, order)
    _keep_backup(work, order, backup)
    _judge(work, order, base, backup, readback)
    work.note("LOADED", order=order.transaction, digest=readback.digest)


async def _loaded(work: Work, order: PushOrder) -> tuple[LiveSet, LiveSet]:
    """What stood before and what stands now, once every point has been written, or was found to differ after that."""
    try:
        found = await work.context.controller.wait_loaded(order, work.context.start_timeout_s)
    except TrueflankError as error:
        work.cut_short = error.code not in RAN_THROUGH
        work.protected = work.protected or error.code == PROTECTED
        raise
    work.cut_short = False
    return found


async def _stand(work: Work, order: PushOrder) -> None:
    """A program moves the axis where the tables agree; without programs the operator does."""
    if not work.context.controller.capabilities.programs:
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


def _keep_backup(work: Work, order: PushOrder, backup: LiveSet) -> None:
    """The text as read, durable before anything else; a restore's own back-up shows the table that failed."""
    name = f"backup-{work.axis}-{order.transaction:06d}.mpf"
    path = str(work.context.folder.write_text(name, backup.native))
    if order.purpose == "restore":
        work.note("FAILED_TABLE", path=path, digest=backup.digest)
        return
    work.backup_path = path
    work.restore_to = table_in(backup, order.table)
    work.base = backup
    old = {"old": table_facts(work.restore_to.table), "old_enabled": work.restore_to.enabled}
    work.note("BACKUP", path=path, digest=backup.digest, **old)


def _judge(work: Work, order: PushOrder, base: LiveSet | None, backup: LiveSet, readback: LiveSet) -> None:
    axis, found = work.axis, table_in(readback, order.table)
    if base is not None and not same_set(base, backup, work.allowed):
        raise VerifyError("E-PUSH-LOST-UPDATE", axis, axis=axis, base=base.digest[:12], found=backup.digest[:12])
    different = list(differences(order.table, found.table, work.allowed))
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
    await context.controller.release_push(order)
    context.say("P-PUSH-RELEASE", axis=work.axis, transaction=order.transaction)
    enabled = await context.controller.wait_enabled(order, context.start_timeout_s)
    if enabled != order.enable:
        raise VerifyError("E-PUSH-SWITCH", work.axis, wanted=order.enable, found=enabled)
    work.note("ENABLED" if enabled else "LEFT_DISABLED", order=order.transaction)
    if enabled:
        context.say("P-PUSH-ACTIVATE", axis=work.axis)
        await context.controller.wait_activated(order, context.start_timeout_s)
        work.note("ACTIVATED", order=order.transaction)


async def _ask_again(work: Work, order: PushOrder) -> None:
    change = replace(work.change, new=order.table, old_enabled=order.enable)
    start = await conversation.facts_at_start(
        work.context, change, order.purpose, work.limits, order.agreeing_position, live=work.base
    )
    found = refusals(_at_release(start))
    if found:
        reasons = "; ".join(refusal.words for refusal in found)
        raise WriteRefused("E-PUSH-RELEASE", work.axis, count=len(found), reasons=reasons)


def _at_release(facts: PushFacts) -> PushFacts:
    return replace(facts, moment="release")


def is_coupled(live: LiveSet, work: Work) -> bool:
    """Whether other CEC tables of the output axis are on; never for an EEC push, which leaves them alone."""
    return work.change.layer == "CEC" and any(one.enabled for one in rest_of(live, work.change.new))
