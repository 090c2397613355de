"""After a crash: what an unfinished push left, what is offered, and the offer carried out on request only.

The verdict comes from what the journal announced and what the controller says now; reading changes no
compensation, and nothing is written before a person asks for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drivers.errors import TrueflankError, words
from drivers.types import ChannelStatus, CompensationTable, LiveSet, LiveTable, Marker
from gateway.domain import PushRecord, TableChange
from gateway.errors import StoreError, VerifyError, WriteRefused
from gateway.interlocks.facts import rest_of
from gateway.push import conversation, journal
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
from gateway.push.journal import JournalRead
from gateway.push.lock import machine_lock
from gateway.push.restoring import hold, roll_back
from gateway.push.unexpected import foreseen, unheard
from gateway.push.work import Work, closed_at_the_end

Action = Literal["close", "restore", "none"]
MOST_TRIES = 3


@dataclass(frozen=True, slots=True)
class Finding:
    """What one unfinished push left. ``code`` is its catalogue entry, ``action`` what is offered.

    ``difference`` says, where somebody else wrote, what is neither old nor new.
    """

    transaction: int
    axis: str
    code: str
    action: Action
    journal: Path
    last: str
    backup: str
    difference: tuple[str, ...] = ()

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
            "what": self.words,
        }


@dataclass(frozen=True, slots=True)
class Seen:
    """What the controller says: the table in question, whether its neighbours are on, and its marker."""

    live: LiveTable
    neighbours_on: bool = False
    marker: Marker | None = None
    marker_ours: bool = True


def unfinished(journals: Path, serial: str, begun: journal.Begun | None = None) -> tuple[JournalRead, ...]:
    """The journals of a machine that did not end, oldest first; ``begun`` as for `journal.left_open`."""
    return journal.left_open(journal.machine_folder(journals, serial), begun)


def verdict(found: JournalRead, live: LiveTable | Seen | None, allowed: float, sign: int = 1) -> Finding:
    """What happened, from the journal and the live table (None: not readable now).

    ``sign`` is that of the machine's CEC proof, in which ``live`` was read.
    """
    seen = Seen(live, _coupled(found)) if isinstance(live, LiveTable) else live
    code, action = _verdict(found, seen, allowed, sign)
    last = found.kinds[-1] if found.kinds else "nothing"
    backup = str(found.latest("path") or "none")
    difference: tuple[str, ...] = ()
    if code == "R-PUSH-FOREIGN" and seen is not None:
        old, new = tables_of(found, sign)
        difference = tuple(three_way(old.table, new, seen.live.table))
    return Finding(found.number, str(found.latest("axis") or ""), code, action, found.path, last, backup, difference)


def _verdict(found: JournalRead, seen: Seen | None, allowed: float, sign: int) -> tuple[str, Action]:
    if found.broken or not found.entries:
        return "R-PUSH-DAMAGED", "none"
    if found.finished:
        return "R-PUSH-DONE", "close"
    if found.kinds.count("RECOVERING") >= MOST_TRIES:
        return "R-PUSH-TRIES", "none"
    if seen is None:
        return "R-PUSH-UNKNOWN", "none"
    if _foreign_marker(seen):
        return "R-PUSH-OTHER-MARKER", "none"
    if _superseded(seen, found):
        return "R-PUSH-SUPERSEDED", "close"
    old, new = tables_of(found, sign)
    if not differences(old.table, seen.live.table, allowed):
        return _is_old(old, seen, found)
    if not differences(new, seen.live.table, allowed):
        return _is_new(seen.live, found)
    return _is_neither(seen.live, found)


def _foreign_marker(seen: Seen) -> bool:
    marker = seen.marker
    return marker is not None and marker.state in ("in-progress", "held") and not seen.marker_ours


def _before(found: JournalRead) -> Marker | None:
    """The marker from before the first order, as far as the journal knows it."""
    number, state = found.latest("before"), found.latest("before_state")
    return Marker(number, state) if isinstance(number, int) and state is not None else None


def _superseded(seen: Seen, found: JournalRead) -> bool:
    """Whether the marker names another push since: this one would have kept it out, so nothing of it arrived."""
    marker = seen.marker
    if (
        marker is None
        or marker.transaction in (0, *journal.orders_of(found))
        or marker.state not in ("none", "committed")
    ):
        return False
    before = _before(found)
    return before is not None and marker != before


def _is_old(old: LiveTable, seen: Seen, found: JournalRead) -> tuple[str, Action]:
    together = found.latest("coupled") is None or seen.neighbours_on == _coupled(found)
    if seen.live.enabled == old.enabled and together:
        return "R-PUSH-UNTOUCHED", "close"
    if (seen.live.enabled and not old.enabled) or not _announced(found, "DISABLE"):
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
    if without_controller.code != "R-PUSH-UNKNOWN":
        return without_controller
    try:
        with foreseen(context.axis.name):
            if context.machine.differences(await context.controller.identify()):
                return without_controller
            seen, allowed = await _see(found, context)
    except TrueflankError:
        return without_controller
    return verdict(found, seen, allowed, context.sign)


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
    """Carry out what `look` offers: close, or restore the old table; "finish" proves a new one that is enabled.

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
        with closed_at_the_end(await _work(found, context)) as work:
            return await _carry_out(work, finding, action)


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
    work.base_digest = next((str(one.facts["digest"]) for one in found.entries if one.kind == "SNAPSHOT"), "")
    work.confirmed, work.begun = bool(found.latest("confirmed")), True
    work.sent |= journal.orders_of(found)
    work.before = _before(found)
    return work


async def _carry_out(work: Work, finding: Finding, action: str) -> PushRecord:
    if finding.code == "R-PUSH-DONE":
        return work.record("rolled-back" if finding.last != "COMMITTED" else "committed")
    if finding.action == "close":
        await work.finish("none")
        work.note("CLOSED", finding=finding.code)
        return work.record("rolled-back")
    work.note("RECOVERING", finding=finding.code, action=action)
    if action != "finish":
        return work.record(await roll_back(work, finding.code))
    axis = work.context.moved
    base = await conversation.read_live(work.context, work.agreeing_position)
    positions = effect_positions(work.change.new, work.restore_to, axis.travel, axis.overrun)
    try:
        await prove_effect(work, positions, base)
    except VerifyError as error:
        await hold(work, str(error))
        return work.record("held")
    await work.finish("committed")
    work.note("COMMITTED")
    return work.record("committed")
