"""Serves sites until told to stop: locks, broker, pages, and each site's devices, runs and folders, ended together."""

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
from gateway import audit
from gateway.broker import Broker, Lease, locked
from gateway.daemon.daily import each_day
from gateway.daemon.desk import interrupt, left_in_order
from gateway.daemon.doorkeeping import doors_of, keep_what_was_seen, note_refused, noting, sessions_of
from gateway.daemon.lasting import lasting
from gateway.daemon.listening import GRACE_S, PageServer, listener_on, more_files, server_of, url_of
from gateway.daemon.logs import logged_into
from gateway.daemon.notify import Notifier, keep_telling
from gateway.daemon.served import ServedPlace, Serving, either, software
from gateway.store.logbook import LogBook
from gateway.users import KeyRing, Sessions, UserAccounts
from gateway.web import Service, create_app

LATER_S = 3.0


async def serve(
    sites: Sequence[Serving],
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
            held.enter_context(locked(root))
        first = sites[0]
        book = LogBook(first.store.root, clock.utc)
        held.enter_context(logged_into(book))
        certificate, key = _tls(first)
        proxies = first.site.service.proxies
        secure = certificate is not None
        listener = held.enter_context(listener_on(host, port, secure=secure))
        places = _places(sites, clock)
        service = service_of(places, clock, accounts or accounts_of(first), sessions, secure=secure or bool(proxies))
        server = server_of(create_app(service), certificate, key, proxies)
        broker = Broker(Lending(places), clock)
        async with broker.open(roots):
            url = url_of(listener, secure=secure, name=next(iter(first.site.service.hosts), ""))

            def answers() -> None:
                _noted(book, f"{software()} serves {', '.join(places)} at {url}, process {os.getpid()}")
                ready(url)

            held.callback(_noted, book, "the service ended")
            hourly = partial(note_refused, service.doors, first.store.root, clock)
            beside = asyncio.create_task(lasting("refused sign-ins for the audit log", hourly, clock))
            try:
                await together(server, listener, places, clock=clock, until=stop.wait(), ready=answers)
            finally:
                await interrupt(beside, clock)
                await keep_what_was_seen(service.doors, first.store.root, clock)


def _noted(book: LogBook, text: str) -> None:
    book.add("INFO", "P-SERVICE-LOG", {"source": "service", "text": text})


def _loaded() -> tuple[object, ...]:
    """Load in a thread what a start does not wait for: its first use in mid-capture would hold up the loop."""
    return scipy.special, scipy.interpolate, scipy.optimize


def _places(sites: Sequence[Serving], clock: Clock) -> dict[str, ServedPlace]:
    found: dict[str, ServedPlace] = {}
    for one in sites:
        if one.site.site.name in found:
            raise ConfigError("E-WEB-NAMES", str(one.path), name=one.site.site.name)
        found[one.site.site.name] = ServedPlace(one, clock)
    return found


def accounts_of(first: Serving) -> UserAccounts:
    """The accounts of a service, which refuse passwords of the list that the first site names."""
    listed = first.site.service.leaked_passwords
    return UserAccounts(first.store.root, leaked=first.path.parent / listed if listed is not None else None)


def _tls(first: Serving) -> tuple[Path | None, Path | None]:
    wanted = first.site.service
    if wanted.certificate is None or wanted.key is None:
        return None, None
    return first.path.parent / wanted.certificate, first.path.parent / wanted.key


def service_of(
    places: dict[str, ServedPlace],
    clock: Clock,
    accounts: UserAccounts,
    sessions: Sessions | None = None,
    *,
    secure: bool,
) -> Service:
    """What the pages serve, and who may come in. Raises StoreError."""
    first = next(iter(places.values()))
    wanted, root = first.site.service, first.store.root
    doors = doors_of(root, clock, accounts, sessions or sessions_of(clock, wanted), hosts=wanted.hosts, secure=secure)

    for place in places.values():
        KeyRing(place.store.root).follow(root)

    def health() -> dict[str, object]:
        alarms = [str(alarm) for place in places.values() for alarm in place.alarms]
        return {"status": "alarm", "alarms": alarms} if alarms else {"status": "ok"}

    note = noting(root, clock)
    return Service(places, doors=doors, clock=clock, health=health, note=note, software=software())


class Lending:
    """Finds the site that a command at a terminal means: by the folder of its store."""

    def __init__(self, places: dict[str, ServedPlace]) -> None:
        self._places = places

    async def __call__(self, lease: Lease) -> None:
        """Let go of that site's devices. Raises ConfigError (E-BROKER-SITE), BusyError."""
        for place in self._places.values():
            if str(place.store.root) == lease.root:
                await place.lend(lease)
                return
        raise ConfigError("E-BROKER-SITE", "broker", root=lease.root)


async def together(
    server: PageServer,
    listener: socket.socket,
    places: dict[str, ServedPlace],
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
        await clock.sleep(LATER_S)
        await asyncio.to_thread(_loaded)

    async def worked(place: ServedPlace) -> None:
        # The page first: what pushes left must be seen soon, and the library of a control takes its time to load.
        await either(server.listening, over)
        await place.work(over)

    works = [asyncio.create_task(worked(place), name=name) for name, place in places.items()]
    page = asyncio.create_task(server.serve(sockets=[listener]), name="page")
    logs = {(place.store.root, place.site.service.syslog) for place in places.values() if place.site.service.syslog}
    days = [partial(each_day, place.desk, place.daily, clock) for place in places.values() if place.daily is not None]
    sent = [partial(audit.forward, root, server, clock) for root, server in sorted(logs)]
    others = [asyncio.create_task(one) for one in (until, announced(), keep_telling(notifier, clock))]
    others += [asyncio.create_task(lasting("the daily comparison", one, clock)) for one in days]
    others += [asyncio.create_task(lasting("audit records for the server of logs", one, clock)) for one in sent]
    try:
        await asyncio.wait((page, *works, others[0]), return_when=asyncio.FIRST_COMPLETED)
    finally:
        notifier.stopping()
        over.set()
        for place in places.values():
            place.hub.end()
        server.should_exit = True
        await asyncio.gather(*(_ended(task, clock) for task in (*works, page)))
        await asyncio.gather(*(interrupt(task, clock) for task in others))
    for task in (*works, page):
        if task.done() and not task.cancelled():
            task.result()


async def _ended(task: asyncio.Task[None], clock: Clock) -> None:
    """Wait for a task that was told to end; one that does not is cancelled."""
    try:
        async with clock.deadline(GRACE_S + 0.4, task.get_name()):
            await asyncio.wait((task,))
    except DeadlineExceeded:
        await left_in_order(task, clock)
        await interrupt(task, clock, 0.1)
