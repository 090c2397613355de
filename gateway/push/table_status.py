"""The state of each table, from the journals and the last read-back: one function for every screen.

What unfinished journals say of a switch, without asking the control, comes before everything else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from drivers.errors import words
from drivers.terms import spoken
from gateway.errors import StoreError
from gateway.push import journal
from gateway.push.history import (
    CommittedPush,
    TableName,
    identify_table,
    pushes_in_folder,
    table_exchange,
    tables_of,
    transaction_age,
)
from gateway.push.journal import JournalRead, is_lock_held
from gateway.push.phases import PushEvent, Switch

SwitchState = Literal["off", "still-on", "interrupted", "untouched"]
_CODES = {"off": "R-HELD-OFF", "still-on": "R-HELD-ON", "interrupted": "R-HELD-UNKNOWN", "untouched": "R-HELD-BEFORE"}
_BACK = {"off": "R-UNDO-OFF", "still-on": "R-UNDO-ON", "interrupted": "R-UNDO-UNKNOWN", "untouched": "R-UNDO-BEFORE"}
_SWITCH_STATES: dict[Switch, SwitchState] = {
    Switch.UNTOUCHED: "untouched",
    Switch.OFF: "off",
    Switch.ON: "still-on",
    Switch.UNKNOWN: "interrupted",
    Switch.NEW: "interrupted",
    Switch.OLD: "untouched",
}
TableActivity = Literal["on", "off", "differs", "unknown"]


@dataclass(frozen=True, slots=True)
class HeldPush:
    """One push or rollback that did not end. ``standing`` "off" only where a read-back said so last.

    ``back``: it is a rollback, which a person finishes or undoes; ``old`` and ``new`` name the table that acted before
    it and the one that it was to put there.
    """

    transaction: int
    axis: str
    standing: SwitchState
    backup: str
    table: str = ""
    back: bool = False
    old: str = ""
    new: str = ""

    @property
    def needs_attention(self) -> bool:
        """Whether something may act that nobody stands for."""
        return self.standing in ("still-on", "interrupted")

    @property
    def code(self) -> str:
        """The catalogue's entry for it."""
        return (_BACK if self.back else _CODES)[self.standing]

    @property
    def fields(self) -> dict[str, object]:
        """What the entry names."""
        told: dict[str, object] = {"axis": self.table or self.axis, "transaction": self.transaction}
        return {**told, "backup": self.backup, "old": self.old or "?", "new": self.new or "?"}

    @property
    def words(self) -> str:
        """As people read it, the next step at the end."""
        return f"{self.code}: {words(self.code, **self.fields)}"

    def as_data(self) -> dict[str, Any]:
        """As JSON data."""
        told = {"transaction": self.transaction, "axis": self.axis, "standing": self.standing}
        told |= {"table": self.table or self.axis, "back": self.back, "old": self.old, "new": self.new}
        return {**told, "backup": self.backup, "loud": self.needs_attention, "what": self.words}


def switch_state(found: JournalRead) -> SwitchState:
    """What the journal proves: each word about the switch holds until the next write was announced."""
    if found.broken:
        return "interrupted"
    return _SWITCH_STATES[found.state.switch]


def held_pushes(journals: Path) -> tuple[HeldPush, ...]:
    """Every push of a store that did not end, the loud ones first; not one that somebody is at work with.

    Raises StoreError.
    """
    folders = sorted(path for path in journals.iterdir() if path.is_dir()) if journals.is_dir() else []
    every = [one for folder in folders if not is_lock_held(folder) for one in _held_in(folder)]
    return tuple(sorted(every, key=lambda one: not one.needs_attention))


def _held_in(folder: Path) -> list[HeldPush]:
    left = [part for found in journal.read_journals(folder) for part in found.parts if not part.is_ended]
    pushes = _known_pushes(folder) if left else ()
    return [held_push(found, pushes) for found in left]


def _known_pushes(folder: Path) -> tuple[CommittedPush, ...]:
    """The pushes that tables are named by; none where a journal cannot be believed: that is told elsewhere."""
    try:
        return pushes_in_folder(folder)
    except StoreError:
        return ()


def held_push(found: JournalRead, pushes: tuple[CommittedPush, ...] = ()) -> HeldPush:
    """One unfinished journal in a word."""
    backup, axis = str(found.latest("path") or "none"), str(found.latest("axis") or "")
    told = HeldPush(found.number, axis, switch_state(found), backup)
    if found.broken or found.purpose not in ("table", "restore"):
        return told
    try:
        both = table_exchange(found, pushes)
    except StoreError:
        return told
    table = spoken().name(both.new.table.kind, axis, both.new.table.index)
    return HeldPush(
        found.number,
        axis,
        told.standing,
        backup,
        table=table,
        back=both.back,
        old=both.old_name.words,
        new=both.new_name.words,
    )


