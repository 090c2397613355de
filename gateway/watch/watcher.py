"""Watches a folder: a file that has stopped growing is handed on once, whatever its name, however often we start.

Plain files only, links are never followed, and nothing in the folder is changed. A content is known by its sha256; the
journal keeps on disk what became of it before anything is said, so a restart hands nothing on twice.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import stat
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from drivers.clock import Clock
from drivers.errors import ConfigError, FileFormatError, FileUnreadable, TrueflankError
from drivers.local.ownfiles import make_own_folder, open_own, read_own, sync_folder
from gateway.errors import CorruptRecord, StoreError
from gateway.say import Say, silence
from gateway.store import disk_errors

# Watches a folder: a file that has stopped growing is handed on once, whatever its name, however often we start.
#
# Small files come first, so that nobody waits behind a large one.
#
# Stopped growing: size and time of change have not changed for ``settle_s`` of the clock, nor while it was read.

REFUSED = "refused "
LARGEST_BYTES = 2 << 30
"""Larger files are not read at all, not even for their hash."""
# Takes a file of this content (path, sha256) and returns the run that holds it.
Take = Callable[[Path, str], str]


@dataclass(slots=True)
class _State:
    """What is known of a name: its stamp, since when, whether this stamp is dealt with, what was said of it."""

    stamp: tuple[int, int]
    since_s: float
    done: bool = False
    said: str = ""


class Watcher:
    """One folder. ``endings`` (with their dot, lower case) are the files that matter; others are not looked at."""

    def __init__(
        self,
        listing: FolderListing,
        journal: WatchJournal,
        take: Take,
        endings: Collection[str],
        *,
        settle_s: float = 5.0,
        say: Say = silence,
    ) -> None:
        self._listing = listing
        self._journal = journal
        self._take = take
        self._endings = frozenset(endings)
        self._settle_s = settle_s
        self._say = say
        self._states: dict[str, _State] = {}
        self._folder_said = ""

    @property
    def waiting(self) -> int:
        """How many files are still awaited: growing, or to be tried again."""
        return sum(not state.done for state in self._states.values())

    def look(self, now_s: float) -> int:
        """One look at the folder at a moment of the clock; returns how many files were newly handed on.

        Whatever is wrong with a file is said once (P-WATCH-...), never raised. Raises StoreError when the
        journal cannot be written: then nothing is known to be done.
        """
        entries = self._entries()
        if entries is None:
            return 0
        self._states = {one.name: self._states[one.name] for one in entries if one.name in self._states}
        return sum(self._consider(one, now_s) for one in entries)

    def _entries(self) -> tuple[SeenFile, ...] | None:
        try:
            found = self._listing.entries()
        except ConfigError as error:
            if self._folder_said != str(error):
                self._folder_said = str(error)
                self._say("P-WATCH-FOLDER", why=error.what)
            return None
        self._folder_said = ""
        return tuple(sorted((one for one in found if self._matters(one)), key=lambda one: (one.size, one.name)))

    def _matters(self, seen: SeenFile) -> bool:
        ending = Path(seen.name).suffix.lower()
        return ending in self._endings and not seen.name.startswith((".", "~"))

    def _consider(self, seen: SeenFile, now_s: float) -> int:
        state = self._states.get(seen.name)
        if state is None or state.stamp != seen.stamp:
            self._states[seen.name] = state = _State(seen.stamp, now_s)
        if state.done:
            return 0
        if not seen.plain:
            state.done = True
            self._tell(state, "P-WATCH-LINK", name=_printable_name(seen.name))
            return 0
        if now_s - state.since_s < self._settle_s:
            return 0
        if seen.size > LARGEST_BYTES:
            state.done = True
            error = FileFormatError("E-WATCH-LARGE", _printable_name(seen.name), bytes=seen.size, limit=LARGEST_BYTES)
            self._tell(state, "P-WATCH-FAILED", name=_printable_name(seen.name), why=str(error))
            return 0
        return self._hand_on(seen, state, now_s)

    def _hand_on(self, seen: SeenFile, state: _State, now_s: float) -> int:
        try:
            digest = self._listing.digest(seen)
            if not digest:
                state.since_s = now_s
                return 0
            if self._is_known_content(seen, state, digest):
                return 0
            run = self._take(self._listing.path(seen.name), digest)
        except (FileUnreadable, ConfigError, StoreError) as error:
            self._record_failure(seen, state, error, "", now_s)
            return 0
        except FileFormatError as error:
            self._record_failure(seen, state, error, digest, now_s)
            return 0
        self._journal.note(digest, run, seen.name)
        state.done = True
        self._tell(state, "P-WATCH-IMPORTED", name=_printable_name(seen.name), run=run)
        return 1

    def _is_known_content(self, seen: SeenFile, state: _State, digest: str) -> bool:
        outcome = self._journal.outcome(digest)
        if not outcome:
            return False
        state.done = True
        if not outcome.startswith(REFUSED):
            self._tell(state, "P-WATCH-SAME", name=_printable_name(seen.name), run=outcome)
        return True

    def _record_failure(self, seen: SeenFile, state: _State, error: TrueflankError, digest: str, now_s: float) -> None:
        """A content that is wrong is refused for good; what a person can put right elsewhere is tried again."""
        self._tell(state, "P-WATCH-FAILED", name=_printable_name(seen.name), why=str(error))
        if digest and error.code != "E-IMPORT-CHANGED":
            self._journal.note(digest, f"{REFUSED}{error.code}", seen.name)
            state.done = True
        else:
            state.since_s = now_s

    def _tell(self, state: _State, code: str, **fields: object) -> None:
        said = f"{code} {fields}"
        if state.said != said:
            state.said = said
            self._say(code, **fields)

    async def watch(self, clock: Clock, stop: asyncio.Event, poll_s: float = 2.0) -> None:
        """Look every ``poll_s`` until ``stop``; the looking itself does not hold up other tasks."""
        while not stop.is_set():
            await asyncio.to_thread(self.look, clock.now())
            pause = asyncio.ensure_future(clock.sleep(poll_s))
            ending = asyncio.ensure_future(stop.wait())
            try:
                await asyncio.wait((pause, ending), return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in (pause, ending):
                    task.cancel()
                await asyncio.gather(pause, ending, return_exceptions=True)


def _printable_name(name: str) -> str:
    """A name as it may be printed and logged."""
    return "".join(char if char.isprintable() else "?" for char in name)[:200]


# What lies in a folder, and its bytes: plain files only, links are never followed, nothing is ever changed.

CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class SeenFile:
    """One entry of a folder. ``plain`` is false for links, folders and devices."""

    name: str
    size: int
    mtime_ns: int
    plain: bool = True

    @property
    def stamp(self) -> tuple[int, int]:
        """What changes while a file grows."""
        return self.size, self.mtime_ns


class FolderListing(Protocol):
    """A folder as the watcher needs it."""

    def entries(self) -> tuple[SeenFile, ...]:
        """What is there now. Raises ConfigError (E-WATCH-FOLDER)."""
        ...

    def digest(self, seen: SeenFile) -> str:
        """sha256 of a file that is still as seen, "" when it is not. Raises FileUnreadable (E-FILE-READ)."""
        ...

    def path(self, name: str) -> Path:
        """Where a name of this folder is."""
        ...


class Folder:
    """A real folder; folders inside it are not looked into."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def entries(self) -> tuple[SeenFile, ...]:
        """See `FolderListing.entries`; an entry that vanishes meanwhile is left out."""
        found: list[SeenFile] = []
        try:
            with os.scandir(self._root) as scan:
                for entry in scan:
                    seen = _seen_file(entry)
                    if seen is not None:
                        found.append(seen)
        except OSError as error:
            raise ConfigError("E-WATCH-FOLDER", str(self._root), why=error.strerror or str(error)) from error
        return tuple(sorted(found, key=lambda one: one.name))

    def path(self, name: str) -> Path:
        """See `FolderListing.path`. Raises ConfigError (E-WATCH-NAME) for what would leave the folder."""
        if name in ("", ".", "..") or any(mark in name for mark in ("/", "\\", "\0")):
            raise ConfigError("E-WATCH-NAME", str(self._root), name=repr(name))
        return self._root / name

    def digest(self, seen: SeenFile) -> str:
        """See `FolderListing.digest`."""
        path = self.path(seen.name)
        try:
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
            with os.fdopen(descriptor, "rb") as file:
                before = os.fstat(descriptor)
                if not stat.S_ISREG(before.st_mode) or (before.st_size, before.st_mtime_ns) != seen.stamp:
                    return ""
                digest = hashlib.sha256()
                while piece := file.read(CHUNK):
                    digest.update(piece)
                after = os.fstat(descriptor)
        except OSError as error:
            raise FileUnreadable("E-FILE-READ", str(path), why=error.strerror or str(error)) from error
        return digest.hexdigest() if (after.st_size, after.st_mtime_ns) == seen.stamp else ""


def _seen_file(entry: os.DirEntry[str]) -> SeenFile | None:
    try:
        facts = entry.stat(follow_symlinks=False)
    except FileNotFoundError:
        return None
    return SeenFile(entry.name, facts.st_size, facts.st_mtime_ns, stat.S_ISREG(facts.st_mode))


# Which contents were handed on or refused already: one line each, on disk before anything is said, kept for good.

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
