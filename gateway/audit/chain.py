"""The log as a chain of records: each line carries its own hash and that of the line before.

A record is one line of canonical JSON: keys sorted, no spaces, ASCII. Its hash is the SHA-256 of the line's bytes
without the member ``hash`` and the line end. The head is number and hash of the last record; `head` on the disk names
the last record known to be there, so that a lost end shows.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from threading import Event
from typing import Any, Literal

from drivers.local.ownfiles import open_own, read_own, sync_folder
from gateway.errors import BusyError, CorruptRecord
from gateway.push import hold_lock
from gateway.store import disk_errors, read_whole, write_whole

Role = Literal["operator", "approver", "service", "program"]
START = "0" * 64
TORN = "torn-line"
CORRECTION = "correction"
_HEAD = re.compile(r"(\d{1,12}):([0-9a-f]{64})")
# Members are sorted by name, so what stands behind ``hash`` is fixed; no text before it can look like it, because
# a quote inside a text is escaped.
_LINE = re.compile(
    rb'(\{"action":".*),"hash":"([0-9a-f]{64})"'
    rb'(,"monotonic_s":.*,"prev_hash":"([0-9a-f]{64})","process":\d+,"role":"[a-z]+","seq":(\d+),"serial":".*\})'
)


@dataclass(frozen=True, slots=True)
class ChainHead:
    """The end of a chain: number and hash of its last record; ``seq`` 0 is a log without records."""

    seq: int = 0
    hash: str = START

    def __str__(self) -> str:
        return f"{self.seq}:{self.hash}"


@dataclass(frozen=True, slots=True)
class AuditEvent:
    """What was done: by whom, as what, to which machine, in which transaction; hashes of plan, old and new table.

    ``details`` values are texts, numbers or truth values.
    """

    action: str
    actor: str
    role: Role = "operator"
    serial: str = ""
    transaction: int = 0
    plan_hash: str = ""
    base_hash: str = ""
    new_hash: str = ""
    details: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """A record as kept. ``monotonic_s`` counts in the process named by ``process``: it does not jump with the date.

    ``clock`` is what the computer knew of its own clock then (`gateway.audit.recording`); empty in older records.
    """

    seq: int
    utc: str
    monotonic_s: float
    process: int
    software: str
    happening: AuditEvent
    prev_hash: str
    hash: str = ""
    clock: Mapping[str, object] = field(default_factory=dict)

    def as_data(self) -> dict[str, Any]:
        """The record as JSON data, as it stands in its line."""
        data: dict[str, Any] = {**asdict(self), **asdict(self.happening)}
        del data["happening"]
        if not self.clock:
            del data["clock"]
        data["details"] = {str(key): _plain(value) for key, value in self.happening.details.items()}
        return data


def _plain(value: object) -> object:
    if isinstance(value, (str, bool, int)) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return str(value)


def encode_line(entry: AuditEntry) -> tuple[bytes, ChainHead]:
    """The record's line with its line end, and the head of the chain it makes; ``entry.hash`` is ignored."""
    data = entry.as_data()
    del data["hash"]
    digest = hashlib.sha256(_canonical(data)).hexdigest()
    return _canonical({**data, "hash": digest}) + b"\n", ChainHead(entry.seq, digest)


def _canonical(data: object) -> bytes:
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.encode("ascii")


def next_head(line: bytes, before: ChainHead) -> ChainHead | None:
    """The head after this line (without its end), or None when it is damaged or does not follow ``before``."""
    found = _LINE.fullmatch(line)
    if found is None:
        return None
    digest = found[2].decode("ascii")
    if hashlib.sha256(found[1] + found[3]).hexdigest() != digest:
        return None
    same_chain = int(found[5]) == before.seq + 1 and found[4].decode("ascii") == before.hash
    return ChainHead(before.seq + 1, digest) if same_chain else None


def head_of_line(line: bytes) -> ChainHead | None:
    """The head that a sound line (without its end) states, whatever stands before it; None when it is damaged."""
    found = _LINE.fullmatch(line)
    if found is None:
        return None
    return next_head(line, ChainHead(int(found[5]) - 1, found[4].decode("ascii")))


def parse_head(text: str) -> ChainHead:
    """A head as exported, ``number:hash`` or the hash alone (number 0). Raises CorruptRecord (E-AUDIT-HEAD)."""
    found = _HEAD.fullmatch(text.strip())
    if found is not None:
        return ChainHead(int(found[1]), found[2])
    if re.fullmatch(r"[0-9a-f]{64}", text.strip()):
        return ChainHead(0, text.strip())
    raise CorruptRecord("E-AUDIT-HEAD", "head", found=text.strip()[:80] or "nothing")


def torn_facts(fragment: bytes) -> dict[str, object]:
    """What the record about a torn end says of it."""
    return {"bytes": len(fragment), "sha256": hashlib.sha256(fragment).hexdigest()}


def describes_fragment(line: bytes, fragment: bytes) -> bool:
    """Whether a line is the record about exactly this torn end."""
    return is_torn_record(line) and _canonical(torn_facts(fragment))[1:-1] in line


def is_torn_record(line: bytes) -> bool:
    """Whether a line is a record about a torn end."""
    return line.startswith(b'{"action":"torn-line",')


# A record is on the disk before the call returns; one process writes at a time.
#
# Files ``audit-000001.jsonl`` ... are never altered and never deleted; a new one begins when the last is large.
# ``head`` names the last record known to be on the disk, so that a lost end shows. The end of a line that a crash tore
# stays where it is: the next file begins with a record about it.

AUDIT = "audit"
HEAD = "head"
ROTATE_BYTES = 1_000_000
_TRIES = 500
_PAUSE_S = 0.01


