"""One site in the service: its jobs, stream and picture, daily comparison, messages to others, lending of devices."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.message import Message
from gateway.broker import Lease
from gateway.config import SiteFile, unprotected_connection
from gateway.daemon.job_runner import Devices, JobRunner, RunStarter, supervise_task
from gateway.daemon.stream import Hub, LiveObserver
from gateway.errors import StoreError
from gateway.index import SiteIndex, figures_of, gateway_name
from gateway.live import Asked
from gateway.mqtt import Outgoing, Publish, Publisher, Spool
from gateway.remaining import RemainingTime
from gateway.say import Say
from gateway.store import Store
from gateway.store.log_book import LogBook
from gateway.views import JobView, StatusView, as_data, job_data
from gateway.views.runs import last_acting, last_result, newest_runs, pushes_held
from gateway.watch import Watcher

# Once a day the live tables are compared with what was pushed: done here where nobody is needed, else told.

LOOK_EVERY_S = 60.0
TRY_AGAIN_S = 3600.0


@dataclass(slots=True)
class DailyComparison:
    """What is to be compared each day from ``hour`` o'clock (UTC) on.

    ``due`` names the tables not compared since; ``job`` compares them all. Whether it may is what ``alone`` says: false
    where the road needs a person, and then it is only said and never started; None as long as that is not known.
    """

    hour: int
    due: Callable[[], tuple[str, ...]]
    job: RunStarter
    alone: Callable[[], bool | None]
    tables: tuple[str, ...] = field(default=(), init=False)

    @property
    def due_message(self) -> Message | None:
        """What a person must do; None where there is nothing, or this program does it."""
        if not self.tables or self.alone() is not False:
            return None
        return Message.of("W-VERIFY-DUE", hour=f"{self.hour:02d}", tables=self.tables)


async def compare_daily(desk: JobRunner, daily: DailyComparison, clock: Clock) -> None:
    """Look every minute, for ever, whether something is due; one that fails is tried again after an hour."""
    tried_at = -TRY_AGAIN_S
    while True:
        with contextlib.suppress(TrueflankError):
            daily.tables = daily.due()
        if daily.tables and daily.alone() and desk.run is None and clock.now() - tried_at >= TRY_AGAIN_S:
            tried_at = clock.now()
            with contextlib.suppress(TrueflankError):  # the desk shows why a job failed
                await desk.start(daily.job)
        await clock.sleep(LOOK_EVERY_S)


# One site as the daemon serves it: its desk, its stream, its picture, and the lending of its devices.

STATE_S = 1.0
WATCH_AGAIN_S = 60.0
INDEX_EVERY_S = 20.0
_LOG = logging.getLogger("trueflank.daemon")


@dataclass(frozen=True, slots=True)
class ServiceParts:
    """What a daemon needs to serve one site.

    ``devices`` makes its supervisor; ``daily`` is what is compared each day, ``alarms`` the live tables that are not as
    they were pushed; ``doctor`` looks at the road to the control; ``watcher`` notices new result files.
    """

    site: SiteFile
    path: Path
    store: Store
    devices: Callable[[], Devices]
    doctor: Callable[[Say], Awaitable[object]]
    daily: DailyComparison | None = None
    alarms: Callable[[], tuple[Message, ...]] = tuple
    watcher: Callable[[Say], Watcher] | None = None


class SiteService:
    """One site at work in the daemon: a `gateway.web.ServedSite`."""

    def __init__(self, what: ServiceParts, clock: Clock) -> None:
        self._what = what
        self._clock = clock
        self._outgoing = publisher_of(what.site, what.path, what.store, clock)
        self._unprotected = unprotected_connection(what.site)
        self.hub = Hub(clock, lambda: as_data(self.picture()), self._tell_event)
        self._book = LogBook(what.store.root, clock.utc)
        self._index = SiteIndex(what.site, what.path, what.store)
        self._looking = LiveObserver(self.hub.tell, clock)
        self.desk = JobRunner(
            what.devices(), None, clock, hear=self._hear_code, onlooker=self._looking, after=self._keep_end
        )

    @property
    def site(self) -> SiteFile:
        """The site file."""
        return self._what.site

    @property
    def path(self) -> Path:
        """Where the site file stands."""
        return self._what.path

    @property
    def store(self) -> Store:
        """Its runs."""
        return self._what.store

    @property
    def index(self) -> SiteIndex:
        """The index of its runs."""
        return self._index

    @property
    def daily(self) -> DailyComparison | None:
        """What is compared each day."""
        return self._what.daily

    @property
    def alarms(self) -> tuple[Message, ...]:
        """Live tables that are not as they were pushed."""
        return self._what.alarms()

    def picture(self) -> StatusView:
        """The whole picture as it is now; reads the newest runs from the store."""
        desk, store, daily = self.desk, self.store, self.daily
        return StatusView(
            site=self.site.site.name,
            software=software(),
            now_utc=self._clock.utc().isoformat(timespec="seconds"),
            devices=desk.devices(),
            control=desk.control,
            run=desk.run,
            last_runs=newest_runs(store),
            failure=desk.failure,
            result=last_result(store),
            acting=last_acting(store),
            trouble=desk.trouble,
            alarms=self.alarms,
            due=daily.due_message if daily is not None else None,
            left=() if desk.left.clear else (desk.left.said.as_record(),),
            held=pushes_held(store),
            unprotected=self._unprotected,
            ambient=self._looking.air,
            positions=dict(self._looking.positions),
            simulated=self.path.with_suffix(".cell.json").exists(),
        )

    def jobs(self) -> tuple[JobView, ...]:
        """The newest commands."""
        return self.desk.jobs.views

    def begin(self, work: RunStarter, *, kind: str, who: str, remaining: RemainingTime | None = None) -> JobView:
        """Give a command; ``remaining`` reckons its time to go. Raises BusyError."""
        job = self.desk.begin(work, kind=kind, who=who, remaining=remaining).view
        self._looking.begin()
        return job

    def stop_job(self, by: str) -> bool:
        """Ask the command at work to end in order."""
        return self.desk.stop_job(by)

    def ask_again(self, axis: str, stop: Asked) -> bool:
        """Have a reading taken again."""
        return self._looking.ask_again(axis, stop)

    def taken(self) -> tuple[Mapping[str, object], ...]:
        """The readings of the plot so far."""
        return tuple(self._looking.kept)

    def airs(self) -> tuple[Mapping[str, object], ...]:
        """Air and material since the command began."""
        return tuple(self._looking.airs)

    def stream(self, who: str = "", *, operates: bool = True) -> AsyncIterator[str]:
        """The live stream for a person. Raises BusyError (E-WEB-STREAMS)."""
        return self.hub.stream(self.hub.join(who, operates=operates))

    def stream_counts(self) -> tuple[int, int]:
        """Pages that listen, frames that slow ones lost."""
        return self.hub.listening, self.hub.dropped

    def outgoing(self) -> Outgoing | None:
        """How the messages to other systems stand."""
        return None if self._outgoing is None else self._outgoing.standing

    def _tell_event(self, kind: str, data: Mapping[str, object]) -> None:
        if self._outgoing is not None:
            self._outgoing.take("status" if kind == "state" else kind, data)

    def _hear_code(self, code: str, fields: Mapping[str, object]) -> None:
        self._looking.said(code, fields)
        self.hub.hear(code, fields)
        now = self.desk.run
        if now is not None and now.kind != "terminal":  # a terminal keeps its own words
            self._book.add("INFO", code, fields, run=now.run_id)

    def _keep_end(self, job: JobView) -> None:
        if job.error is not None and job.kind != "terminal":
            code, fields, where = (job.error.get(key) for key in ("code", "fields", "where"))
            told = fields if isinstance(fields, Mapping) else {}
            self._book.add("ERROR", str(code), told, run=job.run_id, where=str(where or ""))
        seen = job_data(job)
        told = {name: seen[name] for name in ("job", "kind", "who", "run_id", "state", "exit_code", "words")}
        self.hub.tell("ended", told)
        if job.run_id and self._outgoing is not None:
            self._outgoing.take("figures", lambda: figures_to_publish(self._what.store, job.run_id))

    async def doctor(self, say: Say) -> object:
        """Look at the road to the control."""
        return await self._what.doctor(say)

    async def lend(self, lease: Lease) -> None:
        """Give the devices to a command at a terminal, until it gives them back. Raises BusyError."""
        free = asyncio.Event()

        async def work(say: Say) -> object:
            lease.say = say
            say("P-LEASE", who=lease.who, run=lease.run)
            free.set()
            await lease.over()
            return None

        job = self.desk.begin(work, kind="terminal", who=lease.who)
        self._looking.begin()
        job.begin(lease.run)
        job.stop_at = lease.stop
        await wait_for_first(free, job.ended)

    async def work(self, stop: asyncio.Event) -> None:
        """Devices, commands and the watch folder until ``stop``."""
        others: dict[str, Callable[[], Coroutine[object, object, None]]] = {
            "states": self._tell_states,
            "watch folder": lambda: self._watch_folder(stop),
            "index": self._keep_index,
        }
        if self._outgoing is not None:
            others["outgoing messages"] = self._outgoing.work
        beside = [asyncio.create_task(supervise_task(*one, self._clock, self.hub.tell)) for one in others.items()]
        try:
            await self.desk.work(stop)
        finally:
            self.hub.end()
            for task in beside:
                task.cancel()
            await asyncio.gather(*beside, return_exceptions=True)

    async def _watch_folder(self, stop: asyncio.Event) -> None:
        """New result files become runs; a store that refuses them is told, and tried again a minute later."""
        while self._what.watcher is not None and not stop.is_set():
            try:
                await self._what.watcher(self._heard).watch(self._clock, stop)
            except TrueflankError as error:
                _LOG.warning("the watch folder: %s", error)
                self.hub.tell("failure", error.as_record())
                await self._clock.sleep(WATCH_AGAIN_S)

    async def _keep_index(self) -> None:
        """The index follows the run folders, in a thread; a database that is away is caught up with later."""
        told = ""
        while True:
            await self._clock.sleep(INDEX_EVERY_S)
            try:
                await asyncio.to_thread(self._index.caught_up)
                told = ""
            except TrueflankError as error:
                if str(error) != told:
                    _LOG.warning("the index: %s", error)
                told = str(error)

    def _heard(self, code: str, /, **fields: object) -> None:
        self.hub.hear(code, fields)

    async def _tell_states(self) -> None:
        """Tell every page when a device, the command at work or a trouble changes."""
        before: object = None
        while True:
            self._looking.stands(self.desk.positions)
            seen = {
                "devices": self.desk.devices(),
                "run": self.desk.run,
                "failure": self.desk.failure,
                "control": self.desk.control,
            }
            if seen != before:
                before = seen
                self.hub.tell("state", as_data(self.picture()))
            await self._clock.sleep(STATE_S)


async def wait_for_first(*events: asyncio.Event) -> None:
    """Wait for the first of these."""
    waits = [asyncio.create_task(event.wait()) for event in events]
    try:
        await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for wait in waits:
            wait.cancel()
        await asyncio.gather(*waits, return_exceptions=True)


def software() -> str:
    """Name and version."""
    return f"trueflank {metadata.version('trueflank')}"


# What a served site tells other systems: its way out by MQTT where the site file names one, and a run's figures.

MB = 1 << 20


def publisher_of(site: SiteFile, path: Path, store: Store, clock: Clock) -> Publisher | None:
    """The way out of a site; None where it names no server. Raises StoreError (E-MQTT-QUEUE)."""
    section = site.service.mqtt
    if section is None:
        return None
    from gateway.mqtt.connecting import connected  # noqa: PLC0415 - its library only where a site wants it

    name = site.site.name
    spool = Spool(store.root / "service" / f"mqtt-{name}", section.queue_mb * MB)
    ident = hashlib.sha256(gateway_name(store.root).encode("utf-8")).hexdigest()[:8]

    def connect() -> AbstractAsyncContextManager[Publish]:
        return connected(section, path.parent, f"trueflank-{name}-{ident}", will=found.will, clock=clock)

    found = Publisher(name, section.prefix, spool, clock=clock, connect=connect)
    return found


def figures_to_publish(store: Store, run_id: str) -> dict[str, Any]:
    """E, R, B, A, M of each axis and the flank's, before and after, as a run that has ended holds them."""
    told: dict[str, Any] = {"run_id": run_id, "serial": "", "figures": []}
    try:
        folder = store.open(run_id)
        found, serial = [asdict(one) for one in figures_of("", folder)], folder.summary().machine
    except StoreError:
        return told  # the run's own pages say what is damaged
    wanted = ("subject", "phase", "parameter", "value", "expanded", "unit")
    figures = [{key: one[key] for key in wanted} for one in found]
    return told | {"serial": serial, "figures": figures}
