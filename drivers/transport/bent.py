"""A wire that misbehaves on purpose: functions split, drop, repeat or bend what passes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from drivers.transport.stream import ByteTransport

Bend = Callable[[bytes], Iterable[bytes]]


def straight(data: bytes) -> Iterable[bytes]:
    """Pass everything as it is."""
    return (data,)


class BentTransport:
    """Any wire with a bend in each direction; a bend that raises TransportError cuts the wire there."""

    def __init__(self, inner: ByteTransport, incoming: Bend = straight, outgoing: Bend = straight) -> None:
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
