"""A journal that goes on: what it holds already is not written again, it is followed entry by entry.

Work with a control that files are carried to is begun again from its first step each time files came back. It does the
same again up to where it stood, and the journal is the witness: another entry than the one it holds ends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gateway.errors import StoreError
from gateway.push.records.journal import Entry, Journal, JournalRead
from gateway.push.records.phases import PushEvent

BESIDE = (PushEvent.STOPPED,)
"""Entries that say nothing of what was done: a stop from outside."""


class ReplayedJournal(Journal):
    """A journal whose entries so far are followed, then it grows."""

    _ahead: list[Entry]

    @classmethod
    def follow(cls, found: JournalRead) -> ReplayedJournal:
        """From its first entry. Raises StoreError (E-PUSH-DISK)."""
        made = cls.reopen(found)
        made.follows((found.whole or found).entries)
        return made

    def follows(self, entries: Sequence[Entry]) -> None:
        """What is to be followed."""
        self._ahead = [entry for entry in entries if entry.kind not in BESIDE]

    def append(self, kind: str, **facts: object) -> None:
        """The entry that stands there, else a new one. Raises StoreError (E-PUSH-REPLAY, and as `Journal.append`)."""
        if not self._ahead:
            super().append(kind, **facts)
            return
        held = self._ahead[0]
        if (held.kind, held.of) != (kind, Entry(kind, facts).of):
            raise StoreError("E-PUSH-REPLAY", str(self.path), held=held.kind, now=kind)
        self._ahead.pop(0)

    @property
    def ahead(self) -> tuple[Entry, ...]:
        """The entries that are still to be followed."""
        return tuple(self._ahead)


def replaying(kept: Journal) -> bool:
    """Whether what is done now was done before: entries of the journal are still ahead."""
    return isinstance(kept, ReplayedJournal) and bool(kept.ahead)


def foretold(kept: Journal, kind: str, fact: str) -> Any:
    """What the next entry of a kind that is still ahead says; None where there is none."""
    ahead = kept.ahead if isinstance(kept, ReplayedJournal) else ()
    return next((entry.facts.get(fact) for entry in ahead if entry.kind == kind), None)
