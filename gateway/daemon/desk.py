"""Keeps the devices watched, lends them to one run at a time, and knows how far that run is."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError, words
from drivers.leftover import NOTHING, LeftOver
from gateway.errors import BusyError
from gateway.say import Say
from gateway.stopping import LONGEST_S, current
from gateway.views import DeviceView, RunView, SeenDevice, device_views

RunStarter = Callable[[Say], Awaitable[object]]
LOOK_S = 0.1
_LOG = logging.getLogger("trueflank.daemon")


class Devices(Protocol):
    """What the daemon needs of a supervisor."""

    async def open_all(self) -> object:
        """Open every device; raises TrueflankError when some did not, with all of them in the picture."""
        ...

    def picture(self) -> Sequence[SeenDevice]:
        """All devices as they are now."""
        ...

    @property
    def left(self) -> LeftOver:
        """What an earlier gateway left in the control, as seen last."""
        ...

    async def watch(self, stop: asyncio.Event) -> None:
        """Look after the devices until `stop`."""
        ...

    async def close_all(self) -> None:
        """Close every device; never raises."""
        ...


class Desk:
    """One run at a time. A run opens the devices itself, so the watch lets go of them for as long.

    ``starter`` is awaited with a `Say`; it says P-RUN with its folder first, P-STOP with axis, program,
    done and total on the way. It must only propose: nobody at a desk can consent to a write.
    """

    def __init__(self, devices: Devices, starter: RunStarter | None, clock: Clock) -> None:
        self._devices = devices
        self._starter = starter
        self._job = starter
        self._clock = clock
        self._wanted = asyncio.Event()
        self._begun: asyncio.Future[str] | None = None
        self._stopping = False
        self.run: RunView | None = None
        self.failure: Mapping[str, object] | None = None
        self._trouble: Mapping[str, object] | None = None

    @property
    def trouble(self) -> Mapping[str, object] | None:
        """Why the devices, though each of them answers, are not the site's: another machine, a missing axis."""
        return None if any(device.error is not None for device in self.devices()) else self._trouble

    @property
    def left(self) -> LeftOver:
        """What an earlier gateway left in the control; nothing while a run has it."""
        return NOTHING if self.run is not None else self._devices.left

    def devices(self) -> tuple[DeviceView, ...]:
        """All devices as they are now."""
        return device_views(self._devices.picture(), lent=self.run is not None)

    async def start(self, job: RunStarter | None = None) -> str:
        """Ask for a run, or for another ``job`` of the same kind, and return its id as soon as it has one.

        Raises BusyError (E-WEB-BUSY, E-WEB-STOPPING), and whatever kept the run from beginning.
        """
        if self._stopping:
            raise BusyError("E-WEB-STOPPING", "daemon")
        if self._wanted.is_set():
            raise BusyError("E-WEB-BUSY", "daemon", run=self.run.run_id if self.run else "being prepared")
        self._job = job or self._starter
        self._begun = asyncio.get_running_loop().create_future()
        self._wanted.set()
        return await asyncio.shield(self._begun)

    async def work(self, stop: asyncio.Event) -> None:
        """Open and watch the devices until `stop`; in between, do the runs asked for."""
        try:
            while not stop.is_set():
                await self._watch(stop)
                if self._wanted.is_set() and not stop.is_set():
                    await self._do_run(stop)
        finally:
            self._stopping = True
            self._refuse(BusyError("E-WEB-STOPPING", "daemon"))

    async def _watch(self, stop: asyncio.Event) -> None:
        try:
            await self._open(stop)
            if not stop.is_set() and not self._wanted.is_set():
                await unless(self._devices.watch(stop), self._clock, stop, self._wanted)
        finally:
            await self._devices.close_all()

    async def _open(self, stop: asyncio.Event) -> None:
        self._trouble = None
        try:
            await unless(self._devices.open_all(), self._clock, stop, self._wanted)
        except TrueflankError as error:
            # A device that did not open is in the picture, and the watch tries it again.
            self._trouble = error.as_record()

    async def _do_run(self, stop: asyncio.Event) -> None:
        self.failure = None
        self.run = RunView(
            run_id="",
            stage="",
            axis="",
            done=0,
            total=0,
            words="",
            started_utc=self._clock.utc().isoformat(timespec="seconds"),
        )
        try:
            await unless(self._run(), self._clock, stop)
        finally:
            self.run = None
            self._refuse(BusyError("E-WEB-STOPPING", "daemon"))
            self._wanted.clear()

    async def _run(self) -> None:
        if self._job is None:
            return
        try:
            await self._job(self._say)
            self._begin("")
        except TrueflankError as error:
            self._failed(error)
        except Exception as error:  # noqa: BLE001 - the daemon's top: it goes on watching and says what happened
            _LOG.exception("a run ended by a fault")
            self._failed(TrueflankError("E-WEB-FAULT", "run", why=f"{type(error).__name__}: {error}"))

    def _failed(self, error: TrueflankError) -> None:
        self.failure = error.as_record()
        self._refuse(error)

    def _refuse(self, error: TrueflankError) -> None:
        if self._begun is not None and not self._begun.done():
            self._begun.set_exception(error)
            # The caller may have gone away; then nobody asks for this exception.
            self._begun.exception()

    def _say(self, code: str, /, **fields: object) -> None:
        if self.run is None:
            return
        if code == "P-RUN":
            self._begin(PurePath(str(fields.get("folder", ""))).name)
        self.run = _told(self.run, code, fields)

    def _begin(self, run_id: str) -> None:
        if self.run is not None and run_id:
            self.run = replace(self.run, run_id=run_id)
        if self._begun is not None and not self._begun.done():
            self._begun.set_result(run_id)


