"""Turns of several processes on one clock, and their messages: time moves only when all members wait.

Pure but for `TurnLine`: it is told what members report, and says who goes on and at which time. A member that has the
turn runs until it can do nothing more by itself; then it reports when its next timer is due and what it wrote to
and read from its connections. While bytes are on their way from one member to another, the reader goes next and
time stands still. One member runs at a time, so what happens does not depend on how fast any of them is.
"""

from __future__ import annotations

import enum
import socket
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import inf

Wire = tuple[int, int]  # a connection as one of its ends sees it: (own port, the other's port)


class Mark(enum.IntFlag):
    """What an end of a connection says beside its counts."""

    OPENED = 1  # new: an older connection of the same two ports is over
    ENDED = 2  # nothing more will be read here
    CLOSED = 4  # this end is gone
    HELD = 8  # its reader takes nothing at the moment
    STUCK = 16  # its writer waits until the other end has read


NO_MARK = Mark(0)


@dataclass(frozen=True, slots=True)
class CountedEnd:
    """One end of a connection: bytes written and read since it was opened; its end counts as one byte more."""

    wire: Wire
    sent: int = 0
    received: int = 0
    marks: Mark = NO_MARK


@dataclass(frozen=True, slots=True)
class TurnReport:
    """A member waits: since ``now`` (s), for its timer at ``due`` (s; inf: for none), and what changed meanwhile.

    ``ports`` are ports on which it began (True) or ceased (False) to listen.
    """

    now: float
    due: float = inf
    wires: tuple[CountedEnd, ...] = ()
    ports: tuple[tuple[int, bool], ...] = ()
    uncounted: bool = False


@dataclass(frozen=True, slots=True)
class Turn:
    """Member ``number`` goes on at ``now`` (s). Alone with its timers it may go on to any time before ``horizon`` (s).

    ``promised``: how much has been written to connections of its own by the other end; it reads that first.
    """

    number: int
    count: int
    now: float
    horizon: float
    promised: tuple[tuple[Wire, int], ...] = ()


@dataclass(slots=True)
class _End:
    number: int
    sent: int = 0
    received: int = 0
    marks: Mark = NO_MARK
    accepted: bool = False
    told: int = 0


@dataclass(slots=True)
class _Member:
    due: float = inf
    count: int = 0
    wants: bool = True
    uncounted: bool = False
    wires: set[Wire] = field(default_factory=set)


