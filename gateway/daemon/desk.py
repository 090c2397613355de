"""Keeps the devices watched, lends them to one run at a time, and knows how far that run is."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.leftover import NOTHING, LeftOver
from drivers.types.machine import MachineState
from gateway import audit
from gateway.broker.borrowing import held_here
from gateway.daemon.jobs import Job, Jobs, RunStarter
from gateway.daemon.running import fresh, told
from gateway.errors import BusyError
from gateway.live import Nobody, Onlooker, looked_on_by, of_run
from gateway.remaining import RemainingTime
from gateway.stopping import LONGEST_S, TERMINATED, current, obey
from gateway.views import ControlView, DeviceView, JobView, RunView, SeenDevice, control_view, device_views

LOOK_S = 0.1
PATIENCE_S = 0.8
Hear = Callable[[str, Mapping[str, object]], None]
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

    @property
    def seen(self) -> MachineState | None:
        """The control's state at the last look; None before the first and while it is away."""

    async def watch(self, stop: asyncio.Event) -> None:
        """Look after the devices until `stop`."""
        ...

    async def close_all(self) -> None:
        """Close every device; never raises."""
        ...


class Desk:
    """One command at a time. A command opens the devices itself, so the watch lets go of them for as long.

    Its work is awaited with a `Say`; it says P-RUN with its folder first, P-STOP with axis, program, done and total on
    the way. ``starter`` is the work of a start without any: it must only propose, since nobody consents to a write.
    ``hear`` gets every word of it, ``onlooker`` what it reads, ``after`` how it ended.
    """

    def __init__(
        self,
        devices: Devices,
        starter: RunStarter | None,
        clock: Clock,
        *,
        hear: Hear = lambda _code, _fields: None,
        onlooker: Onlooker | None = None,
        after: Callable[[JobView], None] = lambda _job: None,
    ) -> None:
        self._devices = devices
        self._starter = starter
        self._clock = clock
        self._hear = hear
        self._onlooker = onlooker or Nobody()
        self._after = after
        self._wanted = asyncio.Event()
        self._job: Job | None = None
        self._stopping = False
        self.jobs = Jobs(clock)
        self.run: RunView | None = None
        self.failure: Mapping[str, object] | None = None
        self._trouble: Mapping[str, object] | None = None
        self._remaining = RemainingTime()

    @property
    def trouble(self) -> Mapping[str, object] | None:
        """Why the devices, though each of them answers, are not the site's: another machine, a missing axis."""
        return None if any(device.error is not None for device in self.devices()) else self._trouble

    @property
    def left(self) -> LeftOver:
        """What an earlier gateway left in the control; nothing while a run has it."""
        return NOTHING if self.run is not None else self._devices.left

    @property
    def control(self) -> ControlView | None:
        """The control as it was seen last; None while a run has it, or it is away."""
        return None if self.run is not None else control_view(self._devices.seen)

    def devices(self) -> tuple[DeviceView, ...]:
        """All devices as they are now."""
        return device_views(self._devices.picture(), lent=self.run is not None)

    def begin(
        self, work: RunStarter, *, kind: str = "run", who: str = "", remaining: RemainingTime | None = None
    ) -> Job:
        """Ask for a command; it gets the devices once they are free. Raises BusyError (E-WEB-BUSY, E-WEB-STOPPING).

        ``remaining`` reckons its time to go; None knows the program at work alone.
        """
        if self._stopping:
            raise BusyError("E-WEB-STOPPING", "daemon")
        if self._job is not None:
            at_work = self._job.view
            raise BusyError(
                "E-WEB-BUSY", "daemon", run=at_work.run_id or at_work.kind, who=at_work.who or "the service"
            )
        self._job = self.jobs.new(kind, work, who, current())
        self._remaining = remaining or RemainingTime()
        self._wanted.set()
        return self._job

    async def start(self, work: RunStarter | None = None) -> str:
        """Ask for a run, or for other ``work``, and return its id as soon as it has one.

        Raises what `begin` raises, and whatever kept the run from beginning.
        """
        chosen = work or self._starter
        if chosen is None:
            raise BusyError("E-WEB-WATCHING", "daemon")
        return await asyncio.shield(self.begin(chosen).begun)

    def stop_job(self, by: str) -> bool:
        """Ask the command at work to end in order; false where there is none."""
        return self._job is not None and self._job.ask_to_stop(by)

    async def work(self, stop: asyncio.Event) -> None:
        """Open and watch the devices until `stop`; in between, do the commands asked for."""
        try:
            while not stop.is_set():
                await self._watch(stop)
                if self._wanted.is_set() and not stop.is_set():
                    await self._do_job(stop)
        finally:
            self._stopping = True
            self._over()

    async def _watch(self, stop: asyncio.Event) -> None:
        try:
            await self._open(stop)
            if not stop.is_set() and not self._wanted.is_set():
                with looked_on_by(self._onlooker):
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

    async def _do_job(self, stop: asyncio.Event) -> None:
        job = self._job
        if job is None:
            return
        self.failure = None
        self.run = fresh(job.view)
        work, ended = asyncio.create_task(self._done(job)), asyncio.create_task(stop.wait())
        try:
            await asyncio.wait((work, ended), return_when=asyncio.FIRST_COMPLETED)
            if not work.done() and job.stop.ask(current().by or "the end of the service", TERMINATED):
                await _wait(work, self._clock, PATIENCE_S)
                await left_in_order(work, self._clock)
        finally:
            await interrupt(work, self._clock)
            await interrupt(ended, self._clock)
            self.run = None
            self._after(job.view)
            self._over()

    def _over(self) -> None:
        if self._job is not None:
            self._job.refuse(BusyError("E-WEB-STOPPING", "daemon"))
            self._job.ended.set()
        self._job = None
        self._wanted.clear()

    async def _done(self, job: Job) -> None:
        try:
            with audit.act_as(job.view.who), held_here(), looked_on_by(self._onlooker), of_run(lambda: job.view.run_id):
                job.done(await obey(self._work_of(job), job.stop, self._clock), self._clock)
        except TrueflankError as error:
            self._failed(job, error)
        except Exception as error:  # noqa: BLE001 - the daemon's top: it goes on watching and says what happened
            _LOG.exception("a run ended by a fault")
            self._failed(job, TrueflankError("E-WEB-FAULT", "run", why=f"{type(error).__name__}: {error}"))

    async def _work_of(self, job: Job) -> object:
        def say(code: str, /, **fields: object) -> None:
            job.heard(code, fields)
            if self.run is not None:
                now = job.view
                self.run = told(self.run, code, fields)
                self.run = replace(
                    self.run, run_id=now.run_id, steps=now.steps, tables=now.tables, **self._left(code, fields)
                )
            self._hear(code, fields)

        return await job.work(say)

    def _left(self, code: str, fields: Mapping[str, object]) -> dict[str, Any]:
        """The time to go after one more word, in whole seconds."""
        now = self._clock.now()
        self._remaining.told(code, fields, now)
        found = {"left_s": self._remaining.left_s(now), "program_left_s": self._remaining.program_left_s(now)}
        return {name: None if seconds is None else round(seconds) for name, seconds in found.items()}

    def _failed(self, job: Job, error: TrueflankError) -> None:
        self.failure = error.as_record()
        job.failed(error, self._clock)


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