def _told(run: RunView, code: str, fields: Mapping[str, object]) -> RunView:
    """The picture of a run after one more word of it; fields it does not name stay as they were."""
    said = replace(run, words=words(code, **fields), axis=str(fields.get("axis", run.axis)))
    if code != "P-STOP":
        return replace(said, stage=str(fields.get("program", run.stage)), done=0, total=0)
    done, total = (_count(fields.get(name)) for name in ("done", "total"))
    return replace(said, stage=str(fields.get("program", run.stage)), done=done, total=total)


def _count(value: object) -> int:
    return value if isinstance(value, int) else 0


async def unless(work: Coroutine[Any, Any, object], clock: Clock, *signals: asyncio.Event) -> None:
    """Await `work`; a signal interrupts it, and then it is cancelled and waited for.

    What `work` raises by itself is raised here; what it raises while being interrupted is not.
    """
    task = asyncio.create_task(work)
    waiters = [asyncio.create_task(signal.wait()) for signal in signals]
    try:
        await asyncio.wait((task, *waiters), return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
    finally:
        await interrupt(task, clock)
        for waiter in waiters:
            await interrupt(waiter, clock)


async def left_in_order(task: asyncio.Task[Any], clock: Clock) -> None:
    """Wait for a task as long as somebody leaves a machine in order; bounded."""
    until = clock.now() + LONGEST_S
    while not task.done() and current().in_order and clock.now() < until:
        await _wait(task, clock, LOOK_S)


async def _wait(task: asyncio.Task[Any], clock: Clock, seconds: float) -> None:
    with contextlib.suppress(DeadlineExceeded):
        async with clock.deadline(seconds, "daemon"):
            await asyncio.wait((task,))


async def interrupt(task: asyncio.Task[Any], clock: Clock, patience_s: float = 0.4) -> None:
    """Cancel a task until it ends, again and again: a library below may swallow a cancel.

    While a run leaves its machine in order it is waited for, and not cancelled again.
    """
    for _attempt in range(4):
        if task.done():
            break
        task.cancel()
        await _wait(task, clock, patience_s)
        await left_in_order(task, clock)
    if task.done() and not task.cancelled():
        task.exception()
