"""One clock for several processes: their loops take turns, and time moves only when all of them wait.

One process is the host; it keeps the turns (`drivers.clock.turns`) and listens on a loopback port, where the others
join. Between them are real sockets. A loop that has not the turn waits, whatever comes; bytes between members are
counted (`drivers.clock.counted`), so nothing is on its way unseen, and each reads the same pieces in the same order on
every computer. What comes from outside, a browser or a signal, is heard at once and asks for a turn at the time that
it then is. A debugger or a starved process makes all the others wait; one that dies or leaves makes nobody wait.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import selectors
import socket
import sys
import time
from abc import abstractmethod
from collections.abc import Callable, Iterator
from math import inf
from typing import Any

from drivers.clock.counted import LOOPBACK, CountedConnections
from drivers.clock.turns import (
    MessageKind,
    Turn,
    TurnLine,
    TurnReport,
    Turns,
    decode_report,
    decode_request,
    decode_turn,
    encode_report,
    encode_request,
    encode_turn,
)
from drivers.clock.virtual import LOOK_S, SteppedLoop

WALL = time.monotonic  # noqa: TID251 - the only other time there is here
READ, WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE
JOIN_S = 30.0
# A member that is silent for so long of the wall's time is told of, and waited for all the same.
SILENT_S = 60.0
# Time lost on a busy computer is not caught up, beyond this much of the wall's.
SLACK_S = 0.02
# What a wire that nobody can count may need for a byte.
UNCOUNTED_S = 0.002
Ready = list[tuple[selectors.SelectorKey, int]]


class TimeLimit:
    """How far time may have come: ``speed`` times as fast as the wall's at most; without one as far as it likes."""

    def __init__(self, speed: float | None, wall: Callable[[], float] = WALL) -> None:
        if speed is not None and speed <= 0:
            raise ValueError("a clock's speed must be positive")
        self.speed = speed
        self._wall = wall
        self._since, self._from = wall(), 0.0

    def allowed(self, now: float) -> float:
        """The latest time (s) that may be, it being ``now``."""
        if self.speed is None:
            return inf
        wall = self._wall()
        allowed = self._from + (wall - self._since) * self.speed
        most = now + SLACK_S * self.speed
        if allowed > most:
            self._since, self._from, allowed = wall, most, most
        return allowed

    def wait_s(self, due: float, allowed: float) -> float | None:
        """How long (s of the wall) until it may be ``due``; None: for ever."""
        return None if self.speed is None or due == inf else max(due - allowed, 0.0) / self.speed


