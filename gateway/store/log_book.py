"""The full record of what happened, a JSON object a line: time, level, run, device, code, words; turned over by size.

It is for people who ask afterwards. Nothing rests on it: what a run found stands in its folder, who did what in the
audit log. So a log that cannot be written stops nothing; it is said once, at the end.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from drivers.errors import words
from drivers.local.ownfiles import make_own_folder, open_own, read_own

FOLDER, NAME = "logs", "trueflank.log"
LARGEST_BYTES, KEPT = 4_000_000, 5
DEVICE = ("device", "axis", "instrument", "part", "site")


class LogBook:
    """The log of one store; several processes may write it, a line at a time. ``problem`` is why it stopped ("")."""

    def __init__(self, store: Path, utc: Callable[[], datetime], largest_bytes: int = LARGEST_BYTES) -> None:
        self._root, self.path = Path(store), self.place(store)
        self.problem = ""
        self._utc, self._largest = utc, largest_bytes

    @staticmethod
    def place(store: Path) -> Path:
        """Where the log of a store lies."""
        return Path(store) / FOLDER / NAME

    def add(self, level: str, code: str, fields: Mapping[str, object], *, run: str = "", where: str = "") -> None:
        """Keep one line; never raises. A store that is not there yet is not made for it."""
        if self.problem or not self._root.is_dir():
            return
        device = where or next((str(fields[key]) for key in DEVICE if fields.get(key)), "")
        line = {
            "utc": self._utc().isoformat(timespec="milliseconds"),
            "level": level,
            "run": run,
            "device": device,
            "code": code,
            "words": words(code, **fields),
            "fields": {key: value if isinstance(value, (int, float)) else str(value) for key, value in fields.items()},
        }
        try:
            self._append(json.dumps(line).encode("ascii") + b"\n")
        except OSError as error:
            self.problem = error.strerror or str(error)

    def _append(self, line: bytes) -> None:
        make_own_folder(self.path.parent)
        if self.path.exists() and self.path.stat().st_size + len(line) > self._largest:
            self._turn_over()
        with open_own(self.path, "ab", buffering=0) as file:
            file.write(line)

    def _turn_over(self) -> None:
        names = [self.path, *(self.path.with_name(f"{NAME}.{number}") for number in range(1, KEPT))]
        for older, newer in zip(reversed(names), reversed(names[:-1]), strict=False):
            if newer.exists():
                newer.replace(older)


def lines_of(store: Path) -> Iterator[dict[str, Any]]:
    """Every line kept, oldest first; a line that a crash cut short is left out. Raises OSError for a link."""
    folder = Path(store) / FOLDER
    numbered = [folder / f"{NAME}.{number}" for number in range(KEPT - 1, 0, -1)]
    for path in (*numbered, folder / NAME):
        if path.exists():
            yield from parse_lines(read_own(path))


def parse_lines(data: bytes) -> Iterator[dict[str, Any]]:
    """The whole lines of some bytes of a log."""
    for line in data.splitlines():
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict):
            yield found


class LogTail:
    """What is added to a log from now on."""

    def __init__(self, path: Path) -> None:
        self._path, self._older = path, path.with_name(f"{NAME}.1")
        self._file, self._seen = _file_state(path)
        self._begun = b""

    def new(self) -> list[dict[str, Any]]:
        """The lines that were finished since the last time; what a log that turned over still held among them."""
        file, size = _file_state(self._path)
        data = b""
        if file != self._file:
            data = self._rest(self._older) if _file_state(self._older)[0] == self._file else b""
            self._file, self._seen = file, 0
        data += self._rest(self._path) if size > self._seen else b""
        whole, _, self._begun = (self._begun + data).rpartition(b"\n")
        return list(parse_lines(whole))

    def _rest(self, path: Path) -> bytes:
        with open_own(path, "rb") as file:
            file.seek(self._seen)
            data = file.read()
            self._seen = file.tell()
        return data


def _file_state(path: Path) -> tuple[int, int]:
    """Which file stands there, and its size; zeros for none."""
    return (found.st_ino, found.st_size) if path.exists() and (found := path.stat()) else (0, 0)
