"""Connections whose two ends live in one loop: bytes pass from protocol to protocol, without a socket.

They behave like TCP on loopback as far as asyncio shows it: pieces in order, a reader that holds back its writer,
half-closed ends, and a reset where somebody leaves with bytes unread or writes to one who has left.
"""

from __future__ import annotations

import asyncio
import itertools
from collections import deque
from collections.abc import Callable
from typing import Any, cast

LOOPBACK = ("127.0.0.1", "localhost")
PIECE_BYTES = 1 << 18
# What the system's buffers on both sides hold beyond the limit of the transport itself.
ROOM_BYTES = 1 << 18
Factory = Callable[[], asyncio.BaseProtocol]
_ports = itertools.cycle(range(49152, 65536))


class Doors:
    """The servers of one loop by their port."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[asyncio.Server, Factory]] = {}

    def open(self, server: asyncio.Server, factory: Factory) -> None:
        """Remember a server that listens on loopback."""
        for address in (socket.getsockname() for socket in server.sockets):
            if isinstance(address, tuple) and address[0] == LOOPBACK[0]:
                self._known[address[1]] = server, factory

    def behind(self, host: Any, port: Any) -> Factory | None:
        """Who would answer at this address; None where nobody of this loop listens."""
        server, factory = self._known.get(port, (None, None)) if host in LOOPBACK else (None, None)
        return factory if server is not None and server.is_serving() else None


def connected(
    loop: asyncio.AbstractEventLoop, caller: asyncio.BaseProtocol, called: asyncio.BaseProtocol, port: int
) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
    """Join two protocols, each told of its connection; the caller's transport and protocol."""
    here, there = (LOOPBACK[0], next(_ports)), (LOOPBACK[0], port)
    client, server = End(loop, caller, here, there), End(loop, called, there, here)
    client.other, server.other = server, client
    loop.call_soon(called.connection_made, server)
    caller.connection_made(client)
    return client, caller


class End(asyncio.Transport):
    """One end; what the other wrote waits here until it is read."""

    other: End

    def __init__(
        self, loop: asyncio.AbstractEventLoop, protocol: asyncio.BaseProtocol, here: object, there: object
    ) -> None:
        super().__init__({"sockname": here, "peername": there})
        self._loop = loop
        self._protocol = protocol
        self._pieces: deque[bytes] = deque()
        self.waiting = 0
        self._ended: Exception | bool = False  # the other end has nothing more to say, or is gone
        self._reading = True
        self._scheduled = False
        self._eof_sent = False
        self._closing = False
        self._lost = False
        self._held_back = False
        self._high, self._low = 1 << 16, 1 << 14

    # ---- writing ------------------------------------------------------------------------------------

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Hand bytes to the other end; who has left answers with a reset."""
        if self._eof_sent:
            raise RuntimeError("Cannot call write() after write_eof()")
        if not data or self._lost:
            return
        if self.other.is_closing():
            self._reset()
            return
        self.other.take(bytes(data))
        if self.get_write_buffer_size() > self._high and not self._held_back:
            self._held_back = True
            self._protocol.pause_writing()

    def writelines(self, list_of_data: Any) -> None:
        """All at once."""
        self.write(b"".join(list_of_data))

    def write_eof(self) -> None:
        """Nothing more from here; reading goes on."""
        if not self._eof_sent and not self._closing:
            self._eof_sent = True
            self.other.end(True)

    def can_write_eof(self) -> bool:
        """Yes."""
        return True

    def get_write_buffer_size(self) -> int:
        """Bytes the other end has no room for."""
        return max(self.other.waiting - ROOM_BYTES, 0)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """When the protocol is told to pause and to go on."""
        self._high = high if high is not None else (1 << 16 if low is None else 4 * low)
        self._low = low if low is not None else self._high // 4

    def get_write_buffer_limits(self) -> tuple[int, int]:
        """(low, high)."""
        return self._low, self._high

    def has_room(self) -> None:
        """From the other end: it has read something."""
        left = self.get_write_buffer_size()
        if self._held_back and left <= self._low:
            self._held_back = False
            self._protocol.resume_writing()
        if self._closing and not left:
            self._lose(None)

    # ---- reading ------------------------------------------------------------------------------------

    def pause_reading(self) -> None:
        """Let bytes wait."""
        self._reading = False

    def resume_reading(self) -> None:
        """Read again."""
        if not self._closing:
            self._reading = True
            self._schedule()

    def is_reading(self) -> bool:
        """Whether bytes are taken as they come."""
        return self._reading and not self._closing

    def take(self, data: bytes) -> None:
        """From the other end: bytes."""
        self._pieces.append(data)
        self.waiting += len(data)
        self._schedule()

    def end(self, why: Exception | bool) -> None:
        """From the other end: nothing more comes, or why it never will."""
        self._ended = self._ended if isinstance(self._ended, Exception) else why
        if isinstance(why, Exception) and self._held_back:
            self._loop.call_soon(self._lose, why)
        self._schedule()

    def _schedule(self) -> None:
        if not self._scheduled and not self._lost:
            self._scheduled = True
            self._loop.call_soon(self._deliver)

    def _deliver(self) -> None:
        self._scheduled = False
        if not self.is_reading() or self._lost:
            return
        if self._pieces:
            piece = self._next_piece()
            self.other.has_room()
            cast(asyncio.Protocol, self._protocol).data_received(piece)
            if self._pieces or self._ended:
                self._schedule()
        elif isinstance(self._ended, Exception):
            self._lose(self._ended)
        elif self._ended:
            self._hear_end()

    def _next_piece(self) -> bytes:
        """What has come since, at most as much as a socket would give at once."""
        piece = self._pieces.popleft() if len(self._pieces) == 1 else b"".join(self._pieces)
        self._pieces.clear()
        if len(piece) > PIECE_BYTES:
            self._pieces.append(piece[PIECE_BYTES:])
            piece = piece[:PIECE_BYTES]
        self.waiting -= len(piece)
        return piece

    def _hear_end(self) -> None:
        self._reading = False
        if not cast(asyncio.Protocol, self._protocol).eof_received():
            self.close()

    # ---- leaving ------------------------------------------------------------------------------------

    def close(self) -> None:
        """Leave once the other end has room for what was written."""
        if not self._closing:
            self._closing = True
            self._leave()
            if not self.get_write_buffer_size():
                self._lose(None)

    def abort(self) -> None:
        """Leave at once."""
        if not self._closing:
            self._closing = True
            self._leave()
        self._lose(None)

    def is_closing(self) -> bool:
        """Whether this end has left or is about to."""
        return self._closing

    def _leave(self) -> None:
        """The other end reads to the end; bytes that nobody read here are answered with a reset."""
        self.other.end(ConnectionResetError(104, "Connection reset by peer") if self._pieces else True)

    def _reset(self) -> None:
        self._closing = True
        self._lose(ConnectionResetError(104, "Connection reset by peer"))

    def _lose(self, why: Exception | None) -> None:
        if not self._lost:
            self._lost = self._closing = True
            self._pieces.clear()
            self.waiting = 0
            self.other.end(True)
            self._loop.call_soon(self._protocol.connection_lost, why)

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Who is told from now on."""
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        """Who is told."""
        return self._protocol
