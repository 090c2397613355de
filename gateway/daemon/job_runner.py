"""Keeps the devices watched, lends them to one command at a time, and keeps the newest commands with how they ended."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any, Generic, Protocol, TypeVar

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.message import Message, words
from drivers.stale_programs import NOTHING, StaleProgram
from drivers.types.machine import MachineState
from gateway import audit
from gateway.broker import devices_are_own
from gateway.daemon.stream import new_run_view, updated_run
from gateway.errors import BusyError
from gateway.events import DevicesOpened, PushPhaseChanged, RunStarted, TableStateChanged, received
from gateway.live import Nobody, Onlooker, looked_on_by, of_run
from gateway.remaining import RemainingTime
from gateway.say import Say
from gateway.stopping import LONGEST_S, TERMINATED, StopAsked, Stopped, current, obey
from gateway.views import ControlView, DeviceView, JobView, RunView, SeenDevice, control_view, device_views

# Keeps the devices watched, lends them to one run at a time, and knows how far that run is.

LOOK_S = 0.1
PATIENCE_S = 0.8
JobListener = Callable[[str, Mapping[str, object]], None]
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
    def left(self) -> StaleProgram:
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


class JobRunner:
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
        hear: JobListener = lambda _code, _fields: None,
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
    def left(self) -> StaleProgram:
        """What an earlier gateway left in the control; nothing while a run has it."""
        return NOTHING if self.run is not None else self._devices.left

    @property
    def control(self) -> ControlView | None:
        """The control as it was seen last; None while a run has it, or it is away."""
        return None if self.run is not None else control_view(self._devices.seen)

    @property
    def positions(self) -> Mapping[str, float]:
        """Where the axes stand, as the control was seen last; empty while a run has it, or it is away."""
        seen = None if self.run is not None else self._devices.seen
        return {} if seen is None else {name: one.position for name, one in seen.axes.items()}

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
                    await run_until_signal(self._devices.watch(stop), self._clock, stop, self._wanted)
        finally:
            await self._devices.close_all()

    async def _open(self, stop: asyncio.Event) -> None:
        self._trouble = None
        try:
            await run_until_signal(self._devices.open_all(), self._clock, stop, self._wanted)
        except TrueflankError as error:
            # A device that did not open is in the picture, and the watch tries it again.
            self._trouble = error.as_record()

    async def _do_job(self, stop: asyncio.Event) -> None:
        job = self._job
        if job is None:
            return
        self.failure = None
        self.run = new_run_view(job.view)
        work, ended = asyncio.create_task(self._done(job)), asyncio.create_task(stop.wait())
        try:
            await asyncio.wait((work, ended), return_when=asyncio.FIRST_COMPLETED)
            if not work.done() and job.stop.ask(current().by or words("W-STOP-SERVICE-ENDS"), TERMINATED):
                await _wait(work, self._clock, PATIENCE_S)
                await wait_for_shutdown(work, self._clock)
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
            with (
                audit.act_as(job.view.who),
                devices_are_own(),
                looked_on_by(self._onlooker),
                of_run(lambda: job.view.run_id),
            ):
                job.done(await obey(self._work_of(job), job.stop, self._clock), self._clock)
        except TrueflankError as error:
            self._record_failure(job, error)
        except Exception as error:  # noqa: BLE001 - the daemon's top: it goes on watching and says what happened
            _LOG.exception("a run ended by a fault")
            self._record_failure(job, TrueflankError("E-WEB-FAULT", "run", why=f"{type(error).__name__}: {error}"))

    async def _work_of(self, job: Job) -> object:
        def say(code: str, /, **fields: object) -> None:
            job.heard(code, fields)
            if self.run is not None:
                now = job.view
                self.run = updated_run(self.run, code, fields)
                self.run = replace(
                    self.run, run_id=now.run_id, steps=now.steps, tables=now.tables, **self._seconds_to_go(code, fields)
                )
            self._hear(code, fields)

        return await job.work(say)

    def _seconds_to_go(self, code: str, fields: Mapping[str, object]) -> dict[str, Any]:
        """The time to go after one more word, in whole seconds."""
        now = self._clock.now()
        self._remaining.told(code, fields, now)
        found = {"left_s": self._remaining.left_s(now), "program_left_s": self._remaining.program_left_s(now)}
        return {name: None if seconds is None else round(seconds) for name, seconds in found.items()}

    def _record_failure(self, job: Job, error: TrueflankError) -> None:
        self.failure = error.as_record()
        job.failed(error, self._clock)


async def run_until_signal(work: Coroutine[Any, Any, object], clock: Clock, *signals: asyncio.Event) -> None:
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


async def wait_for_shutdown(task: asyncio.Task[Any], clock: Clock) -> None:
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
        await wait_for_shutdown(task, clock)
    if task.done() and not task.cancelled():
        task.exception()


# Commands given to a desk: what each is, how it stands, and how it ended; the newest are kept.

RunStarter = Callable[[Say], Awaitable[object]]
MOST_KEPT = 50
MOST_STEPS = 200


@dataclass(slots=True)
class Job:
    """One command: its work, in whose name, its stop, and how it stands. ``begun`` gets its run id, "" for none.

    ``stop_at`` passes a stop on to where the work is really done: a command at a terminal.
    """

    work: RunStarter
    view: JobView
    stop: StopAsked
    begun: asyncio.Future[str] = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    stop_at: Callable[[str], None] | None = None

    def ask_to_stop(self, by: str) -> bool:
        """Ask for its end in order; false where that was asked before."""
        if self.stop_at is None:
            return self.stop.ask(by, TERMINATED)
        self.stop_at(by)
        return True

    def begin(self, run_id: str) -> None:
        """It has a run folder, or will have none."""
        if run_id:
            self.view = replace(self.view, run_id=run_id)
        if not self.begun.done():
            self.begun.set_result(run_id)

    def refuse(self, error: TrueflankError) -> None:
        """It did not begin, or ended before it had a run folder."""
        if not self.begun.done():
            self.begun.set_exception(error)
            self.begun.exception()  # the caller may have gone away; then nobody asks for it

    def heard(self, code: str, fields: dict[str, object]) -> None:
        """One more word of it."""
        event = received(code, fields)
        if isinstance(event, RunStarted):
            self.begin(event.run_id)
        elif isinstance(event, DevicesOpened) and event.run and not self.view.run_id:
            self.begin(event.run)
        elif isinstance(event, PushPhaseChanged):
            step = (event.axis, str(event.step))
            self.view = replace(self.view, steps=(*self.view.steps, step)[-MOST_STEPS:])
        elif isinstance(event, TableStateChanged):
            self.view = replace(self.view, tables=tuple({**dict(self.view.tables), event.axis: event.state}.items()))
        self.view = replace(self.view, words=Message(code, fields))

    def done(self, outcome: object, clock: Clock) -> None:
        """It came to its end; what a workflow handed back is shown as a terminal would."""
        data: object = outcome.as_data() if hasattr(outcome, "as_data") else {}
        folder = PurePath(str(getattr(outcome, "run_folder", ""))).name
        self.view = replace(
            self.view,
            state="ended",
            ended_utc=_now(clock),
            lines=tuple(getattr(outcome, "lines", ())),
            exit_code=int(getattr(outcome, "exit_code", 0)),
            data=data if isinstance(data, dict) else {"items": data},
        )
        self.begin(folder)
        self.ended.set()

    def failed(self, error: TrueflankError, clock: Clock) -> None:
        """It ended by an error, or was stopped."""
        state = "stopped" if isinstance(error, Stopped) else "failed"
        record = error.as_record()
        self.view = replace(
            self.view, state=state, ended_utc=_now(clock), exit_code=error.exit_code, error=record, words=error.message
        )
        self.refuse(error)
        self.ended.set()


def _now(clock: Clock) -> str:
    return clock.utc().isoformat(timespec="seconds")


class Jobs:
    """The newest jobs of a desk by their numbers."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._kept: dict[int, Job] = {}
        self._count = 0

    def new(self, kind: str, work: RunStarter, who: str, within: StopAsked) -> Job:
        """A job that begins now."""
        self._count += 1
        view = JobView(self._count, kind=kind, who=who, state="running", run_id="", started_utc=_now(self._clock))
        job = Job(work, view, StopAsked(within))
        self._kept[self._count] = job
        while len(self._kept) > MOST_KEPT:
            del self._kept[min(self._kept)]
        return job

    def find(self, number: int) -> Job | None:
        """A job by its number."""
        return self._kept.get(number)

    @property
    def views(self) -> tuple[JobView, ...]:
        """Every kept job, the newest first."""
        return tuple(job.view for _number, job in sorted(self._kept.items(), reverse=True))


