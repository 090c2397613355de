"""TCP wires: tcp://host:port as a client, and plain TCP listeners for tcp:// and socket:// clients."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from urllib.parse import urlsplit

from drivers.clock import Clock
from drivers.errors import ConfigError, DeadlineExceeded, TransportError
from drivers.transport.conversations import Conversations
from drivers.transport.stream import Handler

QUEUE_BYTES = 1 << 20
FLUSH_S = 1.0


class _Pieces(asyncio.Protocol):
    """What has come and was not taken yet, in the pieces it came in; a full queue holds the peer back."""

    def __init__(self, accept: Callable[[_Pieces, asyncio.Transport], None] | None = None) -> None:
        self._accept = accept
        self._transport: asyncio.Transport | None = None
        self._pieces: deque[bytes] = deque()
        self._waiting = 0
        self._paused = False
        self._ended = ""
        self._news = asyncio.Event()
        self._room = asyncio.Event()
        self._room.set()
        self.gone = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if isinstance(transport, asyncio.Transport):
            self._transport = transport
            if self._accept is not None:
                self._accept(self, transport)

    def data_received(self, data: bytes) -> None:
        self._pieces.append(data)
        self._waiting += len(data)
        self._news.set()
        if self._waiting > QUEUE_BYTES and not self._paused and self._transport is not None:
            self._paused = True
            self._transport.pause_reading()

    def eof_received(self) -> bool:
        self._end("the peer closed the connection")
        return True  # what we still have to say may be said

    def connection_lost(self, exc: Exception | None) -> None:
        self._end(str(exc) if exc is not None else "the peer closed the connection")
        self.gone.set()

    def _end(self, why: str) -> None:
        self._ended = self._ended or why
        self._news.set()
        self._room.set()

    def pause_writing(self) -> None:
        self._room.clear()

    def resume_writing(self) -> None:
        self._room.set()

    async def drained(self) -> None:
        """Wait while the peer takes nothing."""
        await self._room.wait()

    async def take(self, max_bytes: int, where: str) -> bytes:
        """The oldest piece, or its beginning; TransportError (E-LINK-CLOSED) once all is taken and the peer gone."""
        while not self._pieces:
            if self._ended:
                raise TransportError("E-LINK-CLOSED", where, why=self._ended)
            self._news.clear()
            await self._news.wait()
        piece = self._pieces.popleft()
        if len(piece) > max_bytes:
            self._pieces.appendleft(piece[max_bytes:])
            piece = piece[:max_bytes]
        self._waiting -= len(piece)
        if self._paused and self._waiting <= QUEUE_BYTES // 2 and self._transport is not None:
            self._paused = False
            self._transport.resume_reading()
        return piece


class TcpTransport:
    """One TCP connection; pieces are handed on as the system gave them, without copies."""

    def __init__(self, url: str, pieces: _Pieces, transport: asyncio.Transport, clock: Clock) -> None:
        self._url = url
        self._pieces = pieces
        self._transport = transport
        self._clock = clock

    @property
    def description(self) -> str:
        """The url."""
        return self._url

    async def read(self, max_bytes: int) -> bytes:
        """Return 1 .. max_bytes bytes; TransportError (E-LINK-CLOSED) at the end of the stream."""
        return await self._pieces.take(max_bytes, self._url)

    async def write(self, data: bytes) -> None:
        """Write, waiting while the peer is slow; TransportError (E-LINK-CLOSED)."""
        self._check_open()
        self._transport.write(data)
        await self._pieces.drained()
        self._check_lost()

    def _check_open(self) -> None:
        if self._transport.is_closing():
            raise TransportError("E-LINK-CLOSED", self._url, why="this end is closed")

    def _check_lost(self) -> None:
        if self._pieces.gone.is_set():
            raise TransportError("E-LINK-CLOSED", self._url, why="the peer closed the connection")

    async def close(self) -> None:
        """Flush for a moment, then let go; a peer that does not read cannot hold us."""
        self._transport.close()
        try:
            async with self._clock.deadline(FLUSH_S, self._url):
                await self._pieces.gone.wait()
        except DeadlineExceeded:
            self._transport.abort()


def host_and_port(url: str) -> tuple[str, int]:
    """Split scheme://host:port. Raises ConfigError (E-LINK-URL)."""
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError as error:
        raise ConfigError("E-LINK-URL", url, why=str(error)) from error
    if not parts.hostname or port is None:
        raise ConfigError("E-LINK-URL", url, why="host or port is missing")
    return parts.hostname, port


async def open_tcp(url: str, clock: Clock, timeout_s: float) -> TcpTransport:
    """Connect to tcp://host:port. Raises TransportError (E-LINK-CONNECT), DeadlineExceeded, ConfigError."""
    host, port = host_and_port(url)
    async with clock.deadline(timeout_s, url):
        try:
            transport, pieces = await asyncio.get_running_loop().create_connection(_Pieces, host, port)
        except OSError as error:
            raise TransportError("E-LINK-CONNECT", url, why=str(error)) from error
    return TcpTransport(url, pieces, transport, clock)


class TcpListener:
    """A listening socket; ``url`` names the port the system gave."""

    def __init__(self, server: asyncio.Server, url: str, conversations: Conversations) -> None:
        self._server = server
        self._url = url
        self._conversations = conversations

    @property
    def url(self) -> str:
        """Where clients reach it."""
        return self._url

    async def close(self) -> None:
        """Stop listening and end all conversations; raises what a handler died of."""
        self._server.close()
        try:
            await self._conversations.end()
        finally:
            with contextlib.suppress(OSError):
                await self._server.wait_closed()


async def serve_tcp(url: str, handler: Handler, clock: Clock) -> TcpListener:
    """Listen on scheme://host:port (port 0: any free one) and run `handler` for each peer."""
    host, port = host_and_port(url)
    scheme = urlsplit(url).scheme
    conversations = Conversations(handler, url)

    def accept(pieces: _Pieces, transport: asyncio.Transport) -> None:
        conversations.begin(TcpTransport(f"peer of {url}", pieces, transport, clock))

    try:
        server = await asyncio.get_running_loop().create_server(lambda: _Pieces(accept), host, port)
    except OSError as error:
        raise TransportError("E-LINK-LISTEN", url, why=str(error)) from error
    real = server.sockets[0].getsockname()[1]
    return TcpListener(server, f"{scheme}://{host}:{real}", conversations)
