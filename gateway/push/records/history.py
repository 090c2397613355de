"""What earlier pushes left for good, from their journals: the table that should be live, and what can be undone."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import words
from drivers.local.ownfiles import read_own
from drivers.terms import spoken
from drivers.types.tables import CompensationTable, LiveTable
from drivers.types.values import Sense
from gateway.errors import StoreError
from gateway.push.compare import COARSEST, table_facts, table_from
from gateway.push.records import journal, numbering
from gateway.push.records.journal import JournalRead
from gateway.push.records.phases import PushEvent
from gateway.table.comparison import differences

Meant = Callable[[CompensationTable, Sense], CompensationTable]
"""A table that was kept in a sense, as it is meant now: the driver's `table_by` with today's proof."""
_SENSES: dict[Any, Sense] = {None: 1, 1: 1, -1: -1}


def as_kept(table: CompensationTable, _sense: Sense) -> CompensationTable:
    """A table as its journal kept it: enough to know its place."""
    return table


@dataclass(frozen=True, slots=True)
class Committed:
    """A push that ended well: ``old`` was live before it, ``new`` since; ``undoes`` the push it took back (0: none).

    ``table`` names the table as in a proposal ("C1", a cross table with its number); ``backup`` is where the old text
    is kept. ``consent`` is the same of every table that one consent changed, whatever transactions it took.
    """

    transaction: int
    table: str
    axis: str
    utc: str
    old: LiveTable
    new: LiveTable
    undoes: int
    backup: str
    journal: Path
    consent: str = ""


def committed(journals: Path, serial: str, table: str, meant: Meant = as_kept) -> tuple[Committed, ...]:
    """Every committed push of one table of one machine, oldest first; sign proofs leave nothing behind.

    ``meant`` gives cross tables as deviations by the machine's proof. Raises StoreError (E-PUSH-JOURNAL) when a
    journal cannot be believed: then nobody knows what should be live.
    """
    return tuple(push for push in every_push(journals, serial, meant) if push.table == table)


def every_push(journals: Path, serial: str, meant: Meant = as_kept) -> tuple[Committed, ...]:
    """Every committed push of a machine, of all its tables, oldest first. Raises as `committed`."""
    return pushes_in(journal.machine_folder(journals, serial), meant)


def pushes_in(folder: Path, meant: Meant = as_kept) -> tuple[Committed, ...]:
    """As `every_push`, of the folder of one machine."""
    every = (_committed(one, meant) for one in _parts(folder))
    return _in_order(folder, [push for push in every if push is not None])


@dataclass(frozen=True, slots=True)
class ConsentSet:
    """What one consent changed in a machine and nobody has taken back since, newest first.

    ``tables`` go back together; ``rest`` are tables of the same consent that were not asked for and go on acting.
    """

    tables: tuple[Committed, ...]
    rest: tuple[Committed, ...] = ()

    @property
    def names(self) -> str:
        """The tables that go back, in words."""
        return ", ".join(one.table for one in self.tables)

    @property
    def transactions(self) -> str:
        """The transactions it took, in words."""
        return ", ".join(map(str, sorted({one.transaction for one in self.tables})))


def consent_set(pushes: tuple[Committed, ...], asked: str = "") -> ConsentSet | None:
    """The set that a rollback restores: what the newest consent changed that nobody has taken back.

    ``asked`` is a machine axis (every table that moves it: its own, its reversal, its cross tables), one table by its
    name, or "" for all; the newest consent is that of the tables asked for. ``pushes`` as `every_push` gives them.
    Recovery, page, report and comparison take their set from here. None where nothing is left to take back.
    """
    tops = _standing(pushes)
    mine = [one for one in tops if not asked or asked in (one.table, one.axis)]
    if not mine:
        return None
    same = [one for one in tops if one.consent == mine[0].consent]
    tables = tuple(one for one in same if one in mine)
    return ConsentSet(tables, tuple(one for one in same if one not in mine))


def same_consent(pushes: tuple[Committed, ...], found: JournalRead) -> tuple[Committed, ...]:
    """Of the consent that an unfinished journal belongs to: what is committed and nobody has taken back, newest first.

    Of a rollback that is the consent of the push that it was to take back. A journal of another purpose has none.
    """
    if found.broken or found.purpose not in ("table", "restore"):
        return ()
    undone = found.latest("undoes")
    consents = {one.consent for one in pushes if one.transaction == undone} if undone else {_consent(found)}
    return tuple(one for one in _standing(pushes) if one.consent in consents)


def _standing(pushes: tuple[Committed, ...]) -> list[Committed]:
    """The newest push of each table that no later one has taken back, newest first."""
    left: dict[str, list[Committed]] = {}
    for push in pushes:
        stack = left.setdefault(push.table, [])
        if push.undoes:
            left[push.table] = [other for other in stack if other.transaction != push.undoes]
        else:
            stack.append(push)
    order = {id(push): place for place, push in enumerate(pushes)}
    return sorted((stack[-1] for stack in left.values() if stack), key=lambda one: -order[id(one)])


def _in_order(folder: Path, pushes: list[Committed]) -> tuple[Committed, ...]:
    age = age_of(folder, [(push.transaction, push.utc) for push in pushes])
    return tuple(sorted(pushes, key=lambda push: age(push.transaction)))


def age_of(folder: Path, known: Sequence[tuple[int, str]]) -> Callable[[int], tuple[int, str, int]]:
    """Place of a transaction in the order of giving, among those ``known`` with their dates.

    Counts go up and begin again after the largest; the PC's clock may jump. Numbers without a store's part are older
    than all others. Where a store lost its part and drew another, the numbers of the last one given are the newest and
    the other parts go by their first date.
    """
    last = _last_number(folder, known)
    newest = last // numbering.PART_SIZE
    firsts: dict[int, str] = {}
    for number, utc in known:
        part = number // numbering.PART_SIZE
        firsts[part] = min(firsts.get(part, utc), utc)

    def age(number: int) -> tuple[int, str, int]:
        if number <= numbering.OLD_MAX:
            return 0, "", (number - last - 1) % numbering.OLD_MAX if last <= numbering.OLD_MAX else number
        part, count = divmod(number, numbering.PART_SIZE)
        if part == newest:
            return 2, "", (count - last % numbering.PART_SIZE - 1) % numbering.MAX_COUNT
        return 1, firsts.get(part, ""), count

    return age


def _last_number(folder: Path, known: Sequence[tuple[int, str]]) -> int:
    """The number given last, from the machine's counter; where that is lost, the largest seen."""
    try:
        text = read_own(folder / "number").decode("ascii").strip()
    except (OSError, UnicodeDecodeError):
        text = ""
    return int(text) if text.isdigit() else max((number for number, _ in known), default=0)


