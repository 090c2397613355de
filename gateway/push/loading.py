"""The two halves on the controller: disable, load and compare; then, only if all is right, enable."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from drivers.types import CompensationTable, LiveSet, LiveTable, PushOrder
from gateway.errors import VerifyError, WriteRefused
from gateway.interlocks import PushFacts, refusals, value_at
from gateway.push import conversation
from gateway.push.compare import differences, same_set, same_table, steepest, table_facts
from gateway.push.work import Work

# The axis stands within its exact stop window of the target: 0.01 mm or deg.
POSITION_SLACK = 0.01
SHOWN_SLACK = 0.01


async def load(work: Work, order: PushOrder, base: LiveSet | None) -> None:
    """First half. On return the table is in the controller, compared point by point, and disabled.

    ``base`` is what must still have been live when the program backed it up; None for a restore.
    Raises VerifyError (E-PUSH-READBACK, E-PUSH-COUPLED, E-PUSH-LOST-UPDATE) and what the port raises.
    """
    context = work.context
    work.note("DISABLE", order=order.transaction, purpose=order.purpose)
    await context.controller.prepare_push(order)
    context.say("P-PUSH-LOAD", axis=work.axis, transaction=order.transaction)
    backup, readback = await context.controller.wait_loaded(order, context.start_timeout_s)
    _keep_backup(work, order, backup)
    _judge(work, order, base, backup, readback)
    work.note("LOADED", order=order.transaction, digest=readback.digest)


def _keep_backup(work: Work, order: PushOrder, backup: LiveSet) -> None:
    """The text as read, durable before anything else; a restore's own back-up shows the table that failed."""
    name = f"backup-{work.axis}-{order.transaction:06d}.mpf"
    path = str(work.context.folder.write_text(name, backup.native))
    if order.purpose == "restore":
        work.note("FAILED_TABLE", path=path, digest=backup.digest)
        return
    work.backup_path = path
    work.restore_to = backup.eec
    old = {"old": table_facts(backup.eec.table), "old_enabled": backup.eec.enabled}
    work.note("BACKUP", path=path, digest=backup.digest, **old)


def _judge(work: Work, order: PushOrder, base: LiveSet | None, backup: LiveSet, readback: LiveSet) -> None:
    axis = work.axis
    if base is not None and not same_set(base, backup, work.allowed):
        raise VerifyError("E-PUSH-LOST-UPDATE", axis, axis=axis, base=base.digest[:12], found=backup.digest[:12])
    different = list(differences(order.table, readback.eec.table, work.allowed))
    if readback.eec.enabled:
        different.append("the compensation is still enabled")
    if different:
        raise VerifyError("E-PUSH-READBACK", axis, count=len(different), first=different[0])
    if not same_set(replace(backup, eec=readback.eec), readback, work.allowed):
        raise VerifyError("E-PUSH-COUPLED", axis, axis=axis)


async def release(work: Work, order: PushOrder) -> None:
    """Second half: fingerprint and state once more, the release, the operator's NC START, activation.

    Raises WriteRefused (E-PUSH-RELEASE) before the release, VerifyError (E-PUSH-SWITCH) after it.
    """
    context = work.context
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
    start = await conversation.facts_at_start(work.context, change, order.purpose, work.limits, order.agreeing_position)
    found = refusals(_at_release(start))
    if found:
        reasons = "; ".join(refusal.words for refusal in found)
        raise WriteRefused("E-PUSH-RELEASE", work.axis, count=len(found), reasons=reasons)


def _at_release(facts: PushFacts) -> PushFacts:
    return replace(facts, moment="release")


async def prove_effect(work: Work, positions: tuple[float, ...], base: LiveSet) -> None:
    """Visit positions and compare what the controller says it applies with the table; then read all once more.

    Raises VerifyError (E-PUSH-EFFECT, E-PUSH-OVERWRITTEN, E-PUSH-COUPLED) and what the port raises.
    """
    context, table = work.context, work.change.new
    context.say("P-PUSH-EFFECT", axis=work.axis, count=len(positions))
    stops = conversation.stops_at(context, positions)
    reached = await conversation.visit(context, conversation.plan_of(context, "TFEFFECT", stops), _no_reading)
    shown = [(stop.target, value_at(table, stop.target), stop.encoder_compensation) for stop in reached]
    work.effect = tuple(shown)
    for position, expected, found in shown:
        if not abs(found - expected) <= effect_tolerance(work, table):
            fields: dict[str, Any] = {"position": position, "expected": round(expected, 4), "found": round(found, 4)}
            raise VerifyError("E-PUSH-EFFECT", work.axis, unit=table.deviation_unit, **fields)
    live = await context.controller.saved_tables(work.axis)
    _still_there(work, live, base)
    await same_machine(work)


async def _no_reading(_stop: object, _reached: object) -> None:
    return None


def effect_tolerance(work: Work, table: CompensationTable) -> float:
    """How far the controller's own value may be from the table: last place, standing still, display."""
    return 2.0 * work.allowed + POSITION_SLACK * steepest(table) + SHOWN_SLACK


def _still_there(work: Work, live: LiveSet, base: LiveSet) -> None:
    wanted = LiveTable(work.change.new, enabled=True)
    if not same_table(wanted, live.eec, work.allowed):
        different = differences(wanted.table, live.eec.table, work.allowed) or ("the switch is off",)
        raise VerifyError("E-PUSH-OVERWRITTEN", work.axis, axis=work.axis, first=different[0])
    if not same_set(replace(base, eec=live.eec), live, work.allowed):
        raise VerifyError("E-PUSH-COUPLED", work.axis, axis=work.axis)


async def same_machine(work: Work) -> None:
    """The fingerprint once more. Raises VerifyError (E-PUSH-OTHER-MACHINE)."""
    found = await work.context.controller.identify()
    different = work.context.machine.differences(found)
    if different:
        raise VerifyError("E-PUSH-OTHER-MACHINE", work.axis, differ=", ".join(different))
