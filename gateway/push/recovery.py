"""After a crash: what an unfinished push left, what is offered, and the offer carried out on request only.

The verdict comes from what the journal announced and what the controller says now; reading changes no
compensation, and nothing is written before a person asks for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drivers.errors import DeadlineExceeded, TransportError, TrueflankError, words
from drivers.types import ChannelStatus, CompensationTable, LiveSet, LiveTable, Marker
from gateway.domain import PushRecord, TableChange
from gateway.errors import StoreError, VerifyError, WriteRefused
from gateway.interlocks.facts import rest_of
from gateway.push import conversation, disabling, journal
from gateway.push.compare import (
    agreeing_position,
    differences,
    effect_positions,
    table_from,
    table_in,
    three_way,
    tolerance,
)
from gateway.push.context import PushContext
from gateway.push.effect import prove_effect
from gateway.push.holding import standing
from gateway.push.journal import JournalRead
from gateway.push.lock import machine_lock
from gateway.push.restoring import held, hold, roll_back
from gateway.push.work import Work, closed_at_the_end

Action = Literal["close", "restore", "disable", "none"]
MOST_TRIES = 3


@dataclass(frozen=True, slots=True)
class Finding:
    """What one unfinished push left. ``code`` is its catalogue entry, ``action`` what is offered.

    ``difference`` says, where somebody else wrote, what is neither old nor new. ``still_on``: something is enabled,
    or may be, that no push stands for; it is told before all else.
    """

    transaction: int
    axis: str
    code: str
    action: Action
    journal: Path
    last: str
    backup: str
    difference: tuple[str, ...] = ()
    still_on: bool = False

    @property
    def words(self) -> str:
        """The finding as people read it."""
        told = {"axis": self.axis, "transaction": self.transaction, "last": self.last, "backup": self.backup}
        text = f"{self.code}: {words(self.code, **told, count=MOST_TRIES)}"
        return f"{text}: {'; '.join(self.difference)}" if self.difference else text

    def as_data(self) -> dict[str, Any]:
        """The finding as JSON data."""
        return {
            "transaction": self.transaction,
            "axis": self.axis,
            "code": self.code,
            "action": self.action,
            "journal": str(self.journal),
            "last": self.last,
            "backup": self.backup,
            "difference": list(self.difference),
            "still_on": self.still_on,
            "what": self.words,
        }


@dataclass(frozen=True, slots=True)
class Seen:
    """What the controller says: the table in question, whether its neighbours are on, and its marker."""

    live: LiveTable
    neighbours_on: bool = False
    marker: Marker | None = None
    marker_ours: bool = True


def unfinished(journals: Path, serial: str) -> tuple[JournalRead, ...]:
    """The journals of a machine that did not end, oldest first."""
    folder = journal.machine_folder(journals, serial)
    return tuple(found for found in journal.all_of(folder) if not found.finished)


def verdict(found: JournalRead, live: LiveTable | Seen | None, allowed: float, sign: int = 1) -> Finding:
    """What happened, from the journal and the live table (None: not readable now).

    ``sign`` is that of the machine's CEC proof, in which ``live`` was read.
    """
    seen = Seen(live, _coupled(found)) if isinstance(live, LiveTable) else live
    code, action = _verdict(found, seen, allowed, sign)
    last = found.kinds[-1] if found.kinds else "nothing"
    backup = str(found.latest("path") or "none")
    difference: tuple[str, ...] = ()
    if code in ("R-PUSH-FOREIGN", "R-PUSH-STILL-ON") and seen is not None:
        old, new = tables_of(found, sign)
        difference = tuple(three_way(old.table, new, seen.live.table))
    axis, loud = str(found.latest("axis") or ""), _still_on(found, seen, code, action)
    return Finding(found.number, axis, code, action, found.path, last, backup, difference, loud)


def _still_on(found: JournalRead, seen: Seen | None, code: str, action: Action) -> bool:
    """What is to be switched off, or was held without proof and does not read off now."""
    held = standing(found) == "still-on" and code not in ("R-PUSH-UNTOUCHED", "R-PUSH-DONE")
    return action == "disable" or (held and (seen is None or seen.live.enabled))


def _verdict(found: JournalRead, seen: Seen | None, allowed: float, sign: int) -> tuple[str, Action]:
    if found.broken or not found.entries:
        return "R-PUSH-DAMAGED", "none"
    if found.finished:
        return "R-PUSH-DONE", "close"
    if found.latest("purpose") == "disable":
        return "R-DISABLE-LEFT", "close"
    tried = _tries(found) >= MOST_TRIES
    if seen is None:
        return "R-PUSH-TRIES" if tried else "R-PUSH-UNKNOWN", "none"
    if _foreign_marker(seen):
        return "R-PUSH-OTHER-MARKER", "none"
    code, action = _by_content(found, seen, allowed, sign)
    return (code, action) if action == "disable" or not tried else ("R-PUSH-TRIES", "none")


def _tries(found: JournalRead) -> int:
    """Restores begun; switching off is never given up."""
    return sum(entry.kind == "RECOVERING" and entry.facts.get("action") != "disable" for entry in found.entries)


def _by_content(found: JournalRead, seen: Seen, allowed: float, sign: int) -> tuple[str, Action]:
    old, new = tables_of(found, sign)
    if not differences(old.table, seen.live.table, allowed):
        return _is_old(old, seen, found)
    if not differences(new, seen.live.table, allowed):
        return _is_new(seen.live, found)
    return _is_neither(seen.live, found)


def _foreign_marker(seen: Seen) -> bool:
    marker = seen.marker
    return marker is not None and marker.state in ("in-progress", "held") and not seen.marker_ours


def _is_old(old: LiveTable, seen: Seen, found: JournalRead) -> tuple[str, Action]:
    together = found.latest("coupled") is None or seen.neighbours_on == _coupled(found)
    if seen.live.enabled == old.enabled and together:
        return "R-PUSH-UNTOUCHED", "close"
    if seen.live.enabled and not old.enabled:
        return _not_ours(found)
    ours = _announced(found, "DISABLE") or _announced(found, "SWITCH_OFF")
    return ("R-PUSH-DISABLED", "restore") if ours else ("R-PUSH-FOREIGN", "none")


def _is_new(live: LiveTable, found: JournalRead) -> tuple[str, Action]:
    if not live.enabled:
        return "R-PUSH-WRITTEN", "restore"
    return ("R-PUSH-ENABLED", "restore") if _announced(found, "ENABLE") else _not_ours(found)


def _is_neither(live: LiveTable, found: JournalRead) -> tuple[str, Action]:
    if live.enabled:
        return _not_ours(found)
    return ("R-PUSH-HALF", "restore") if _announced(found, "DISABLE") else ("R-PUSH-FOREIGN", "none")


def _not_ours(found: JournalRead) -> tuple[str, Action]:
    """Something is on that this push did not switch on: off, once it had announced a write; else it is another's."""
    return ("R-PUSH-STILL-ON", "disable") if _announced(found, "DISABLE") else ("R-PUSH-FOREIGN", "none")


