"""An instrument on its wire: listens, samples on a task of its own, can be unplugged and plugged in again."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from abc import ABC, abstractmethod
from collections.abc import Callable

from drivers.clock import Clock, LoopClock
from drivers.errors import DeadlineExceeded
from drivers.transport import ByteTransport, Listener, serve

WireWrapper = Callable[[ByteTransport], ByteTransport]
# Nobody listens: the instrument keeps up with its machine in stretches of this length.
IDLE_S = 5.0


class InstrumentServer(ABC):
    """The part of every answering instrument that is wire: subclasses bring the sampling and the talk."""

    def __init__(self, clock: Clock, block_s: float, around: WireWrapper | None = None) -> None:
        """`block_s` of instrument time fills a block; `around` may put faults around each wire."""
        self._clock = clock
        self._block_s = block_s
        self._around = around
        self._listener: Listener | None = None
        self._task: asyncio.Task[None] | None = None
        self._listened = asyncio.Event()
        self.silent = False
        self.tls: ssl.SSLContext | None = None

    @property
    def url(self) -> str:
        """Where clients reach it; "" while its line is pulled."""
        return self._listener.url if self._listener is not None else ""

    async def start(self, url: str) -> str:
        """Begin to sample and to listen; the url with its real port."""
        self._skip_to(self._clock.now())
        self._task = asyncio.get_running_loop().create_task(self._produce(), name=f"samples for {url}")
        return await self.plug(url)

    async def plug(self, url: str) -> str:
        """Listen (again) on this url."""
        self._listener = await serve(url, self._visited, LoopClock(), self.tls)
        return self._listener.url

    async def pull(self) -> None:
        """Pull the line: connections end, nobody listens."""
        listener, self._listener = self._listener, None
        if listener is not None:
            await listener.close()

    async def stop(self) -> None:
        """End everything."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        await self.pull()

    async def _visited(self, wire: ByteTransport) -> None:
        await self._converse(self._around(wire) if self._around is not None else wire)

    async def _block_over(self) -> None:
        """Let the time of a block pass; while nobody listens a longer one, cut short when somebody comes."""
        if not self._listened.is_set():
            with contextlib.suppress(DeadlineExceeded):
                async with self._clock.deadline(IDLE_S - self._block_s, self.url):
                    await self._listened.wait()
        await self._clock.sleep(self._block_s)

    @abstractmethod
    def _skip_to(self, now_s: float) -> None:
        """Sample from this moment on."""

    @abstractmethod
    async def _produce(self) -> None:
        """Sample for ever."""

    @abstractmethod
    async def _converse(self, peer: ByteTransport) -> None:
        """Talk to one client until its wire ends."""
