"""The client's end of a connection with a fault in one of its system calls: a send or a receive that fails once.

Under a virtual loop both ends of a connection live in one loop (`drivers.clock.virtual.LocalEnd`). A failed call has
the consequence that asyncio's selector transport gives it: a failed ``recv`` or ``send`` ends the connection with that
error, bytes unread are gone, and what was not sent never arrives.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from drivers.clock import virtual

SEND, RECEIVE = "send", "recv"
HALF, LOST, PIECEMEAL = "half, then ECONNRESET", "lost", "one byte, the rest later"
"""Half of the bytes pass and then the connection is reset; nothing passes and nobody is told; a short read or write."""
KINDS = {
    SEND: ("ECONNRESET", "EPIPE", "ETIMEDOUT", HALF, LOST),
    RECEIVE: ("ECONNRESET", "ETIMEDOUT", HALF, LOST, PIECEMEAL),
}


@dataclass
class Exchange:
    """Counts the calls of one kind while ``armed``; the ``nth`` one meets its fault, all others are sound."""

    call: str = SEND
    nth: int = -1
    kind: str = ""
    armed: bool = False
    sends: int = 0
    receives: int = 0
    hit: bool = False

    def due(self, call: str) -> str:
        """The fault of this call; "" for none."""
        if not self.armed:
            return ""
        if call == SEND:
            self.sends += 1
        else:
            self.receives += 1
        if self.hit or call != self.call or self.nth != (self.sends if call == SEND else self.receives):
            return ""
        self.hit = True
        return self.kind


class FaultyEnd(virtual.LocalEnd):
    """An end that asks at every call whether it is to fail."""

    exchange: Exchange

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send, or meet the fault."""
        kind = self.exchange.due(SEND) if data and not self._lost else ""
        if not kind:
            super().write(data)
        elif kind == HALF:
            super().write(bytes(data)[: len(data) // 2])
            self._fail("ECONNRESET")
        elif kind != LOST:
            self._fail(kind)

    def _deliver(self) -> None:
        """Receive, or meet the fault."""
        ready = self._pieces and self.is_reading() and not self._lost
        kind = self.exchange.due(RECEIVE) if ready else ""
        if not kind:
            super()._deliver()
        elif kind == LOST:
            self._scheduled = False
            self._next_piece()
            self.other.has_room()
        elif kind in (HALF, PIECEMEAL):
            piece = self._next_piece()
            size = 1 if kind == PIECEMEAL else len(piece) // 2
            self._pieces.append(piece[:size])
            self.waiting += size
            super()._deliver()
            self._rest(piece[size:], kind)
        else:
            self._fail(kind)

    def _rest(self, rest: bytes, kind: str) -> None:
        if kind == HALF:
            self._fail("ECONNRESET")
        elif rest and not self._lost:
            self._pieces.appendleft(rest)
            self.waiting += len(rest)
            self._schedule()

    def _fail(self, name: str) -> None:
        """What asyncio does with an error of a socket: the connection is lost with it."""
        number = getattr(errno, name)
        self._closing = True
        self._lose(OSError(number, os.strerror(number)))


@contextlib.contextmanager
def failing_calls(exchange: Exchange) -> Iterator[None]:
    """While it lasts, every connection that a client of a virtual loop opens asks ``exchange``."""
    real = virtual.connect_ends

    def connect(loop: Any, caller: Any, called: Any, port: int) -> Any:
        made = real(loop, caller, called, port)
        made[0].__class__ = FaultyEnd
        made[0].exchange = exchange  # type: ignore[attr-defined]
        return made

    virtual.connect_ends = connect
    try:
        yield
    finally:
        virtual.connect_ends = real
