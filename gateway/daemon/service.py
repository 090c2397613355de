"""Serves sites until told to stop, or the page that makes the first site file: locks, broker, pages, devices."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable, Coroutine, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import scipy

from drivers.clock import Clock
from drivers.errors import ConfigError, DeadlineExceeded
from drivers.message import words
from gateway import audit
from gateway.broker import Broker, Lease, hold_folder_lock
from gateway.config import ServiceSection
from gateway.daemon.job_runner import interrupt, supervise_task, wait_for_shutdown
from gateway.daemon.server import (
    GRACE_S,
    PageServer,
    access_of,
    audit_person_acts,
    listener_on,
    more_files,
    record_access,
    record_refusals_hourly,
    server_of,
    sessions_of,
    url_of,
)
from gateway.daemon.service_manager import Notifier, keep_telling, log_into
from gateway.daemon.site_service import ServiceParts, SiteService, compare_daily, software, wait_for_first
from gateway.store.log_book import LogBook
from gateway.users import KeyRing, Sessions, UserAccounts
from gateway.web import Making, Service, SiteMaking, create_app

# Serves sites until told to stop: locks, broker, pages, and each site's devices, runs and folders, ended together.

LOAD_AFTER_S = 3.0


async def serve(
    sites: Sequence[ServiceParts],
    *,
    clock: Clock,
    stop: asyncio.Event,
    host: str = "127.0.0.1",
    port: int = 8617,
    ready: Callable[[str], None] = lambda _url: None,
    accounts: UserAccounts | None = None,
    sessions: Sessions | None = None,
) -> None:
    """Open and watch the devices of all sites and serve their pages until `stop` is set; ends within 3 s of it.

    A run at work leaves its machine in order first, which is bounded by `gateway.stopping.LONGEST_S`.
    ``ready`` gets the page's url once it answers. Accounts, certificate and host names are those of the first site;
    ``sessions`` are those of people who have signed in already.
    Raises ConfigError (E-WEB-BIND, E-WEB-PORT, E-WEB-FILES, E-WEB-NAMES), BusyError (E-WEB-LOCKED), StoreError.
    """
    more_files()
    roots = tuple(dict.fromkeys(one.store.root for one in sites))
    with ExitStack() as held:
        for root in roots:
            held.enter_context(hold_folder_lock(root))
        first = sites[0]
        book = LogBook(first.store.root, clock.utc)
        held.enter_context(log_into(book))
        certificate, key = _tls(first)
        proxies = first.site.service.proxies
        secure = certificate is not None
        listener = held.enter_context(listener_on(host, port, secure=secure))
        places = _places(sites, clock)
        service = service_of(places, clock, accounts or accounts_of(first), sessions, secure=secure or bool(proxies))
        server = server_of(create_app(service), certificate, key, proxies)
        broker = Broker(SiteLender(places), clock)
        async with broker.open(roots):
            url = url_of(listener, secure=secure, name=next(iter(first.site.service.hosts), ""))

            def answers() -> None:
                _store_notice(
                    book,
                    words(
                        "S-SERVICE-SERVES", software=software(), places=", ".join(places), url=url, getpid=os.getpid()
                    ),
                )
                ready(url)

            held.callback(_store_notice, book, words("S-SERVICE-ENDED"))
            hourly = partial(record_refusals_hourly, service.doors, first.store.root, clock)
            beside = asyncio.create_task(supervise_task("refused sign-ins for the audit log", hourly, clock))
            try:
                await run_together(server, listener, places, clock=clock, until=stop.wait(), ready=answers)
            finally:
                await interrupt(beside, clock)
                await record_access(service.doors, first.store.root, clock)


def _store_notice(book: LogBook, text: str) -> None:
    book.add("INFO", "P-SERVICE-LOG", {"source": "service", "text": text})


def _load_libraries() -> tuple[object, ...]:
    """Load in a thread what a start does not wait for: its first use in mid-capture would hold up the loop."""
    return scipy.special, scipy.interpolate, scipy.optimize


def _places(sites: Sequence[ServiceParts], clock: Clock) -> dict[str, SiteService]:
    found: dict[str, SiteService] = {}
    for one in sites:
        if one.site.site.name in found:
            raise ConfigError("E-WEB-NAMES", str(one.path), name=one.site.site.name)
        found[one.site.site.name] = SiteService(one, clock)
    return found


def accounts_of(first: ServiceParts) -> UserAccounts:
    """The accounts of a service, which refuse passwords of the list that the first site names."""
    listed = first.site.service.leaked_passwords
    return UserAccounts(first.store.root, leaked=first.path.parent / listed if listed is not None else None)


def _tls(first: ServiceParts) -> tuple[Path | None, Path | None]:
    wanted = first.site.service
    if wanted.certificate is None or wanted.key is None:
        return None, None
    return first.path.parent / wanted.certificate, first.path.parent / wanted.key


def service_of(
    places: dict[str, SiteService],
    clock: Clock,
    accounts: UserAccounts,
    sessions: Sessions | None = None,
    *,
    secure: bool,
) -> Service:
    """What the pages serve, and who may come in. Raises StoreError."""
    first = next(iter(places.values()))
    wanted, root = first.site.service, first.store.root
    doors = access_of(root, clock, accounts, sessions or sessions_of(clock, wanted), hosts=wanted.hosts, secure=secure)

    for place in places.values():
        KeyRing(place.store.root).follow(root)

    def health() -> dict[str, object]:
        alarms = [str(alarm) for place in places.values() for alarm in place.alarms]
        return {"status": "alarm", "alarms": alarms} if alarms else {"status": "ok"}

    note = audit_person_acts(root, clock)
    return Service(places, doors=doors, clock=clock, health=health, note=note, software=software())


class SiteLender:
    """Finds the site that a command at a terminal means: by the folder of its store."""

    def __init__(self, places: dict[str, SiteService]) -> None:
        self._places = places

    async def __call__(self, lease: Lease) -> None:
        """Let go of that site's devices. Raises ConfigError (E-BROKER-SITE), BusyError."""
        for place in self._places.values():
            if str(place.store.root) == lease.root:
                await place.lend(lease)
                return
        raise ConfigError("E-BROKER-SITE", "broker", root=lease.root)


