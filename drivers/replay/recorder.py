"""Wire traces: their form and their files of bounded size; a full disk ends the trace, never the measuring."""

from __future__ import annotations

import contextlib
import json
import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

from drivers.clock import Clock
from drivers.errors import ConfigError, FileFormatError
from drivers.local.names import allowed, is_name, shown
from drivers.local.ownfiles import make_own_folder, open_own
from drivers.local.scrub import without_secrets, without_user
from drivers.message import Message

# A trace file's form: one line of JSON about the device, then records of direction, clock time and bytes, pure.
#
# A record is 13 bytes little-endian (direction, seconds of the gateway's clock as a double, length) and its bytes.
# Directions: "<" from the device, ">" to it, "#" a new opening. A torn last record is left out.

FORM = 1
_RECORD = struct.Struct("<cdI")
LONGEST = 1 << 26
Direction = Literal["<", ">", "#"]
_SECRET_BYTES = re.compile(rb'("[^"]{0,40}(?:pass|secret|token|credential)[^"]{0,40}"\s*:\s*)"[^"\n]*"', re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Record:
    """Bytes that passed at a clock time in s."""

    direction: Direction
    at_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Trace:
    """A file's records, and what it says of the device: driver, name, url, settings, when."""

    about: Mapping[str, Any]
    records: tuple[Record, ...]

    def sessions(self) -> tuple[tuple[Record, ...], ...]:
        """The records of each opening; those before the first mark are one too."""
        found: list[list[Record]] = [[]]
        for record in self.records:
            if record.direction == "#":
                found.append([])
            else:
                found[-1].append(record)
        return tuple(tuple(session) for session in found if session)


def encode_head(about: Mapping[str, Any]) -> bytes:
    """The first line of a file."""
    said = {"trueflank_trace": FORM, **about, "url": without_user(str(about.get("url", "")))}
    return json.dumps(said, default=str).encode("utf-8") + b"\n"


def encode_record(record: Record) -> bytes:
    """A record as bytes; passwords that pass in JSON are hidden."""
    data = _SECRET_BYTES.sub(rb'\1"***"', record.data) if b'"' in record.data else record.data
    return _RECORD.pack(record.direction.encode(), record.at_s, len(data)) + data


def read_trace(files: Iterable[bytes], where: str) -> Trace:
    """Files of one trace, the oldest first. Raises FileFormatError (E-REPLAY-FILE) with place and reason."""
    about: Mapping[str, Any] = {}
    records: list[Record] = []
    for data in files:
        end = data.find(b"\n") + 1
        about = _about(data[:end], where)
        records += _records(data, end, where)
    return Trace(about, tuple(records))


def _about(line: bytes, where: str) -> Mapping[str, Any]:
    try:
        about = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise FileFormatError("E-REPLAY-FILE", where, line=1, why=str(error)) from error
    if not isinstance(about, dict) or about.get("trueflank_trace") != FORM:
        raise FileFormatError("E-REPLAY-FILE", where, line=1, why=Message.of("W-REPLAY-FIRST-LINE"))
    return about


def _records(data: bytes, at: int, where: str) -> list[Record]:
    found = []
    while len(data) - at >= _RECORD.size:
        mark, at_s, length = _RECORD.unpack_from(data, at)
        if mark not in (b"<", b">", b"#") or length > LONGEST or not abs(at_s) < 1e12:
            raise FileFormatError("E-REPLAY-FILE", where, line=1, why=Message.of("W-REPLAY-NO-RECORD", at=at))
        begin = at + _RECORD.size
        if len(data) < begin + length:
            break
        direction: Direction = "<" if mark == b"<" else ">" if mark == b">" else "#"
        found.append(Record(direction, at_s, data[begin : begin + length]))
        at = begin + length
    return found


# Keeps what passes on a device's wire in files of bounded size; a full disk ends the trace, never the measuring.

FILE_BYTES = 16 << 20
FILES = 4


class TraceRecorder:
    """A device's ``trace``: called with ">" or "<" and bytes. NAME.trace is the newest file, NAME.trace.3 the oldest.

    ``failure`` says why it stopped, "" while it works. Raises ConfigError (E-NAME) when NAME is none.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        clock: Clock,
        about: Mapping[str, Any],
        *,
        file_bytes: int = FILE_BYTES,
        files: int = FILES,
    ) -> None:
        if not is_name(name):
            raise ConfigError("E-NAME", str(folder), name=shown(name), allowed=allowed())
        self.path = folder / f"{name}.trace"
        self.failure = ""
        self._clock = clock
        self._file_bytes = file_bytes
        self._files = files
        said = {**about, "device": name, "started_utc": clock.utc().isoformat(timespec="milliseconds")}
        self._head = encode_head({**said, "settings": without_secrets(about.get("settings", {}))})
        self._file: BinaryIO | None = None
        self._size = 0
        with self._kept():
            make_own_folder(folder)
            self._begin()

    def _kept(self) -> contextlib.AbstractContextManager[None]:
        return _Kept(self)

    def stop(self, why: str) -> None:
        """Record no more."""
        self.failure = self.failure or why
        self.close()

    def _begin(self) -> None:
        self._file = open_own(self.path, "wb")
        self._size = self._file.write(self._head)

    def session(self) -> None:
        """Mark that the device is opened (again)."""
        self._put(Record("#", self._clock.now(), b""))

    def __call__(self, direction: Literal["<", ">"], data: bytes) -> None:
        """Keep a piece."""
        self._put(Record(direction, self._clock.now(), data))

    def _put(self, record: Record) -> None:
        if self._file is None:
            return
        with self._kept():
            self._size += self._file.write(encode_record(record))
            if self._size >= self._file_bytes:
                self._rotate()

    def _rotate(self) -> None:
        self.close()
        for number in range(self._files - 1, 0, -1):
            older = self._numbered(number)
            newer = self._numbered(number - 1)
            if newer.exists():
                newer.replace(older)
        self._begin()

    def _numbered(self, number: int) -> Path:
        return self.path if number == 0 else self.path.with_name(f"{self.path.name}.{number}")

    def close(self) -> None:
        """Let go of the file; may be called twice."""
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):
                file.close()


class _Kept(contextlib.AbstractContextManager[None]):
    """What the disk refuses ends the trace."""

    def __init__(self, recorder: TraceRecorder) -> None:
        self._recorder = recorder

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> bool:
        if not isinstance(error, OSError):
            return False
        self._recorder.stop(str(error))
        return True
