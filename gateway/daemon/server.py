"""The listening side of the pages: address and TLS, bounds of the server, and who may come in."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import ssl
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from datetime import datetime
from ipaddress import ip_address
from pathlib import Path

import uvicorn

from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.message import render
from gateway import audit
from gateway.broker import token_of
from gateway.config import ServiceSection
from gateway.users import RefusedSignIns, Sessions, Tries, UserAccounts
from gateway.web import Doorkeeping

# The listening side: an address that may be listened on, TLS beyond this computer, the bounds of the server.
#
# Only documented options of uvicorn and of sockets are used. Neither bounds the time that a caller takes for its
# handshake (asyncio: 60 s) or for the head of its request. Such a caller holds one open file and no place of the gate;
# beyond this computer a reverse proxy ends it sooner (docs/service.md).

GRACE_S = 2
IDLE_S = 30
"""How long a connection is kept between two requests, s: a page's next command needs no new handshake."""
HEAD_BYTES = 1 << 15
BACKLOG = 4096
"""Who finds no place to wait at the door is let in by the kernel a second later, at the earliest."""
AT_ONCE = 64
"""How many connections the loop accepts before it turns to other work: a crowd at the door must not hold it up."""


class PageServer(uvicorn.Server):
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
        for one in sockets or ():
            one.listen(BACKLOG)  # the loop takes few at a time; those that wait their turn wait here
        self.listening.set()


def server_of(app: object, certificate: Path | None, key: Path | None, proxies: Sequence[str] = ()) -> PageServer:
    """A server of an application, over TLS where there is a certificate; ``proxies`` may say who asks through them.

    Raises ConfigError (E-WEB-FILES).
    """
    config = uvicorn.Config(
        app,  # type: ignore[arg-type]
        loop="asyncio",
        http="h11",
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=bool(proxies),
        forwarded_allow_ips=list(proxies),
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
        timeout_keep_alive=IDLE_S,
        h11_max_incomplete_event_size=HEAD_BYTES,
        backlog=AT_ONCE,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    try:
        config.load()
    except (OSError, ssl.SSLError) as error:
        raise ConfigError("E-WEB-FILES", "service", why=error.strerror or str(error)) from error
    return PageServer(config)


@contextmanager
def listener_on(host: str, port: int, *, secure: bool) -> Iterator[socket.socket]:
    """A bound socket; beyond this computer only over TLS. Raises ConfigError (E-WEB-BIND, E-WEB-PORT)."""
    address = "127.0.0.1" if host == "localhost" else host
    with socket.socket(_family(address, secure=secure), socket.SOCK_STREAM) as listener:
        if os.name == "posix":
            # Elsewhere this option would let two programs share the port.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)  # its callers have it too: the dead are found
        try:
            listener.bind((address, port))
            listener.listen(BACKLOG)
        except OSError as error:
            raise ConfigError("E-WEB-PORT", "web", port=port, why=error.strerror or str(error)) from error
        yield listener


def _family(address: str, *, secure: bool) -> socket.AddressFamily:
    try:
        known = ip_address(address)
    except ValueError as error:
        raise ConfigError("E-WEB-BIND", "web", host=address) from error
    if not known.is_loopback and not secure:
        raise ConfigError("E-WEB-BIND", "web", host=address)
    return socket.AF_INET6 if known.version == 6 else socket.AF_INET


def url_of(listener: socket.socket, *, secure: bool, name: str = "") -> str:
    """Where the page is; one that listens at every address is told by ``name``, else as this computer reaches it."""
    host, port = listener.getsockname()[:2]
    if ip_address(host).is_unspecified:
        host = name or "localhost"
    return f"{'https' if secure else 'http'}://{f'[{host}]' if ':' in host else host}:{port}/"


def more_files() -> None:
    """Let this process have as many connections as the system allows it: half-open ones of others must not fill it."""
    if os.name != "posix":
        return
    import resource  # noqa: PLC0415 - there is none elsewhere

    _soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 65536) if hard > 0 else 65536, hard))


# Who may come in to the pages of a store, and the record of what people did there.

SECRET_TRIES, SECRET_WITHIN_S = 5, 60.0
REQUESTS, REQUESTS_WITHIN_S = 600, 10.0
REFUSED_EVERY_S, REFUSED, RENAMED = 3600.0, "sign-in-refused", "user-renamed"
LOG = logging.getLogger("trueflank.accounts")


def sessions_of(clock: Clock, wanted: ServiceSection) -> Sessions:
    """Nobody has signed in yet."""
    return Sessions(lambda: clock.uptime().seconds, wanted.signout_min * 60.0)


def access_of(
    root: Path,
    clock: Clock,
    accounts: UserAccounts,
    sessions: Sessions,
    *,
    hosts: Sequence[str] = (),
    secure: bool = False,
) -> Doorkeeping:
    """Who may come in to a store's service; makes the token of the first start, brings older accounts up to date.

    Raises StoreError.
    """
    accounts.first_token()
    for one in accounts.migrate(clock.utc()):
        LOG.warning("%s", render(one))
        audit.note(root, RENAMED, clock=clock, actor="nobody", role="service", details=dict(one.fields))
    return Doorkeeping(
        accounts=accounts,
        sessions=sessions,
        terminal=token_of(root),
        tries=Tries(clock.now, SECRET_TRIES, SECRET_WITHIN_S),
        asks=Tries(clock.now, REQUESTS, REQUESTS_WITHIN_S),
        hosts=tuple(hosts),
        secure=secure,
    )


@dataclass(frozen=True, slots=True)
class Moment:
    """One moment of a clock, for a thread that has no loop to ask."""

    at_utc: datetime
    at_s: float

    def utc(self) -> datetime:
        """The moment in UTC."""
        return self.at_utc

    def now(self) -> float:
        """Monotonic seconds."""
        return self.at_s


async def record_refusals_hourly(doors: Doorkeeping, root: Path, clock: Clock) -> None:
    """Every hour, for ever, what `record_refusals` and the accounts have to keep."""
    while True:
        await clock.sleep(REFUSED_EVERY_S)
        await record_access(doors, root, clock)


async def record_access(doors: Doorkeeping, root: Path, clock: Clock) -> None:
    """Refused sign-ins into the audit log, and when tokens were used last into the accounts."""
    await record_refusals(doors.refused, root, clock)
    await asyncio.to_thread(doors.accounts.keep_uses)


async def record_refusals(refused: RefusedSignIns, root: Path, clock: Clock) -> None:
    """What was refused since the last time into the audit log, in a thread: nobody acted, the address is recorded.

    There is one record for each name and address.
    """
    found, moment = refused.take(), Moment(clock.utc(), clock.now())

    def keep() -> None:
        for one in found:
            audit.note(root, REFUSED, clock=moment, actor="nobody", role="service", details=one.as_data())

    if found:
        await asyncio.to_thread(keep)


def audit_person_acts(root: Path, clock: Clock) -> Callable[..., str]:
    """Keeps what people did in a store's audit log."""

    def note(action: str, *, actor: str = "", details: dict[str, object] | None = None) -> str:
        return audit.note(root, action, clock=clock, actor=actor, role="service", details=details)

    return note