@dataclass(frozen=True, slots=True)
class Tail:
    """Where the next record goes: ``path`` the last file, ``fragment`` torn ends that no record speaks of yet."""

    head: ChainHead
    number: int
    size: int
    fragment: bytes


def append(root: Path, entry: AuditEntry, rotate_bytes: int = ROTATE_BYTES) -> ChainHead:
    """Add a record to the log below ``root``, numbered and chained here; returns the new head once it is durable.

    Raises CorruptRecord (E-AUDIT-BROKEN) when the end of the log is not sound, StoreError (E-STORE-DISK),
    BusyError (E-AUDIT-BUSY).
    """
    folder = root / AUDIT
    with _hold_log(folder):
        tail = tail_of(folder)
        if tail.fragment:
            program = AuditEvent(TORN, "trueflank", "program", details=torn_facts(tail.fragment))
            about = replace(entry, happening=program)
            tail = _write_line(folder, tail.number + 1, 0, tail.head, about)
        new_file = tail.number == 0 or tail.size >= rotate_bytes
        number, size = (tail.number + 1, 0) if new_file else (tail.number, tail.size)
        return _write_line(folder, number, size, tail.head, entry).head


def _write_line(folder: Path, number: int, size: int, before: ChainHead, entry: AuditEntry) -> Tail:
    line, head = encode_line(replace(entry, seq=before.seq + 1, prev_hash=before.hash))
    path = folder / file_name(number)
    if not (folder / HEAD).exists():
        write_whole(folder / HEAD, f"{before}\n".encode("ascii"))
    with disk_errors(path):
        with open_own(path, "ab") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        sync_folder(folder)
    write_whole(folder / HEAD, f"{head}\n".encode("ascii"))
    return Tail(head, number, size + len(line), b"")


@contextlib.contextmanager
def _hold_log(folder: Path) -> Iterator[None]:
    """Hold the log's lock; another process has it for milliseconds, so a few seconds are waited."""
    with contextlib.ExitStack() as stack:
        for attempt in range(_TRIES):
            try:
                stack.enter_context(hold_lock(folder))
                break
            except BusyError as error:
                if attempt == _TRIES - 1:
                    raise BusyError("E-AUDIT-BUSY", str(folder), holder=error.fields.get("holder", "")) from error
                Event().wait(_PAUSE_S)
        yield


def tail_of(folder: Path) -> Tail:
    """The log's end. Raises CorruptRecord (E-AUDIT-BROKEN) when it is not what `head` says."""
    paths = audit_files(folder)
    kept = read_head_file(folder)
    known = parse_head_file(kept) if kept is not None else None
    fragment = b""
    size = _size(paths[-1]) if paths else 0
    for path in reversed(paths):
        *lines, rest = read_log_file(path).split(b"\n")
        fragment = rest + fragment
        if lines:
            found = head_of_line(lines[-1])
            _require_known_end(found, known, path)
            return Tail(found or ChainHead(), len(paths), size, fragment)
    _require_known_end(ChainHead(), known, folder)
    return Tail(ChainHead(), len(paths), size, fragment)


def _require_known_end(found: ChainHead | None, known: ChainHead | None, path: Path) -> None:
    """A crash between a record and `head` leaves `head` one behind; anything else is a break."""
    behind = found is not None and known is not None and found.seq == known.seq + 1
    nothing_yet = known is None and found == ChainHead()
    if not (found == known or behind or nothing_yet):
        raise CorruptRecord("E-AUDIT-BROKEN", str(path), why=f"{HEAD}: {known}, {path.name}: {found}")


def file_name(number: int) -> str:
    """Name of a log file, numbered from 1."""
    return f"audit-{number:06d}.jsonl"


def audit_files(folder: Path) -> list[Path]:
    """The log's files in order; none where there is no log yet. Raises StoreError (E-STORE-DISK)."""
    with disk_errors(folder):
        try:
            names = os.listdir(folder)
        except FileNotFoundError:
            return []
    return [folder / name for name in sorted(names) if name.startswith("audit-") and name.endswith(".jsonl")]


def read_head_file(folder: Path) -> bytes | None:
    """The head file as it is; None where there is none. Raises StoreError (E-STORE-DISK)."""
    with disk_errors(folder / HEAD):
        try:
            return read_own(folder / HEAD)
        except FileNotFoundError:
            return None


def parse_head_file(text: bytes) -> ChainHead:
    """What a head file says. Raises CorruptRecord (E-AUDIT-HEAD) when it is damaged."""
    told = text.decode("ascii", "replace")
    head = parse_head(told)
    if told != f"{head}\n":
        raise CorruptRecord("E-AUDIT-HEAD", HEAD, found=told[:80])
    return head


def read_log_file(path: Path) -> bytes:
    """A file of the log. Raises StoreError (E-STORE-DISK)."""
    return read_whole(path)


def _size(path: Path) -> int:
    with disk_errors(path):
        return path.stat().st_size


# For people to read: a damaged line is shown as such and hides no other.


def read_entries(root: Path) -> Iterator[dict[str, Any]]:
    """Every record in order as JSON data; ``damaged`` is true where a line does not match its own hash."""
    for path in audit_files(root / AUDIT):
        lines = read_log_file(path).split(b"\n")[:-1]
        for number, line in enumerate(lines, 1):
            yield _read_line(line, f"{path.name}:{number}")


def _read_line(line: bytes, place: str) -> dict[str, Any]:
    if head_of_line(line) is None:
        return {"place": place, "damaged": True, "text": line.decode("ascii", "replace")}
    return {**json.loads(line), "place": place, "damaged": False}
