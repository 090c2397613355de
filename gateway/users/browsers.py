"""Browsers that somebody has signed in with before: a stranger's tries elsewhere must not keep them out."""

from __future__ import annotations

import secrets

from drivers.local.names import person_key
from gateway.users.passwords import token_digest

MOST_KNOWN = 500


class KnownBrowsers:
    """Random keys that browsers keep, each with the names that signed in there; kept in memory, bounded."""

    def __init__(self) -> None:
        self._known: dict[str, set[str]] = {}

    def knows(self, key: str, name: str) -> bool:
        """Whether this name has signed in with this browser since the service began."""
        return person_key(name) in self._known.get(token_digest(key), ())

    def remember(self, key: str, name: str) -> str:
        """The browser's key, a new one where it has none that is known; its name is kept with it."""
        if token_digest(key) not in self._known:
            key = secrets.token_urlsafe(24)
            if len(self._known) >= MOST_KNOWN:
                self._known.pop(next(iter(self._known)))
        self._known.setdefault(token_digest(key), set()).add(person_key(name))
        return key
