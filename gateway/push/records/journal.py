"""The journal of one transaction: a line is on the disk before what it announces is done.

A line is ``len|seq|prev|json|sha256``: length of the JSON text, number from 0, hash of the line before, the
entry, hash of all that comes before it on the line. A broken last line is torn by a crash and is ignored; a
broken earlier line means the file cannot be believed. Appending blocks for one fsync (well under 10 ms): the
order "journal, then act" is worth more than a free event loop here.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self

from drivers.local.names import stem
from drivers.local.ownfiles import make_own_folder, open_own, read_own
from drivers.message import Message
from drivers.terms import in_todays_words
from gateway.errors import StoreError
from gateway.push.records.phases import FAILED, PushState, state_of

JOURNALS = "journal"
FREE_BYTES = 50_000_000
_START = "0" * 64
_NAME = re.compile(r"tx-(\d{6}|\d{9})\.jnl")


Begun = Callable[[int], bool]


@dataclass(frozen=True, slots=True)
class Entry:
    """One line: what was about to be done, or what is known since."""

    kind: str
    facts: Mapping[str, Any]

    @property
    def of(self) -> tuple[str, ...]:
        """Which tables of its transaction it tells of; "" where there is only one."""
        return tuple(self.facts.get("all", ())) or (str(self.facts.get("of", "")),)


@dataclass(frozen=True, slots=True)
class JournalRead:
    """A journal as found. ``broken`` says why it cannot be believed; ``whole_bytes`` is what is sound.

    Where a transaction holds several tables every entry says ``of`` which; `part` is the view of one of them.
    """

    path: Path
    number: int
    entries: tuple[Entry, ...]
    broken: str = ""
    whole_bytes: int = 0
    last_sha: str = _START
    of: str = ""
    whole: JournalRead | None = None

    @property
    def kinds(self) -> tuple[str, ...]:
        """What happened, in order."""
        return tuple(entry.kind for entry in self.entries)

    @property
    def purpose(self) -> str:
        """What it was begun for; orders on its way back have purposes of their own."""
        return str(self.entries[0].facts.get("purpose", "")) if self.entries else ""

    @property
    def reasons(self) -> tuple[Message, ...]:
        """Why it did not go on as asked, first cause first, each once."""
        told = (_message(one.facts["why"]) for one in self.entries if one.kind in FAILED and one.facts.get("why"))
        return tuple(dict.fromkeys(told))

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do: every table ended, or torn before anything was announced."""
        return not self.broken and all(part.state.phase.final for part in self.parts if part.entries)

    @property
    def state(self) -> PushState:
        """The state of the one table that it tells of, by the table of transitions."""
        return state_of((entry.kind, entry.facts) for entry in self.entries)

    @property
    def said_last(self) -> str:
        """Its newest entry; "nothing" where there is none."""
        return self.entries[-1].kind if self.entries else "nothing"

    @property
    def parts(self) -> tuple[JournalRead, ...]:
        """What it tells of each table, in order; itself where it tells of one, or cannot be believed."""
        names = dict.fromkeys(name for entry in self.entries for name in entry.of if name)
        return tuple(self.part(name) for name in names) if names and not self.broken else (self,)

    def part(self, name: str) -> JournalRead:
        """What it tells of one table of several; itself for no name."""
        if not name:
            return self
        told = tuple(entry for entry in self.entries if name in entry.of)
        return replace(self, entries=told, of=name, whole=self)

    def latest(self, name: str) -> Any:
        """The newest value of a fact, None where it was never noted."""
        for entry in reversed(self.entries):
            if name in entry.facts:
                return entry.facts[name]
        return None


class Journal:
    """A journal being written. After one failed write it takes nothing more: what is on disk is unknown."""

    def __init__(self, path: Path, file: BinaryIO, sequence: int, previous: str) -> None:
        self.path = path
        self._file = file
        self._sequence = sequence
        self._previous = previous
        self._poisoned = False

    @classmethod
    def create(cls, folder: Path, number: int) -> Journal:
        """A new journal. Raises StoreError (E-PUSH-DISK) when the disk is nearly full or refuses."""
        path = folder / f"tx-{number:06d}.jnl"
        try:
            free = shutil.disk_usage(folder).free
            if free < FREE_BYTES:
                raise StoreError("E-PUSH-DISK", str(folder), why=f"{free} bytes free, {FREE_BYTES} needed")
            file = open_own(path, "xb")
            sync_folder(folder)
        except OSError as error:
            raise StoreError("E-PUSH-DISK", str(path), why=str(error)) from error
        return cls(path, file, 0, _START)

    @classmethod
    def reopen(cls, found: JournalRead) -> Self:
        """Go on with a journal; a torn end is cut off. Its end is read afresh: another table's part may have grown."""
        found = read(found.path)
        try:
            file = open_own(found.path, "r+b")
            file.truncate(found.whole_bytes)
            file.seek(found.whole_bytes)
        except OSError as error:
            raise StoreError("E-PUSH-DISK", str(found.path), why=str(error)) from error
        return cls(found.path, file, len(found.entries), found.last_sha)

    def append(self, kind: str, **facts: object) -> None:
        """Make an entry durable. Raises StoreError (E-PUSH-JOURNAL), and from then on always."""
        if self._poisoned:
            raise StoreError("E-PUSH-JOURNAL", str(self.path), why="an earlier write failed")
        line, sha = _line(self._sequence, self._previous, {"kind": kind, **facts})
        self._poisoned = True
        try:
            self._file.write(line)
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise StoreError("E-PUSH-JOURNAL", str(self.path), why=str(error)) from error
        self._poisoned = False
        self._sequence, self._previous = self._sequence + 1, sha

    def close(self) -> None:
        """Let go of the file; never raises. What was accepted is on the disk, what was refused has been told."""
        with contextlib.suppress(OSError):
            self._let_go()

    def _let_go(self) -> None:
        self._file.close()


