"""Loops with a time of their own: threads in a fixed order, connections inside one loop, and time that jumps.

The loop asks its selector for events with the time until the next timer. `_JumpingSelector` waits only a fraction of a
millisecond for bytes of other processes; when nothing comes, no thread works and no connection inside the loop has
bytes, nothing can happen before the next timer, and the loop's clock jumps there::

    ready callbacks -> run them at the same time | threads at work -> wait for them | nothing -> clock = next timer
"""

from __future__ import annotations

import asyncio
import itertools
import selectors
import time
from collections import deque
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar, cast

# Work in threads under a loop whose time is not the wall's: time stands still meanwhile, and the order is the same.
#
# Everything that waits for threads is told in the order in which the work was given, once the loop can do nothing
# else, so that it does not matter how fast each thread was.

T = TypeVar("T")
# A thread that does nothing for so long waits for something that only the loop can do, or for a person: the others go
# on then. One that works is waited for, however busy the computer is: its processor time tells.
PATIENCE_S = 5.0
WORKS_S = 0.1  # a fiftieth of a core; who only looks from time to time takes less
LONGEST = 120  # times the patience, for who works without end
LOOK_S = 0.001
SPENT = time.process_time  # of all threads, while the loop's own waits


class ThreadJobs:
    """What threads are doing for one loop."""

    def __init__(self) -> None:
        self._open: list[tuple[Future[Any], asyncio.Future[Any]]] = []
        self._slow: set[Future[Any]] = set()

    def __bool__(self) -> bool:
        return bool(self._open)

    def add(self, work: Future[T], told: asyncio.Future[T]) -> asyncio.Future[T]:
        """``told`` is done when ``work`` is and its turn has come."""
        self._open.append((work, told))
        told.add_done_callback(lambda done: work.cancel() if done.cancelled() else None)
        return told

    def settle(self) -> bool:
        """Wait for the threads and hand on what they found; whether anything was, so that the loop has work."""
        self._open = [(work, told) for work, told in self._open if not told.done()]
        quick = [work for work, _ in self._open if work not in self._slow]
        self._slow |= _unfinished(quick)
        done = [(work, told) for work, told in self._open if work.done()]
        self._open = [(work, told) for work, told in self._open if not work.done()]
        self._slow &= {work for work, _ in self._open}
        for work, told in done:
            _hand_on(work, told)
        return bool(done)


def _unfinished(works: list[Future[Any]]) -> set[Future[Any]]:
    """Those that are not done when nothing works any more."""
    for _ in range(LONGEST):
        began = SPENT()
        if not (left := wait(works, PATIENCE_S).not_done) or SPENT() - began < WORKS_S:
            return left
    return left


def _hand_on(work: Future[T], told: asyncio.Future[T]) -> None:
    if work.cancelled():
        told.cancel()
    elif (error := work.exception()) is not None:
        told.set_exception(error)
    else:
        told.set_result(work.result())


class SteppedLoop(asyncio.SelectorEventLoop):
    """What loops with a time of their own have in common: seconds that only they move, and threads in order."""

    _closed = True  # until it is made: where that fails there is nothing to close

    def __init__(self, selector: Any, now_s: float) -> None:
        self.now_s = now_s
        self.jobs = ThreadJobs()
        self.ending = 0
        self._threads: Executor | None = None
        super().__init__(selector)

    def time(self) -> float:
        """Seconds of this loop."""
        return self.now_s

    @property
    def threads_at_work(self) -> bool:
        """Whether time stands still for a thread."""
        return bool(self.jobs) or self.ending > 0

    def set_default_executor(self, executor: Any) -> None:
        """As any loop."""
        self._threads = executor
        super().set_default_executor(executor)

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        """Run in a thread and hold time still until it is done."""
        if executor is None and self._threads is None:
            self.set_default_executor(ThreadPoolExecutor(thread_name_prefix="asyncio"))
        work = (executor or self._threads).submit(func, *args)  # type: ignore[union-attr]
        return self.jobs.add(work, self.create_future())

    async def shutdown_default_executor(self, *args: Any, **options: Any) -> None:
        """End the threads and hold time still meanwhile: newer Pythons give them a time limit of the loop's."""
        self.ending += 1
        try:
            await super().shutdown_default_executor(*args, **options)
        finally:
            self.ending -= 1


