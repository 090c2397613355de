"""A uMD counter on a real serial port: a pseudo terminal into which its lines are written as the loop turns."""

from __future__ import annotations

import asyncio
import os
import pty
import tty
from pathlib import Path

import numpy as np

from drivers.clock import LoopClock
from drivers.umd.codec import CODE, DATA, SEQUENCE, encode_rows

RATE_HZ = 1000
BLOCK = 50


class PtyCounter:
    """Sends ``BLOCK`` lines whenever the port has room; displacement is twice the sequence number."""

    def __init__(self, firmware: int = 126, stale: bytes = b"") -> None:
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        os.set_blocking(self.master, False)
        self.sent = 0
        self.dropped = 0
        self._facts = ((1, 10, firmware), (2, 8, 100 * RATE_HZ), (13, 20, 1025))
        self._writer: asyncio.Task[None] | None = None
        if stale:
            os.write(self.master, stale)

    def lines(self, count: int) -> bytes:
        """The next lines."""
        numbers = self.sent + np.arange(count)
        rows = np.zeros((count, 8), np.int64)
        rows[:, 2], rows[:, 3], rows[:, SEQUENCE] = 2 * numbers, 2, numbers
        for slot, code, data in self._facts:
            rows[numbers % 32 == slot, CODE], rows[numbers % 32 == slot, DATA] = code, data
        self.sent += count
        return encode_rows(rows)

    def start(self, clock: LoopClock) -> None:
        """Send from now on."""
        self._writer = asyncio.create_task(self._write_on(clock), name="pty counter")

    async def _write_on(self, clock: LoopClock) -> None:
        while True:
            data = self.lines(BLOCK)
            try:
                # The counter drops what its port does not take, like the real one.
                self.dropped += len(data) - os.write(self.master, data)
            except BlockingIOError:
                self.dropped += len(data)
            await clock.sleep(0.05)

    async def unplug(self) -> None:
        """The device is gone."""
        if self._writer is not None:
            self._writer.cancel()
            await asyncio.gather(self._writer, return_exceptions=True)
            self._writer = None
        for number in (self.master, self._slave):
            if number >= 0:
                os.close(number)
        self.master = self._slave = -1


def plug(link: Path, counter: PtyCounter) -> None:
    """Let a name of /dev/serial/by-id point to the port the device has now."""
    fresh = link.with_suffix(".new")
    fresh.symlink_to(counter.path)
    fresh.replace(link)
