"""Time is injected: deadlines, ages and waits come from a clock, wall or virtual, handed in from outside.

The asyncio loop is the clock's source. Under `VirtualTimeLoop` the loop's own time stands still while any
task can run and jumps to the next timer when none can, so a test waits hours in milliseconds and every
library that sleeps on the loop (asyncua, pymodbus) follows without knowing.
"""

from __future__ import annotations

import asyncio
import contextlib
import selectors
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from concurrent.futures import Executor
from datetime import UTC, datetime, timedelta
from typing import Any, Protocol, TypeVar

from drivers.errors import DeadlineExceeded

T = TypeVar("T")


class Clock(Protocol):
    """What a room may know of time. Seconds are monotonic; ``utc`` is for records only."""

    def now(self) -> float:
        """Monotonic seconds of this clock."""
        ...

    def utc(self) -> datetime:
        """The moment for records, in UTC."""
        ...

    async def sleep(self, seconds: float) -> None:
        """Wait that many seconds of this clock."""
        ...

    def deadline(self, timeout_s: float, where: str) -> contextlib.AbstractAsyncContextManager[None]:
        """Bound a block; raises `DeadlineExceeded` (E-LINK-DEADLINE) when it takes longer."""
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

    def utc(self) -> datetime:
        """UTC now, or the given start plus this clock's seconds."""
        if self._started_utc is None:
            return datetime.now(UTC)
        return self._started_utc + timedelta(seconds=self.now())

    async def sleep(self, seconds: float) -> None:
        """Wait; zero or less gives other tasks one turn."""
        await asyncio.sleep(max(seconds, 0.0) / self.speed)  # noqa: TID251 - the one place

    @contextlib.asynccontextmanager
    async def deadline(self, timeout_s: float, where: str) -> AsyncIterator[None]:
        """Bound a block of awaits. Raises DeadlineExceeded; cancels from outside pass through."""
        try:
            async with asyncio.timeout(timeout_s / self.speed):  # noqa: TID251 - the one place
                yield
        except TimeoutError as error:
            raise DeadlineExceeded("E-LINK-DEADLINE", where, timeout_s=timeout_s) from error


class _JumpingSelector(selectors.BaseSelector):
    """Waits a fraction of a millisecond for real I/O, then jumps the loop's clock to the next timer."""

    GRACE_S = 0.0002

    def __init__(self, loop: VirtualTimeLoop) -> None:
        self._loop = loop
        self._inner = selectors.DefaultSelector()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None or self._loop.threads_at_work:
            return self._inner.select(0.001 if self._loop.threads_at_work else timeout)
        if timeout <= 0:
            return self._inner.select(0)
        # Only the loop's own wake-up socket: nothing outside can be on its way to us.
        alone = len(self._inner.get_map()) <= 1
        ready = self._inner.select(0)
        if not ready and not alone:
            # Sockets of other threads or processes get a moment; epoll itself would wait a whole millisecond.
            time.sleep(self.GRACE_S)  # noqa: TID251 - the one place
            ready = self._inner.select(0)
        if not ready:
            self._loop.jump(timeout)
        return ready

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._inner.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.modify(fileobj, events, data)

    def get_map(self) -> Any:
        return self._inner.get_map()

    def close(self) -> None:
        self._inner.close()


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose time moves only when every task waits."""

    def __init__(self) -> None:
        self._virtual_s = 1000.0
        self.threads_at_work = 0
        super().__init__(_JumpingSelector(self))

    def time(self) -> float:
        """Virtual seconds."""
        return self._virtual_s

    def jump(self, seconds: float) -> None:
        """Move virtual time forward; only the selector calls this."""
        self._virtual_s += seconds

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        """Run in a thread and hold time still until it is done."""
        self.threads_at_work += 1
        future = super().run_in_executor(executor, func, *args)
        future.add_done_callback(self._thread_done)
        return future

    async def shutdown_default_executor(self, *args: Any, **options: Any) -> None:
        """End the threads and hold time still meanwhile: newer Pythons give them a time limit of the loop's."""
        self.threads_at_work += 1
        try:
            await super().shutdown_default_executor(*args, **options)
        finally:
            self.threads_at_work -= 1

    def _thread_done(self, _future: asyncio.Future[Any]) -> None:
        self.threads_at_work -= 1


def run_virtual(main: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine function to its end in virtual time, on a loop of its own."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main())