def _announced(found: JournalRead, kind: str) -> bool:
    return kind in found.kinds


def _coupled(found: JournalRead) -> bool:
    return bool(found.latest("coupled"))


def tables_of(found: JournalRead, sign: int = 1) -> tuple[LiveTable, CompensationTable]:
    """The old table with its switch and the new one, as the journal noted them last.

    CEC deviations are turned from the sign the journal was kept in to ``sign``. Raises StoreError
    (E-PUSH-JOURNAL) when the journal does not hold them.
    """
    try:
        old, new = table_from(found.latest("old")), table_from(found.latest("new"))
        turn = (int(found.latest("sign") or 1) * sign) if new.function == "CEC" else 1
        return LiveTable(_turned(old, turn), bool(found.latest("old_enabled"))), _turned(new, turn)
    except (TypeError, KeyError) as error:
        raise StoreError("E-PUSH-JOURNAL", str(found.path), why="it names no tables") from error


def _turned(table: CompensationTable, turn: int) -> CompensationTable:
    return replace(table, deviations=tuple(turn * value + 0.0 for value in table.deviations))


async def look(found: JournalRead, context: PushContext) -> Finding:
    """Read the controller and say what an unfinished push left; changes no compensation.

    A controller that cannot be read, or whose program still waits, gives a finding that says so.
    """
    without_controller = verdict(found, None, 0.0)
    if without_controller.code not in ("R-PUSH-UNKNOWN", "R-PUSH-TRIES"):
        return without_controller
    try:
        if context.machine.differences(await context.controller.identify()):
            return without_controller
        seen, allowed = await _see(found, context)
    except (TransportError, DeadlineExceeded):
        return without_controller
    except TrueflankError:
        return await _unreadable(found, context, without_controller)
    return verdict(found, seen, allowed, context.sign)