# Connections whose two ends live in one loop: bytes pass from protocol to protocol, without a socket.
#
# They behave like TCP on loopback as far as asyncio shows it: pieces in order, a reader that holds back its writer,
# half-closed ends, and a reset where somebody leaves with bytes unread or writes to one who has left.

LOOPBACK = ("127.0.0.1", "localhost")
PIECE_BYTES = 1 << 18
# What the system's buffers on both sides hold beyond the limit of the transport itself.
ROOM_BYTES = 1 << 18
Factory = Callable[[], asyncio.BaseProtocol]
_ports = itertools.cycle(range(49152, 65536))


class LocalServers:
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


def connect_ends(
    loop: asyncio.AbstractEventLoop, caller: asyncio.BaseProtocol, called: asyncio.BaseProtocol, port: int
) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
    """Join two protocols, each told of its connection; the caller's transport and protocol."""
    here, there = (LOOPBACK[0], next(_ports)), (LOOPBACK[0], port)
    client, server = LocalEnd(loop, caller, here, there), LocalEnd(loop, called, there, here)
    client.other, server.other = server, client
    loop.call_soon(called.connection_made, server)
    caller.connection_made(client)
    return client, caller


class LocalEnd(asyncio.Transport):
    """One end; what the other wrote waits here until it is read."""

    other: LocalEnd

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


# The virtual loop.


class _JumpingSelector(selectors.BaseSelector):
    """Waits a fraction of a millisecond for strangers' bytes, then jumps the loop's clock to the next timer."""

    GRACE_S = 0.0002

    def __init__(self, loop: VirtualTimeLoop) -> None:
        self._loop = loop
        self._inner = selectors.DefaultSelector()
        # The loop's own wake-up socket, and sockets on which nobody has called yet: nothing is on its way there.
        self._expected = 1
        self._doors: set[int] = set()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is not None and timeout <= 0:
            return self._inner.select(0)
        if self._loop.threads_at_work:
            return [] if self._loop.jobs.settle() else self._inner.select(LOOK_S)
        if timeout is None:
            return self._inner.select(None)
        ready = self._inner.select(0)
        if not ready and len(self._inner.get_map()) > self._expected:
            # Sockets of other threads or processes get a moment; epoll itself would wait a whole millisecond.
            time.sleep(self.GRACE_S)  # noqa: TID251 - the one place
            ready = self._inner.select(0)
        if not ready:
            self._loop.jump(timeout)
        return ready

    def leave_open(self, fileno: int) -> None:
        """This socket listens; that somebody calls on it is nothing to wait for."""
        self._doors.add(fileno)
        self._count()

    def _count(self) -> None:
        registered = self._inner.get_map()
        self._expected = 1 + sum(fileno in registered for fileno in self._doors)

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        key = self._inner.register(fileobj, events, data)
        self._count()
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        key = self._inner.unregister(fileobj)
        self._doors.discard(key.fd)
        self._count()
        return key

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.modify(fileobj, events, data)

    def get_map(self) -> Any:
        return self._inner.get_map()

    def close(self) -> None:
        self._inner.close()


class VirtualTimeLoop(SteppedLoop):
    """An event loop whose time moves only when every task waits."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector(self)
        self._doors = LocalServers()
        super().__init__(self._jumping, 1000.0)

    def jump(self, seconds: float) -> None:
        """Move virtual time forward; only the selector calls this."""
        self.now_s += seconds

    async def create_server(
        self, protocol_factory: Callable[[], asyncio.BaseProtocol], *args: Any, **options: Any
    ) -> asyncio.Server:
        """As any loop; calls from this loop itself come in without a socket."""
        server = await super().create_server(protocol_factory, *args, **options)
        for socket in server.sockets:
            self._jumping.leave_open(socket.fileno())
        if options.get("ssl") is None:
            self._doors.open(server, protocol_factory)
        return server

    async def create_connection(
        self, protocol_factory: Callable[[], asyncio.BaseProtocol], host: Any = None, port: Any = None, **options: Any
    ) -> Any:
        """As any loop; a call to a server of this loop needs no socket."""
        called = self._doors.behind(host, port) if not any(options.values()) else None
        if called is None:
            return await super().create_connection(protocol_factory, host, port, **options)
        return connect_ends(self, protocol_factory(), called(), int(port))


def run_virtual(main: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine function to its end in virtual time, on a loop of its own."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main())