async def run_together(
    server: PageServer,
    listener: socket.socket,
    places: dict[str, SiteService],
    *,
    clock: Clock,
    until: Coroutine[Any, Any, object],
    ready: Callable[[], None],
) -> None:
    """Pages and sites until ``until`` is over, then all ended; ``ready`` is told once the pages answer."""
    over, notifier = asyncio.Event(), Notifier()

    async def announced() -> None:
        await server.listening.wait()
        notifier.ready(", ".join(places))
        ready()
        await clock.sleep(LOAD_AFTER_S)
        await asyncio.to_thread(_load_libraries)

    async def worked(place: SiteService) -> None:
        # The page first: what pushes left must be seen soon, and the library of a control takes its time to load.
        await wait_for_first(server.listening, over)
        await place.work(over)

    works = [asyncio.create_task(worked(place), name=name) for name, place in places.items()]
    page = asyncio.create_task(server.serve(sockets=[listener]), name="page")
    logs = {(place.store.root, place.site.service.syslog) for place in places.values() if place.site.service.syslog}
    days = [
        partial(compare_daily, place.desk, place.daily, clock) for place in places.values() if place.daily is not None
    ]
    sent = [partial(audit.forward, root, server, clock) for root, server in sorted(logs)]
    others = [asyncio.create_task(one) for one in (until, announced(), keep_telling(notifier, clock))]
    others += [asyncio.create_task(supervise_task("the daily comparison", one, clock)) for one in days]
    others += [asyncio.create_task(supervise_task("audit records for the server of logs", one, clock)) for one in sent]
    try:
        await asyncio.wait((page, *works, others[0]), return_when=asyncio.FIRST_COMPLETED)
    finally:
        notifier.stopping()
        over.set()
        for place in places.values():
            place.hub.end()
        server.should_exit = True
        await asyncio.gather(*(_end_task(task, clock) for task in (*works, page)))
        await asyncio.gather(*(interrupt(task, clock) for task in others))
    for task in (*works, page):
        if task.done() and not task.cancelled():
            task.result()


async def _end_task(task: asyncio.Task[None], clock: Clock) -> None:
    """Wait for a task that was told to end; one that does not is cancelled."""
    try:
        async with clock.deadline(GRACE_S + 0.4, task.get_name()):
            await asyncio.wait((task,))
    except DeadlineExceeded:
        await wait_for_shutdown(task, clock)
        await interrupt(task, clock, 0.1)


# Serves the page of a service that has no site file yet, until one is made there or the service is stopped.


async def serve_setup(
    site: SiteMaking,
    root: Path,
    *,
    clock: Clock,
    stop: asyncio.Event,
    host: str,
    port: int,
    ready: Callable[[str], None],
) -> tuple[Sessions, int]:
    """Ask for a site file on the page; ``root`` is the folder of its store. Who has signed in there, and the port.

    Raises ConfigError (E-WEB-BIND, E-WEB-PORT), BusyError (E-WEB-LOCKED), StoreError.
    """
    more_files()
    making = Making(site, asyncio.Event())
    accounts, sessions = UserAccounts(root), sessions_of(clock, ServiceSection())
    with ExitStack() as held:
        held.enter_context(hold_folder_lock(root))
        held.enter_context(log_into(LogBook(root, clock.utc)))
        listener = held.enter_context(listener_on(host, port, secure=False))
        doors, note = access_of(root, clock, accounts, sessions), audit_person_acts(root, clock)
        service = Service(
            {}, doors=doors, clock=clock, health=lambda: {"status": "ok"}, note=note, software=software(), making=making
        )
        server = server_of(create_app(service), None, None)
        url = url_of(listener, secure=False)
        port = int(listener.getsockname()[1])
        until = wait_for_first(stop, making.made)
        await run_together(server, listener, {}, clock=clock, until=until, ready=lambda: ready(url))
    return sessions, port