class Turns:
    """The turns of all members, whose numbers go from 0 in order of joining; seconds are those of the one clock."""

    def __init__(self, now: float = 0.0) -> None:
        self.now = now
        self.holder: int | None = None
        self.alone_until = -inf  # how far who has the turn may go on alone through its timers
        self._next_number = 0
        self._members: dict[int, _Member] = {}
        self._ends: dict[Wire, _End] = {}
        self._listening: dict[int, int] = {}
        self._owed: set[Wire] = set()  # ends, there or about to be, to which something is on its way
        self._stuck: dict[Wire, int] = {}  # how much the other end had read when this one's writer began to wait

    # ---- what members say ---------------------------------------------------------------------------

    def join(self) -> int:
        """A new member, which gets a turn as soon as nobody else has it; its number."""
        number, self._next_number = self._next_number, self._next_number + 1
        self._members[number] = _Member()
        return number

    def leave(self, number: int) -> None:
        """A member is gone, wherever it was; nobody waits for it any longer."""
        member = self._members.pop(number, None)
        if member is None:
            return
        if self.holder == number:
            self.holder = None
        for port in [port for port, who in self._listening.items() if who == number]:
            self._unlisten(port)
        for wire in member.wires:
            self._ends[wire].marks |= Mark.CLOSED | Mark.ENDED
            # Its system closes what it left open.
            self._ends[wire].sent += 1
            self._look(wire)

    def want(self, number: int, count: int) -> None:
        """Something from outside came to a member whose last turn was its ``count``-th; older wishes are void."""
        member = self._members.get(number)
        if member is not None and self.holder != number and member.count == count:
            member.wants = True

    def yielded(self, number: int, told: TurnReport) -> None:
        """The member whose turn it was waits. Raises ValueError when it had no turn."""
        if self.holder != number:
            raise ValueError(f"member {number} has no turn to give back")
        member = self._members[number]
        self.holder, member.due, member.uncounted = None, told.due, told.uncounted
        self.now = max(self.now, told.now)
        for port, begun in told.ports:
            if begun:
                self._listening[port] = number
            else:
                self._unlisten(port)
        for counted in told.wires:
            self._note(number, counted)
        for counted in told.wires:
            self._look(counted.wire)

    # ---- who goes on --------------------------------------------------------------------------------

    @property
    def others(self) -> int:
        """Members beside the first."""
        return sum(number != 0 for number in self._members)

    @property
    def wanted(self) -> bool:
        """Whether somebody who has no turn has something from outside to do."""
        return any(member.wants for number, member in self._members.items() if number != self.holder)

    @property
    def earliest(self) -> float:
        """The next timer of all (s); inf where there is none."""
        return min((member.due for member in self._members.values()), default=inf)

    @property
    def uncounted(self) -> bool:
        """Whether a member has a wire whose bytes nobody counts."""
        return any(member.uncounted for member in self._members.values())

    @property
    def settled(self) -> bool:
        """Whether nothing but a timer can let anybody go on."""
        return self.holder is None and not self._owed and not self._unstuck() and not self.wanted

    def next(self, allowed: float = inf) -> Turn | None:
        """Whose turn it is now, or None: somebody has it, or nobody can go on before ``allowed`` (s) is over.

        Bytes on their way come first, then what came from outside, then timers, and members by number.
        """
        if self.holder is not None or not self._members:
            return None
        number = self._reader()
        if number is None:
            number = next((number for number, member in sorted(self._members.items()) if member.wants), None)
            if number is not None and allowed < inf:
                self.now = max(self.now, min(allowed, self.earliest))
        if number is None and self.earliest <= max(allowed, self.now) and self.earliest < inf:
            self.now = max(self.now, self.earliest)
            number = min(number for number, member in self._members.items() if member.due <= self.now)
        return None if number is None else self._given(number, allowed)

    def _reader(self) -> int | None:
        found = [self._ends[wire].number if wire in self._ends else self._listening[wire[0]] for wire in self._owed]
        return min([*found, *(self._ends[wire].number for wire in self._unstuck())], default=None)

    def _unstuck(self) -> list[Wire]:
        """Ends whose writer waited and whose other end has read since, or is gone."""
        return [wire for wire, read in self._stuck.items() if self._read_at(wire[::-1]) != read]

    def _read_at(self, wire: Wire) -> int:
        end = self._ends.get(wire)
        return -1 if end is None or Mark.CLOSED in end.marks else end.received

    def _given(self, number: int, allowed: float) -> Turn:
        member = self._members[number]
        member.wants, member.count, self.holder = False, member.count + 1, number
        horizon = min((other.due for one, other in self._members.items() if one != number), default=inf)
        horizon = -inf if self.wanted else min(horizon, allowed)
        self.alone_until = horizon
        return Turn(number, member.count, self.now, horizon, promised=tuple(self._promises(number)))

    def count_of(self, number: int) -> int:
        """How many turns a member has had."""
        return self._members[number].count if number in self._members else 0

    def _promises(self, number: int) -> Iterable[tuple[Wire, int]]:
        for wire in sorted(self._members[number].wires):
            end, other = self._ends[wire], self._ends.get(wire[::-1])
            self._stuck.pop(wire, None)
            if other is not None and other.sent != end.told:
                end.told = other.sent
                yield wire, other.sent
        for wire in sorted(self._owed):
            if wire not in self._ends and self._listening[wire[0]] == number:
                yield wire, self._ends[wire[::-1]].sent

    # ---- connections --------------------------------------------------------------------------------

    def _note(self, number: int, counted: CountedEnd) -> None:
        wire = counted.wire
        if Mark.OPENED in counted.marks:
            old = self._ends.get(wire[::-1])
            if wire in self._ends and old is not None:
                self._forget(wire[::-1])
            self._ends[wire] = _End(number)
            self._members[number].wires.add(wire)
        end = self._ends.get(wire)
        if end is None:
            return
        end.sent, end.received, end.marks = counted.sent, counted.received, counted.marks & ~Mark.OPENED
        other = self._ends.get(wire[::-1])
        if other is not None:
            end.accepted = other.accepted = True
        if Mark.STUCK in counted.marks:
            self._stuck[wire] = self._read_at(wire[::-1])

    def _look(self, wire: Wire) -> None:
        """Judge anew what is on its way between the two ends; connections that are over at both are forgotten."""
        for one in (wire, wire[::-1]):
            if self._on_its_way(one):
                self._owed.add(one)
            else:
                self._owed.discard(one)
        over = all(one not in self._ends or Mark.CLOSED in self._ends[one].marks for one in (wire, wire[::-1]))
        if over and not self._owed & {wire, wire[::-1]}:
            self._forget(wire)
            self._forget(wire[::-1])

    def _on_its_way(self, to: Wire) -> bool:
        source, end = self._ends.get(to[::-1]), self._ends.get(to)
        if source is None:
            return False
        if end is None:
            # A call nobody has taken yet: on its way to who listens there; to a stranger otherwise.
            return not source.accepted and to[0] in self._listening
        return source.sent > end.received and not end.marks & (Mark.ENDED | Mark.CLOSED | Mark.HELD)

    def _unlisten(self, port: int) -> None:
        self._listening.pop(port, None)
        for wire in [wire for wire in self._ends if wire[1] == port]:
            self._look(wire)

    def _forget(self, wire: Wire) -> None:
        end = self._ends.pop(wire, None)
        self._owed.discard(wire)
        self._stuck.pop(wire, None)
        if end is not None and end.number in self._members:
            self._members[end.number].wires.discard(wire)