def _line(sequence: int, previous: str, entry: Mapping[str, object]) -> tuple[bytes, str]:
    text = json.dumps(_finite(entry), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    head = f"{len(text)}|{sequence}|{previous}|{text}|".encode("ascii")
    sha = hashlib.sha256(head).hexdigest()
    return head + sha.encode("ascii") + b"\n", sha


def _message(data: Any) -> Message:
    """A reason as a journal holds it; an older version wrote a sentence."""
    try:
        return Message.from_data(data)
    except (ValueError, TypeError, AttributeError):
        return Message.stored(str(data))


def _finite(value: Any) -> Any:
    """JSON has no NaN or infinity: they are noted as text, so that an odd reading never stops the journal."""
    if isinstance(value, Message):
        return value.as_data()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    return [_finite(item) for item in value] if isinstance(value, (list, tuple)) else value


def read(path: Path) -> JournalRead:
    """Read a journal; never raises for what is in it. Raises StoreError (E-PUSH-DISK) when it cannot be read."""
    try:
        data = read_own(path)
    except OSError as error:
        raise StoreError("E-PUSH-DISK", str(path), why=str(error)) from error
    match = _NAME.fullmatch(path.name)
    found = JournalRead(path, int(match.group(1)) if match else 0, ())
    lines = data.splitlines(keepends=True)
    for number, line in enumerate(lines):
        entry = _entry(line, number, found.last_sha)
        if entry is None:
            last = number == len(lines) - 1
            return found if last else replace(found, broken=f"line {number + 1} of {len(lines)} is damaged")
        sha = line[-65:-1].decode("ascii")
        whole = found.whole_bytes + len(line)
        found = replace(found, entries=(*found.entries, entry), whole_bytes=whole, last_sha=sha)
    return found


def _entry(line: bytes, sequence: int, previous: str) -> Entry | None:
    head, sha = line[:-65], line[-65:-1]
    if not line.endswith(b"\n") or hashlib.sha256(head).hexdigest().encode("ascii") != sha:
        return None
    parts = head.split(b"|", 3)
    if len(parts) != 4 or parts[1:3] != [str(sequence).encode("ascii"), previous.encode("ascii")]:
        return None
    try:
        facts = json.loads(parts[3][:-1])
        return Entry(str(facts.pop("kind")), in_todays_words(facts))
    except (ValueError, KeyError, AttributeError):
        return None


def machine_folder(root: Path, serial: str) -> Path:
    """Where the journals of one machine are kept below a journal root."""
    return root / stem(serial, unique=True)


def all_of(folder: Path) -> tuple[JournalRead, ...]:
    """Every journal of a machine that is still in place, oldest number first."""
    if not folder.is_dir():
        return ()
    paths = [path for path in folder.iterdir() if _NAME.fullmatch(path.name)]
    return tuple(read(path) for path in sorted(paths, key=lambda path: (len(path.name), path.name)))


def numbers(folder: Path) -> frozenset[int]:
    """Numbers of a machine's journals, ended ones as well, by the names of their files."""
    paths = [*folder.glob("tx-*.jnl"), *folder.glob("done/tx-*.jnl")]
    return frozenset(int(match.group(1)) for path in paths if (match := _NAME.fullmatch(path.name)))


def judged(found: JournalRead, begun: Begun | None) -> JournalRead:
    """A journal that says nothing although its transaction had begun is no finished one: it was emptied."""
    if found.entries or found.broken or begun is None or not begun(found.number):
        return found
    return replace(found, broken="it is empty, and the audit log says that its transaction had begun")


def left_open(folder: Path, begun: Begun | None = None) -> tuple[JournalRead, ...]:
    """Journals of a machine that did not end, oldest number first; those put among the ended ones as well.

    ``begun`` says whether a transaction is known elsewhere to have begun.
    """
    every = (judged(found, begun) for found in (*all_of(folder), *all_of(folder / "done")))
    return tuple(found for found in every if not found.finished)


def knows(folder: Path, number: int) -> bool:
    """Whether a transaction number, or that of a restore inside one, was given by this store for the machine."""
    named = f"tx-{number:06d}.jnl"
    if (folder / named).exists() or (folder / "done" / named).exists():
        return True
    return bool(sender(folder, number))


def sender(folder: Path, number: int) -> int:
    """The transaction of a machine's journals that sent this order number; 0 where none did."""
    every = (*all_of(folder), *reversed(all_of(folder / "done")))
    return next((found.number for found in every if number in orders_of(found)), 0)


def orders_of(found: JournalRead) -> frozenset[int]:
    """Every number this journal sent to the controller, its own among them."""
    sent = (entry.facts.get("order") for entry in (found.whole or found).entries)
    return frozenset((found.number, *(number for number in sent if isinstance(number, int))))


def tidy(folder: Path, begun: Begun | None = None) -> tuple[JournalRead, ...]:
    """Set ended journals aside that a crash left in place; returns them. ``begun`` as for `left_open`."""
    left = tuple(found for found in all_of(folder) if judged(found, begun).finished)
    for found in left:
        set_aside(found.path)
    return left


def set_aside(path: Path) -> None:
    """Move an ended journal to `done`, never delete it; where that is refused it stays and is still read."""
    if path.parent.name == "done":
        return
    done = path.parent / "done"
    try:
        make_own_folder(done)
        os.replace(path, done / path.name)
        sync_folder(done)
        sync_folder(path.parent)
    except OSError:
        return


def sync_folder(folder: Path) -> None:
    """Make a new or renamed file durable; Windows has no way to ask for it."""
    if sys.platform == "win32":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
