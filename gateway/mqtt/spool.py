"""A bounded queue on the disk: messages wait here, numbered, until they are confirmed; a kill loses none.

Pieces ``000000000001.jsonl`` ... begin at the number in their name. ``standing.json`` says which number was confirmed
last and how many were ever dropped; after a kill it may be behind, then a few are sent twice under the same number.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.local.ownfiles import make_own_folder, open_own, read_own
from gateway.errors import StoreError

PIECE_BYTES = 1 << 20
STANDING = "standing.json"


@dataclass(frozen=True, slots=True)
class Waiting:
    """A message: its number, its topic, whether it stays at the server as the newest word, and what it says."""

    number: int
    topic: str
    stays: bool
    data: Mapping[str, Any]


@dataclass(slots=True)
class _Piece:
    path: Path
    first: int
    count: int
    size: int

    @property
    def last(self) -> int:
        return self.first + self.count - 1


class Spool:
    """The queue of one site. Every call may come from a thread of its own. Raises StoreError (E-MQTT-QUEUE)."""

    def __init__(self, folder: Path, most_bytes: int, piece_bytes: int = PIECE_BYTES) -> None:
        self._folder, self._most, self._piece = folder, most_bytes, min(piece_bytes, max(most_bytes // 4, 1))
        self._lock = threading.Lock()
        self._pieces: list[_Piece] = []
        self._at = (0, 0)
        self.confirmed = 0
        self.dropped = 0
        self._load()

    @property
    def queued(self) -> int:
        """How many wait."""
        return self._pieces[-1].last - self.confirmed if self._pieces else 0

    def _load(self) -> None:
        try:
            make_own_folder(self._folder)
            standing = _json_of(self._folder / STANDING)
            self.confirmed, self.dropped = (int(standing.get(key, 0)) for key in ("confirmed", "dropped"))
            for path in sorted(self._folder.glob("[0-9]*.jsonl")):
                self._pieces.append(_piece_of(path))
        except OSError as error:
            raise _refused(self._folder, error) from error
        self._pieces = [one for one in self._pieces if one.count or one is self._pieces[-1]]
        if self._pieces:
            # A gap is what could not be kept, and was counted then.
            self.confirmed = max(self.confirmed, self._pieces[0].first - 1)
        self._forget_confirmed()

    def put(self, messages: Sequence[tuple[str, bool, Mapping[str, Any]]]) -> None:
        """Keep messages (topic, stays, data) durably in their order; where there is no room the oldest go, counted."""
        with self._lock:
            try:
                for message in messages:
                    self._put(message)
                self._sync()
            except OSError as error:
                raise _refused(self._folder, error) from error

    def _put(self, message: tuple[str, bool, Mapping[str, Any]]) -> None:
        number = self._pieces[-1].last + 1 if self._pieces else self.confirmed + 1
        topic, stays, data = message
        told = {"number": number, "topic": topic, "stays": stays, "data": data}
        line = json.dumps(told, default=str).encode("ascii") + b"\n"
        if not self._pieces or self._pieces[-1].size + len(line) > self._piece:
            self._sync()
            path = self._folder / f"{number:012d}.jsonl"
            self._pieces.append(_Piece(path, number, 0, 0))
        piece = self._pieces[-1]
        with open_own(piece.path, "ab", buffering=0) as file:
            file.truncate(piece.size)  # what a full disk left of the message before
            file.write(line)
        piece.count, piece.size = piece.count + 1, piece.size + len(line)
        self._make_room()

    def _make_room(self) -> None:
        while sum(one.size for one in self._pieces) > self._most and len(self._pieces) > 1:
            oldest = self._pieces.pop(0)
            self.dropped += max(oldest.last - max(self.confirmed, oldest.first - 1), 0)
            self.confirmed = max(self.confirmed, oldest.last)
            oldest.path.unlink(missing_ok=True)
            self._keep_standing()

    def _sync(self) -> None:
        if self._pieces and self._pieces[-1].path.exists():
            with open_own(self._pieces[-1].path, "ab") as file:
                os.fsync(file.fileno())

    def lose(self, count: int) -> None:
        """So many could not even be queued."""
        with self._lock:
            self.dropped += count
            self._keep_standing()

    def next(self, most: int = 100) -> list[Waiting]:
        """The oldest that wait, in their order."""
        with self._lock:
            try:
                return self._next(most)
            except OSError as error:
                raise _refused(self._folder, error) from error

    def _next(self, most: int) -> list[Waiting]:
        piece = next((one for one in self._pieces if one.last > self.confirmed), None)
        if piece is None:
            return []
        offset = self._at[1] if self._at[0] == piece.first else 0
        found: list[Waiting] = []
        with open_own(piece.path, "rb") as file:
            file.seek(offset)
            while len(found) < most and file.tell() < piece.size:
                before, line = file.tell(), json.loads(file.readline())
                if line["number"] > self.confirmed:
                    if not found:
                        self._at = (piece.first, before)
                    found.append(Waiting(line["number"], line["topic"], line["stays"], line["data"]))
        return found

    def confirm(self, number: int) -> None:
        """All up to this number have arrived."""
        with self._lock:
            self.confirmed = max(self.confirmed, number)
            self._forget_confirmed()
            self._keep_standing()

    def _forget_confirmed(self) -> None:
        while len(self._pieces) > 1 and self._pieces[0].last <= self.confirmed:
            self._pieces.pop(0).path.unlink(missing_ok=True)

    def _keep_standing(self) -> None:
        """Without waiting for the disk: what a power cut makes old is sent again."""
        new = self._folder / f"{STANDING}.new"
        try:
            with open_own(new, "wb") as file:
                file.write(json.dumps({"confirmed": self.confirmed, "dropped": self.dropped}).encode("ascii"))
            os.replace(new, self._folder / STANDING)
        except OSError as error:
            raise _refused(self._folder, error) from error


def _piece_of(path: Path) -> _Piece:
    """A piece as it stands; what a crash tore off its end is cut away."""
    data = read_own(path)
    size = data.rfind(b"\n") + 1
    if size < len(data):
        with open_own(path, "r+b") as file:
            file.truncate(size)
    return _Piece(path, int(path.stem), data.count(b"\n"), size)


def _json_of(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(read_own(path))
    except (FileNotFoundError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _refused(folder: Path, error: OSError) -> StoreError:
    return StoreError("E-MQTT-QUEUE", str(folder), why=error.strerror or str(error))