# What the host of a clock and its guests say to each other, over one loopback connection each.

_HEAD = struct.Struct("!BI")
_YIELDED, _PORT, _WIRE = struct.Struct("!dd?HH"), struct.Struct("!H?"), struct.Struct("!HHQQB")
_TURN, _PROMISE = struct.Struct("!IIddH"), struct.Struct("!HHQ")
_WANT = struct.Struct("!I")


class MessageKind(enum.IntEnum):
    """Kinds of messages; HELLO and what follows it come from guests."""

    TURN = 1
    COME_BACK = 2
    HELLO = 3
    YIELDED = 4
    WANT = 5


def encode_report(told: TurnReport) -> bytes:
    """A member's report, as bytes."""
    ports = b"".join(_PORT.pack(*port) for port in told.ports)
    wires = b"".join(_WIRE.pack(*one.wire, one.sent, one.received, one.marks) for one in told.wires)
    return _YIELDED.pack(told.now, told.due, told.uncounted, len(told.ports), len(told.wires)) + ports + wires


def decode_report(data: bytes) -> TurnReport:
    """The report in these bytes. Raises ValueError for anything else."""
    try:
        now, due, uncounted, ports, wires = _YIELDED.unpack_from(data)
        middle = _YIELDED.size + ports * _PORT.size
        if len(data) != middle + wires * _WIRE.size:
            raise ValueError(f"a report of {len(data)} bytes")
        begun = tuple(_PORT.iter_unpack(data[_YIELDED.size : middle]))
        counted = tuple(
            CountedEnd((a, b), sent, got, Mark(m)) for a, b, sent, got, m in _WIRE.iter_unpack(data[middle:])
        )
    except struct.error as error:
        raise ValueError(str(error)) from error
    return TurnReport(now, due, counted, ports=begun, uncounted=uncounted)


def encode_turn(turn: Turn) -> bytes:
    """A turn, as bytes."""
    promised = b"".join(_PROMISE.pack(*wire, total) for wire, total in turn.promised)
    return _TURN.pack(turn.number, turn.count, turn.now, turn.horizon, len(turn.promised)) + promised


def decode_turn(data: bytes) -> Turn:
    """The turn in these bytes. Raises ValueError for anything else."""
    try:
        number, count, now, horizon, _ = _TURN.unpack_from(data)
        promised = tuple(((a, b), total) for a, b, total in _PROMISE.iter_unpack(data[_TURN.size :]))
    except struct.error as error:
        raise ValueError(str(error)) from error
    return Turn(number, count, now, horizon, promised=promised)


def encode_request(count: int) -> bytes:
    """A wish for a turn, as bytes."""
    return _WANT.pack(count)


def decode_request(data: bytes) -> int:
    """The turn since which something came. Raises ValueError."""
    if len(data) != _WANT.size:
        raise ValueError(f"a wish of {len(data)} bytes")
    return int(_WANT.unpack(data)[0])


class TurnLine:
    """One such connection; it writes at once and reads what has come."""

    def __init__(self, plain: socket.socket) -> None:
        plain.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        plain.setblocking(True)
        self._socket = plain
        self._pending = b""

    def fileno(self) -> int:
        """Of its socket."""
        return self._socket.fileno()

    def say(self, word: MessageKind, data: bytes = b"") -> None:
        """Write a message; one to an end that is gone is lost, reading tells."""
        try:
            self._socket.sendall(_HEAD.pack(word, len(data)) + data)
        except OSError:
            return

    def hear(self) -> Iterator[tuple[MessageKind, bytes]]:
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
                yield MessageKind(kind), data
            except ValueError as error:
                raise EOFError(str(error)) from error

    def close(self) -> None:
        """Leave."""
        self._socket.close()
