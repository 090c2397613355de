"""What unfinished journals say of the switch, without asking the control: the word that stands first everywhere."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from drivers.errors import words
from gateway.push import journal
from gateway.push.journal import JournalRead

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
    def words(self) -> str:
        """As people read it, the next step at the end."""
        code = _CODES[self.standing]
        return f"{code}: {words(code, axis=self.axis, transaction=self.transaction, backup=self.backup)}"

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
    """Every push that did not end, of all machines of a store, the loud ones first. Raises StoreError."""
    folders = sorted(journals.iterdir()) if journals.is_dir() else []
    left = [found for folder in folders for found in journal.all_of(folder) if not found.finished]
    return tuple(sorted((held_push(found) for found in left), key=lambda one: not one.loud))


def held_push(found: JournalRead) -> HeldPush:
    """One unfinished journal in a word."""
    backup = str(found.latest("path") or "none")
    return HeldPush(found.number, str(found.latest("axis") or ""), standing(found), backup)
