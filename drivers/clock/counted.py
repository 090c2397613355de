"""Sockets that count: what went out and came in on each loopback connection of one loop, for who waits for the rest.

A piece that another member has written is read whole: where the system has brought only its beginning, the reader
waits for the rest, so that pieces are the same on every computer.
"""

from __future__ import annotations

import selectors
import socket
from collections.abc import Callable, Iterable
from typing import Any

from drivers.clock.turns import NO_MARK, CountedEnd, Mark, Wire

LOOPBACK = ("127.", "::1", "::ffff:127.")
# A piece comes over loopback in microseconds; where the rest of it is lost its reader goes on with what it has.
REST_S = 10.0


class CountedConnections:
    """The counted connections of one loop, each by its two ports."""

    def __init__(self) -> None:
        self._open: dict[Wire, CountedSocket] = {}
        self._changed: dict[Wire, CountedEnd] = {}
        self._promised: dict[Wire, int] = {}  # for calls not yet taken
        self.owing: set[CountedSocket] = set()
        self.inside: set[int] = set()  # files whose other end is a member

    def counted(self, plain: socket.socket) -> socket.socket:
        """The same connection, counted from now on; what does not stay on this computer is left as it is."""
        wire = _wire_of(plain)
        if wire is None:
            return plain
        timeout = plain.gettimeout()
        found = CountedSocket(plain.family, plain.type, plain.proto, fileno=plain.detach())
        found.settimeout(timeout)
        self._open[wire] = found
        found.join(self, wire, self._promised.pop(wire, None))
        return found

    def promise(self, promised: Iterable[tuple[Wire, int]], ports: Iterable[int]) -> list[int]:
        """Other members have written so much; the files of which it is known only now that they end at members."""
        before = set(self.inside)
        for wire, total in promised:
            found = self._open.get(wire)
            if found is not None:
                found.promise(total)
            elif wire[0] in ports:
                self._promised[wire] = total
        return sorted(self.inside - before)

    @property
    def uncalled(self) -> set[int]:
        """Ports on which a member has called and nobody has answered yet."""
        return {wire[0] for wire in self._promised}

    def give_up(self) -> list[Wire]:
        """Wait no longer for what was promised; the connections it was promised on."""
        lost = [*self._promised, *(one.wire for one in self.owing)]
        self._promised.clear()
        for one in list(self.owing):
            one.received = one.promised
        self.owing.clear()
        return lost

    def ceased(self, port: int) -> None:
        """Nobody listens here any more: calls that nobody took are lost."""
        for wire in [wire for wire in self._promised if wire[0] == port]:
            del self._promised[wire]

    def changed(self, one: CountedSocket, marks: Mark = NO_MARK) -> None:
        """Note what an end has to say."""
        old = self._changed.get(one.wire)
        told = marks | one.marks | (old.marks & Mark.OPENED if old is not None else NO_MARK)
        self._changed[one.wire] = CountedEnd(one.wire, one.sent, one.received, told)
        if Mark.CLOSED in told and self._open.get(one.wire) is one:
            del self._open[one.wire]

    def knows(self, one: CountedSocket) -> None:
        """This connection ends at a member."""
        self.inside.add(one.fileno())

    @property
    def quiet(self) -> bool:
        """Whether nothing has changed since it was last told."""
        return not self._changed

    def told(self, events: Callable[[int], int]) -> tuple[CountedEnd, ...]:
        """What changed since the last time; ``events`` says what a file waits for, 0 for nothing."""
        for one in self.owing:  # what is left unread is left on purpose
            self.changed(one, Mark.HELD)
        told = []
        for wire, counted in self._changed.items():
            end = self._open.get(wire)
            stuck = end is not None and end.fileno() in self.inside and events(end.fileno()) & selectors.EVENT_WRITE
            told.append(
                CountedEnd(wire, counted.sent, counted.received, counted.marks | Mark.STUCK) if stuck else counted
            )
        self._changed.clear()
        return tuple(told)

    def close(self) -> None:
        """Close what is still open, so that the other ends hear of it."""
        for one in list(self._open.values()):
            one.close()


