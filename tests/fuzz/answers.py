"""What an OPC UA server answers, as one input of bytes: recorded once from the simulator, damaged, and played again.

The recording holds the pieces of the server in the order of the requests: length of each, then the bytes. A damaged
recording is cut into pieces again by its own lengths, so that a search may change these too.
"""

from __future__ import annotations

import asyncio
import functools
import tempfile
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual, virtual
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from tests.push.uaworld import SETTINGS, ua_world

MOST_PIECES = 64


async def ask(url: str, clock: LoopClock) -> None:
    """What a gateway asks first: end points, session, limits, identity, state, the standing alarms."""
    device = SinumerikOpcUa("840D", url, dict(SETTINGS), clock)
    try:
        await device.open(5.0)
        await device.identify()
        await device.state()
    finally:
        await device.close()


def packed(pieces: list[bytes]) -> bytes:
    """Pieces as one input."""
    return b"".join(len(one).to_bytes(3, "big") + one for one in pieces)


def unpacked(data: bytes) -> list[bytes]:
    """The pieces of an input, however its lengths were damaged."""
    found, at = [], 0
    while at < len(data) and len(found) < MOST_PIECES:
        size = int.from_bytes(data[at : at + 3], "big")
        found.append(data[at + 3 : at + 3 + size])
        at += 3 + size
    return found


@functools.cache
def recorded() -> bytes:
    """The answers of the simulator to `ask`."""
    pieces: list[bytes] = []
    real = virtual.connect_ends

    def connect(loop: Any, caller: Any, called: Any, port: int) -> Any:
        made = real(loop, caller, called, port)
        end, take = made[0], made[0].take

        def taking(data: bytes) -> None:
            pieces.append(data)
            take(data)

        end.take = taking  # type: ignore[method-assign, attr-defined]
        return made

    async def main() -> None:
        clock = LoopClock()
        with tempfile.TemporaryDirectory() as keys:
            async with ua_world(clock, Path(keys)) as at:
                virtual.connect_ends = connect
                try:
                    await ask(at.server.url, clock)
                finally:
                    virtual.connect_ends = real

    run_virtual(main)
    return packed(pieces)


class _Player(asyncio.Protocol):
    """Answers each request with the next piece, on whatever connection it comes."""

    def __init__(self, pieces: list[bytes]) -> None:
        self._pieces = pieces

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """One request, or two that came together."""
        assert isinstance(self._transport, asyncio.Transport)
        if not self._pieces:
            self._transport.close()
            return
        self._transport.write(self._pieces.pop(0))


def talk(data: bytes) -> None:
    """Let a driver ask a server that answers with these bytes. Raises our errors, or what is a finding."""
    pieces = unpacked(data)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: _Player(pieces), "127.0.0.1", 0)
        try:
            port = server.sockets[0].getsockname()[1]
            await ask(f"opc.tcp://127.0.0.1:{port}", LoopClock())
        finally:
            server.close()

    run_virtual(main)
