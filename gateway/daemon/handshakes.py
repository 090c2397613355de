"""Callers over TLS before their handshake: who says nothing costs nothing, and the newest of a crowd is heard first."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections import deque
from collections.abc import Callable

AT_ONCE = 4
"""How many handshakes are begun in a turn of the loop: each takes 1 to 2 ms of it."""
MOST_WAITING = 256
"""How many callers may wait for theirs; beyond, those that have waited longest are hung up on."""


class Handshakes:
    """Begins handshakes few at a time, the newest caller's first: a question for health does not wait for a crowd.

    What is asked cannot be read before the handshake, so nobody can be told why: who came too late for its turn finds
    the connection closed. ``patience_s`` is how long a caller may be silent, take for its handshake, or take its leave.
    """

    def __init__(self, protocol: Callable[[], asyncio.Protocol], context: ssl.SSLContext, *, patience_s: float) -> None:
        self._protocol, self._context, self._patience_s = protocol, context, patience_s
        self._loop = asyncio.get_running_loop()
        self._silent: dict[socket.socket, asyncio.TimerHandle] = {}
        self._waiting: deque[socket.socket] = deque()
        self._begun: set[asyncio.Task[None]] = set()

    def enter(self, caller: socket.socket) -> None:
        """A caller has come; it waits for its turn once it has said something."""
        self._silent[caller] = self._loop.call_later(self._patience_s, self._leave, caller)
        self._loop.add_reader(caller, self._says, caller)

    def _says(self, caller: socket.socket) -> None:
        self._loop.remove_reader(caller)
        self._silent.pop(caller).cancel()
        self._waiting.append(caller)
        if len(self._waiting) > MOST_WAITING:
            self._waiting.popleft().close()
        elif len(self._waiting) == 1:
            self._loop.call_soon(self._next)

    def _leave(self, caller: socket.socket) -> None:
        self._loop.remove_reader(caller)
        del self._silent[caller]
        caller.close()

    def _next(self) -> None:
        for _one in range(min(AT_ONCE, len(self._waiting))):
            task = self._loop.create_task(self._shaken(self._waiting.pop()), name="handshake")
            self._begun.add(task)
            task.add_done_callback(self._begun.discard)
        if self._waiting:
            self._loop.call_soon(self._next)

    async def _shaken(self, caller: socket.socket) -> None:
        with contextlib.suppress(OSError):  # the caller's doing, or it has left
            await self._loop.connect_accepted_socket(
                self._protocol,
                caller,
                ssl=self._context,
                ssl_handshake_timeout=self._patience_s,
                ssl_shutdown_timeout=self._patience_s,
            )

    async def end(self) -> None:
        """Hang up on all that have not been let in."""
        for caller in tuple(self._silent):
            self._silent[caller].cancel()
            self._leave(caller)
        while self._waiting:
            self._waiting.pop().close()
        if self._begun:
            await asyncio.wait(self._begun, timeout=0.0)  # a task that never ran would leave its connection open
        for task in tuple(self._begun):
            task.cancel()
        await asyncio.gather(*self._begun, return_exceptions=True)
