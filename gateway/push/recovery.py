"""After a crash: what an unfinished push left, what is offered, and the offer carried out on request only.

The verdict comes from what the journal announced and what the controller says now; reading changes no
compensation, and nothing is written before a person asks for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drivers.errors import TrueflankError, words
from drivers.types import ChannelStatus, LiveTable
from gateway.domain import PushRecord, TableChange
from gateway.errors import StoreError, VerifyError, WriteRefused
from gateway.push import conversation, journal
from gateway.push.compare import agreeing_position, differences, effect_positions, table_from, tolerance
from gateway.push.context import PushContext
from gateway.push.journal import JournalRead
from gateway.push.loading import prove_effect
from gateway.push.lock import machine_lock
from gateway.push.restoring import roll_back
from gateway.push.work import Work, closed_at_the_end

Action = Literal["close", "restore", "none"]
MOST_TRIES = 3


@dataclass(frozen=True, slots=True)
class Finding:
    """What one unfinished push left. ``code`` is its catalogue entry, ``action`` what is offered."""

    transaction: int
    axis: str
    code: str
    action: Action
    journal: Path
    last: str
    backup: str

    @property
    def words(self) -> str:
        """The finding as people read it."""
        told = {"axis": self.axis, "transaction": self.transaction, "last": self.last, "backup": self.backup}
        return f"{self.code}: {words(self.code, **told)}"

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
            "what": self.words,
        }


def unfinished(journals: Path, serial: str) -> tuple[JournalRead, ...]:
    """The journals of a machine that did not end, oldest first."""
    folder = journal.machine_folder(journals, serial)
    return tuple(found for found in journal.all_of(folder) if not found.finished)


def verdict(found: JournalRead, live: LiveTable | None, allowed: float) -> Finding:
    """What happened, from the journal and the live table (None: not readable now)."""
    code, action = _verdict(found, live, allowed)
    last = found.kinds[-1] if found.kinds else "nothing"
    backup = str(found.latest("path") or "none")
    return Finding(found.number, str(found.latest("axis") or ""), code, action, found.path, last, backup)


def _verdict(found: JournalRead, live: LiveTable | None, allowed: float) -> tuple[str, Action]:
    if found.broken or not found.entries:
        return "R-PUSH-DAMAGED", "none"
    if live is None:
        return "R-PUSH-UNKNOWN", "none"
    old, new = tables_of(found)
    if not differences(old.table, live.table, allowed):
        return _is_old(old, live, found)
    if not differences(new, live.table, allowed):
        return _is_new(live, found)
    return _is_neither(live, found)


def _is_old(old: LiveTable, live: LiveTable, found: JournalRead) -> tuple[str, Action]:
    if live.enabled == old.enabled:
        return "R-PUSH-UNTOUCHED", "close"
    if live.enabled or not _announced(found, "DISABLE"):
        return "R-PUSH-FOREIGN", "none"
    return "R-PUSH-DISABLED", "restore"


def _is_new(live: LiveTable, found: JournalRead) -> tuple[str, Action]:
    if not live.enabled:
        return "R-PUSH-WRITTEN", "restore"
    return ("R-PUSH-ENABLED", "restore") if _announced(found, "ENABLE") else ("R-PUSH-FOREIGN", "none")


def _is_neither(live: LiveTable, found: JournalRead) -> tuple[str, Action]:
    if live.enabled or not _announced(found, "DISABLE"):
        return "R-PUSH-FOREIGN", "none"
    return "R-PUSH-HALF", "restore"


def _announced(found: JournalRead, kind: str) -> bool:
    return kind in found.kinds


def tables_of(found: JournalRead) -> tuple[LiveTable, Any]:
    """The old table with its switch and the new one, as the journal noted them last.

    Raises StoreError (E-PUSH-JOURNAL) when the journal does not hold them.
    """
    try:
        old = LiveTable(table_from(found.latest("old")), bool(found.latest("old_enabled")))
        return old, table_from(found.latest("new"))
    except (TypeError, KeyError) as error:
        raise StoreError("E-PUSH-JOURNAL", str(found.path), why="it names no tables") from error


async def look(found: JournalRead, context: PushContext) -> Finding:
    """Read the controller and say what an unfinished push left; changes no compensation.

    A controller that cannot be read, or whose program still waits, gives a finding that says so.
    """
    if found.broken or not found.entries:
        return verdict(found, None, 0.0)
    try:
        if context.machine.differences(await context.controller.identify()):
            return verdict(found, None, 0.0)
        live, allowed = await _live(found, context)
    except TrueflankError:
        return verdict(found, None, 0.0)
    return verdict(found, live, allowed)


async def _live(found: JournalRead, context: PushContext) -> tuple[LiveTable | None, float]:
    state = await context.controller.state()
    if state.channel is not ChannelStatus.RESET:
        context.say("P-PUSH-RESET", axis=context.axis.name)
        return None, 0.0
    _old, new = tables_of(found)
    limits = await context.controller.table_limits(context.axis.name)
    live = await conversation.read_live(context, _place(found, context))
    return live.eec, tolerance(limits, new)


def _place(found: JournalRead, context: PushContext) -> float:
    old, new = tables_of(found)
    axis = context.axis
    place = agreeing_position(old, new, axis.reference, axis.travel)
    return axis.reference if place is None else place


async def recover(
    found: JournalRead, context: PushContext, action: Literal["offered", "finish"] = "offered"
) -> PushRecord:
    """Carry out what `look` offers: close, or restore the old table; "finish" proves a new one that is enabled.

    Raises WriteRefused (E-PUSH-NO-OFFER, E-PUSH-TRIES, E-INT-NAME) with nothing written, BusyError, StoreError.
    """
    if context.typed_name != context.site_name:
        typed = context.typed_name or "nothing"
        raise WriteRefused("E-INT-NAME", found.path.name, typed=typed, wanted=context.site_name)
    with machine_lock(journal.machine_folder(context.journals, context.machine.serial)):
        finding = await look(found, context)
        if finding.action == "none" or (action == "finish" and finding.code != "R-PUSH-ENABLED"):
            raise WriteRefused("E-PUSH-NO-OFFER", found.path.name, finding=finding.words)
        if found.kinds.count("RECOVERING") >= MOST_TRIES:
            raise WriteRefused("E-PUSH-TRIES", found.path.name, count=MOST_TRIES, backup=finding.backup)
        with closed_at_the_end(await _work(found, context)) as work:
            return await _carry_out(work, finding, action)


async def _work(found: JournalRead, context: PushContext) -> Work:
    old, new = tables_of(found)
    limits = await context.controller.table_limits(context.axis.name)
    nothing = np.zeros(0)
    base = str(found.latest("base_digest") or "")
    change = TableChange(context.axis.name, old.table, new, old.enabled, base, nothing, nothing, nothing)
    folder = journal.machine_folder(context.journals, context.machine.serial)
    written = journal.Journal.reopen(found)
    place = _place(found, context)
    work = Work(context, folder, written, found.number, change, "table", limits, place, old)
    work.backup_path = str(found.latest("path") or "")
    return work


async def _carry_out(work: Work, finding: Finding, action: str) -> PushRecord:
    if finding.action == "close":
        work.note("CLOSED", finding=finding.code)
        return work.record("rolled-back")
    work.note("RECOVERING", finding=finding.code, action=action)
    if action != "finish":
        return work.record(await roll_back(work, finding.code))
    axis = work.context.axis
    base = await conversation.read_live(work.context, work.agreeing_position)
    positions = effect_positions(work.change.new, work.restore_to, axis.travel, axis.overrun)
    try:
        await prove_effect(work, positions, base)
    except VerifyError as error:
        work.note("HELD", why=str(error), backup=work.backup_path)
        return work.record("held")
    work.note("COMMITTED")
    return work.record("committed")
