"""The main run: does in time, one after the other, what interpreted blocks leave to the machine.

The interpreter runs ahead of it by a limited number of blocks and waits for `calm` where the program says
STOPRE. NC stop and M0 hold the main run; NC start lets it go on.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Protocol

from simulators.nck.machine.core import Core
from simulators.nck.program.block import Deed

_EPS_S = 1e-9


class Screen(Protocol):
    """What the main run asks of the control."""

    def show(self, text: str) -> None:
        """Show a message of the part program."""
        ...

    def stops_at_m1(self) -> bool:
        """Whether the optional stop is on."""
        ...


class MainRun:
    """A queue of deeds with the source line each came from, and the task that does them."""

    def __init__(self, core: Core, screen: Screen) -> None:
        self._core = core
        self._clock = core.clock
        self._screen = screen
        self._queue: deque[tuple[int, Deed]] = deque()
        self._work = asyncio.Event()
        self._calm = asyncio.Event()
        self._calm.set()
        self._room = asyncio.Event()
        self._resumed = asyncio.Event()
        self._sleeper: asyncio.Task[None] | None = None
        self._task: asyncio.Task[None] | None = None
        self.line: int | None = None
        self.stop_requested = False
        self.stopped = False

    @property
    def is_calm(self) -> bool:
        """Whether everything handed over has been done."""
        return self._calm.is_set()

    def begin(self) -> None:
        """Start the task."""
        self._task = asyncio.ensure_future(self._follow())

    async def end(self) -> None:
        """End the task, whatever it is doing."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task})

    # -- for the interpreter -----------------------------------------------------------------------

    async def take(self, line: int, deed: Deed, ahead: int) -> None:
        """Hand over a deed; waits until no more than ``ahead`` are not yet done."""
        self._queue.append((line, deed))
        self._calm.clear()
        self._work.set()
        while self._open > ahead:
            self._room.clear()
            await self._room.wait()
            self._check()

    @property
    def _open(self) -> int:
        return len(self._queue) + (self.line is not None)

    async def calm(self) -> None:
        """Wait until everything handed over has been done."""
        await self._calm.wait()
        self._check()

    def _check(self) -> None:
        if self._task is not None and self._task.done() and not self._task.cancelled():
            self._task.result()

    # -- for the panel -----------------------------------------------------------------------------

    def stop(self) -> None:
        """NC stop: at once, also in mid-motion."""
        self.stop_requested = True
        self._resumed.clear()
        if self._sleeper is not None:
            self._sleeper.cancel()

    def resume(self) -> None:
        """NC start after a stop."""
        self.stop_requested = False
        self.stopped = False
        self._resumed.set()

    async def hold(self) -> None:
        """Stand until NC start."""
        self.stopped = True
        self._resumed.clear()
        await self._resumed.wait()

    async def stand(self) -> None:
        """The interpreter's part of an NC stop: wait for NC start; without deeds at hand the program stands."""
        self.stopped = self.stopped or self.is_calm
        await self._resumed.wait()

    # -- doing -------------------------------------------------------------------------------------

    async def _follow(self) -> None:
        try:
            while True:
                while self._queue:
                    self.line, deed = self._queue.popleft()
                    await self._do(deed)
                    self.line = None
                    self._room.set()
                self._calm.set()
                self._work.clear()
                await self._work.wait()
        finally:
            self._calm.set()
            self._room.set()

    async def _do(self, deed: Deed) -> None:
        while self.stop_requested:
            await self.hold()
        if deed.message is not None:
            self._screen.show(deed.message)
        if deed.targets:
            await self._travel(deed)
        if deed.dwell_s > 0.0:
            await self._wait_through(self._clock.now() + deed.dwell_s)
        if deed.ending == "M0" or (deed.ending == "M1" and self._screen.stops_at_m1()):
            await self.hold()

    async def _travel(self, deed: Deed) -> None:
        while True:
            seconds = self._core.move(deed.targets, deed.rate)
            if await self._wait_until(self._clock.now() + seconds):
                break
            self._core.halt()
            await self.hold()
        if deed.window is not None:
            now = self._clock.now()
            axes = (self._core.axes[index] for index in deed.targets)
            settling = max(axis.settling_s(now, deed.window) for axis in axes)
            await self._wait_through(now + settling)

    async def _wait_through(self, time_s: float) -> None:
        while True:
            left = time_s - self._clock.now()
            if await self._wait_until(time_s):
                return
            left = max(time_s - self._clock.now(), 0.0) if left > 0.0 else 0.0
            await self.hold()
            time_s = self._clock.now() + left

    async def _wait_until(self, time_s: float) -> bool:
        """Wait; False as soon as a stop was asked for before that time."""
        while (left := time_s - self._clock.now()) > _EPS_S:
            if self.stop_requested:
                return False
            self._sleeper = asyncio.ensure_future(self._clock.sleep(left))
            try:
                await asyncio.wait({self._sleeper})
            finally:
                self._sleeper.cancel()
                self._sleeper = None
        return True
