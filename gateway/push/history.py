"""What earlier pushes left for good, from their journals: which table should be live, what a rollback would restore."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drivers.errors import words
from drivers.local.ownfiles import read_own
from drivers.message import Message, told
from drivers.terms import spoken
from drivers.types.tables import CompensationTable, LiveTable
from drivers.types.values import Approach, Sense
from gateway.errors import StoreError
from gateway.moves import position_text
from gateway.push import journal
from gateway.push.compare import COARSEST, table_facts, table_from_facts
from gateway.push.journal import JournalRead
from gateway.push.phases import PushEvent
from gateway.table.comparison import deviations_toward, differences, effective

SenseConversion = Callable[[CompensationTable, Sense], CompensationTable]
"""A table that was kept in a sense, as it is meant now: the driver's `table_by` with today's proof."""
_SENSES: dict[Any, Sense] = {None: 1, 1: 1, -1: -1}


def without_conversion(table: CompensationTable, _sense: Sense) -> CompensationTable:
    """A table as its journal kept it: enough to know its place."""
    return table


@dataclass(frozen=True, slots=True)
class CommittedPush:
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


def committed_pushes(
    journals: Path, serial: str, table: str, meant: SenseConversion = without_conversion
) -> tuple[CommittedPush, ...]:
    """Every committed push of one table of one machine, oldest first; sign proofs leave nothing behind.

    ``meant`` gives cross tables as deviations by the machine's proof. Raises StoreError (E-PUSH-JOURNAL) when a
    journal cannot be believed: then nobody knows what should be live.
    """
    return tuple(push for push in all_pushes(journals, serial, meant) if push.table == table)


def all_pushes(journals: Path, serial: str, meant: SenseConversion = without_conversion) -> tuple[CommittedPush, ...]:
    """Every committed push of a machine, of all its tables, oldest first. Raises as `committed_pushes`."""
    return pushes_in_folder(journal.machine_folder(journals, serial), meant)


def pushes_in_folder(folder: Path, meant: SenseConversion = without_conversion) -> tuple[CommittedPush, ...]:
    """As `all_pushes`, of the folder of one machine."""
    every = (_committed_push(one, meant) for one in _journal_parts(folder))
    return _sorted_by_age(folder, [push for push in every if push is not None])


@dataclass(frozen=True, slots=True)
class ConsentSet:
    """What one consent changed in a machine and nobody has taken back since, newest first.

    ``tables`` go back together; ``rest`` are tables of the same consent that were not asked for and go on acting.
    """

    tables: tuple[CommittedPush, ...]
    rest: tuple[CommittedPush, ...] = ()

    @property
    def names(self) -> str:
        """The tables that go back, in words."""
        return ", ".join(one.table for one in self.tables)

    @property
    def transactions(self) -> str:
        """The transactions it took, in words."""
        return ", ".join(map(str, sorted({one.transaction for one in self.tables})))


def consent_set(pushes: tuple[CommittedPush, ...], asked: str = "") -> ConsentSet | None:
    """The set that a rollback restores: what the newest consent changed that nobody has taken back.

    ``asked`` is a machine axis (every table that moves it: its own, its reversal, its cross tables), one table by its
    name, or "" for all; the newest consent is that of the tables asked for. ``pushes`` as `all_pushes` gives them.
    Recovery, page, report and comparison take their set from here. None where nothing is left to take back.
    """
    tops = _not_taken_back(pushes)
    mine = [one for one in tops if not asked or asked in (one.table, one.axis)]
    if not mine:
        return None
    same = [one for one in tops if one.consent == mine[0].consent]
    tables = tuple(one for one in same if one in mine)
    return ConsentSet(tables, tuple(one for one in same if one not in mine))


def same_consent(pushes: tuple[CommittedPush, ...], found: JournalRead) -> tuple[CommittedPush, ...]:
    """Of the consent that an unfinished journal belongs to: what is committed and nobody has taken back, newest first.

    Of a rollback that is the consent of the push that it was to take back. A journal of another purpose has none.
    """
    if found.broken or found.purpose not in ("table", "restore"):
        return ()
    undone = found.latest("undoes")
    consents = {one.consent for one in pushes if one.transaction == undone} if undone else {_consent_of(found)}
    return tuple(one for one in _not_taken_back(pushes) if one.consent in consents)


def _not_taken_back(pushes: tuple[CommittedPush, ...]) -> list[CommittedPush]:
    """The newest push of each table that no later one has taken back, newest first."""
    left: dict[str, list[CommittedPush]] = {}
    for push in pushes:
        stack = left.setdefault(push.table, [])
        if push.undoes:
            left[push.table] = [other for other in stack if other.transaction != push.undoes]
        else:
            stack.append(push)
    order = {id(push): place for place, push in enumerate(pushes)}
    return sorted((stack[-1] for stack in left.values() if stack), key=lambda one: -order[id(one)])


def _sorted_by_age(folder: Path, pushes: list[CommittedPush]) -> tuple[CommittedPush, ...]:
    age = transaction_age(folder, [(push.transaction, push.utc) for push in pushes])
    return tuple(sorted(pushes, key=lambda push: age(push.transaction)))


def transaction_age(folder: Path, known: Sequence[tuple[int, str]]) -> Callable[[int], tuple[int, str, int]]:
    """Place of a transaction in the order of giving, among those ``known`` with their dates.

    Counts go up and begin again after the largest; the PC's clock may jump. Numbers without a store's part are older
    than all others. Where a store lost its part and drew another, the numbers of the last one given are the newest and
    the other parts go by their first date.
    """
    last = _last_number(folder, known)
    newest = last // journal.PART_SIZE
    firsts: dict[int, str] = {}
    for number, utc in known:
        part = number // journal.PART_SIZE
        firsts[part] = min(firsts.get(part, utc), utc)

    def age(number: int) -> tuple[int, str, int]:
        if number <= journal.OLD_MAX:
            return 0, "", (number - last - 1) % journal.OLD_MAX if last <= journal.OLD_MAX else number
        part, count = divmod(number, journal.PART_SIZE)
        if part == newest:
            return 2, "", (count - last % journal.PART_SIZE - 1) % journal.MAX_COUNT
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
    """Names of the tables of a machine that committed pushes have left, in order. Raises as `committed_pushes`."""
    folder = journal.machine_folder(journals, serial)
    pushes = (_committed_push(one, without_conversion) for one in _journal_parts(folder))
    return tuple(sorted({push.table for push in pushes if push is not None}))


def journalled_machines(journals: Path) -> tuple[str, ...]:
    """Serial numbers of the machines that ended journals of a store tell of, in order; what is damaged is left out."""
    folders = [path for path in journals.iterdir() if path.is_dir()] if journals.is_dir() else []
    return tuple(sorted({_machine_serial(folder) for folder in folders} - {""}))


def _machine_serial(folder: Path) -> str:
    told = (part.latest("serial") for part in _journal_parts(folder) if not part.broken)
    return next((str(serial) for serial in told if serial), "")


def table_id(push: CommittedPush) -> str:
    """The first twelve digits of a table's own hash: the same points in the same form have the same."""
    return _table_hash(push.new.table)


