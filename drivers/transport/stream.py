"""A stream of bytes to one peer, the conversations of one listener, and a wire with faults on purpose."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from typing import Protocol

from drivers.errors import TransportError


class ByteTransport(Protocol):
    """One open wire. A lost or closed wire is always an exception, never an empty read."""

    @property
    def description(self) -> str:
        """The url, for messages and records."""
        ...

    async def read(self, max_bytes: int) -> bytes:
        """Wait for bytes and return 1 .. max_bytes of them; raises TransportError when the wire is gone."""
        ...

    async def write(self, data: bytes) -> None:
        """Hand all bytes over, waiting while the peer is slow; raises TransportError."""
        ...

    async def close(self) -> None:
        """Let go of the wire; never raises, may be called twice."""
        ...


Handler = Callable[[ByteTransport], Awaitable[None]]


class Listener(Protocol):
    """The serving end of a url: ``url`` names the real port."""

    @property
    def url(self) -> str:
        """Where clients reach it."""
        ...

    async def close(self) -> None:
        """Stop listening and end all conversations; raises what a handler died of, if one did."""
        ...


# The conversations of one listener: a task each, ended together, none forgotten.


class Conversations:
    """Runs a handler for each peer and remembers the first failure that was not just a lost wire."""

    def __init__(self, handler: Handler, name: str) -> None:
        self._handler = handler
        self._name = name
        self._tasks: set[asyncio.Task[None]] = set()
        self._failure: Exception | None = None

    def begin(self, transport: ByteTransport) -> None:
        """Start the handler on a new wire; the wire is closed when the handler ends."""
        task = asyncio.get_running_loop().create_task(self._converse(transport), name=f"peer of {self._name}")
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    async def _converse(self, transport: ByteTransport) -> None:
        try:
            await self._handler(transport)
        except TransportError:
            pass  # the peer left: every conversation ends that way
        finally:
            await transport.close()

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if isinstance(error, Exception) and self._failure is None:
            self._failure = error

    async def end(self) -> None:
        """Cancel and await every conversation; raises the first failure of a handler."""
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for task in tasks:
            self._ended(task)  # a task that has only just ended has not yet been called back
        if self._failure is not None:
            raise self._failure


# A wire that misbehaves on purpose: functions split, drop, repeat or bend what passes.

WireFault = Callable[[bytes], Iterable[bytes]]


def pass_unchanged(data: bytes) -> Iterable[bytes]:
    """Pass everything as it is."""
    return (data,)


class FaultyTransport:
    """Any wire with a bend in each direction; a bend that raises TransportError cuts the wire there."""

    def __init__(
        self, inner: ByteTransport, incoming: WireFault = pass_unchanged, outgoing: WireFault = pass_unchanged
    ) -> None:
        self._inner = inner
        self._incoming = incoming
        self._outgoing = outgoing
        self._ready: list[bytes] = []

    @property
    def description(self) -> str:
        """The inner wire's url."""
        return self._inner.description

    async def read(self, max_bytes: int) -> bytes:
        """Return the next bent piece that is not empty."""
        while not self._ready:
            data = await self._inner.read(max_bytes)
            self._ready.extend(piece for piece in self._incoming(data) if piece)
        piece = self._ready.pop(0)
        if len(piece) > max_bytes:
            self._ready.insert(0, piece[max_bytes:])
        return piece[:max_bytes]

    async def write(self, data: bytes) -> None:
        """Write the bent pieces one by one."""
        for piece in self._outgoing(data):
            if piece:
                await self._inner.write(piece)

    async def close(self) -> None:
        """Close the inner wire."""
        await self._inner.close()
