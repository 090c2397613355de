"""Register 15 changes about once a second while a session is open, so that the PLC knows its PC is alive."""

from __future__ import annotations

import asyncio
import contextlib

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, TrueflankError
from drivers.sinumerik.mailbox.codec.registers import ADDRESS, LAST_NUMBER
from drivers.sinumerik.mailbox.wire import ModbusWire

PERIOD_S = 1.0


class Heartbeat:
    """One task that ends by itself: an exchange that is cut short would break the wire."""

    def __init__(self, wire: ModbusWire, clock: Clock, where: str) -> None:
        self._wire = wire
        self._clock = clock
        self._where = where
        self._task: asyncio.Task[None] | None = None
        self._stop = asyncio.Event()

    def start(self) -> None:
        """Beat from now on, if it does not already."""
        if self._task is None or self._task.done():
            self._stop = asyncio.Event()
            loop = asyncio.get_running_loop()
            self._task = loop.create_task(self._run(self._stop), name=f"heartbeat to {self._where}")

    async def stop(self) -> None:
        """Beat no more; returns when the last beat has been answered or has failed."""
        task, self._task = self._task, None
        if task is not None:
            self._stop.set()
            await asyncio.gather(task, return_exceptions=True)

    async def _run(self, stop: asyncio.Event) -> None:
        """A wire that broke ends it, and the next command says why."""
        beat = 0
        with contextlib.suppress(TrueflankError):
            while not stop.is_set():
                beat = beat % LAST_NUMBER + 1
                try:
                    await self._wire.write_one(ADDRESS["PC_HEARTBEAT"], beat)
                except DeadlineExceeded:
                    if not self._wire.sound:
                        return
                    continue  # its turn did not come: another exchange took all the time
                with contextlib.suppress(DeadlineExceeded):
                    async with self._clock.deadline(PERIOD_S, self._where):
                        await stop.wait()