@dataclass(frozen=True, slots=True)
class TableName:
    """A table by what people can compare: the id of its points, and when it was written or first seen (UTC).

    ``id`` is "" where no table acts.
    """

    id: str = ""
    utc: str = ""

    @property
    def message(self) -> Message:
        """As people read it, the id short as every screen shows it."""
        if not self.id:
            return Message.of("W-TABLE-NONE")
        return Message.of("W-TABLE-NAMED", id=self.id[:6], date=self.utc[:16].replace("T", " ") or "?")

    @property
    def words(self) -> str:
        """The same in English."""
        return str(self.message)


def identify_table(pushes: tuple[CommittedPush, ...], table: str, live: LiveTable, seen: str = "") -> TableName:
    """The name of what stands in the place of a table, as the push gave it that wrote it; ``seen`` where none did.

    What a control gives back may be rounded to its last place, so points within `COARSEST` are the same table.
    """
    if not live.enabled:
        return TableName()
    for push in reversed(pushes):
        wrote = push.table == table and not push.undoes and push.new.enabled
        if wrote and not differences(push.new.table, live.table, COARSEST):
            return TableName(table_id(push), push.utc)
    return TableName(_table_hash(live.table), seen)


def _table_hash(table: CompensationTable) -> str:
    facts = json.dumps(table_facts(table), sort_keys=True, default=str)
    return hashlib.sha256(facts.encode("utf-8")).hexdigest()[:12]


