"""The cell's event loop on a busy computer: its time goes on slower instead of jumping.

A machine at 300 times runs out of every deadline of its own while the computer does something else for a second. Time
that the loop was not given does not count: the machine runs slower for a moment, and nobody falls silent.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable
from typing import Any

# What one turn of the loop, and a wait beyond what was asked, may add to the loop's time at most, in seconds.
TURN_S = 0.005
WALL = time.monotonic  # noqa: TID251 - a loop's time comes from somewhere


class PacedTime:
    """The loop's time (s): waits count as long as they were asked for, turns at most `TURN_S`; it never goes back."""

    def __init__(self, wall: Callable[[], float] = WALL) -> None:
        self._wall = wall
        self._base = self._since = wall()

    def now(self) -> float:
        """Seconds, steady."""
        return self._base + min(self._wall() - self._since, TURN_S)

    def count_wait(self, wait: Callable[[float | None], Any], timeout: float | None) -> Any:
        """What ``wait`` (of a timeout in s; None: without end) answers; its time counts as said."""
        self._base, self._since = self.now(), self._wall()
        try:
            return wait(timeout)
        finally:
            now = self._wall()
            took = now - self._since
            self._base += took if timeout is None else min(took, max(timeout, 0.0) + TURN_S)
            self._since = now


class _PacedSelector(selectors.SelectSelector):
    """epoll rounds every wait up to a millisecond, which is 0.3 s of a machine at 300 times; select does not."""

    def __init__(self, pace: PacedTime) -> None:
        super().__init__()
        self._pace = pace

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        return list(self._pace.count_wait(super().select, timeout))


class PacedLoop(asyncio.SelectorEventLoop):
    """A loop whose time is a `PacedTime`."""

    def __init__(self, wall: Callable[[], float] = WALL) -> None:
        self._pace = PacedTime(wall)
        super().__init__(_PacedSelector(self._pace))

    def time(self) -> float:
        """Seconds of the pace."""
        return self._pace.now()
