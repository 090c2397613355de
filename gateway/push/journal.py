"""The journal of one transaction: a line is on the disk before what it announces is done.

A line is ``len|seq|prev|json|sha256``: length of the JSON text, number from 0, hash of the line before, the
entry, hash of all that comes before it on the line. A broken last line is torn by a crash and is ignored; a
broken earlier line means the file cannot be believed. Appending blocks for one fsync (well under 10 ms): the
order "journal, then act" is worth more than a free event loop here.

Next to it: the replay of a journal whose work waited for carried files, the numbers of transactions, and the lock that
lets one process at a time write to a machine.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
import secrets
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self

from drivers.local.names import stem
from drivers.local.ownfiles import make_own_folder, open_own, read_own, sync_folder
from drivers.message import Message
from drivers.terms import with_current_keys
from gateway.errors import BusyError, StoreError
from gateway.push.phases import FAILED, PushEvent, PushState, state_of

JOURNALS = "journal"
FREE_BYTES = 50_000_000
_START = "0" * 64
_NAME = re.compile(r"tx-(\d{6}|\d{9})\.jnl")


BegunCheck = Callable[[int], bool]


@dataclass(frozen=True, slots=True)
class Entry:
    """One line: what was about to be done, or what is known since."""

    kind: str
    facts: Mapping[str, Any]

    @property
    def of(self) -> tuple[str, ...]:
        """Which tables of its transaction it tells of; "" where there is only one."""
        return tuple(self.facts.get("all", ())) or (str(self.facts.get("of", "")),)


@contextlib.contextmanager
def _kept_open(file: BinaryIO) -> Iterator[BinaryIO]:
    """A file that stays open behind the block, unless the block fails: then nobody else would close it."""
    try:
        yield file
    except BaseException:
        file.close()
        raise


@dataclass(frozen=True, slots=True)
class JournalRead:
    """A journal as found. ``broken`` says why it cannot be believed; ``whole_bytes`` is what is sound.

    Where a transaction holds several tables every entry says ``of`` which; `part` is the view of one of them.
    """

    path: Path
    number: int
    entries: tuple[Entry, ...]
    broken: str | Message = ""
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
    def is_ended(self) -> bool:
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
            with _kept_open(open_own(path, "xb")) as file:
                sync_folder(folder)
        except OSError as error:
            raise StoreError("E-PUSH-DISK", str(path), why=str(error)) from error
        return cls(path, file, 0, _START)

    @classmethod
    def reopen(cls, found: JournalRead) -> Self:
        """Go on with a journal; a torn end is cut off. Its end is read afresh: another table's part may have grown."""
        found = read(found.path)
        try:
            with _kept_open(open_own(found.path, "r+b")) as file:
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
    text = json.dumps(_json_safe(entry), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    head = f"{len(text)}|{sequence}|{previous}|{text}|".encode("ascii")
    sha = hashlib.sha256(head).hexdigest()
    return head + sha.encode("ascii") + b"\n", sha


def _message(data: Any) -> Message:
    """A reason as a journal holds it; an older version wrote a sentence."""
    try:
        return Message.from_data(data)
    except (ValueError, TypeError, AttributeError):
        return Message.stored(str(data))


def _json_safe(value: Any) -> Any:
    """JSON has no NaN or infinity: they are noted as text, so that an odd reading never stops the journal."""
    if isinstance(value, Message):
        return value.as_data()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {key: _json_safe(item) for key, item in value.items()}
    return [_json_safe(item) for item in value] if isinstance(value, (list, tuple)) else value


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
            return (
                found
                if last
                else replace(found, broken=Message.of("W-JOURNAL-LINE", line=number + 1, count=len(lines)))
            )
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
        return Entry(str(facts.pop("kind")), with_current_keys(facts))
    except (ValueError, KeyError, AttributeError):
        return None


def machine_folder(root: Path, serial: str) -> Path:
    """Where the journals of one machine are kept below a journal root."""
    return root / stem(serial, unique=True)


def read_journals(folder: Path) -> tuple[JournalRead, ...]:
    """Every journal of a machine that is still in place, oldest number first."""
    if not folder.is_dir():
        return ()
    paths = [path for path in folder.iterdir() if _NAME.fullmatch(path.name)]
    return tuple(read(path) for path in sorted(paths, key=lambda path: (len(path.name), path.name)))


def journal_numbers(folder: Path) -> frozenset[int]:
    """Numbers of a machine's journals, ended ones as well, by the names of their files."""
    paths = [*folder.glob("tx-*.jnl"), *folder.glob("done/tx-*.jnl")]
    return frozenset(int(match.group(1)) for path in paths if (match := _NAME.fullmatch(path.name)))


def mark_emptied(found: JournalRead, begun: BegunCheck | None) -> JournalRead:
    """A journal that says nothing although its transaction had begun is no finished one: it was emptied."""
    if found.entries or found.broken or begun is None or not begun(found.number):
        return found
    return replace(found, broken=Message.of("W-JOURNAL-EMPTY"))


def unfinished_journals(folder: Path, begun: BegunCheck | None = None) -> tuple[JournalRead, ...]:
    """Journals of a machine that did not end, oldest number first; those put among the ended ones as well.

    ``begun`` says whether a transaction is known elsewhere to have begun.
    """
    every = (mark_emptied(found, begun) for found in (*read_journals(folder), *read_journals(folder / "done")))
    return tuple(found for found in every if not found.is_ended)


def is_known_number(folder: Path, number: int) -> bool:
    """Whether a transaction number, or that of a restore inside one, was given by this store for the machine."""
    named = f"tx-{number:06d}.jnl"
    if (folder / named).exists() or (folder / "done" / named).exists():
        return True
    return bool(sending_transaction(folder, number))


def sending_transaction(folder: Path, number: int) -> int:
    """The transaction of a machine's journals that sent this order number; 0 where none did."""
    every = (*read_journals(folder), *reversed(read_journals(folder / "done")))
    return next((found.number for found in every if number in order_numbers(found)), 0)


def order_numbers(found: JournalRead) -> frozenset[int]:
    """Every number this journal sent to the controller, its own among them."""
    sent = (entry.facts.get("order") for entry in (found.whole or found).entries)
    return frozenset((found.number, *(number for number in sent if isinstance(number, int))))


def set_ended_aside(folder: Path, begun: BegunCheck | None = None) -> tuple[JournalRead, ...]:
    """Set ended journals aside that a crash left in place; returns them. ``begun`` as for `unfinished_journals`."""
    left = tuple(found for found in read_journals(folder) if mark_emptied(found, begun).is_ended)
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


# Work with a control that files are carried to starts again from its first step each time files come back. It repeats
# the same steps up to where it was; the journal is followed entry by entry instead of being written, and another entry
# than the recorded one ends the work.

IGNORED_EVENTS = (PushEvent.STOPPED,)
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
        self._ahead = [entry for entry in entries if entry.kind not in IGNORED_EVENTS]

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


def is_replaying(kept: Journal) -> bool:
    """Whether what is done now was done before: entries of the journal are still ahead."""
    return isinstance(kept, ReplayedJournal) and bool(kept.ahead)


def replayed_value(kept: Journal, kind: str, fact: str) -> Any:
    """What the next entry of a kind that is still ahead says; None where there is none."""
    ahead = kept.ahead if isinstance(kept, ReplayedJournal) else ()
    return next((entry.facts.get(fact) for entry in ahead if entry.kind == kind), None)


# A transaction number is four digits of the store and a count, so that two stores never give the same one; it is given
# once and is exact in an R parameter.

PART_SIZE = 100_000  # a number is the store's part and a count: 4 and 5 digits
MAX_COUNT = PART_SIZE - 1
MAX_NUMBER = 9999 * PART_SIZE + MAX_COUNT
OLD_MAX = 999_999  # numbers once had no part
PART = ".part"  # no serial number makes a folder of this name
_FIRST_PART, _PARTS = 1000, 9000


def allocate_number(folder: Path, seed: int) -> int:
    """The next transaction number of a machine, durable before it is used; an R parameter holds it exactly.

    Its first four digits are the store's own, so that two stores give no number twice. ``seed`` begins the count
    where none was ever kept, so that a lost folder does not repeat numbers that the control may still hold.
    Raises StoreError (E-PUSH-DISK).
    """
    counter = folder / "number"
    try:
        part = _store_part(folder.parent)
        last = max([_read_number(counter), *_numbers_in_use(folder)], default=0)
        count = last % PART_SIZE if last else seed % (PART_SIZE // 2)
        while True:
            count = count % MAX_COUNT + 1
            number = part * PART_SIZE + count
            if not (folder / f"tx-{number}.jnl").exists() and not (folder / "done" / f"tx-{number}.jnl").exists():
                break
        _write_number(counter, number)
    except OSError as error:
        raise StoreError("E-PUSH-DISK", str(counter), why=str(error)) from error
    return number


def is_own_number(folder: Path, number: int) -> bool:
    """Whether the store that a machine's journals are kept in gave this number, by the part it carries."""
    kept = _read_number(folder.parent / PART)
    return _FIRST_PART <= kept == number // PART_SIZE


def _store_part(root: Path) -> int:
    """The store's own part of its numbers, drawn once and kept."""
    kept = _read_number(root / PART)
    if not _FIRST_PART <= kept < _FIRST_PART + _PARTS:
        kept = _FIRST_PART + secrets.randbelow(_PARTS)
        _write_number(root / PART, kept)
    return kept


def _read_number(counter: Path) -> int:
    try:
        text = read_own(counter).decode("ascii").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        return 0
    return int(text) if text.isdigit() and int(text) <= MAX_NUMBER else 0


def _numbers_in_use(folder: Path) -> list[int]:
    """Numbers of all journals; only asked for when the counter was lost or runs behind."""
    return [] if _read_number(folder / "number") else sorted(journal_numbers(folder))


def _write_number(counter: Path, number: int) -> None:
    temporary = counter.with_name(f".number.{secrets.token_hex(4)}")
    with open_own(temporary, "xb") as file:
        file.write(str(number).encode("ascii"))
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, counter)
    sync_folder(counter.parent)


# One push per machine. A lock of the operating system, because a killed process cannot leave it behind.

# Windows forbids reading a locked byte, so the byte locked lies beyond the holder's name.
_BYTE = 1024
# Who only asks whether a lock is held takes it for some microseconds.
TRIES = 100


@contextlib.contextmanager
def machine_lock(folder: Path) -> Iterator[None]:
    """Hold a machine's lock and, above it, the gateway's: one push at a time, whatever the machine.

    Raises BusyError (E-PUSH-BUSY) naming the holder, StoreError (E-PUSH-DISK).
    """
    with hold_lock(folder), hold_lock(folder.parent):
        yield


@contextlib.contextmanager
def hold_lock(folder: Path) -> Iterator[None]:
    """Hold one folder's lock. Raises BusyError (E-PUSH-BUSY) naming the holder, StoreError (E-PUSH-DISK)."""
    path = folder / "lock"
    try:
        make_own_folder(folder)
        file = open_own(path, "a+b")
    except OSError as error:
        raise StoreError("E-PUSH-DISK", str(path), why=str(error)) from error
    with file:
        if not any(_lock(file) for _ in range(TRIES)):
            raise BusyError("E-PUSH-BUSY", str(folder), holder=_holder(path))
        _write_holder(file)
        try:
            yield
        finally:
            _unlock(file)


def is_lock_held(folder: Path) -> bool:
    """Whether somebody, this process included, holds a folder's lock. Raises StoreError (E-PUSH-DISK)."""
    try:
        file = open_own(folder / "lock", "r+b")
    except FileNotFoundError:
        return False
    except OSError as error:
        raise StoreError("E-PUSH-DISK", str(folder), why=str(error)) from error
    with file:
        taken = _lock(file)
        if taken:
            _unlock(file)
        return not taken


def _holder(path: Path) -> str:
    try:
        return read_own(path)[:80].decode("ascii", "replace").strip() or "unknown"
    except OSError:
        return "unknown"


def _write_holder(file: BinaryIO) -> None:
    with contextlib.suppress(OSError):
        file.truncate(0)
        file.write(f"process {os.getpid()}\n".encode("ascii"))
        file.flush()


if sys.platform == "win32":
    import msvcrt

    def _take(file: BinaryIO) -> bool:
        file.seek(_BYTE)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _give_back(file: BinaryIO) -> None:
        file.seek(_BYTE)
        with contextlib.suppress(OSError):
            msvcrt.locking(file.fileno(), msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _lock(file: BinaryIO) -> bool:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def _unlock(file: BinaryIO) -> None:
        fcntl.flock(file.fileno(), fcntl.LOCK_UN)
