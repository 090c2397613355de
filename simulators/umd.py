"""The laser's counter on its wire: streams uMD lines of every sample, in blocks, to whoever is connected."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, LoopClock
from drivers.errors import TransportError
from drivers.transport import ByteTransport, Listener, serve
from drivers.umd.codec import (
    AIR_TEMPERATURE,
    CODE,
    DATA,
    DISPLACEMENT,
    FIRMWARE,
    HOMODYNE,
    HUMIDITY,
    MATERIAL_TEMPERATURE,
    PRESSURE,
    SAMPLE_FREQUENCY,
    SEQUENCE,
    SIGNAL_STRENGTH,
    VELOCITY,
    encode_rows,
)
from simulators.optics import Bench, Counts, LaserCounter

IntArray = NDArray[np.int64]
Around = Callable[[ByteTransport], ByteTransport]
CYCLE = 32
BANNER = b"uMD2 homodyne (simulated)\r\n"


class UmdAnswerer:
    """Serves one laser counter. Nothing is dropped: a slow reader makes the blocks longer, not fewer."""

    def __init__(
        self, counter: LaserCounter, bench: Bench, clock: Clock, block_s: float, around: Around | None = None
    ) -> None:
        self.counter = counter
        self._bench = bench
        self._clock = clock
        self._block_s = block_s
        self._around = around
        self._peers: list[ByteTransport] = []
        self._listener: Listener | None = None
        self._task: asyncio.Task[None] | None = None
        self._last_count = 0
        self.silent = False

    @property
    def url(self) -> str:
        """Where clients reach it; "" while its line is pulled."""
        return self._listener.url if self._listener is not None else ""

    async def start(self, url: str) -> str:
        """Begin to count and to listen; the url with its real port."""
        self.counter.skip_to(self._clock.now())
        self._task = asyncio.get_running_loop().create_task(self._produce(), name=f"umd {url}")
        return await self.plug(url)

    async def plug(self, url: str) -> str:
        """Listen (again) on this url."""
        self._listener = await serve(url, self._converse, LoopClock())
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

    async def _converse(self, wire: ByteTransport) -> None:
        peer = self._around(wire) if self._around is not None else wire
        await peer.write(BANNER)
        self._peers.append(peer)
        try:
            while True:
                await peer.read(4096)  # the counter takes no commands
        finally:
            self._peers.remove(peer)

    async def _produce(self) -> None:
        while True:
            await self._clock.sleep(self._block_s)
            counts = self.counter.read(self._clock.now())
            if len(counts.sequence) and self._peers and not self.silent:
                await self._send(encode_rows(self.rows(counts)))

    async def _send(self, data: bytes) -> None:
        for peer in tuple(self._peers):
            try:
                await peer.write(data)
            except TransportError:
                await peer.close()

    def rows(self, counts: Counts) -> IntArray:
        """The lines of these samples as integers (n, 8): displacement, velocity, sequence and slow values."""
        rows = np.zeros((len(counts.sequence), 8), dtype=np.int64)
        rows[:, DISPLACEMENT[0]] = counts.counts
        rows[:, VELOCITY[0]] = np.diff(counts.counts, prepend=self._last_count)
        rows[:, SEQUENCE] = counts.sequence
        codes, data = self._slow()
        slot = counts.sequence % CYCLE
        rows[:, CODE], rows[:, DATA] = codes[slot], data[slot]
        self._last_count = int(counts.counts[-1])
        return rows

    def _slow(self) -> tuple[IntArray, IntArray]:
        """Slow values by the low five bits of the sequence number; every one comes once in 32 lines."""
        spec, air = self.counter.spec, self._bench.truth.climate.sensed(self._clock.now())
        values = (
            (SAMPLE_FREQUENCY, spec.sample_hz * 100.0),
            (FIRMWARE, spec.firmware * 100.0),
            (HOMODYNE, 1 + 256 * spec.counts_per_cycle),
            (AIR_TEMPERATURE, air.air_degc * 100.0),
            (MATERIAL_TEMPERATURE, air.material_degc * 100.0),
            (PRESSURE, air.pressure_hpa * 100.0),
            (HUMIDITY, air.humidity_pct * 10.0),
            (SIGNAL_STRENGTH, 0 if self._dark else 90),
        )
        table = np.zeros((2, CYCLE), dtype=np.int64)
        table[:, 1 : 1 + len(values)] = np.rint(np.asarray(values)).astype(np.int64).T
        return table[0], table[1]

    @property
    def _dark(self) -> bool:
        name = self.counter.spec.name
        return name in self._bench.broken or self._bench.mounted(name) is None
