"""Which contents were handed on or refused already: one line each, on disk before anything is said, kept for good."""

from __future__ import annotations

import json
import os
from pathlib import Path

from drivers.local.ownfiles import make_own_folder, open_own, read_own, sync_folder
from gateway.errors import CorruptRecord
from gateway.store.disk import disk_errors

_FOLDER, _FILE = "watch", "journal.jsonl"


class WatchJournal:
    """Contents by their sha256. A line torn by a crash is passed over and what it meant is done again."""

    def __init__(self, root: Path) -> None:
        self._path = Path(root) / _FOLDER / _FILE
        self._known: dict[str, str] = {}
        self._torn = False
        self._load()

    def _load(self) -> None:
        """Raises CorruptRecord (E-STORE-JSON) when a line that was whole is damaged."""
        with disk_errors(self._path):
            make_own_folder(self._path.parent)
            data = read_own(self._path) if self._path.exists() else b""
        whole, _newline, rest = data.rpartition(b"\n")
        self._torn = bool(rest)
        for number, line in enumerate(whole.split(b"\n") if whole else (), start=1):
            try:
                said = json.loads(line)
                self._known[str(said["sha256"])] = str(said["outcome"])
            except (ValueError, KeyError, TypeError) as error:
                if line.endswith(b"~torn"):
                    continue
                raise CorruptRecord("E-STORE-JSON", f"{self._path}:{number}", why=str(error)) from error

    def outcome(self, sha256: str) -> str:
        """The run that holds a content, "refused CODE", or "" when it is not known."""
        return self._known.get(sha256, "")

    def note(self, sha256: str, outcome: str, name: str) -> None:
        """Keep what became of a content; on disk when this returns. Raises StoreError (E-STORE-DISK)."""
        line = json.dumps({"sha256": sha256, "outcome": outcome, "name": name}, ensure_ascii=True) + "\n"
        with disk_errors(self._path):
            new = not self._path.exists()
            with open_own(self._path, "ab") as file:
                file.write((b"~torn\n" if self._torn else b"") + line.encode("ascii"))
                file.flush()
                os.fsync(file.fileno())
            if new:
                sync_folder(self._path.parent)
        self._torn = False
        self._known[sha256] = outcome
