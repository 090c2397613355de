"""The listening side: an address that may be listened on, TLS beyond this computer, heads that come in time."""

from __future__ import annotations

import asyncio
import os
import socket
import ssl
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from ipaddress import ip_address
from pathlib import Path

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from drivers.errors import ConfigError

GRACE_S = 2
HEAD_S = 5.0
BACKLOG = 4096
"""Who finds no place to wait at the door is let in by the kernel a second later, at the earliest."""
AT_ONCE = 64
"""How many connections the loop accepts before it turns to other work: a crowd at the door must not hold it up."""


class InTime(H11Protocol):
    """Closes a connection whose request head is not complete within 5 s of its first moment.

    ``refused`` is what an address that asks too often is told at once; b"" where it may ask.
    """

    refused: Callable[[str], bytes] = staticmethod(lambda _address: b"")

    _watch: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """As usual, and the time begins."""
        super().connection_made(transport)
        self._begin()

    def data_received(self, data: bytes) -> None:
        """As usual; the head of the next request on the same connection has its time too."""
        if answer := self._answer_at_the_door(data):
            self._end()
            self.transport.write(answer)
            self.transport.close()
            return
        super().data_received(data)
        if self.cycle is not None and not self.cycle.response_complete:
            self._end()
        elif self._watch is None and not self.transport.is_closing():
            self._begin()

    def _answer_at_the_door(self, data: bytes) -> bytes:
        """To a crowd: its requests are not even read. A question for health always is."""
        asks = self.cycle is None and data.startswith(b"GET ") and not data.startswith(b"GET /healthz ")
        return self.refused(self.client[0] if self.client else "") if asks and b"\r\n\r\n" in data else b""

    def connection_lost(self, exc: Exception | None) -> None:
        """As usual."""
        self._end()
        super().connection_lost(exc)

    def _begin(self) -> None:
        self._watch = self.loop.call_later(HEAD_S, self._close)

    def _end(self) -> None:
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None

    def _close(self) -> None:
        if not self.transport.is_closing():
            self.transport.abort()


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


def server_of(app: object, certificate: Path | None, key: Path | None, refused: Callable[[str], bytes]) -> PageServer:
    """A server of an application, over TLS where there is a certificate. Raises ConfigError (E-WEB-FILES)."""
    config = uvicorn.Config(
        app,  # type: ignore[arg-type]
        loop="asyncio",
        http=type("Door", (InTime,), {"refused": staticmethod(refused)}),
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
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


def url_of(listener: socket.socket, *, secure: bool) -> str:
    """Where the page is."""
    host, port = listener.getsockname()[:2]
    return f"{'https' if secure else 'http'}://{f'[{host}]' if ':' in host else host}:{port}/"


def more_files() -> None:
    """Let this process have as many connections as the system allows it: half-open ones of others must not fill it."""
    if os.name != "posix":
        return
    import resource  # noqa: PLC0415 - there is none elsewhere

    _soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 65536) if hard > 0 else 65536, hard))
