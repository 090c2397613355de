"""Who is signed in: kept in memory alone, ended by leaving, by time and by a restart."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass

from drivers.local.names import person_key
from gateway.users.records import Person

LONGEST_S = 12 * 3600.0
MOST = 200
MOST_SHOWN = 120


@dataclass(slots=True)
class Session:
    """One sign-in. ``csrf`` must come back in a header with whatever changes something.

    ``id`` names it to its person and opens nothing; ``address`` and ``browser`` say where it was begun.
    """

    person: Person
    csrf: str
    begun_s: float
    seen_s: float
    id: str = ""
    address: str = ""
    browser: str = ""


class Sessions:
    """Sessions by a random key that only the browser's cookie holds."""

    def __init__(self, now: Callable[[], float], idle_s: float) -> None:
        """``now`` counts seconds that no calendar moves, a sleeping computer's included (`drivers.clock.Clock.uptime`).

        Who asks for nothing during ``idle_s`` is signed out.
        """
        self._now = now
        self.idle_s = idle_s
        self._open: dict[str, Session] = {}

    def begin(self, person: Person, address: str = "", browser: str = "") -> tuple[str, Session]:
        """A new session and its key; the oldest one goes where there are too many."""
        self._sweep()
        if len(self._open) >= MOST:
            del self._open[min(self._open, key=lambda key: self._open[key].seen_s)]
        key, now = secrets.token_urlsafe(32), self._now()
        place = {"id": secrets.token_hex(8), "address": address, "browser": browser[:MOST_SHOWN]}
        self._open[key] = Session(person, secrets.token_urlsafe(24), now, now, **place)
        return key, self._open[key]

    def find(self, key: str, *, touch: bool = True) -> Session | None:
        """The session of a key that has not run out; to ask for it keeps it open, unless told otherwise."""
        found = self._open.get(key)
        if found is None or self._is_over(found):
            self._open.pop(key, None)
            return None
        if touch:
            found.seen_s = self._now()
        return found

    def end(self, key: str) -> None:
        """Sign out."""
        self._open.pop(key, None)

    def of(self, name: str) -> tuple[Session, ...]:
        """A person's sessions, the one that was used last first."""
        self._sweep()
        wanted = person_key(name)
        found = (one for one in self._open.values() if person_key(one.person.name) == wanted)
        return tuple(sorted(found, key=lambda one: -one.seen_s))

    def end_of(self, name: str, ended: str = "", but: str = "") -> int:
        """Sign a person out everywhere, or of the session ``ended`` alone, never of ``but``; how many ended."""
        gone = {one.id for one in self.of(name) if ended in ("", one.id) and one.id != but}
        self._open = {key: one for key, one in self._open.items() if one.id not in gone}
        return len(gone)

    def age_s(self, session: Session) -> tuple[float, float]:
        """Seconds since a session was begun, and since it was used last."""
        now = self._now()
        return now - session.begun_s, now - session.seen_s

    def left_s(self, session: Session) -> float:
        """Seconds until a session ends where nothing is asked for."""
        now = self._now()
        return max(min(session.seen_s + self.idle_s, session.begun_s + LONGEST_S) - now, 0.0)

    def _is_over(self, session: Session) -> bool:
        return self.left_s(session) <= 0.0

    def _sweep(self) -> None:
        self._open = {key: one for key, one in self._open.items() if not self._is_over(one)}