def newest_not_undone(pushes: tuple[CommittedPush, ...]) -> CommittedPush | None:
    """The newest push that no later one has taken back; None when there is none left."""
    standing: list[CommittedPush] = []
    for push in pushes:
        if push.undoes:
            standing = [other for other in standing if other.transaction != push.undoes]
        else:
            standing.append(push)
    return standing[-1] if standing else None


@dataclass(frozen=True, slots=True)
class TableExchange:
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


def table_exchange(
    found: JournalRead, pushes: tuple[CommittedPush, ...], meant: SenseConversion = without_conversion
) -> TableExchange:
    """Both tables of a journal with their names; ``back``: it takes a push back. Raises StoreError (E-PUSH-JOURNAL)."""
    old, table = tables_of(found, meant)
    switch, undone = found.latest("enable"), found.latest("undoes")
    name = spoken().name(table.kind, str(found.latest("axis") or ""), table.index)
    if switch is None and undone:
        switch = next((one.old.enabled for one in pushes if (one.transaction, one.table) == (undone, name)), True)
    new = LiveTable(table, enabled=True if switch is None else bool(switch))
    seen = next((str(one.facts["utc"]) for one in found.entries if "utc" in one.facts), "")
    before = tuple(one for one in pushes if one.transaction != found.number)
    names = identify_table(before, name, old, seen), identify_table(pushes, name, new, seen)
    return TableExchange(old, new, *names, back=found.purpose == "restore")


def _journal_parts(folder: Path) -> list[JournalRead]:
    """What every journal of a machine tells of each of its tables, ended ones first."""
    found = [
        one
        for one in (*journal.read_journals(folder / "done"), *journal.read_journals(folder))
        if one.entries or one.broken
    ]
    return [part for one in found for part in one.parts]


def _committed_push(found: JournalRead, meant: SenseConversion) -> CommittedPush | None:
    if found.broken:
        raise StoreError("E-PUSH-JOURNAL", str(found.path), why=found.broken)
    ends = [entry for entry in found.entries if entry.kind == PushEvent.COMMITTED]
    if not ends or found.entries[0].facts.get("purpose") not in ("table", "restore"):
        return None
    old, new = tables_of(found, meant)
    switch = found.latest("enable")
    axis = str(found.latest("axis") or "")
    return CommittedPush(
        found.number,
        spoken().name(new.kind, axis, new.index),
        axis=axis,
        utc=str(ends[-1].facts.get("utc", "")),
        old=old,
        new=LiveTable(new, enabled=True if switch is None else bool(switch)),
        undoes=int(found.latest("undoes") or 0),
        backup=str(found.latest("path") or ""),
        journal=found.path,
        consent=_consent_of(found),
    )


def _consent_of(found: JournalRead) -> str:
    """What ties together the transactions of one consent; a journal of an older version has its run's folder for it."""
    folder = str(found.latest("path") or "").rpartition("/")[0]
    return str(found.latest("consent") or folder or f"transaction {found.number}")


def tables_of(found: JournalRead, meant: SenseConversion = without_conversion) -> tuple[LiveTable, CompensationTable]:
    """The old table with its switch and the new one, as the journal noted them last.

    ``meant`` gives them by today's proof, whatever the journal was kept in. Raises StoreError (E-PUSH-JOURNAL) when
    the journal does not hold them.
    """
    try:
        old, new = table_from_facts(found.latest("old")), table_from_facts(found.latest("new"))
        sense = _SENSES[found.latest("sign")]
        return LiveTable(meant(old, sense), bool(found.latest("old_enabled"))), meant(new, sense)
    except (TypeError, KeyError) as error:
        raise StoreError("E-PUSH-JOURNAL", str(found.path), why=Message.of("W-PUSH-NO-TABLES")) from error


# The preview of a rollback: terminal and page show the same figures because both take them from here.