def pushed_tables(journals: Path, serial: str) -> tuple[str, ...]:
    """Names of the tables of a machine that committed pushes have left, in order. Raises as `committed`."""
    folder = journal.machine_folder(journals, serial)
    pushes = (_committed(one, as_kept) for one in _parts(folder))
    return tuple(sorted({push.table for push in pushes if push is not None}))


def machines(journals: Path) -> tuple[str, ...]:
    """Serial numbers of the machines that ended journals of a store tell of, in order; what is damaged is left out."""
    folders = [path for path in journals.iterdir() if path.is_dir()] if journals.is_dir() else []
    return tuple(sorted({_serial(folder) for folder in folders} - {""}))


def _serial(folder: Path) -> str:
    told = (part.latest("serial") for part in _parts(folder) if not part.broken)
    return next((str(serial) for serial in told if serial), "")


def table_id(push: Committed) -> str:
    """The first twelve digits of a table's own hash: the same points in the same form have the same."""
    return _id(push.new.table)


@dataclass(frozen=True, slots=True)
class TableName:
    """A table by what people can compare: the id of its points, and when it was written or first seen (UTC).

    ``id`` is "" where no table acts.
    """

    id: str = ""
    utc: str = ""

    @property
    def words(self) -> str:
        """As people read it, the id short as every screen shows it."""
        if not self.id:
            return words("W-TABLE-NONE")
        return words("W-TABLE-NAMED", id=self.id[:6], date=self.utc[:16].replace("T", " ") or "?")


def named(pushes: tuple[Committed, ...], table: str, live: LiveTable, seen: str = "") -> TableName:
    """The name of what stands in the place of a table, as the push gave it that wrote it; ``seen`` where none did.

    What a control gives back may be rounded to its last place, so points within `COARSEST` are the same table.
    """
    if not live.enabled:
        return TableName()
    for push in reversed(pushes):
        wrote = push.table == table and not push.undoes and push.new.enabled
        if wrote and not differences(push.new.table, live.table, COARSEST):
            return TableName(table_id(push), push.utc)
    return TableName(_id(live.table), seen)


