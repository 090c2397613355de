"""Serves a site until told to stop: lock, token, page and desk, started and ended together."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from importlib import metadata
from ipaddress import ip_address

import uvicorn

from drivers.clock import Clock
from drivers.errors import ConfigError, DeadlineExceeded
from gateway.config import SiteFile
from gateway.daemon.daily import Daily, each_day
from gateway.daemon.desk import Desk, Devices, RunStarter, interrupt, left_in_order
from gateway.daemon.lock import locked
from gateway.daemon.stored import last_result, newest_runs, pushes_held, stored_report
from gateway.daemon.token import token_of
from gateway.store import Store
from gateway.views import StatusView
from gateway.web import create_app

GRACE_S = 2


class _Server(uvicorn.Server):
    """A uvicorn that leaves signals to us and says when it listens."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.listening = asyncio.Event()

    def capture_signals(self) -> nullcontext[None]:  # type: ignore[override]
        """Signals are the business of whoever started the daemon."""
        return nullcontext()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start as usual, then say so."""
        await super().startup(sockets)
        self.listening.set()


async def serve(
    site: SiteFile,
    supervisor_factory: Callable[[], Devices],
    run_starter: RunStarter | None,
    *,
    store: Store,
    clock: Clock,
    stop: asyncio.Event,
    host: str = "127.0.0.1",
    port: int = 8617,
    ready: Callable[[str], None] = lambda _url: None,
    daily: Daily | None = None,
    alarms: Callable[[], tuple[str, ...]] = tuple,
) -> None:
    """Open and watch the devices and serve the page until `stop` is set; ends within 3 s of it.

    A run at work leaves its machine in order first, which is bounded by `gateway.stopping.LONGEST_S`.

    ``run_starter`` does a whole run that only proposes (see `Desk`); None makes a gateway that only watches.
    ``ready`` gets the page's url once it answers. ``daily`` is what is compared each day; ``alarms`` tells the live
    tables that are not as they were pushed. The lock and the token live in the store's folder.
    Raises ConfigError (E-WEB-BIND, E-WEB-PORT), BusyError (E-WEB-LOCKED), StoreError (E-WEB-STATE).
    """
    with locked(store.root), _listener(host, port) as listener:
        desk = Desk(supervisor_factory(), run_starter, clock)
        picture = partial(status, site, desk, store, clock, alarms, daily)
        starter = desk.start if run_starter is not None else None
        app = create_app(picture, starter, token_of(store.root), partial(stored_report, store))
        await _together(_server(app), listener, desk, clock, stop, ready, daily)


async def _together(
    server: _Server,
    listener: socket.socket,
    desk: Desk,
    clock: Clock,
    stop: asyncio.Event,
    ready: Callable[[str], None],
    daily: Daily | None,
) -> None:
    over = asyncio.Event()
    page = asyncio.create_task(server.serve(sockets=[listener]), name="page")
    work = asyncio.create_task(desk.work(over), name="desk")
    ended = asyncio.create_task(stop.wait(), name="stop")
    listening = asyncio.create_task(_announce(server, listener, ready), name="ready")
    days = asyncio.create_task(each_day(desk, daily, clock), name="daily") if daily is not None else None
    try:
        await asyncio.wait((page, work, ended), return_when=asyncio.FIRST_COMPLETED)
    finally:
        over.set()
        server.should_exit = True
        await asyncio.gather(_ended(work, clock), _ended(page, clock))
        others = [task for task in (ended, listening, days) if task is not None]
        await asyncio.gather(*(interrupt(task, clock) for task in others))
    for task in (work, page):
        if task.done() and not task.cancelled():
            task.result()


async def _announce(server: _Server, listener: socket.socket, ready: Callable[[str], None]) -> None:
    await server.listening.wait()
    host, port = listener.getsockname()[:2]
    ready(f"http://{f'[{host}]' if ':' in host else host}:{port}/")


async def _ended(task: asyncio.Task[None], clock: Clock) -> None:
    """Wait for a task that was told to end; one that does not is cancelled."""
    try:
        async with clock.deadline(GRACE_S + 0.4, task.get_name()):
            await asyncio.wait((task,))
    except DeadlineExceeded:
        await left_in_order(task, clock)
        await interrupt(task, clock, 0.1)


def _server(app: object) -> _Server:
    config = uvicorn.Config(
        app,  # type: ignore[arg-type]
        loop="asyncio",
        http="h11",
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        limit_concurrency=64,
        timeout_graceful_shutdown=GRACE_S,
    )
    return _Server(config)


@contextmanager
def _listener(host: str, port: int) -> Iterator[socket.socket]:
    """A bound socket on a loopback address. Raises ConfigError (E-WEB-BIND, E-WEB-PORT)."""
    address = "127.0.0.1" if host == "localhost" else host
    with socket.socket(_family(address), socket.SOCK_STREAM) as listener:
        if os.name == "posix":
            # Elsewhere this option would let two programs share the port.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address, port))
            listener.listen(64)
        except OSError as error:
            raise ConfigError("E-WEB-PORT", "web", port=port, why=error.strerror or str(error)) from error
        yield listener


def _family(address: str) -> socket.AddressFamily:
    try:
        known = ip_address(address)
    except ValueError as error:
        raise ConfigError("E-WEB-BIND", "web", host=address) from error
    if not known.is_loopback:
        raise ConfigError("E-WEB-BIND", "web", host=address)
    return socket.AF_INET6 if known.version == 6 else socket.AF_INET


def status(
    site: SiteFile,
    desk: Desk,
    store: Store,
    clock: Clock,
    alarms: Callable[[], tuple[str, ...]] = tuple,
    daily: Daily | None = None,
) -> StatusView:
    """The whole picture as it is now; reads the newest runs from the store."""
    return StatusView(
        site=site.site.name,
        software=f"trueflank {metadata.version('trueflank')}",
        now_utc=clock.utc().isoformat(timespec="seconds"),
        devices=desk.devices(),
        run=desk.run,
        last_runs=newest_runs(store),
        failure=desk.failure,
        result=last_result(store),
        trouble=desk.trouble,
        alarms=alarms(),
        due=daily.words if daily is not None else "",
        left=() if desk.left.clear else (desk.left.said.as_record(),),
        held=pushes_held(store),
    )
