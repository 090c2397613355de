"""After a crash: what an unfinished push left, what is offered, and the offer carried out on request only.

The verdict comes from what the journal announced and what the controller says now; reading changes no
compensation, and nothing is written before a person asks for it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from drivers.errors import DeadlineExceeded, TransportError, TrueflankError
from drivers.types.abilities import Marker
from drivers.types.machine import ChannelStatus
from drivers.types.tables import CompensationTable, LiveSet
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError, WriteRefused
from gateway.interlocks.facts import rest_of
from gateway.push import conversation
from gateway.push.compare import (
    agreeing_position,
    effect_positions,
    table_in,
    tolerance,
)
from gateway.push.context import PushContext
from gateway.push.effect import prove_effect
from gateway.push.records import journal
from gateway.push.records.history import tables_of
from gateway.push.records.journal import JournalRead
from gateway.push.records.lock import machine_lock
from gateway.push.undo import disabling
from gateway.push.undo.finding import MOST_TRIES, PushFinding, Seen, announced, before, coupled, verdict
from gateway.push.undo.restoring import held, hold, roll_back
from gateway.push.unexpected import foreseen, unheard
from gateway.push.work import Work, closed_at_the_end


def unfinished(journals: Path, serial: str, begun: journal.Begun | None = None) -> tuple[JournalRead, ...]:
    """The journals of a machine that did not end, oldest first; ``begun`` as for `journal.left_open`."""
    return journal.left_open(journal.machine_folder(journals, serial), begun)


async def look(found: JournalRead, context: PushContext) -> PushFinding:
    """Read the controller and say what an unfinished push left; changes no compensation.

    A controller that cannot be read, or whose program still waits, gives a finding that says so.
    """
    without_controller = verdict(found, None, 0.0)
    if without_controller.code not in ("R-PUSH-UNKNOWN", "R-PUSH-TRIES"):
        return without_controller
    try:
        with foreseen(context.axis.name):
            if context.machine.differences(await context.controller.identify()):
                return without_controller
            seen, allowed = await _see(found, context)
    except (TransportError, DeadlineExceeded):
        return without_controller
    except TrueflankError:
        return await _unreadable(found, context, without_controller)
    return verdict(found, seen, allowed, context.meant)


async def _unreadable(found: JournalRead, context: PushContext, otherwise: PushFinding) -> PushFinding:
    """Tables that cannot be read may be anything: unless the switch reads off, they are switched off."""
    if not announced(found, "DISABLE"):
        return otherwise
    reading = await disabling.read(context, disabling.order_of(tables_of(found, context.meant)[1]))
    if reading is not None and reading.off:
        return otherwise
    return replace(otherwise, code="R-PUSH-UNREADABLE", action="disable", still_on=True)


async def _see(found: JournalRead, context: PushContext) -> tuple[Seen | None, float]:
    state = await context.controller.state()
    if state.channel is not ChannelStatus.RESET:
        context.say("P-PUSH-RESET", axis=context.axis.name)
        return None, 0.0
    _old, new = tables_of(found, context.meant)
    limits = await context.controller.table_limits(context.axis.name, new.kind, new.index)
    live = await conversation.read_live(context)
    marker = await context.controller.marker() if context.controller.capabilities.marker else None
    ours = marker is None or marker.transaction in journal.orders_of(found) or _known(context, marker)
    return Seen(table_in(live, new), _neighbours_on(live, new), marker, ours), tolerance(limits, new)


def _known(context: PushContext, marker: Marker) -> bool:
    folder = journal.machine_folder(context.journals, context.machine.serial)
    return marker.transaction == 0 or journal.knows(folder, marker.transaction)


def _neighbours_on(live: LiveSet, table: CompensationTable) -> bool:
    return table.kind == "cross" and any(one.enabled for one in rest_of(live, table))


def _place(found: JournalRead, context: PushContext) -> float:
    old, new = tables_of(found, context.meant)
    axis = context.moved
    place = agreeing_position(old, new, axis.reference, axis.room)
    return axis.reference if place is None else place


async def recover(
    found: JournalRead, context: PushContext, action: Literal["offered", "finish"] = "offered"
) -> PushRecord:
    """Carry out what `look` offers: close, switch off, restore the old table; "finish" proves a new one that is on.

    Raises WriteRefused (E-PUSH-NO-OFFER, E-PUSH-TRIES, E-INT-NAME) with nothing written, BusyError, StoreError.
    """
    if context.typed_name != context.site_name:
        typed = context.typed_name or "nothing"
        raise WriteRefused("E-INT-NAME", found.path.name, typed=typed, wanted=context.site_name)
    with foreseen(context.axis.name):
        return await _recovered(found, unheard(context), action)


async def _recovered(found: JournalRead, context: PushContext, action: Literal["offered", "finish"]) -> PushRecord:
    with machine_lock(journal.machine_folder(context.journals, context.machine.serial)):
        finding = await look(found, context)
        if finding.code == "R-PUSH-TRIES":
            raise WriteRefused("E-PUSH-TRIES", found.path.name, count=MOST_TRIES, backup=finding.backup)
        may_finish = finding.code == "R-PUSH-ENABLED" and found.latest("purpose") == "table"
        if finding.action == "none" or (action == "finish" and not may_finish):
            raise WriteRefused("E-PUSH-NO-OFFER", found.path.name, finding=finding.words)
        if finding.code == "R-DISABLE-LEFT":
            return _closed(found, finding)
        with closed_at_the_end(await _work(found, context)) as work:
            return await _carry_out(work, finding, action)


def _closed(found: JournalRead, finding: PushFinding) -> PushRecord:
    """A disable order leaves nothing half done: its journal ends as it stands."""
    kept = journal.Journal.reopen(found)
    try:
        kept.append("CLOSED", finding=finding.code)
    finally:
        kept.close()
    journal.set_aside(found.path)
    return PushRecord(found.number, finding.axis, outcome="skipped", steps=(finding.words,), backup_path="")


async def _work(found: JournalRead, context: PushContext) -> Work:
    old, new = tables_of(found, context.meant)
    limits = await context.controller.table_limits(context.axis.name, new.kind, new.index)
    nothing = np.zeros(0)
    base = str(found.latest("base_digest") or "")
    change = TableChange(
        context.axis.name,
        old.table,
        new=new,
        old_enabled=old.enabled,
        base_digest=base,
        targets=nothing,
        predicted=nothing,
        predicted_U=nothing,
    )
    folder = journal.machine_folder(context.journals, context.machine.serial)
    written = journal.Journal.reopen(found)
    place = _place(found, context)
    work = Work(
        context,
        folder,
        journal=written,
        number=found.number,
        change=change,
        purpose="table",
        limits=limits,
        agreeing_position=place,
        restore_to=old,
        coupled=coupled(found),
    )
    work.backup_path = str(found.latest("path") or "")
    work.marked = work.order(new, False, "restore", found.number)
    work.cut_short, work.torn = True, bool(found.latest("torn"))
    work.base_digest = next((str(one.facts["digest"]) for one in found.entries if one.kind == "SNAPSHOT"), "")
    work.confirmed, work.begun = bool(found.latest("confirmed")), True
    work.sent |= journal.orders_of(found)
    work.before = before(found)
    return work


async def _carry_out(work: Work, finding: PushFinding, action: str) -> PushRecord:
    if finding.code == "R-PUSH-DONE":
        return work.record("rolled-back" if finding.last != "COMMITTED" else "committed")
    if finding.action == "close":
        await work.finish("none")
        work.note("CLOSED", finding=finding.code)
        return work.record("rolled-back")
    work.note("RECOVERING", finding=finding.code, action="disable" if finding.action == "disable" else action)
    if finding.action == "disable":
        reading = await disabling.read(work.context, disabling.order_of(work.change.new))
        return work.record(await held(work, finding.code, off=await disabling.switch_off(work, reading)))
    if action != "finish":
        return work.record(await roll_back(work, finding.code))
    axis = work.context.moved
    base = await conversation.read_live(work.context)
    positions = effect_positions(work.change.new, work.restore_to, axis.room, axis.overrun)
    try:
        await prove_effect(work, positions, base)
    except VerifyError as error:
        work.seen = table_in(base, work.change.new)
        return work.record(await hold(work, str(error)))
    await work.finish("committed")
    work.note("COMMITTED")
    return work.record("committed")
