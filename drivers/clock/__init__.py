"""Time is injected: deadlines, ages and waits come from a clock, wall or virtual, handed in from outside.

The asyncio loop is the clock's source. Under `VirtualTimeLoop` the loop's own time stands still while any
task can run and jumps to the next timer when none can, so a test waits hours in milliseconds and every
library that sleeps on the loop (asyncua, pymodbus) follows without knowing. `HostedTimeLoop` and `JoinedTimeLoop` do
the same for processes that talk over real sockets (`drivers.clock.shared`).
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Protocol

from drivers.clock.deadline import Deadline
from drivers.clock.shared import HostedTimeLoop, JoinedTimeLoop, SharedTimeLoop
from drivers.clock.virtual import VirtualTimeLoop, run_virtual
from drivers.types.uptime import Uptime

__all__ = [
    "Clock",
    "Deadline",
    "HostedTimeLoop",
    "JoinedTimeLoop",
    "LoopClock",
    "SharedTimeLoop",
    "Uptime",
    "VirtualTimeLoop",
    "run_virtual",
]


BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


@functools.cache
def _boot_id() -> str:
    """Which start of this computer it is; "" where the system does not say."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def read_uptime() -> Uptime:
    """How long this computer has been on, its sleep included."""
    counting_sleep = getattr(time, "CLOCK_BOOTTIME", None)
    # Windows' own monotonic clock goes on while the computer sleeps; that of Linux does not.
    seconds = time.monotonic() if counting_sleep is None else time.clock_gettime(counting_sleep)  # noqa: TID251 - here
    return Uptime(_boot_id(), seconds)


class Clock(Protocol):
    """What a room may know of time. Seconds are monotonic; ``utc`` is for records only."""

    def now(self) -> float:
        """Monotonic seconds of this clock."""
        ...

    def utc(self) -> datetime:
        """The moment for records, in UTC."""
        ...

    def uptime(self) -> Uptime:
        """How long this computer has been on: what tells an age although the calendar may be set, or the lid closed."""
        ...

    async def sleep(self, seconds: float) -> None:
        """Wait that many seconds of this clock."""
        ...

    def deadline(self, timeout_s: float, where: str) -> contextlib.AbstractAsyncContextManager[None]:
        """Bound a block; raises `LimitPassed` (E-LINK-DEADLINE) when it takes longer."""
        ...


class LoopClock:
    """The running loop's time times a fixed speed: wall time at speed 1, a fast cell at 100."""

    def __init__(self, speed: float = 1.0, started_utc: datetime | None = None) -> None:
        if speed <= 0:
            raise ValueError("a clock's speed must be positive")
        self.speed = speed
        self._started_utc = started_utc
        self._origin: float | None = None

    def now(self) -> float:
        """Seconds of this clock; starts near zero at first use."""
        loop_time = asyncio.get_running_loop().time()
        if self._origin is None:
            self._origin = loop_time
        return (loop_time - self._origin) * self.speed

    def change_speed(self, speed: float) -> None:
        """Go on from now at another speed; who sleeps already wakes when it would have.

        Raises ValueError for a speed that is not positive.
        """
        if speed <= 0:
            raise ValueError("a clock's speed must be positive")
        reached = self.now()
        self.speed = speed
        self._origin = asyncio.get_running_loop().time() - reached / speed

    def utc(self) -> datetime:
        """UTC now, or the given start plus this clock's seconds."""
        if self._started_utc is None:
            return datetime.now(UTC)
        return self._started_utc + timedelta(seconds=self.now())

    def uptime(self) -> Uptime:
        """That of the system; not known to a clock whose calendar was given."""
        return read_uptime() if self._started_utc is None else Uptime()

    async def sleep(self, seconds: float) -> None:
        """Wait; zero or less gives other tasks one turn."""
        await asyncio.sleep(max(seconds, 0.0) / self.speed)  # noqa: TID251 - the one place

    def deadline(self, timeout_s: float, where: str) -> Deadline:
        """Bound a block of awaits. Raises DeadlineExceeded; cancels from outside pass through."""
        return Deadline(timeout_s / self.speed, timeout_s, where)