class _TurnSelector(selectors.BaseSelector):
    """Gives a loop its events while it has the turn; without, it hears only what comes from outside."""

    def __init__(self) -> None:
        self.wires = CountedConnections()
        self.connecting = self.uncounted = 0
        self.count = 0
        self._loop: SharedTimeLoop
        self._horizon = -inf
        self._all, self._outside, self._control = (selectors.DefaultSelector() for _ in range(3))
        self._order: dict[int, int] = {}
        self._numbers = itertools.count()
        self._doors: dict[int, int] = {}  # port by file
        self._ports: list[tuple[int, bool]] = []

    def serve(self, loop: SharedTimeLoop) -> None:
        """The loop whose events these are."""
        self._loop = loop

    # ---- files --------------------------------------------------------------------------------------

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        key = self._all.register(fileobj, events, data)
        self._order.setdefault(key.fd, next(self._numbers))
        self._watch(key.fd, events)
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        key = self._all.unregister(fileobj)
        self._watch(key.fd, 0)
        self._order.pop(key.fd, None)
        port = self._doors.pop(key.fd, None)
        if port is not None:
            self._ports.append((port, False))
            self.wires.ceased(port)
        return key

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        key = self._all.modify(fileobj, events, data)
        self._watch(key.fd, events)
        return key

    def get_map(self) -> Any:
        return self._all.get_map()

    def listens(self, fileno: int, port: int) -> None:
        """A socket on which others may call."""
        self._doors[fileno] = port
        self._ports.append((port, True))

    def _watch(self, fileno: int, events: int) -> None:
        """Hear it from outside too; of a connection to a member only that there is room again."""
        wanted = events & WRITE if fileno in self.wires.inside else events
        known = self._outside.get_map()
        if fileno in known:
            self._outside.unregister(fileno)
        if wanted:
            self._outside.register(fileno, wanted)

    def _events(self, fileno: int) -> int:
        key = self._all.get_map().get(fileno)
        return key.events if key is not None else 0

    def _now_ready(self, wait_s: float | None = 0) -> Ready:
        """In the order in which files came, which is the same on every computer."""
        return sorted(self._all.select(wait_s), key=lambda one: self._order.get(one[0].fd, 0))

    def close(self) -> None:
        self.wires.close()
        for one in (self._all, self._outside, self._control):
            one.close()

    # ---- while it has the turn ----------------------------------------------------------------------

    def select(self, timeout: float | None = None) -> Ready:
        if timeout is not None and timeout <= 0:
            return self._now_ready()
        if self._loop.threads_at_work:
            return [] if self._loop.jobs.settle() else self._now_ready(LOOK_S)
        ready = self._promised() or self._now_ready(LOOK_S if self.connecting else 0)
        if ready or self.connecting:
            return ready
        due = inf if timeout is None else self._loop.now_s + timeout
        if due < self._horizon and self.wires.quiet and not self._ports and not self._called_back():
            self._loop.now_s = due
            return []
        return self._idle(due)

    def _promised(self) -> Ready:
        """Wait until all is there that members have written, and who has called; [] where nothing was promised."""
        began = WALL()
        while wanted := self._owing():
            ready = self._now_ready()
            missing = wanted - {key.fd for key, _ in ready}
            if not missing:
                return ready
            with selectors.DefaultSelector() as waiting:
                waiting.register(missing.pop(), READ)
                if not waiting.select(1.0) and WALL() - began > SILENT_S:
                    _tell(f"never came, though a member wrote it: {self.wires.give_up()}")
        return []

    def _owing(self) -> set[int]:
        if not self.wires.owing and not self.wires.uncalled:
            return set()
        owing = {one.fileno() for one in self.wires.owing if self._events(one.fileno()) & READ}
        return owing | {fileno for fileno, port in self._doors.items() if port in self.wires.uncalled}

    def _begin(self, turn: Turn) -> Ready:
        self.count, self._horizon = turn.count, turn.horizon
        self._loop.now_s = max(self._loop.now_s, turn.now)
        for fileno in self.wires.promise(turn.promised, self._doors.values()):
            self._watch(fileno, self._events(fileno))
        return self._promised() or self._now_ready()

    def _report(self, due: float) -> TurnReport:
        ports, self._ports = tuple(self._ports), []
        return TurnReport(
            self._loop.now_s, due, self.wires.told(self._events), ports=ports, uncounted=self.uncounted > 0
        )

    @abstractmethod
    def _called_back(self) -> bool:
        """Whether somebody else is to have a turn, though this member could go on alone."""

    @abstractmethod
    def _idle(self, due: float) -> Ready:
        """Give the turn back and wait for the next one; ``due`` (s) is the next timer here."""


