"""Wires inside one process: memory://name, two bounded pipes between a client and a registered listener."""

from __future__ import annotations

import asyncio
from urllib.parse import urlsplit

from drivers.errors import ConfigError, TransportError
from drivers.message import Message
from drivers.transport.stream import Conversations, Handler

PIPE_BYTES = 1 << 18


class _Pipe:
    """One direction: a bounded buffer that holds its writer back when full."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._filled = asyncio.Event()
        self._emptied = asyncio.Event()
        self._closed = False

    async def put(self, data: bytes, where: str) -> None:
        view = memoryview(data)
        while view:
            while len(self._buffer) >= PIPE_BYTES and not self._closed:
                self._emptied.clear()
                await self._emptied.wait()
            if self._closed:
                raise TransportError("E-LINK-CLOSED", where, why=Message.of("W-LINK-PEER-CLOSED"))
            room = PIPE_BYTES - len(self._buffer)
            self._buffer += view[:room]
            view = view[room:]
            self._filled.set()

    async def take(self, max_bytes: int, where: str) -> bytes:
        while not self._buffer:
            if self._closed:
                raise TransportError("E-LINK-CLOSED", where, why=Message.of("W-LINK-PEER-CLOSED"))
            self._filled.clear()
            await self._filled.wait()
        data = bytes(self._buffer[:max_bytes])
        del self._buffer[:max_bytes]
        self._emptied.set()
        return data

    def close(self) -> None:
        self._closed = True
        self._filled.set()
        self._emptied.set()


class MemoryTransport:
    """One end of a pair of pipes."""

    def __init__(self, url: str, incoming: _Pipe, outgoing: _Pipe) -> None:
        self._url = url
        self._incoming = incoming
        self._outgoing = outgoing
        self._closed = False
        # Two tasks may write to one peer (answers and news): a long message must not be cut by the other.
        self._writing = asyncio.Lock()

    @property
    def description(self) -> str:
        """The url."""
        return self._url

    async def read(self, max_bytes: int) -> bytes:
        """Return 1 .. max_bytes bytes; once the peer has closed and all is read, E-LINK-CLOSED."""
        self._check()
        return await self._incoming.take(max_bytes, self._url)

    async def write(self, data: bytes) -> None:
        """Write, waiting while the pipe is full; TransportError (E-LINK-CLOSED)."""
        self._check()
        async with self._writing:
            await self._outgoing.put(data, self._url)

    def _check(self) -> None:
        if self._closed:
            raise TransportError("E-LINK-CLOSED", self._url, why=Message.of("W-LINK-CLOSED"))

    async def close(self) -> None:
        """Close both directions."""
        self._closed = True
        self._outgoing.close()
        self._incoming.close()


class MemoryListener:
    """A name under which clients of this process and loop find a handler."""

    def __init__(self, name: str, handler: Handler) -> None:
        self._name = name
        self._loop = asyncio.get_running_loop()
        self._conversations = Conversations(handler, self.url)

    @property
    def url(self) -> str:
        """Where clients reach it."""
        return f"memory://{self._name}"

    @property
    def alive(self) -> bool:
        """False once the loop it was made on is closed: nobody can answer there any more."""
        return not self._loop.is_closed()

    def connect(self) -> MemoryTransport:
        """Give a client its end and start the handler on the other."""
        up, down = _Pipe(), _Pipe()
        self._conversations.begin(MemoryTransport(f"peer of {self.url}", up, down))
        return MemoryTransport(self.url, down, up)

    async def close(self) -> None:
        """Free the name and end all conversations; raises what a handler died of."""
        if _listeners.get(self._name) is self:
            del _listeners[self._name]
        await self._conversations.end()


_listeners: dict[str, MemoryListener] = {}


def listen_memory(name: str, handler: Handler) -> MemoryListener:
    """Answer memory://name with `handler`. Raises TransportError (E-LINK-LISTEN) when the name is taken."""
    taken = _listeners.get(name)
    if taken is not None and taken.alive:
        raise TransportError("E-LINK-LISTEN", f"memory://{name}", why=Message.of("W-LINK-NAME-TAKEN"))
    listener = MemoryListener(name, handler)
    _listeners[name] = listener
    return listener


def name_of(url: str) -> str:
    """The name in memory://name. Raises ConfigError (E-LINK-URL)."""
    parts = urlsplit(url)
    name = parts.netloc + parts.path
    if not name:
        raise ConfigError("E-LINK-URL", url, why=Message.of("W-LINK-NAME-MISSING"))
    return name


def open_memory(url: str) -> MemoryTransport:
    """Connect to memory://name. Raises TransportError (E-LINK-CONNECT) when nobody listens there."""
    listener = _listeners.get(name_of(url))
    if listener is None or not listener.alive:
        raise TransportError("E-LINK-CONNECT", url, why=Message.of("W-LINK-NOBODY"))
    return listener.connect()
