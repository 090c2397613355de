"""What unfinished journals say of the switch, without asking the control: the word that stands first everywhere."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from drivers.errors import words
from gateway.push.records import journal
from gateway.push.records.journal import JournalRead
from gateway.push.records.lock import is_held

Standing = Literal["off", "still-on", "interrupted", "untouched"]
_CODES = {"off": "R-HELD-OFF", "still-on": "R-HELD-ON", "interrupted": "R-HELD-UNKNOWN", "untouched": "R-HELD-BEFORE"}


@dataclass(frozen=True, slots=True)
class HeldPush:
    """One push that did not end. ``standing`` "off" only where a read-back said so last."""

    transaction: int
    axis: str
    standing: Standing
    backup: str

    @property
    def loud(self) -> bool:
        """Whether something may act that nobody stands for."""
        return self.standing in ("still-on", "interrupted")

    @property
    def code(self) -> str:
        """The catalogue's entry for it."""
        return _CODES[self.standing]

    @property
    def fields(self) -> dict[str, object]:
        """What the entry names."""
        return {"axis": self.axis, "transaction": self.transaction, "backup": self.backup}

    @property
    def words(self) -> str:
        """As people read it, the next step at the end."""
        return f"{self.code}: {words(self.code, **self.fields)}"

    def as_data(self) -> dict[str, Any]:
        """As JSON data."""
        told = {"transaction": self.transaction, "axis": self.axis, "standing": self.standing}
        return {**told, "backup": self.backup, "loud": self.loud, "what": self.words}


def standing(found: JournalRead) -> Standing:
    """What the journal proves: each word about the switch holds until the next write was announced."""
    if found.broken:
        return "interrupted"
    for entry in reversed(found.entries):
        if entry.kind == "OFF" or (entry.kind == "HELD" and entry.facts.get("on") is False):
            return "off"
        if entry.kind in ("STILL_ON", "HELD"):
            return "still-on"
        if entry.kind in ("DISABLE", "ENABLE", "SWITCH_OFF"):
            return "interrupted"
    return "untouched"


def held_pushes(journals: Path) -> tuple[HeldPush, ...]:
    """Every push of a store that did not end, the loud ones first; not one that somebody is at work with.

    Raises StoreError.
    """
    folders = sorted(path for path in journals.iterdir() if path.is_dir()) if journals.is_dir() else []
    quiet = [folder for folder in folders if not is_held(folder)]
    every = [part for folder in quiet for found in journal.all_of(folder) for part in found.parts]
    left = [found for found in every if not found.finished]
    return tuple(sorted((held_push(found) for found in left), key=lambda one: not one.loud))


def held_push(found: JournalRead) -> HeldPush:
    """One unfinished journal in a word."""
    backup = str(found.latest("path") or "none")
    return HeldPush(found.number, str(found.latest("axis") or ""), standing(found), backup)
