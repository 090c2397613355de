"""The conversations of one listener: a task each, ended together, none forgotten."""

from __future__ import annotations

import asyncio

from drivers.errors import TransportError
from drivers.transport.stream import ByteTransport, Handler


class Conversations:
    """Runs a handler for each peer and remembers the first failure that was not just a lost wire."""

    def __init__(self, handler: Handler, name: str) -> None:
        self._handler = handler
        self._name = name
        self._tasks: set[asyncio.Task[None]] = set()
        self._failure: Exception | None = None

    def begin(self, transport: ByteTransport) -> None:
        """Start the handler on a new wire; the wire is closed when the handler ends."""
        task = asyncio.get_running_loop().create_task(self._converse(transport), name=f"peer of {self._name}")
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    async def _converse(self, transport: ByteTransport) -> None:
        try:
            await self._handler(transport)
        except TransportError:
            pass  # the peer left: every conversation ends that way
        finally:
            await transport.close()

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if isinstance(error, Exception) and self._failure is None:
            self._failure = error

    async def end(self) -> None:
        """Cancel and await every conversation; raises the first failure of a handler."""
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for task in tasks:
            self._ended(task)  # a task that has only just ended has not yet been called back
        if self._failure is not None:
            raise self._failure
