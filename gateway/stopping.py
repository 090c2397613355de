"""A stop asked for from outside: the work is cancelled once, and who must leave a machine in order gets the time to.

Whatever asks (SIGTERM, Ctrl-C, a closed console, a service), a stop is this one thing. A second asking changes nothing:
it must not cut the leaving off. All of it ends within `LONGEST_S`.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Coroutine, Iterator
from contextvars import ContextVar
from typing import Any, TypeVar

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.message import Message

T = TypeVar("T")

LONGEST_S = 30.0
# A library below may swallow a cancel: while nobody is leaving in order it is asked again, this often.
ASK_AGAIN_S = 2.0
INTERRUPTED, TERMINATED = 130, 143


class Stopped(TrueflankError):
    """The work was ended from outside before its end; what was left at the machine is in the fields."""

    def __init__(self, exit_code: int, by: str, left: str | Message) -> None:
        super().__init__("E-STOPPED", by=by, left=left)
        self.exit_code = exit_code  # type: ignore[misc]


class StopAsked:
    """The stop of one command: who asked for it, who is leaving in order, what they told, transactions cut short."""

    def __init__(self, within: StopAsked | None = None) -> None:
        """``within`` is the stop of the program that this command is a part of: it knows who leaves in order."""
        self.asked = asyncio.Event()
        self.by = ""
        self.exit_code = TERMINATED
        self.told: list[str] = []
        self.transactions: list[int] = []
        self._leaving = 0
        self._within = within

    def ask(self, by: str, exit_code: int = TERMINATED) -> bool:
        """Ask for the stop; false when it was asked for before, which changes nothing."""
        if self.asked.is_set():
            return False
        self.by, self.exit_code = by, exit_code
        self.asked.set()
        return True

    @property
    def in_order(self) -> bool:
        """Whether somebody is leaving a machine in order now."""
        return self._leaving > 0

    @contextlib.contextmanager
    def leaving(self) -> Iterator[None]:
        """No further cancel comes in this block; it must be bounded itself."""
        self._leaving += 1
        try:
            with self._within.leaving() if self._within is not None else contextlib.nullcontext():
                yield
        finally:
            self._leaving -= 1

    def tell(self, words: str) -> None:
        """What was ended or left, for the last word of the command."""
        if words not in self.told:
            self.told.append(words)
        if self._within is not None and self._within.asked.is_set():
            self._within.tell(words)

    def error(self) -> Stopped:
        """How the command ends."""
        left = "; ".join(self.told) or Message.of("W-STOP-NOTHING")
        return Stopped(self.exit_code, self.by or "the program", left)


_current: ContextVar[StopAsked | None] = ContextVar("stop", default=None)
_nobody = StopAsked()


def current() -> StopAsked:
    """The stop of the command that this task belongs to; one that nobody asks for where there is none."""
    return _current.get() or _nobody


async def obey(work: Coroutine[Any, Any, T], stop: StopAsked, clock: Clock, *, ends_itself: bool = False) -> T:
    """Await `work`, which is cancelled once the stop is asked for; one that ``ends_itself`` gets the time to.

    Raises Stopped (E-STOPPED) when the work did not come to its end, else what it raises.
    """
    token = _current.set(stop)
    task = asyncio.create_task(work)
    _current.reset(token)
    asked = asyncio.create_task(stop.asked.wait())
    try:
        await asyncio.wait((task, asked), return_when=asyncio.FIRST_COMPLETED)
        if ends_itself and not task.done():
            await _within(task, clock, LONGEST_S)
    finally:
        await end(task, clock, stop)
        asked.cancel()
        await asyncio.gather(asked, return_exceptions=True)
    return _result(task, stop)


def _result(task: asyncio.Task[T], stop: StopAsked) -> T:
    if task.cancelled() or not task.done():
        raise stop.error()
    failure = task.exception()
    if stop.asked.is_set() and isinstance(failure, TrueflankError):
        stop.tell(f"{failure.code}: {failure.what}")
        raise stop.error() from failure
    return task.result()


async def end(task: asyncio.Task[Any], clock: Clock, stop: StopAsked, again_s: float = ASK_AGAIN_S) -> None:
    """Cancel a task until it ends, but not while somebody in it leaves a machine in order; bounded."""
    until = clock.now() + LONGEST_S
    while not task.done() and clock.now() < until:
        if not stop.in_order:
            task.cancel()
        await _within(task, clock, again_s)
    for _last in range(3):
        if not task.done():
            task.cancel()
            await _within(task, clock, again_s)


async def _within(task: asyncio.Task[Any], clock: Clock, seconds: float) -> None:
    with contextlib.suppress(DeadlineExceeded):
        async with clock.deadline(seconds, "stop"):
            await asyncio.wait((task,))