def _tell(what: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write(f"the shared clock: {what}\n")
        sys.stderr.flush()


class _Host(_TurnSelector):
    """Member 0, which also keeps the turns and hears the guests."""

    def __init__(self, limit: TimeLimit, now_s: float) -> None:
        super().__init__()
        self._limit = limit
        self.held = False
        self._turns = Turns(now_s)
        self._turns.join()
        self._lines: dict[int, TurnLine] = {}  # by file
        self._numbers_of: dict[int, int] = {}  # a guest's number, by file
        self._names: dict[int, str] = {}
        self._door = socket.create_server(("127.0.0.1", 0))
        self._control.register(self._door, READ)
        self._outside.register(self._door, READ)
        self._told_of = (-1, -1)
        self.address = f"127.0.0.1:{self._door.getsockname()[1]}"

    def first(self) -> None:
        """Its first turn, before its loop runs."""
        turn = self._turns.next(self._allowed())
        self.count = turn.count if turn is not None else 0

    def close(self) -> None:
        for line in self._lines.values():
            line.close()
        self._door.close()
        super().close()

    def _allowed(self) -> float:
        if self.held and self._limit.speed is None and not self._turns.others:
            return self._turns.now  # as fast as the others keep up: nobody is there
        return self._limit.allowed(self._turns.now)

    def _called_back(self) -> bool:
        self._hear([key for key, _ in self._control.select(0)])
        return self._turns.wanted

    def _idle(self, due: float) -> Ready:
        self._turns.yielded(0, self._report(due))
        asked = False
        while True:
            self._hear([key for key, _ in self._control.select(0)])
            if self._turns.uncounted and self._turns.settled:
                asked |= self._wait(UNCOUNTED_S, asked=asked)
            allowed = self._allowed()
            turn = self._turns.next(allowed)
            if turn is not None and turn.number == 0:
                return self._begin(turn)
            if turn is not None:
                self._line_of(turn.number).say(MessageKind.TURN, encode_turn(turn))
            elif self._turns.holder is not None:
                asked |= self._wait(SILENT_S, asked=asked)
            else:
                asked |= self._wait(self._limit.wait_s(self._turns.earliest, allowed), asked=asked)

    def _wait(self, wait_s: float | None, *, asked: bool) -> bool:
        """Until somebody says something; whether it came from outside to this process itself."""
        ready = [key for key, _ in (self._control if asked else self._outside).select(wait_s)]
        mine = [key for key in ready if key.fd not in self._lines and key.fileobj is not self._door]
        self._hear([key for key in ready if key not in mine])
        if not ready and wait_s == SILENT_S:
            self._tell_of_silence()
        if mine:
            self._turns.want(0, self.count)
        return bool(mine)

    def _tell_of_silence(self) -> None:
        number = self._turns.holder
        if number and self._told_of != (number, self._turns.count_of(number)):
            self._told_of = (number, self._turns.count_of(number))
            _tell(f"{self._names.get(number, number)} has been at work for {SILENT_S:.0f} s; everybody waits for it")

    # ---- guests -------------------------------------------------------------------------------------

    def _line_of(self, number: int) -> TurnLine:
        return next(self._lines[fileno] for fileno, one in self._numbers_of.items() if one == number)

    def _hear(self, keys: list[selectors.SelectorKey]) -> None:
        for key in keys:
            if key.fileobj is self._door:
                self._welcome()
            elif key.fd in self._lines:
                self._heard(key.fd)
        holder = self._turns.holder
        if holder and self._turns.wanted and self._turns.alone_until > -inf:
            # Somebody has news from outside: who goes on alone through its timers comes back first.
            self._turns.alone_until = -inf
            self._line_of(holder).say(MessageKind.COME_BACK)

    def _welcome(self) -> None:
        with contextlib.suppress(OSError):
            line = TurnLine(self._door.accept()[0])
            self._lines[line.fileno()] = line
            self._control.register(line.fileno(), READ)
            self._outside.register(line.fileno(), READ)

    def _heard(self, fileno: int) -> None:
        try:
            for word, data in self._lines[fileno].hear():
                self._obey(fileno, word, data)
        except (EOFError, ValueError):
            self._lost(fileno)

    def _obey(self, fileno: int, word: MessageKind, data: bytes) -> None:
        number = self._numbers_of.get(fileno)
        if number is None and word is MessageKind.HELLO:
            self._numbers_of[fileno] = number = self._turns.join()
            self._names[number] = data.decode("utf-8", "replace")[:80]
        elif number is not None and word is MessageKind.YIELDED:
            self._turns.yielded(number, decode_report(data))
        elif number is not None and word is MessageKind.WANT:
            self._turns.want(number, decode_request(data))
        else:
            raise ValueError(f"{word!r} out of turn")

    def _lost(self, fileno: int) -> None:
        self._control.unregister(fileno)
        self._outside.unregister(fileno)
        self._lines.pop(fileno).close()
        number = self._numbers_of.pop(fileno, None)
        if number is not None:
            self._turns.leave(number)
            self._names.pop(number, None)


class _Guest(_TurnSelector):
    """A member whose turns come from the host. When the host is gone, its time goes on as the wall's."""

    def __init__(self, address: str, name: str) -> None:
        super().__init__()
        host, _, port = address.rpartition(":")
        plain = socket.create_connection((host, int(port)), timeout=JOIN_S)
        self._line: TurnLine | None = TurnLine(plain)
        plain.settimeout(JOIN_S)
        self._line.say(MessageKind.HELLO, name.encode())
        try:
            self.first = self._first(self._line)
        except EOFError:
            self.close()
            raise
        plain.settimeout(None)
        self._control.register(self._line.fileno(), READ)
        self._outside.register(self._line.fileno(), READ)
        self._gone_at = 0.0

    @staticmethod
    def _first(line: TurnLine) -> Turn:
        while True:
            for word, data in line.hear():
                if word is MessageKind.TURN:
                    return decode_turn(data)

    def select(self, timeout: float | None = None) -> Ready:
        if self._line is not None:
            return super().select(timeout)
        busy = self._loop.threads_at_work
        ready = [] if busy and self._loop.jobs.settle() else self._now_ready(LOOK_S if busy else timeout)
        wall = WALL()
        self._loop.now_s += wall - self._gone_at
        self._gone_at = wall
        return ready

    def close(self) -> None:
        if self._line is not None:
            self._line.close()
        super().close()

    def _alone(self) -> Ready:
        if self._line is not None:
            self._line.close()
        self._line, self._gone_at = None, WALL()
        self.wires.give_up()
        return self._now_ready()

    def _called_back(self) -> bool:
        if self._line is not None and self._control.select(0):
            try:
                for word, _ in self._line.hear():
                    self._horizon = -inf if word is MessageKind.COME_BACK else self._horizon
            except EOFError:
                return True
        return self._horizon == -inf

    def _idle(self, due: float) -> Ready:
        if self._line is None:
            return self._now_ready()
        self._horizon = -inf
        self._line.say(MessageKind.YIELDED, encode_report(self._report(due)))
        asked = False
        while True:
            ready = [key.fd for key, _ in (self._control if asked else self._outside).select()]
            if self._line.fileno() in ready:
                try:
                    for word, data in self._line.hear():
                        if word is MessageKind.TURN:
                            return self._begin(decode_turn(data))
                except (EOFError, ValueError):
                    return self._alone()
            elif ready:
                asked = True
                self._line.say(MessageKind.WANT, encode_request(self.count))


class SharedTimeLoop(SteppedLoop):
    """A loop whose time is shared with those of other processes; see the head of this file."""

    def __init__(self, turns: _TurnSelector, now_s: float) -> None:
        self._turns = turns
        turns.serve(self)
        super().__init__(turns, now_s)

    async def create_server(self, *args: Any, **options: Any) -> asyncio.Server:
        """As any loop; members that call are waited for."""
        server = await super().create_server(*args, **options)
        for one in server.sockets:
            if one.family in (socket.AF_INET, socket.AF_INET6):
                self._turns.listens(one.fileno(), one.getsockname()[1])
        return server

    async def sock_connect(self, sock: Any, address: Any) -> None:
        """As any loop; a call on this computer is answered before time goes on."""
        near = isinstance(address, tuple) and str(address[0]).startswith(LOOPBACK)
        self._turns.connecting += near
        try:
            await super().sock_connect(sock, address)
        finally:
            self._turns.connecting -= near

    # Every connection that asyncio makes, called or calling, becomes a transport in one of these two.

    def _make_socket_transport(self, sock: Any, *args: Any, **options: Any) -> Any:
        return super()._make_socket_transport(self._turns.wires.counted(sock), *args, **options)  # type: ignore[misc]

    def _make_ssl_transport(self, rawsock: Any, *args: Any, **options: Any) -> Any:
        return super()._make_ssl_transport(self._turns.wires.counted(rawsock), *args, **options)  # type: ignore[misc]

    @contextlib.contextmanager
    def uncounted_wire(self) -> Iterator[None]:
        """While a wire is open whose bytes nobody counts, a serial port: a moment of real time before each jump."""
        self._turns.uncounted += 1
        try:
            yield
        finally:
            self._turns.uncounted -= 1


class HostedTimeLoop(SharedTimeLoop):
    """The loop of the process that keeps the clock; ``address`` is where others join.

    ``speed`` is how many seconds of its time may pass in one of the wall's; None: as many as it can do.
    """

    def __init__(self, speed: float | None = None) -> None:
        host = _Host(TimeLimit(speed), 0.0)
        self.address = host.address
        self._host = host
        super().__init__(host, 0.0)
        host.first()

    @contextlib.contextmanager
    def keeping_up(self) -> Iterator[None]:
        """In this block others may join; without a limit time stands still while nobody has."""
        self._host.held = True
        try:
            yield
        finally:
            self._host.held = False


class JoinedTimeLoop(SharedTimeLoop):
    """The loop of a process that joins another's clock at "host:port" and begins with a turn.

    Raises OSError where nobody keeps a clock there, EOFError where that one has gone.
    """

    def __init__(self, address: str, name: str = "") -> None:
        guest = _Guest(address, name or f"process {os.getpid()}")
        super().__init__(guest, guest.first.now)
        guest.count, guest._horizon = guest.first.count, guest.first.horizon  # noqa: SLF001 - the same module
