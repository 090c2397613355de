"""The loop whose time moves only when every task waits: it jumps to the next timer when nothing can happen before.

Connections between two ends of the loop itself are no sockets (`drivers.clock.inside`), so nothing can be on its way
unseen. Only sockets of other threads or processes get a moment of real time before each jump.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from drivers.clock.inside import Doors, connected
from drivers.clock.jobs import LOOK_S, SteppedLoop

T = TypeVar("T")


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
        self._doors = Doors()
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
        return connected(self, protocol_factory(), called(), int(port))


def run_virtual(main: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine function to its end in virtual time, on a loop of its own."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main())
