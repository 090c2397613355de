"""Appends to the log so that a record is on the disk before the call returns, one process at a time.

Files ``audit-000001.jsonl`` ... are never altered and never deleted; a new one begins when the last is large. ``head``
names the last record known to be on the disk, so that a lost end shows. The end of a line that a crash tore stays
where it is: the next file begins with a record about it.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event

from drivers.local.ownfiles import open_own, read_own
from gateway.audit.entries import TORN, AuditEntry, ChainHead, Happening, head_of, head_of_line, line_of, torn_facts
from gateway.errors import BusyError, CorruptRecord
from gateway.push.records.lock import held
from gateway.store.disk import disk_errors, read_whole, sync_folder, write_whole

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
    with _alone(folder):
        tail = tail_of(folder)
        if tail.fragment:
            program = Happening(TORN, "trueflank", "program", details=torn_facts(tail.fragment))
            about = replace(entry, happening=program)
            tail = _written(folder, tail.number + 1, 0, tail.head, about)
        new_file = tail.number == 0 or tail.size >= rotate_bytes
        number, size = (tail.number + 1, 0) if new_file else (tail.number, tail.size)
        return _written(folder, number, size, tail.head, entry).head


def _written(folder: Path, number: int, size: int, before: ChainHead, entry: AuditEntry) -> Tail:
    line, head = line_of(replace(entry, seq=before.seq + 1, prev_hash=before.hash))
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
def _alone(folder: Path) -> Iterator[None]:
    """Hold the log's lock; another process has it for milliseconds, so a few seconds are waited."""
    with contextlib.ExitStack() as stack:
        for attempt in range(_TRIES):
            try:
                stack.enter_context(held(folder))
                break
            except BusyError as error:
                if attempt == _TRIES - 1:
                    raise BusyError("E-AUDIT-BUSY", str(folder), holder=error.fields.get("holder", "")) from error
                Event().wait(_PAUSE_S)
        yield


def tail_of(folder: Path) -> Tail:
    """The log's end. Raises CorruptRecord (E-AUDIT-BROKEN) when it is not what `head` says."""
    paths = files(folder)
    kept = kept_text(folder)
    known = head_in(kept) if kept is not None else None
    fragment = b""
    size = _size(paths[-1]) if paths else 0
    for path in reversed(paths):
        *lines, rest = content(path).split(b"\n")
        fragment = rest + fragment
        if lines:
            found = head_of_line(lines[-1])
            _believe(found, known, path)
            return Tail(found or ChainHead(), len(paths), size, fragment)
    _believe(ChainHead(), known, folder)
    return Tail(ChainHead(), len(paths), size, fragment)


def _believe(found: ChainHead | None, known: ChainHead | None, path: Path) -> None:
    """A crash between a record and `head` leaves `head` one behind; anything else is a break."""
    behind = found is not None and known is not None and found.seq == known.seq + 1
    nothing_yet = known is None and found == ChainHead()
    if not (found == known or behind or nothing_yet):
        raise CorruptRecord("E-AUDIT-BROKEN", str(path), why=f"{HEAD}: {known}, {path.name}: {found}")


def file_name(number: int) -> str:
    """Name of a log file, numbered from 1."""
    return f"audit-{number:06d}.jsonl"


def files(folder: Path) -> list[Path]:
    """The log's files in order; none where there is no log yet. Raises StoreError (E-STORE-DISK)."""
    with disk_errors(folder):
        try:
            names = os.listdir(folder)
        except FileNotFoundError:
            return []
    return [folder / name for name in sorted(names) if name.startswith("audit-") and name.endswith(".jsonl")]


def kept_text(folder: Path) -> bytes | None:
    """The head file as it is; None where there is none. Raises StoreError (E-STORE-DISK)."""
    with disk_errors(folder / HEAD):
        try:
            return read_own(folder / HEAD)
        except FileNotFoundError:
            return None


def head_in(text: bytes) -> ChainHead:
    """What a head file says. Raises CorruptRecord (E-AUDIT-HEAD) when it is damaged."""
    told = text.decode("ascii", "replace")
    head = head_of(told)
    if told != f"{head}\n":
        raise CorruptRecord("E-AUDIT-HEAD", HEAD, found=told[:80])
    return head


def content(path: Path) -> bytes:
    """A file of the log. Raises StoreError (E-STORE-DISK)."""
    return read_whole(path)


def _size(path: Path) -> int:
    with disk_errors(path):
        return path.stat().st_size
