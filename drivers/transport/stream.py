"""A stream of bytes to one peer: what every wire offers, whatever it is made of."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Protocol


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
