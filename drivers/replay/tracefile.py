"""A trace file's form: one line of JSON about the device, then records of direction, clock time and bytes, pure.

A record is 13 bytes little-endian (direction, seconds of the gateway's clock as a double, length) and its bytes.
Directions: "<" from the device, ">" to it, "#" a new opening. A torn last record is left out.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from drivers.errors import FileFormatError
from drivers.local.scrub import without_user

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


def head(about: Mapping[str, Any]) -> bytes:
    """The first line of a file."""
    said = {"trueflank_trace": FORM, **about, "url": without_user(str(about.get("url", "")))}
    return json.dumps(said, default=str).encode("utf-8") + b"\n"


def encode(record: Record) -> bytes:
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
        raise FileFormatError("E-REPLAY-FILE", where, line=1, why="its first line is not that of a trace")
    return about


def _records(data: bytes, at: int, where: str) -> list[Record]:
    found = []
    while len(data) - at >= _RECORD.size:
        mark, at_s, length = _RECORD.unpack_from(data, at)
        if mark not in (b"<", b">", b"#") or length > LONGEST or not abs(at_s) < 1e12:
            raise FileFormatError("E-REPLAY-FILE", where, line=1, why=f"no record begins at byte {at}")
        begin = at + _RECORD.size
        if len(data) < begin + length:
            break
        direction: Direction = "<" if mark == b"<" else ">" if mark == b">" else "#"
        found.append(Record(direction, at_s, data[begin : begin + length]))
        at = begin + length
    return found
