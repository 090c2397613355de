"""What earlier pushes left for good, from their journals: the table that should be live, and what can be undone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from drivers.types import LiveTable
from gateway.errors import StoreError
from gateway.push import journal
from gateway.push.finding import tables_of
from gateway.push.journal import JournalRead


@dataclass(frozen=True, slots=True)
class Committed:
    """A push that ended well: ``old`` was live before it, ``new`` since; ``undoes`` the push it took back (0: none).

    ``table`` names the table as in a proposal ("C1", "C1-cec3"); ``backup`` is where the old text is kept.
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


def committed(journals: Path, serial: str, table: str, sign: int = 1) -> tuple[Committed, ...]:
    """Every committed push of one table of one machine, oldest first; sign proofs leave nothing behind.

    ``sign`` is that of the machine's CEC proof, in which CEC deviations are given. Raises StoreError
    (E-PUSH-JOURNAL) when a journal cannot be believed: then nobody knows what should be live.
    """
    folder = journal.machine_folder(journals, serial)
    found = [one for one in (*journal.all_of(folder / "done"), *journal.all_of(folder)) if one.entries or one.broken]
    every = (_committed(one, sign) for one in found)
    pushes = [push for push in every if push is not None and push.table == table]
    last = _last_number(folder, pushes)
    return tuple(sorted(pushes, key=lambda push: _age(push.transaction, last)))


def _age(number: int, last: int) -> int:
    """Place in the order of giving: numbers count up and begin again after the largest; the PC's clock may jump."""
    return (number - last - 1) % journal.MAX_NUMBER


def _last_number(folder: Path, pushes: list[Committed]) -> int:
    """The number given last, from the machine's counter; where that is lost, the largest seen."""
    try:
        text = (folder / "number").read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        text = ""
    return int(text) if text.isdigit() else max((push.transaction for push in pushes), default=0)


def to_undo(pushes: tuple[Committed, ...]) -> Committed | None:
    """The newest push that no later one has taken back; None when there is none left."""
    standing: list[Committed] = []
    for push in pushes:
        if push.undoes:
            standing = [other for other in standing if other.transaction != push.undoes]
        else:
            standing.append(push)
    return standing[-1] if standing else None


def _committed(found: JournalRead, sign: int) -> Committed | None:
    if found.broken:
        raise StoreError("E-PUSH-JOURNAL", str(found.path), why=found.broken)
    ends = [entry for entry in found.entries if entry.kind == "COMMITTED"]
    if not ends or found.entries[0].facts.get("purpose") not in ("table", "restore"):
        return None
    old, new = tables_of(found, sign)
    switch = found.latest("enable")
    axis = str(found.latest("axis") or "")
    return Committed(
        found.number,
        axis if new.function == "EEC" else f"{axis}-cec{new.index}",
        axis,
        str(ends[-1].facts.get("utc", "")),
        old,
        LiveTable(new, enabled=True if switch is None else bool(switch)),
        int(found.latest("undoes") or 0),
        str(found.latest("path") or ""),
        found.path,
    )