def _wire_of(plain: socket.socket) -> Wire | None:
    if plain.family not in (socket.AF_INET, socket.AF_INET6) or plain.type != socket.SOCK_STREAM:
        return None
    try:
        own, other = plain.getsockname(), plain.getpeername()
    except OSError:  # gone before anybody looked
        return None
    return (own[1], other[1]) if str(other[0]).startswith(LOOPBACK) else None


class CountedSocket(socket.socket):
    """A socket that counts for its loop's `CountedConnections`, and reads what was promised in one piece."""

    _wires: CountedConnections | None = None

    def join(self, wires: CountedConnections, wire: Wire, promised: int | None) -> None:
        """Count for ``wires`` from now on; ``promised`` by a member that called, None by a stranger."""
        self._wires, self.wire = wires, wire
        self.sent = self.received = 0
        self.marks = NO_MARK
        self.promised = 0
        self._shut = False
        wires.changed(self, Mark.OPENED)
        if promised is not None:
            self.promise(promised)

    def promise(self, total: int) -> None:
        """The other end, a member's, has written so much since the connection was opened."""
        self.promised = total
        if self._wires is not None:
            self._wires.knows(self)
        self._settle()

    def _settle(self) -> None:
        if self._wires is not None:
            owing = self.promised > self.received and Mark.ENDED not in self.marks
            (self._wires.owing.add if owing else self._wires.owing.discard)(self)

    def _note(self, *, sent: int = 0, received: int = 0, marks: Mark = NO_MARK) -> None:
        if self._wires is None:
            return
        self.sent += sent
        self.received += received
        self.marks |= marks
        if received or marks:
            self._settle()
        self._wires.changed(self)

    # ---- what asyncio calls -------------------------------------------------------------------------

    def recv(self, bufsize: int, flags: int = 0) -> bytes:
        """As any socket; what was promised comes in one piece."""
        try:
            piece = super().recv(bufsize, flags)
        except (BlockingIOError, InterruptedError):
            raise
        except OSError:
            self._note(marks=Mark.ENDED)
            raise
        while 0 < len(piece) < min(bufsize, self._left(len(piece))):
            more = self._rest(bufsize - len(piece), flags)
            if not more:
                break
            piece += more
        self._came(len(piece))
        return piece

    def recv_into(self, buffer: Any, nbytes: int = 0, flags: int = 0) -> int:
        """As `recv`."""
        view = memoryview(buffer).cast("B")
        piece = self.recv(nbytes or len(view), flags)
        view[: len(piece)] = piece
        return len(piece)

    def _left(self, got: int) -> int:
        """How much a piece that began with ``got`` bytes is to have; the end that counts as a byte is none."""
        due = self.promised - self.received
        return due if due > got else got

    def _rest(self, size: int, flags: int) -> bytes:
        """What is still on its way; b"" where nothing more comes."""
        with selectors.DefaultSelector() as waiting:
            waiting.register(self.fileno(), selectors.EVENT_READ)
            if not waiting.select(REST_S):
                return b""
        try:
            return super().recv(size, flags)
        except OSError:
            return b""  # the next call meets it again, and says so

    def _came(self, size: int) -> None:
        self._note(received=size or 1, marks=NO_MARK if size else Mark.ENDED)

    def send(self, data: Any, flags: int = 0) -> int:
        """As any socket."""
        size = super().send(data, flags)
        self._note(sent=size)
        return size

    def sendmsg(self, buffers: Any, *more: Any) -> int:
        """As any socket."""
        size = super().sendmsg(buffers, *more)
        self._note(sent=size)
        return size

    def shutdown(self, how: int) -> None:
        """As any socket; the end is one byte more for who counts."""
        super().shutdown(how)
        if how != socket.SHUT_RD and not self._shut:
            self._shut = True
            self._note(sent=1)

    def close(self) -> None:
        """As any socket."""
        fileno = self.fileno()
        super().close()
        if fileno >= 0 and self._wires is not None:
            self._wires.inside.discard(fileno)
            self._note(sent=0 if self._shut else 1, marks=Mark.CLOSED | Mark.ENDED)
