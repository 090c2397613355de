"""Work in threads under a loop whose time is not the wall's: time stands still meanwhile, and the order is the same.

Everything that waits for threads is told in the order in which the work was given, once the loop can do nothing else,
so that it does not matter how fast each thread was.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar

T = TypeVar("T")
# A thread that does nothing for so long waits for something that only the loop can do, or for a person: the others go
# on then. One that works is waited for, however busy the computer is: its processor time tells.
PATIENCE_S = 5.0
WORKS_S = 0.1  # a fiftieth of a core; who only looks from time to time takes less
LONGEST = 120  # times the patience, for who works without end
LOOK_S = 0.001
SPENT = time.process_time  # of all threads, while the loop's own waits


class Jobs:
    """What threads are doing for one loop."""

    def __init__(self) -> None:
        self._open: list[tuple[Future[Any], asyncio.Future[Any]]] = []
        self._slow: set[Future[Any]] = set()

    def __bool__(self) -> bool:
        return bool(self._open)

    def add(self, work: Future[T], told: asyncio.Future[T]) -> asyncio.Future[T]:
        """``told`` is done when ``work`` is and its turn has come."""
        self._open.append((work, told))
        told.add_done_callback(lambda done: work.cancel() if done.cancelled() else None)
        return told

    def settle(self) -> bool:
        """Wait for the threads and hand on what they found; whether anything was, so that the loop has work."""
        self._open = [(work, told) for work, told in self._open if not told.done()]
        quick = [work for work, _ in self._open if work not in self._slow]
        self._slow |= _waited(quick)
        done = [(work, told) for work, told in self._open if work.done()]
        self._open = [(work, told) for work, told in self._open if not work.done()]
        self._slow &= {work for work, _ in self._open}
        for work, told in done:
            _hand_on(work, told)
        return bool(done)


def _waited(works: list[Future[Any]]) -> set[Future[Any]]:
    """Those that are not done when nothing works any more."""
    for _ in range(LONGEST):
        began = SPENT()
        if not (left := wait(works, PATIENCE_S).not_done) or SPENT() - began < WORKS_S:
            return left
    return left


def _hand_on(work: Future[T], told: asyncio.Future[T]) -> None:
    if work.cancelled():
        told.cancel()
    elif (error := work.exception()) is not None:
        told.set_exception(error)
    else:
        told.set_result(work.result())


class SteppedLoop(asyncio.SelectorEventLoop):
    """What loops with a time of their own have in common: seconds that only they move, and threads in order."""

    _closed = True  # until it is made: where that fails there is nothing to close

    def __init__(self, selector: Any, now_s: float) -> None:
        self.now_s = now_s
        self.jobs = Jobs()
        self.ending = 0
        self._threads: Executor | None = None
        super().__init__(selector)

    def time(self) -> float:
        """Seconds of this loop."""
        return self.now_s

    @property
    def threads_at_work(self) -> bool:
        """Whether time stands still for a thread."""
        return bool(self.jobs) or self.ending > 0

    def set_default_executor(self, executor: Any) -> None:
        """As any loop."""
        self._threads = executor
        super().set_default_executor(executor)

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        """Run in a thread and hold time still until it is done."""
        if executor is None and self._threads is None:
            self.set_default_executor(ThreadPoolExecutor(thread_name_prefix="asyncio"))
        work = (executor or self._threads).submit(func, *args)  # type: ignore[union-attr]
        return self.jobs.add(work, self.create_future())

    async def shutdown_default_executor(self, *args: Any, **options: Any) -> None:
        """End the threads and hold time still meanwhile: newer Pythons give them a time limit of the loop's."""
        self.ending += 1
        try:
            await super().shutdown_default_executor(*args, **options)
        finally:
            self.ending -= 1