async def _unreadable(found: JournalRead, context: PushContext, otherwise: Finding) -> Finding:
    """Tables that cannot be read may be anything: unless the switch reads off, they are switched off."""
    if not _announced(found, "DISABLE"):
        return otherwise
    reading = await disabling.read(context, disabling.order_of(tables_of(found, context.sign)[1]))
    if reading is not None and reading.off:
        return otherwise
    return replace(otherwise, code="R-PUSH-UNREADABLE", action="disable", still_on=True)


async def _see(found: JournalRead, context: PushContext) -> tuple[Seen | None, float]:
    state = await context.controller.state()
    if state.channel is not ChannelStatus.RESET:
        context.say("P-PUSH-RESET", axis=context.axis.name)
        return None, 0.0
    _old, new = tables_of(found, context.sign)
    limits = await context.controller.table_limits(context.axis.name, new.function, new.index)
    live = await conversation.read_live(context, _place(found, context))
    marker = await context.controller.marker() if context.controller.capabilities.marker else None
    ours = marker is None or marker.transaction in journal.orders_of(found) or _known(context, marker)
    return Seen(table_in(live, new), _neighbours_on(live, new), marker, ours), tolerance(limits, new)


def _known(context: PushContext, marker: Marker) -> bool:
    folder = journal.machine_folder(context.journals, context.machine.serial)
    return marker.transaction == 0 or journal.knows(folder, marker.transaction)


def _neighbours_on(live: LiveSet, table: CompensationTable) -> bool:
    return table.function == "CEC" and any(one.enabled for one in rest_of(live, table))


def _place(found: JournalRead, context: PushContext) -> float:
    old, new = tables_of(found, context.sign)
    axis = context.moved
    place = agreeing_position(old, new, axis.reference, axis.travel)
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


def _closed(found: JournalRead, finding: Finding) -> PushRecord:
    """A disable order leaves nothing half done: its journal ends as it stands."""
    kept = journal.Journal.reopen(found)
    try:
        kept.append("CLOSED", finding=finding.code)
    finally:
        kept.close()
    journal.set_aside(found.path)
    return PushRecord(found.number, finding.axis, "skipped", (finding.words,), "")


async def _work(found: JournalRead, context: PushContext) -> Work:
    old, new = tables_of(found, context.sign)
    limits = await context.controller.table_limits(context.axis.name, new.function, new.index)
    nothing = np.zeros(0)
    base = str(found.latest("base_digest") or "")
    change = TableChange(context.axis.name, old.table, new, old.enabled, base, nothing, nothing, nothing)
    folder = journal.machine_folder(context.journals, context.machine.serial)
    written = journal.Journal.reopen(found)
    place = _place(found, context)
    work = Work(context, folder, written, found.number, change, "table", limits, place, old, _coupled(found))
    work.backup_path = str(found.latest("path") or "")
    work.marked = work.order(new, False, "restore", found.number)
    work.cut_short, work.torn = True, bool(found.latest("torn"))
    return work


async def _carry_out(work: Work, finding: Finding, action: str) -> PushRecord:
    if finding.code == "R-PUSH-DONE":
        return work.record("rolled-back" if finding.last != "COMMITTED" else "committed")
    if finding.action == "close":
        await work.finish("none")
        work.note("CLOSED", finding=finding.code)
        return work.record("rolled-back")
    work.note("RECOVERING", finding=finding.code, action="disable" if finding.action == "disable" else action)
    if finding.action == "disable":
        return work.record(await held(work, finding.code, off=await disabling.switch_off(work)))
    if action != "finish":
        return work.record(await roll_back(work, finding.code))
    axis = work.context.moved
    base = await conversation.read_live(work.context, work.agreeing_position)
    positions = effect_positions(work.change.new, work.restore_to, axis.travel, axis.overrun)
    try:
        await prove_effect(work, positions, base)
    except VerifyError as error:
        work.seen = table_in(base, work.change.new)
        return work.record(await hold(work, str(error)))
    await work.finish("committed")
    work.note("COMMITTED")
    return work.record("committed")
