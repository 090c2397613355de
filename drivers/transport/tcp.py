"""TCP wires: tcp://host:port as a client, and plain TCP listeners for tcp:// and socket:// clients."""

from __future__ import annotations

import asyncio
import contextlib
from urllib.parse import urlsplit

from drivers.clock import Clock
from drivers.errors import ConfigError, DeadlineExceeded, TransportError
from drivers.transport.conversations import Conversations
from drivers.transport.stream import Handler

BUFFER_BYTES = 1 << 20
FLUSH_S = 1.0


class TcpTransport:
    """One TCP connection over asyncio streams."""

    def __init__(self, url: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, clock: Clock) -> None:
        self._url = url
        self._reader = reader
        self._writer = writer
        self._clock = clock

    @property
    def description(self) -> str:
        """The url."""
        return self._url

    async def read(self, max_bytes: int) -> bytes:
        """Return 1 .. max_bytes bytes; TransportError (E-LINK-CLOSED) at the end of the stream."""
        try:
            data = await self._reader.read(max_bytes)
        except OSError as error:
            raise TransportError("E-LINK-CLOSED", self._url, why=str(error)) from error
        if not data:
            raise TransportError("E-LINK-CLOSED", self._url, why="the peer closed the connection")
        return data

    async def write(self, data: bytes) -> None:
        """Write and drain; TransportError (E-LINK-CLOSED)."""
        if self._writer.is_closing():
            raise TransportError("E-LINK-CLOSED", self._url, why="this end is closed")
        try:
            self._writer.write(data)
            await self._writer.drain()
        except OSError as error:
            raise TransportError("E-LINK-CLOSED", self._url, why=str(error)) from error

    async def close(self) -> None:
        """Flush for a moment, then let go; a peer that does not read cannot hold us."""
        self._writer.close()
        try:
            async with self._clock.deadline(FLUSH_S, self._url):
                await self._writer.wait_closed()
        except (DeadlineExceeded, OSError):
            self._writer.transport.abort()


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
            reader, writer = await asyncio.open_connection(host, port, limit=BUFFER_BYTES)
        except OSError as error:
            raise TransportError("E-LINK-CONNECT", url, why=str(error)) from error
    return TcpTransport(url, reader, writer, clock)


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

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        conversations.begin(TcpTransport(f"peer of {url}", reader, writer, clock))

    try:
        server = await asyncio.start_server(accept, host, port, limit=BUFFER_BYTES)
    except OSError as error:
        raise TransportError("E-LINK-LISTEN", url, why=str(error)) from error
    real = server.sockets[0].getsockname()[1]
    return TcpListener(server, f"{scheme}://{host}:{real}", conversations)
