"""The listening side: an address that may be listened on, TLS beyond this computer, heads that come in time."""

from __future__ import annotations

import asyncio
import os
import socket
import ssl
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from drivers.errors import ConfigError
from gateway.daemon.handshakes import Handshakes

GRACE_S = 2
HEAD_S = 5.0
HEAD_BYTES = 1 << 16
BACKLOG = 4096
"""Who finds no place to wait at the door is let in by the kernel a second later, at the earliest."""
AT_ONCE = 64
"""How many connections the loop accepts before it turns to other work: a crowd at the door must not hold it up."""


class InTurn:
    """Requests that have come and wait for their turn: one is begun in each turn of the loop, health never waits.

    ``refused`` gets an address and how many wait; what that caller is told at once, b"" where it may come in.
    """

    def __init__(self, refused: Callable[[str, int], bytes]) -> None:
        self._refused = refused
        self._line: deque[tuple[InTime, bytes]] = deque()

    def answer(self, data: bytes, address: str) -> bytes:
        """What a request is told before it is read; b"" where it may wait, or is none that can be refused here."""
        return self._refused(address, len(self._line)) if is_whole(data) and data.startswith(b"GET ") else b""

    def enter(self, one: InTime, data: bytes) -> None:
        """This request is begun in its turn."""
        self._line.append((one, data))
        if len(self._line) == 1:
            one.loop.call_soon(self._next)

    def _next(self) -> None:
        one, data = self._line.popleft()
        if self._line:
            one.loop.call_soon(self._next)
        one.begin(data)


def is_whole(data: bytes) -> bool:
    """Whether this is a complete request head, and not a question for health."""
    return b"\r\n\r\n" in data and not data.startswith(b"GET /healthz ")


class InTime(H11Protocol):
    """Closes a connection whose request head is not complete within 5 s of its first moment; requests take turns."""

    waiting: InTurn

    _watch: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """As usual, and the time begins."""
        super().connection_made(transport)
        self._begin()

    def data_received(self, data: bytes) -> None:
        """A request is told to go, or waits for its turn; the head of the next one has its time too."""
        if not self._is_idle() or not is_whole(data):
            self._read(data)
        elif answer := self.waiting.answer(data, self.client[0] if self.client else ""):
            self._end()
            self.transport.write(answer)
            self.transport.close()
        else:
            self._end()
            self._unset_keepalive_if_required()  # it has asked, though it is read later only
            self.flow.pause_reading()
            self.waiting.enter(self, data)

    def begin(self, data: bytes) -> None:
        """Its turn has come; nothing where the caller has left."""
        if not self.transport.is_closing():
            self.flow.resume_reading()
            self._read(data)

    def _read(self, data: bytes) -> None:
        super().data_received(data)
        if not self._is_idle():
            self._end()
        elif self._watch is None and not self.transport.is_closing():
            self._begin()

    def _is_idle(self) -> bool:
        return self.cycle is None or self.cycle.response_complete

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


class Entrance(socket.socket):
    """Takes a bounded number of callers in a turn of the loop, and answers at once whom ``answer`` refuses.

    ``answer`` gets what a caller has sent so far and its address; b"" lets it in. Over TLS nothing can be read here:
    ``enter`` gets every caller. A loop that does not call `accept` (Windows) lets all in: refused when they ask.
    """

    answer: Callable[[bytes, str], bytes] = staticmethod(lambda _data, _address: b"")
    enter: Callable[[socket.socket], None] | None = None
    _left = AT_ONCE

    def accept(self) -> tuple[socket.socket, Any]:
        """The next caller that is let in; BlockingIOError where there is none, or the turn is over."""
        try:
            while self._left:
                self._left -= 1
                caller, address = super().accept()
                caller.setblocking(False)
                if self.enter is not None:
                    self.enter(caller)
                elif not self._is_refused(caller, str(address[0])):
                    return caller, address
            raise BlockingIOError
        except OSError:
            self._left = AT_ONCE
            raise

    def _is_refused(self, caller: socket.socket, address: str) -> bool:
        try:
            if not (answer := self.answer(caller.recv(HEAD_BYTES, socket.MSG_PEEK), address)):
                return False
            caller.recv(HEAD_BYTES)
            caller.send(answer)
        except BlockingIOError:
            return False  # it has asked nothing yet
        except OSError:
            pass  # it has left
        caller.close()
        return True


class PageServer(uvicorn.Server):
    """A uvicorn that leaves signals to us and says when it listens."""

    def __init__(self, config: uvicorn.Config, waiting: InTurn) -> None:
        super().__init__(config)
        self._waiting = waiting
        self._handshakes: Handshakes | None = None
        self.listening = asyncio.Event()

    def capture_signals(self) -> nullcontext[None]:  # type: ignore[override]
        """Signals are the business of whoever started the daemon."""
        return nullcontext()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start as usual, then say so."""
        await super().startup(sockets)
        for one in sockets or ():
            if isinstance(one, Entrance) and (context := self.config.ssl) is not None:
                one.enter = self._before_tls(context).enter
            elif isinstance(one, Entrance):
                one.answer = self._waiting.answer
            one.listen(BACKLOG)  # the loop takes few at a time; those that wait their turn wait here
        self.listening.set()

    def _before_tls(self, context: ssl.SSLContext) -> Handshakes:
        given = {"config": self.config, "server_state": self.server_state, "app_state": self.lifespan.state}
        protocol = partial(self.config.http_protocol_class, **given)
        self._handshakes = Handshakes(protocol, context, patience_s=HEAD_S)
        return self._handshakes

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End as usual; who has not been let in yet is hung up on first."""
        if self._handshakes is not None:
            for server in self.servers:
                server.close()
            await self._handshakes.end()
        await super().shutdown(sockets)


def server_of(
    app: object, certificate: Path | None, key: Path | None, refused: Callable[[str, int], bytes]
) -> PageServer:
    """A server of an application, over TLS where there is a certificate. Raises ConfigError (E-WEB-FILES)."""
    waiting = InTurn(refused)
    config = uvicorn.Config(
        app,  # type: ignore[arg-type]
        loop="asyncio",
        http=type("Door", (InTime,), {"waiting": waiting}),
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
        backlog=AT_ONCE + 1,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    try:
        config.load()
    except (OSError, ssl.SSLError) as error:
        raise ConfigError("E-WEB-FILES", "service", why=error.strerror or str(error)) from error
    return PageServer(config, waiting)


@contextmanager
def listener_on(host: str, port: int, *, secure: bool) -> Iterator[socket.socket]:
    """A bound socket; beyond this computer only over TLS. Raises ConfigError (E-WEB-BIND, E-WEB-PORT)."""
    address = "127.0.0.1" if host == "localhost" else host
    with Entrance(_family(address, secure=secure), socket.SOCK_STREAM) as listener:
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