def sense_conversion(senses: Callable[[str], Sense | None]) -> Callable[[CompensationTable, Sense], CompensationTable]:
    """Tables as deviations by today's proofs where no controller is open: ``senses`` gives the proof's of an axis.

    Only cross tables have one. Where an axis has no proof any more its tables are as they were kept, and nothing can be
    taken back before the sign is proved again.
    """

    def meant(kept: CompensationTable, sense: Sense) -> CompensationTable:
        today = senses(kept.output_axis) if kept.kind == "cross" else None
        if today is None or today == sense:
            return kept
        turned = (tuple(-value + 0.0 for value in values) for values in (kept.deviations, kept.reverse))
        deviations, reverse = turned
        return replace(kept, deviations=deviations, reverse=reverse)

    return meant


@dataclass(frozen=True, slots=True)
class RollbackPreview:
    """One table of a set: what acts in its place until the rollback (``newer``), what acts after it (``older``)."""

    done: CommittedPush
    newer: TableName
    older: TableName

    @property
    def plan(self) -> Message:
        """Both tables by their names, in words."""
        told = {"transaction": self.done.transaction, "utc": self.done.utc[:16].replace("T", " ")}
        names = {"newer": self.newer.message, "older": self.older.message}
        return Message.of("W-ROLLBACK-PLAN", table=self.done.table, **names, **told)

    @property
    def move(self) -> tuple[str, dict[str, Any]]:
        """By how much the table moves its axis at most, and where: a code of the catalogue and what it names."""
        new = self.done.new.table
        told: dict[str, Any] = {"axis": new.output_axis, "unit": new.deviation_unit}
        if new.kind == "reversal":
            was, becomes = (float(effective(one).deviations[0]) for one in (self.done.new, self.done.old))
            return "W-ROLLBACK-REVERSAL", {**told, **_figures(was, becomes)}
        points = list(point_changes(self.done))
        place, _, was, becomes = max(points, key=lambda one: abs(one[3] - one[2]))
        told |= {
            "place": position_text(place),
            "place_unit": new.input_unit,
            "input": new.input_axis,
            "count": len(points),
        }
        return "W-ROLLBACK-LARGEST", {**told, **_figures(was, becomes)}

    @property
    def lines(self) -> tuple[Message, ...]:
        """As a terminal shows it."""
        code, fields = self.move
        return self.plan, Message(code, fields)

    def as_data(self) -> dict[str, Any]:
        """As JSON data: names, and the move as code, fields and words."""
        code, fields = self.move
        names = {"newer": told(self.newer.message), "older": told(self.older.message)}
        return {
            "table": self.done.table,
            **names,
            "move": {"code": code, "fields": fields, "words": words(code, **fields)},
        }


def rollback_previews(pushes: tuple[CommittedPush, ...], found: ConsentSet) -> Mapping[str, RollbackPreview]:
    """The preview of each table of a set, by the table's name.

    ``pushes`` are as they were kept, for a table keeps its name whatever its sign was proved to be since; the figures
    are those of ``found``.
    """
    return {one.table: _preview(pushes, one) for one in found.tables}


def _preview(pushes: tuple[CommittedPush, ...], done: CommittedPush) -> RollbackPreview:
    kept = next((one for one in pushes if (one.transaction, one.table) == (done.transaction, done.table)), done)
    before = tuple(one for one in pushes if one.transaction != done.transaction)
    newer, older = identify_table(pushes, done.table, kept.new), identify_table(before, done.table, kept.old, done.utc)
    return RollbackPreview(done, newer, older)


def _figures(was: float, becomes: float) -> dict[str, float]:
    return {"was": round(was, 2) + 0.0, "becomes": round(becomes, 2) + 0.0, "size": round(abs(becomes - was), 2)}


def point_changes(done: CommittedPush) -> Iterator[tuple[float, Approach, float, float]]:
    """Each point of the larger of both tables, the direction of travel, what acts there now and what would act."""
    new, old = done.new, done.old
    places = max((new.table, old.table), key=lambda table: len(table.deviations)).positions
    ways: tuple[Approach, ...] = (1, -1) if new.table.reverse or old.table.reverse else (1,)
    for way in ways:
        now, then = deviations_toward(effective(new), places, way), deviations_toward(effective(old), places, way)
        for place, was, becomes in zip(places, now, then, strict=True):
            yield float(place), way, float(was), float(becomes)