def _id(table: CompensationTable) -> str:
    facts = json.dumps(table_facts(table), sort_keys=True, default=str)
    return hashlib.sha256(facts.encode("utf-8")).hexdigest()[:12]


def to_undo(pushes: tuple[Committed, ...]) -> Committed | None:
    """The newest push that no later one has taken back; None when there is none left."""
    standing: list[Committed] = []
    for push in pushes:
        if push.undoes:
            standing = [other for other in standing if other.transaction != push.undoes]
        else:
            standing.append(push)
    return standing[-1] if standing else None


@dataclass(frozen=True, slots=True)
class TwoTables:
    """What a journal is about: the table that acted before it, and the one that it puts in its place."""

    old: LiveTable
    new: LiveTable
    old_name: TableName
    new_name: TableName
    back: bool

    @property
    def words(self) -> dict[str, str]:
        """Both names for the texts of the catalogue."""
        return {"old": self.old_name.words, "new": self.new_name.words}


def two_tables(found: JournalRead, pushes: tuple[Committed, ...], meant: Meant = as_kept) -> TwoTables:
    """Both tables of a journal with their names; ``back``: it takes a push back. Raises StoreError (E-PUSH-JOURNAL)."""
    old, table = tables_of(found, meant)
    switch, undone = found.latest("enable"), found.latest("undoes")
    name = spoken().name(table.kind, str(found.latest("axis") or ""), table.index)
    if switch is None and undone:
        switch = next((one.old.enabled for one in pushes if (one.transaction, one.table) == (undone, name)), True)
    new = LiveTable(table, enabled=True if switch is None else bool(switch))
    seen = next((str(one.facts["utc"]) for one in found.entries if "utc" in one.facts), "")
    before = tuple(one for one in pushes if one.transaction != found.number)
    names = named(before, name, old, seen), named(pushes, name, new, seen)
    return TwoTables(old, new, *names, back=found.purpose == "restore")


def _parts(folder: Path) -> list[JournalRead]:
    """What every journal of a machine tells of each of its tables, ended ones first."""
    found = [one for one in (*journal.all_of(folder / "done"), *journal.all_of(folder)) if one.entries or one.broken]
    return [part for one in found for part in one.parts]


def _committed(found: JournalRead, meant: Meant) -> Committed | None:
    if found.broken:
        raise StoreError("E-PUSH-JOURNAL", str(found.path), why=found.broken)
    ends = [entry for entry in found.entries if entry.kind == PushEvent.COMMITTED]
    if not ends or found.entries[0].facts.get("purpose") not in ("table", "restore"):
        return None
    old, new = tables_of(found, meant)
    switch = found.latest("enable")
    axis = str(found.latest("axis") or "")
    return Committed(
        found.number,
        spoken().name(new.kind, axis, new.index),
        axis=axis,
        utc=str(ends[-1].facts.get("utc", "")),
        old=old,
        new=LiveTable(new, enabled=True if switch is None else bool(switch)),
        undoes=int(found.latest("undoes") or 0),
        backup=str(found.latest("path") or ""),
        journal=found.path,
        consent=_consent(found),
    )


def _consent(found: JournalRead) -> str:
    """What ties together the transactions of one consent; a journal of an older version has its run's folder for it."""
    folder = str(found.latest("path") or "").rpartition("/")[0]
    return str(found.latest("consent") or folder or f"transaction {found.number}")


def tables_of(found: JournalRead, meant: Meant = as_kept) -> tuple[LiveTable, CompensationTable]:
    """The old table with its switch and the new one, as the journal noted them last.

    ``meant`` gives them by today's proof, whatever the journal was kept in. Raises StoreError (E-PUSH-JOURNAL) when
    the journal does not hold them.
    """
    try:
        old, new = table_from(found.latest("old")), table_from(found.latest("new"))
        sense = _SENSES[found.latest("sign")]
        return LiveTable(meant(old, sense), bool(found.latest("old_enabled"))), meant(new, sense)
    except (TypeError, KeyError) as error:
        raise StoreError("E-PUSH-JOURNAL", str(found.path), why="it names no tables") from error
