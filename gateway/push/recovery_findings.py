"""What one unfinished push left, from its journal and from what the controller says; pure.

Each finding carries what is offered; nothing is read or written here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, ClassVar, Literal

from drivers.message import Form, Message
from drivers.types.abilities import Marker
from drivers.types.tables import LiveTable
from gateway.push import journal
from gateway.push.compare import three_way
from gateway.push.history import CommittedPush, SenseConversion, same_consent, tables_of, without_conversion
from gateway.push.journal import JournalRead
from gateway.push.phases import PushEvent, step_message
from gateway.push.table_status import held_push, switch_state
from gateway.table.comparison import differences

Action = Literal["close", "restore", "disable", "none"]
MOST_TRIES = 3


class FindingKind(StrEnum):
    """What an unfinished push left, and the one thing that may be done about it; the value is its catalogue entry."""

    DONE = "R-PUSH-DONE"
    SUPERSEDED = "R-PUSH-SUPERSEDED"
    UNTOUCHED = "R-PUSH-UNTOUCHED"
    DISABLE_ORDER = "R-DISABLE-LEFT"
    DISABLED = "R-PUSH-DISABLED"
    HALF = "R-PUSH-HALF"
    WRITTEN = "R-PUSH-WRITTEN"
    ENABLED = "R-PUSH-ENABLED"
    WAITS = "R-PUSH-WAITS"
    STILL_ON = "R-PUSH-STILL-ON"
    UNREADABLE = "R-PUSH-UNREADABLE"
    UNKNOWN = "R-PUSH-UNKNOWN"
    TRIED = "R-PUSH-TRIES"
    FOREIGN = "R-PUSH-FOREIGN"
    OTHER_MARKER = "R-PUSH-OTHER-MARKER"
    DAMAGED = "R-PUSH-DAMAGED"

    @property
    def action(self) -> Action:
        """What is offered: nothing where a person must look first."""
        return _PERMITS.get(self, "none")


_PERMITS: dict[FindingKind, Action] = {
    FindingKind.DONE: "close",
    FindingKind.SUPERSEDED: "close",
    FindingKind.UNTOUCHED: "close",
    FindingKind.DISABLE_ORDER: "close",
    FindingKind.DISABLED: "restore",
    FindingKind.HALF: "restore",
    FindingKind.WRITTEN: "restore",
    FindingKind.ENABLED: "restore",
    FindingKind.WAITS: "restore",
    FindingKind.STILL_ON: "disable",
    FindingKind.UNREADABLE: "disable",
}
_ENDED = (FindingKind.DONE, FindingKind.SUPERSEDED)
_CHANGED_BY_READING = (FindingKind.UNKNOWN, FindingKind.TRIED)
"""Kinds that reading the control may change."""


@dataclass(frozen=True, slots=True)
class PushFinding:
    """What one unfinished push left; its ``kind`` says what may be done about it.

    ``difference`` says, where somebody else wrote, what is neither old nor new. ``still_on``: something is enabled,
    or may be, that no push stands for; it is told before all else. ``table``: which one of a push of several.
    ``ended``: the outcome of what was done about it, "" for nothing. ``old`` and ``new`` name the table that acted
    before and the one that was to act, by id and date. ``back``: a rollback was interrupted after it had announced
    a write, and the person says whether it is finished or undone. ``rest`` are other tables of the same consent, which
    act and which a rollback takes back.
    """

    transaction: int
    axis: str
    kind: FindingKind
    journal: Path
    last: str
    backup: str
    difference: tuple[Message, ...] = ()
    still_on: bool = False
    table: str = ""
    ended: str = ""
    old: str = ""
    new: str = ""
    back: bool = False
    rest: tuple[str, ...] = ()
    stands: ClassVar[bool] = False

    @property
    def code(self) -> str:
        """Its entry in the catalogue."""
        return self.kind.value

    @property
    def action(self) -> Action:
        """What is offered."""
        return self.kind.action

    @property
    def settled_by_the_journal(self) -> bool:
        """Whether reading the control would change nothing of it."""
        return self.kind not in _CHANGED_BY_READING

    @property
    def choices(self) -> tuple[str, ...]:
        """What a person may choose; nothing where only one thing can be done."""
        return ("finish", "undo") if self.back and self.action in ("restore", "close") else ()

    @property
    def message(self) -> Message:
        """What was found, without what a person may choose."""
        return Message(self.code, {**self._fields, "count": MOST_TRIES}, Form.REASON)

    @property
    def _fields(self) -> dict[str, object]:
        last = step_message(self.last)
        told = {"axis": self.table or self.axis, "transaction": self.transaction, "last": last, "backup": self.backup}
        return {**told, "old": self.old or "?", "new": self.new or "?"}

    @property
    def words(self) -> str:
        """The finding as people read it."""
        return ". ".join(map(str, self.said))

    @property
    def said(self) -> tuple[Message, ...]:
        """The finding, where it differs, what a person may choose, and what else of the consent acts."""
        text = self.message
        if self.difference:
            text = Message.of("R-UNDO-DIFFERENCE", found=text, difference=self.difference)
        choice = (Message.of("R-UNDO-CHOICE", **self._fields),) if self.choices else ()
        return text, *choice, *self._rest

    @property
    def _rest(self) -> tuple[Message, ...]:
        return (Message.of("R-CONSENT-REST", tables=", ".join(self.rest)),) if self.rest else ()

    @property
    def at_last(self) -> str:
        """How it stands now, in English."""
        return ". ".join(map(str, self.said_at_last))

    @property
    def said_at_last(self) -> tuple[Message, ...]:
        """How it stands now: the outcome of what was done about it, else the finding."""
        if not self.ended:
            return self.said
        acts = {"rolled-back": self.old, "committed": self.new}.get(self.ended, "")
        told = {"acts": acts} if acts else {"outcome": self.ended}
        return Message.of("P-RECOVERED" if acts else "P-PUSH-END", axis=self.table or self.axis, **told), *self._rest

    def as_data(self) -> dict[str, Any]:
        """The finding as JSON data."""
        return {
            "transaction": self.transaction,
            "axis": self.axis,
            "table": self.table or self.axis,
            "code": self.code,
            "action": self.action,
            "journal": str(self.journal),
            "last": self.last,
            "backup": self.backup,
            "difference": list(map(str, self.difference)),
            "still_on": self.still_on,
            "ended": self.ended,
            "old": self.old,
            "new": self.new,
            "choices": list(self.choices),
            "rest": list(self.rest),
            "what": self.words,
        }


def with_rest(
    findings: Sequence[PushFinding], left: Sequence[JournalRead], pushes: tuple[CommittedPush, ...]
) -> tuple[PushFinding, ...]:
    """The findings with the other tables of the same consent, each named once; ``left`` are the journals looked at."""
    of = {found.path: same_consent(pushes, found) for found in left}
    told, made = {one.table or one.axis for one in findings}, []
    for finding in findings:
        rest = tuple(one.table for one in of.get(finding.journal, ()) if one.table not in told)
        told |= set(rest)
        made.append(replace(finding, rest=rest))
    return tuple(made)


@dataclass(frozen=True, slots=True)
class ControllerReading:
    """What the controller says: the table in question, whether its neighbours are on, its marker, and whether it waits.

    ``waits``: the table stands for the control's next start, and another acts until then.
    """

    live: LiveTable
    neighbours_on: bool = False
    marker: Marker | None = None
    marker_ours: bool = True
    waits: bool = False


def make_finding(
    found: JournalRead,
    live: LiveTable | ControllerReading | None,
    allowed: float,
    meant: SenseConversion = without_conversion,
    pushes: tuple[CommittedPush, ...] = (),
) -> PushFinding:
    """What happened, from the journal and the live table (None: not readable now).

    ``meant`` gives the journal's tables by the proof that ``live`` was read by; ``pushes`` are those that tables are
    named by.
    """
    seen = ControllerReading(live, was_coupled(found)) if isinstance(live, LiveTable) else live
    kind = _finding_kind(found, seen, allowed, meant)
    last = found.kinds[-1] if found.kinds else "nothing"
    backup = str(found.latest("path") or "none")
    difference: tuple[Message, ...] = ()
    if kind in (FindingKind.FOREIGN, FindingKind.STILL_ON) and seen is not None:
        old, new = tables_of(found, meant)
        difference = tuple(three_way(old.table, new, seen.live.table))
    axis, loud = str(found.latest("axis") or ""), _is_still_on(found, seen, kind)
    held = held_push(found, pushes)
    return PushFinding(
        found.number,
        axis,
        kind=kind,
        journal=found.path,
        last=last,
        backup=backup,
        difference=difference,
        still_on=loud,
        table=found.of or held.table,
        old=held.old,
        new=held.new,
        back=held.back and kind not in _ENDED and (kind.action == "restore" or is_announced(found, PushEvent.DISABLE)),
    )


def _is_still_on(found: JournalRead, seen: ControllerReading | None, kind: FindingKind) -> bool:
    """What is to be switched off, or was held without proof and does not read off now."""
    held = switch_state(found) == "still-on" and kind not in (FindingKind.UNTOUCHED, *_ENDED)
    return kind.action == "disable" or (held and (seen is None or seen.live.enabled))


def _finding_kind(
    found: JournalRead, seen: ControllerReading | None, allowed: float, meant: SenseConversion
) -> FindingKind:
    if found.broken or not found.entries:
        return FindingKind.DAMAGED
    if found.is_ended:
        return FindingKind.DONE
    if found.latest("purpose") == "disable":
        return FindingKind.DISABLE_ORDER
    tried = _restore_attempts(found) >= MOST_TRIES
    if seen is None:
        return FindingKind.TRIED if tried else FindingKind.UNKNOWN
    if _has_foreign_marker(seen):
        return FindingKind.OTHER_MARKER
    if _is_superseded(seen, found):
        return FindingKind.SUPERSEDED
    kind = _kind_by_content(found, seen, allowed, meant)
    return kind if kind.action == "disable" or not tried else FindingKind.TRIED


def _restore_attempts(found: JournalRead) -> int:
    """Restores begun; switching off is never given up."""
    return sum(entry.kind == PushEvent.RECOVERING and entry.facts.get("action") != "disable" for entry in found.entries)


def _kind_by_content(
    found: JournalRead, seen: ControllerReading, allowed: float, meant: SenseConversion
) -> FindingKind:
    old, new = tables_of(found, meant)
    if seen.waits:
        return FindingKind.WAITS if is_announced(found, PushEvent.ENABLE) else FindingKind.FOREIGN
    if not differences(old.table, seen.live.table, allowed):
        return _kind_when_old(old, seen, found)
    if not differences(new, seen.live.table, allowed):
        return _kind_when_new(seen.live, found)
    return _kind_when_neither(seen.live, found)


def _has_foreign_marker(seen: ControllerReading) -> bool:
    marker = seen.marker
    return marker is not None and marker.state in ("in-progress", "held") and not seen.marker_ours


def marker_before(found: JournalRead) -> Marker | None:
    """The marker from before the first order, as far as the journal knows it."""
    number, state = found.latest("before"), found.latest("before_state")
    return Marker(number, state) if isinstance(number, int) and state is not None else None


def _is_superseded(seen: ControllerReading, found: JournalRead) -> bool:
    """Whether the marker names another push since: this one would have kept it out, so nothing of it arrived."""
    marker = seen.marker
    if (
        marker is None
        or marker.transaction in (0, *journal.order_numbers(found))
        or marker.state not in ("none", "committed")
    ):
        return False
    earlier = marker_before(found)
    return earlier is not None and marker != earlier


def _kind_when_old(old: LiveTable, seen: ControllerReading, found: JournalRead) -> FindingKind:
    together = found.latest("coupled") is None or seen.neighbours_on == was_coupled(found)
    if seen.live.enabled == old.enabled and together:
        return FindingKind.UNTOUCHED
    if seen.live.enabled and not old.enabled:
        return _kind_when_foreign(found)
    ours = is_announced(found, PushEvent.DISABLE) or is_announced(found, PushEvent.SWITCH_OFF)
    return FindingKind.DISABLED if ours else FindingKind.FOREIGN


def _kind_when_new(live: LiveTable, found: JournalRead) -> FindingKind:
    if not live.enabled:
        return FindingKind.WRITTEN
    return FindingKind.ENABLED if is_announced(found, PushEvent.ENABLE) else _kind_when_foreign(found)


def _kind_when_neither(live: LiveTable, found: JournalRead) -> FindingKind:
    if live.enabled:
        return _kind_when_foreign(found)
    return FindingKind.HALF if is_announced(found, PushEvent.DISABLE) else FindingKind.FOREIGN


def _kind_when_foreign(found: JournalRead) -> FindingKind:
    """Something is on that this push did not switch on: off, once it had announced a write; else it is another's."""
    return FindingKind.STILL_ON if is_announced(found, PushEvent.DISABLE) else FindingKind.FOREIGN


def is_announced(found: JournalRead, kind: str) -> bool:
    """Whether the journal says that this was about to be done."""
    return kind in found.kinds


def was_coupled(found: JournalRead) -> bool:
    """Whether other cross tables of the output axis were on before."""
    return bool(found.latest("coupled"))
