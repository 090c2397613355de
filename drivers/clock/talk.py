"""What the host of a clock and its guests say to each other, over one loopback connection each."""

from __future__ import annotations

import enum
import socket
import struct
from collections.abc import Iterator

from drivers.clock.turns import Counted, Mark, Turn, Yielded

_HEAD = struct.Struct("!BI")
_YIELDED, _PORT, _WIRE = struct.Struct("!dd?HH"), struct.Struct("!H?"), struct.Struct("!HHQQB")
_TURN, _PROMISE = struct.Struct("!IIddH"), struct.Struct("!HHQ")
_WANT = struct.Struct("!I")


class Word(enum.IntEnum):
    """Kinds of messages; HELLO and what follows it come from guests."""

    TURN = 1
    COME_BACK = 2
    HELLO = 3
    YIELDED = 4
    WANT = 5


def of_yielded(told: Yielded) -> bytes:
    """A member's report, as bytes."""
    ports = b"".join(_PORT.pack(*port) for port in told.ports)
    wires = b"".join(_WIRE.pack(*one.wire, one.sent, one.received, one.marks) for one in told.wires)
    return _YIELDED.pack(told.now, told.due, told.uncounted, len(told.ports), len(told.wires)) + ports + wires


def yielded_of(data: bytes) -> Yielded:
    """The report in these bytes. Raises ValueError for anything else."""
    try:
        now, due, uncounted, ports, wires = _YIELDED.unpack_from(data)
        middle = _YIELDED.size + ports * _PORT.size
        if len(data) != middle + wires * _WIRE.size:
            raise ValueError(f"a report of {len(data)} bytes")
        begun = tuple(_PORT.iter_unpack(data[_YIELDED.size : middle]))
        counted = tuple(Counted((a, b), sent, got, Mark(m)) for a, b, sent, got, m in _WIRE.iter_unpack(data[middle:]))
    except struct.error as error:
        raise ValueError(str(error)) from error
    return Yielded(now, due, counted, ports=begun, uncounted=uncounted)


def of_turn(turn: Turn) -> bytes:
    """A turn, as bytes."""
    promised = b"".join(_PROMISE.pack(*wire, total) for wire, total in turn.promised)
    return _TURN.pack(turn.number, turn.count, turn.now, turn.horizon, len(turn.promised)) + promised


def turn_of(data: bytes) -> Turn:
    """The turn in these bytes. Raises ValueError for anything else."""
    try:
        number, count, now, horizon, _ = _TURN.unpack_from(data)
        promised = tuple(((a, b), total) for a, b, total in _PROMISE.iter_unpack(data[_TURN.size :]))
    except struct.error as error:
        raise ValueError(str(error)) from error
    return Turn(number, count, now, horizon, promised=promised)


def of_want(count: int) -> bytes:
    """A wish for a turn, as bytes."""
    return _WANT.pack(count)


def want_of(data: bytes) -> int:
    """The turn since which something came. Raises ValueError."""
    if len(data) != _WANT.size:
        raise ValueError(f"a wish of {len(data)} bytes")
    return int(_WANT.unpack(data)[0])


class Line:
    """One such connection; it writes at once and reads what has come."""

    def __init__(self, plain: socket.socket) -> None:
        plain.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        plain.setblocking(True)
        self._socket = plain
        self._pending = b""

    def fileno(self) -> int:
        """Of its socket."""
        return self._socket.fileno()

    def say(self, word: Word, data: bytes = b"") -> None:
        """Write a message; one to an end that is gone is lost, reading tells."""
        try:
            self._socket.sendall(_HEAD.pack(word, len(data)) + data)
        except OSError:
            return

    def hear(self) -> Iterator[tuple[Word, bytes]]:
        """The messages that are there, once something is. Raises EOFError when the other end is gone."""
        try:
            piece = self._socket.recv(1 << 16)
        except OSError as error:
            raise EOFError(str(error)) from error
        if not piece:
            raise EOFError("the other end is gone")
        self._pending += piece
        while len(self._pending) >= _HEAD.size:
            kind, size = _HEAD.unpack_from(self._pending)
            end = _HEAD.size + size
            if len(self._pending) < end:
                return
            data, self._pending = self._pending[_HEAD.size : end], self._pending[end:]
            try:
                yield Word(kind), data
            except ValueError as error:
                raise EOFError(str(error)) from error

    def close(self) -> None:
        """Leave."""
        self._socket.close()
