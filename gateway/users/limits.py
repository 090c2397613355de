"""How often something may be tried: a bounded count by key within a stretch of time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

MOST_KEYS = 4096


class Tries:
    """At most ``most`` tries within ``within_s`` for each key; ``now`` counts monotonic seconds."""

    def __init__(self, now: Callable[[], float], most: int, within_s: float) -> None:
        self._now = now
        self._most = most
        self._within_s = within_s
        self._seen: dict[str, deque[float]] = {}

    def wait_s(self, key: str) -> float:
        """Seconds until this key may try again; 0.0 now. Does not count as a try."""
        tries = self._fresh(key)
        return 0.0 if len(tries) < self._most else max(tries[0] + self._within_s - self._now(), 0.0)

    def count(self, key: str) -> None:
        """One try more."""
        if key not in self._seen and len(self._seen) >= MOST_KEYS:
            self._seen.pop(next(iter(self._seen)))
        self._seen.setdefault(key, deque(maxlen=self._most)).append(self._now())

    def forget(self, key: str) -> None:
        """It succeeded: what was tried before does not count any more."""
        self._seen.pop(key, None)

    def _fresh(self, key: str) -> deque[float]:
        tries = self._seen.get(key, deque())
        while tries and tries[0] <= self._now() - self._within_s:
            tries.popleft()
        return tries
