"""A limit for a block of awaits that knows its own cancel again, whatever a library makes of it on the way out.

`asyncio.timeout` counts on the cancel that it sends coming back as exactly `CancelledError`. Libraries raise classes of
their own (`wait_for2`), errors instead, or swallow it where the answer came in the same turn of the loop (3.11's
`wait_for`); what then leaves the block differs from one Python to the next. Here it does not.
"""

from __future__ import annotations

import asyncio
from types import TracebackType

from drivers.errors import LimitPassed, TrueflankError


class Deadline:
    """Bounds one block: `LimitPassed` where its time has run out, cancelled where it was cancelled from outside.

    Exactly: once the limit has cancelled the task, nothing but LimitPassed (E-LINK-DEADLINE), an error of ours
    that is no consequence of that cancel, or a cancel from outside leaves the block, not even a result; a cancel from
    outside that was swallowed inside is raised at the end of the block. The limit's own cancel is taken back.
    """

    def __init__(self, loop_s: float, timeout_s: float, where: str) -> None:
        """``loop_s`` in the loop's seconds, ``timeout_s`` as people are told it."""
        self._loop_s = loop_s
        self._timeout_s = timeout_s
        self._where = where
        self._fired = False

    async def __aenter__(self) -> None:
        task = asyncio.current_task()
        if task is None:
            raise RuntimeError("a deadline bounds a task")
        self._task, self._before = task, task.cancelling()
        loop = asyncio.get_running_loop()
        over = self._loop_s <= 0.0
        self._timer = loop.call_soon(self._fire) if over else loop.call_later(self._loop_s, self._fire)

    def _fire(self) -> None:
        self._fired = True
        self._task.cancel()

    async def __aexit__(
        self, _kind: type[BaseException] | None, error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        if self._fired:
            self._task.uncancel()
        if error is not None and not isinstance(error, asyncio.CancelledError | Exception):
            return
        if self._task.cancelling() > self._before:
            self._cancelled(error)
        elif self._fired and (not isinstance(error, TrueflankError) or _by_cancel(error)):
            raise LimitPassed("E-LINK-DEADLINE", self._where, timeout_s=self._timeout_s) from error

    def _cancelled(self, error: BaseException | None) -> None:
        """Somebody else wants the task to end: it does, even where the block swallowed it or made an error of it."""
        if error is None or (not isinstance(error, asyncio.CancelledError) and _by_cancel(error)):
            raise asyncio.CancelledError from error


def _by_cancel(error: BaseException | None) -> bool:
    """Whether an error comes of a cancel: one stands somewhere in its chain."""
    seen = error
    while seen is not None and not isinstance(seen, asyncio.CancelledError):
        seen = seen.__cause__ or seen.__context__
    return seen is not None
