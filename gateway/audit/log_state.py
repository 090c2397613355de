"""What the log says now: which lines it holds, what was proposed, approved, used, begun, and what alarms stand."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.message import Message
from gateway.audit.chain import AUDIT, audit_files, read_entries, tail_of
from gateway.store import disk_errors

BEGUN, ENDING = "push-begun", "push-ending"
PROPOSED, APPROVED, USED = "propose", "approve", "approval-used"
DIFFERS, AS_PUSHED = "table-differs", "table-as-pushed"
MARKER_LOST = "push-marker-lost"
# What a line of this kind leaves in the control's marker; None leaves whatever stood there.
_MARKER_LEFT: Mapping[str, bool] = {"committed": True, "held": True, "none": False}


@dataclass(slots=True)
class LogState:
    """One machine's part of a log, but for ``prefixes``: the first 64 bits of every line's hash.

    ``plans`` are (plan hash, hash of the stored proposal) pairs that were proposed, each with the keys and signatures
    of its lines; ``approved`` (each with the number of its line) and ``used`` hashes of
    approvals; ``begun`` transactions, ``announced`` those of them with a journal; ``last_mark`` the transaction whose
    end the control's marker should still name (0 none); ``alarms`` what was found at each table at the last look, where
    it was not as pushed; ``looked`` when each table was compared last (UTC), ``kinds`` what was found then.
    ``marker_lost`` are axis, transaction and reason where the control's marker could not be written last.
    ``peaks`` are the lines (number, UTC) after which no later time comes, of ``lines`` in all.
    """

    prefixes: set[int] = field(default_factory=set)
    plans: dict[tuple[str, str], set[tuple[str, str]]] = field(default_factory=dict)
    approved: dict[str, int] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    begun: set[int] = field(default_factory=set)
    announced: set[int] = field(default_factory=set)
    last_mark: int = 0
    alarms: dict[str, Message] = field(default_factory=dict)
    looked: dict[str, str] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    marker_lost: dict[str, str] = field(default_factory=dict)
    lines: int = 0
    peaks: list[tuple[int, str]] = field(default_factory=list)

    def latest_since(self, approval: str) -> str:
        """The latest time (UTC) of all lines from an approval's own on; "" where the log does not know it."""
        since = self.approved.get(approval)
        return "" if since is None else self.peaks[bisect_left(self.peaks, (since, ""))][1]

    def take(self, entry: Mapping[str, Any], serial: str) -> None:
        """One more line of the log; of another machine only its hash."""
        self.prefixes.add(int(entry["hash"][:16], 16))
        self.lines += 1
        utc = str(entry["utc"])
        while self.peaks and self.peaks[-1][1] <= utc:
            self.peaks.pop()
        self.peaks.append((self.lines, utc))
        if serial and entry["serial"] != serial:
            return
        action, details, number = str(entry["action"]), entry["details"], int(entry["transaction"])
        if number:
            self.begun.add(number)
        if action == BEGUN:
            self.announced.add(number)
        if action == PROPOSED:
            signed = (str(details.get("key", "")), str(details.get("signature", "")))
            self.plans.setdefault((entry["plan_hash"], str(details.get("proposal", ""))), set()).add(signed)
        elif action == APPROVED:
            self.approved[str(details.get("approval", ""))] = self.lines
        elif action == USED:
            self.used.add(str(details.get("approval", "")))
        elif action == ENDING:
            self.last_mark = number if _MARKER_LEFT.get(str(details.get("state")), False) else 0
            self.marker_lost = {}
        elif action == MARKER_LOST:
            told = {"axis": details.get("table", ""), "transaction": number, "why": details.get("why", "")}
            self.marker_lost = {key: str(value) for key, value in told.items()}
        else:
            self._take_table(action, str(details.get("table", "")), entry)

    def _take_table(self, action: str, table: str, entry: Mapping[str, Any]) -> None:
        """Comparisons, and what ends an alarm: the table was written anew."""
        if action in (DIFFERS, AS_PUSHED):
            self.looked[table] = str(entry["utc"])
            self.kinds[table] = str(entry["details"].get("kind", "differs" if action == DIFFERS else "as-approved"))
        if action == DIFFERS:
            self.alarms[table] = _found(entry["details"])
        elif action in (AS_PUSHED, "push-committed", "rollback-committed"):
            self.alarms.pop(table, None)


def _found(details: Mapping[str, Any]) -> Message:
    """What a comparison found; of an older version the finished text."""
    try:
        return Message.from_data(json.loads(str(details["said"])))
    except (KeyError, ValueError):
        return Message.stored(str(details.get("found", "")))


def read_log_state(root: Path, serial: str = "") -> LogState:
    """Read the log below ``root`` for one machine (all: ""); damaged lines count for nothing.

    Raises StoreError (E-STORE-DISK).
    """
    found = LogState()
    for entry in read_entries(root):
        if not entry["damaged"]:
            found.take(entry, serial)
    return found


def file_sizes(root: Path) -> tuple[tuple[str, int], ...]:
    """The files of the log with their sizes: these change with every line. Raises StoreError (E-STORE-DISK)."""
    with disk_errors(root):
        return tuple((path.name, path.stat().st_size) for path in audit_files(root / AUDIT))


def current_head(root: Path) -> str:
    """The head of the log as it stands. Raises CorruptRecord (E-AUDIT-BROKEN), StoreError."""
    return str(tail_of(root / AUDIT).head)
