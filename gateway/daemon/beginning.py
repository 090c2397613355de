"""Serves the page of a service that has no site file yet, until one is made there or the service is stopped."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from drivers.clock import Clock
from gateway.broker import locked
from gateway.config.service import ServiceSection
from gateway.daemon.doorkeeping import doors_of, noting, sessions_of
from gateway.daemon.listening import listener_on, more_files, server_of, url_of
from gateway.daemon.logs import logged_into
from gateway.daemon.served import either, software
from gateway.daemon.serving import together
from gateway.store.logbook import LogBook
from gateway.users import Sessions, UserAccounts
from gateway.web import Making, Service, SiteMaking, create_app


async def begin(
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
        held.enter_context(locked(root))
        held.enter_context(logged_into(LogBook(root, clock.utc)))
        listener = held.enter_context(listener_on(host, port, secure=False))
        doors, note = doors_of(root, clock, accounts, sessions), noting(root, clock)
        service = Service(
            {}, doors=doors, clock=clock, health=lambda: {"status": "ok"}, note=note, software=software(), making=making
        )
        server = server_of(create_app(service), None, None)
        url = url_of(listener, secure=False)
        port = int(listener.getsockname()[1])
        until = either(stop, making.made)
        await together(server, listener, {}, clock=clock, until=until, ready=lambda: ready(url))
    return sessions, port