# Work beside the devices that must go on for months: a fault in it is kept and told, and it begins again.

AGAIN_S = 60.0


def _nobody(_kind: str, _data: Mapping[str, object]) -> None:
    return None


async def supervise_task(
    name: str,
    begin: Callable[[], Coroutine[object, object, object]],
    clock: Clock,
    tell: Callable[[str, Mapping[str, object]], None] = _nobody,
) -> None:
    """Do ``begin()`` until it ends by itself; where a fault ends it, again a minute later.

    Without this a task that nobody awaits would end in silence, and with it what it looked after.
    """
    while True:
        try:
            await begin()
            return
        except Exception as error:  # noqa: BLE001 - whatever it is, this work must not stay undone
            _LOG.exception("%s ended by a fault and begins again in %g s", name, AGAIN_S)
            why = f"{name}: {type(error).__name__}"
            tell("failure", TrueflankError("E-WEB-FAULT", "service", why=why).as_record())
        await clock.sleep(AGAIN_S)


# Devices whose drivers are loaded beside the page: a start must show soon what pushes left.

D = TypeVar("D", bound=Devices)
_ONE_AT_A_TIME = threading.Lock()
"""Sites that begin together load the same modules."""


class LazyDevices(Generic[D]):
    """A `gateway.daemon.job_runner.Devices` that is made in a thread when it is opened first, and then stays.

    ``shown`` is the picture until then: every device of the site, closed.
    """

    def __init__(self, make: Callable[[], D], shown: Sequence[SeenDevice]) -> None:
        self._make = make
        self._shown = tuple(shown)
        self._coming: asyncio.Future[D] | None = None
        self.made: D | None = None
        """The devices themselves; None before they were made."""

    async def open_all(self) -> object:
        """Make them, then open every one. Raises what making and opening raise."""
        if self._coming is None:
            self._coming = asyncio.ensure_future(asyncio.to_thread(self._load_devices))
        # Whoever cancels this does not stop the thread: the next opening takes what it made.
        self.made = await asyncio.shield(self._coming)
        return await self.made.open_all()

    def _load_devices(self) -> D:
        with _ONE_AT_A_TIME:
            return self._make()

    def picture(self) -> Sequence[SeenDevice]:
        """All devices as they are now."""
        return self._shown if self.made is None else self.made.picture()

    @property
    def left(self) -> StaleProgram:
        """What an earlier gateway left in the control, as seen last."""
        return NOTHING if self.made is None else self.made.left

    @property
    def seen(self) -> MachineState | None:
        """The control's state at the last look."""
        return None if self.made is None else self.made.seen

    async def watch(self, stop: asyncio.Event) -> None:
        """Look after the devices until `stop`."""
        if self.made is not None:
            await self.made.watch(stop)
        else:
            await stop.wait()

    async def close_all(self) -> None:
        """Close every device."""
        if self.made is not None:
            await self.made.close_all()