@dataclass(frozen=True, slots=True)
class TableState:
    """How one table stands: ``acts`` in a word, ``name`` by id and date of what stands there where that is known.

    "differs": the last comparison found another table than was pushed. "unknown": a write was announced and nothing
    has been read back since. ``push`` is the newest push that ended, ``held`` the one that did not; ``utc`` is when
    this was known.
    """

    table: str
    axis: str
    acts: TableActivity
    name: TableName
    utc: str
    push: CommittedPush | None = None
    held: HeldPush | None = None

    @property
    def is_settled(self) -> bool:
        """Whether nothing has to be put right before the next push."""
        return self.held is None and self.acts in ("on", "off")


NOTHING = TableName()


@dataclass(slots=True)
class _Evidence:
    """What is known of one table by now: the newest word about its switch, when it was given, and what stands there."""

    axis: str
    utc: str = ""
    acts: TableActivity = "unknown"
    name: TableName = NOTHING
    push: CommittedPush | None = None
    held: HeldPush | None = None

    def take(self, utc: str, acts: TableActivity, name: TableName | None = None) -> None:
        """A newer word; without a name the table is the one that was known."""
        self.utc, self.acts = utc, acts
        self.name = self.name if name is None else name


def table_states(
    journals: Path, serial: str, looks: Mapping[str, tuple[str, str]] | None = None
) -> tuple[TableState, ...]:
    """Every table of a machine that a push, a rollback or an order to switch off has been about, by its name.

    ``looks`` are the newest comparisons with the control by the table's name: when (UTC), and what was found (the kind
    of `gateway.table.live_comparison.ThreeWay`). Journals count in the order of their transactions, a look where it is
    newer than the last of them; a push that did not end counts before all. Raises StoreError (E-PUSH-JOURNAL) when a
    journal cannot be believed.
    """
    folder = journal.machine_folder(journals, serial)
    pushes = pushes_in_folder(folder)
    of_part = {(push.transaction, push.table): push for push in pushes}
    found: dict[str, _Evidence] = {}
    ended = [part for part in _ended_parts(folder) if part.entries]
    age = transaction_age(folder, [(part.number, _utc(part)) for part in ended])
    for part in sorted(ended, key=lambda one: age(one.number)):
        name = _table_of(part)
        if name:
            one = found.setdefault(name, _Evidence(str(part.latest("axis") or "")))
            _take_journal(part, one, pushes, of_part.get((part.number, name)))
    for name, (utc, kind) in (looks or {}).items():
        if name in found and _moment(found[name].utc) <= _moment(utc):
            _take_comparison(found[name], utc, kind)
    for held in _held_in(folder):
        if held.table:
            found.setdefault(held.table, _Evidence(held.axis)).held = held
    return tuple(_table_state(name, one) for name, one in sorted(found.items()) if one.push is not None or one.held)


def _ended_parts(folder: Path) -> Iterator[JournalRead]:
    for found in (*journal.read_journals(folder / "done"), *journal.read_journals(folder)):
        yield from (part for part in found.parts if part.is_ended and not part.broken)


def _utc(part: JournalRead) -> str:
    return str(part.latest("utc") or "")


def _table_of(part: JournalRead) -> str:
    """The table that a journal is about; "" where it is about none that stays."""
    axis = str(part.latest("axis") or "")
    if part.purpose == "disable":
        return spoken().name(part.latest("kind_of_table"), axis, int(part.latest("index") or 0))
    if part.purpose not in ("table", "restore"):
        return ""
    new = tables_of(part)[1]
    return spoken().name(new.kind, axis, new.index)


def _take_journal(
    part: JournalRead, one: _Evidence, pushes: tuple[CommittedPush, ...], push: CommittedPush | None
) -> None:
    """One more ended journal: a push, one that went back, or an order to switch off."""
    if push is not None:
        one.push = push
        one.take(push.utc, _activity(enabled=push.new.enabled), identify_table(pushes, push.table, push.new, push.utc))
    elif part.purpose == "disable":
        if switch_state(part) != "untouched":
            one.take(_utc(part), "off" if switch_state(part) == "off" else "unknown", TableName())
    elif part.said_last == PushEvent.ROLLED_BACK:
        old = tables_of(part)[0]
        one.take(_utc(part), _activity(enabled=old.enabled), identify_table(pushes, _table_of(part), old, _utc(part)))


def _activity(*, enabled: bool) -> TableActivity:
    return "on" if enabled else "off"


def _take_comparison(one: _Evidence, utc: str, kind: str) -> None:
    """A comparison with the newest push, as it was then."""
    if one.push is None:
        return
    acts: dict[str, TableActivity] = {"as-approved": _activity(enabled=one.push.new.enabled), "switched-off": "off"}
    acts |= {"switched-on": "on"}
    one.take(utc, acts.get(kind, "differs"), None if kind in acts else TableName())


def _moment(utc: str) -> datetime:
    try:
        found = datetime.fromisoformat(utc)
    except ValueError:
        return datetime.min.replace(tzinfo=UTC)
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _table_state(name: str, one: _Evidence) -> TableState:
    acts, table = one.acts, one.name
    if one.held is not None and one.held.standing != "untouched":
        acts, table = ("off" if one.held.standing == "off" else "unknown"), TableName()
    return TableState(name, one.axis, acts=acts, name=table, utc=one.utc, push=one.push, held=one.held)
