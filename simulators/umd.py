"""The laser's counter on its wire: streams uMD lines of every sample, in blocks, to whoever is connected."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import TransportError
from drivers.transport import ByteTransport
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
from simulators.instrument_server import InstrumentServer, WireWrapper
from simulators.optics import CounterSamples, LaserCounter, OpticsBench

IntArray = NDArray[np.int64]
CYCLE = 32
BANNER = b"uMD2 homodyne (simulated)\r\n"


class UmdServer(InstrumentServer):
    """Serves one laser counter. Nothing is dropped: a slow reader makes the blocks longer, not fewer."""

    def __init__(
        self, counter: LaserCounter, bench: OpticsBench, clock: Clock, block_s: float, around: WireWrapper | None = None
    ) -> None:
        super().__init__(clock, block_s, around)
        self.counter = counter
        self._bench = bench
        self._peers: list[ByteTransport] = []
        self._last_count = 0

    def _skip_to(self, now_s: float) -> None:
        self.counter.skip_to(now_s)

    async def _converse(self, peer: ByteTransport) -> None:
        await peer.write(BANNER)
        if not self._peers:
            self._pass_over()
        self._peers.append(peer)
        self._listened.set()
        try:
            while True:
                await peer.read(4096)  # the counter takes no commands
        finally:
            self._peers.remove(peer)
            if not self._peers:
                self._listened.clear()

    def _pass_over(self) -> None:
        """Count on to now; what nobody heard is gone."""
        counts = self.counter.read(self._clock.now())
        if len(counts.counts):
            self._last_count = int(counts.counts[-1])

    async def _produce(self) -> None:
        while True:
            await self._block_over()
            if not self._peers or self.silent:
                self._pass_over()
                continue
            counts = self.counter.read(self._clock.now())
            if len(counts.sequence):
                await self._send(encode_rows(self.rows(counts)))

    async def _send(self, data: bytes) -> None:
        for peer in tuple(self._peers):
            try:
                await peer.write(data)
            except TransportError:
                await peer.close()

    def rows(self, counts: CounterSamples) -> IntArray:
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
