"""Watches a folder: a file that has stopped growing is handed on once, whatever its name, however often we start.

Small files come first, so that nobody waits behind a large one.

Stopped growing: size and time of change have not changed for ``settle_s`` of the clock, nor while it was read.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import ConfigError, FileFormatError, FileUnreadable, TrueflankError
from gateway.errors import StoreError
from gateway.say import Say, silence
from gateway.watch.journal import WatchJournal
from gateway.watch.listing import FolderListing, SeenFile

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
            self._tell(state, "P-WATCH-LINK", name=_shown(seen.name))
            return 0
        if now_s - state.since_s < self._settle_s:
            return 0
        if seen.size > LARGEST_BYTES:
            state.done = True
            error = FileFormatError("E-WATCH-LARGE", _shown(seen.name), bytes=seen.size, limit=LARGEST_BYTES)
            self._tell(state, "P-WATCH-FAILED", name=_shown(seen.name), why=str(error))
            return 0
        return self._hand_on(seen, state, now_s)

    def _hand_on(self, seen: SeenFile, state: _State, now_s: float) -> int:
        try:
            digest = self._listing.digest(seen)
            if not digest:
                state.since_s = now_s
                return 0
            if self._known(seen, state, digest):
                return 0
            run = self._take(self._listing.path(seen.name), digest)
        except (FileUnreadable, ConfigError, StoreError) as error:
            self._failed(seen, state, error, "", now_s)
            return 0
        except FileFormatError as error:
            self._failed(seen, state, error, digest, now_s)
            return 0
        self._journal.note(digest, run, seen.name)
        state.done = True
        self._tell(state, "P-WATCH-IMPORTED", name=_shown(seen.name), run=run)
        return 1

    def _known(self, seen: SeenFile, state: _State, digest: str) -> bool:
        outcome = self._journal.outcome(digest)
        if not outcome:
            return False
        state.done = True
        if not outcome.startswith(REFUSED):
            self._tell(state, "P-WATCH-SAME", name=_shown(seen.name), run=outcome)
        return True

    def _failed(self, seen: SeenFile, state: _State, error: TrueflankError, digest: str, now_s: float) -> None:
        """A content that is wrong is refused for good; what a person can put right elsewhere is tried again."""
        self._tell(state, "P-WATCH-FAILED", name=_shown(seen.name), why=str(error))
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


def _shown(name: str) -> str:
    """A name as it may be printed and logged."""
    return "".join(char if char.isprintable() else "?" for char in name)[:200]
