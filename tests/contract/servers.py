"""Scripted instruments for the contract suite: the codec's server role and nothing of any simulator's physics."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from drivers.bridge import records
from drivers.bridge.codec import BridgeCodec, BridgeMessage, BridgeRefusal, Notification, Reply, Request, SampleFrame
from drivers.bridge.records import BridgeIdentity, BridgeSamples, CalibratorStatus, environment_as_object
from drivers.clock import Clock
from drivers.errors import TransportError
from drivers.transport import ByteTransport
from drivers.types.sensing import Ambient
from drivers.umd.codec import CODE, DATA, SEQUENCE, UmdCodec, UmdLines

BLOCK_S = 0.02
RATE_HZ = 1000


class ScriptedInstrument(Protocol):
    """What the suite may do to an instrument, whatever its dialect."""

    driver: str
    channels: tuple[str, ...]
    silent: bool
    garbage: bool
    bend: Callable[[bytes], bytes]
    skip: int

    async def converse(self, wire: ByteTransport) -> None:
        """Serve one client until it leaves."""
        ...

    def drop(self) -> None:
        """Cut all wires now."""
        ...

    def expected(self, time_s: np.ndarray) -> np.ndarray:
        """Values (n, channels) at these instrument times, from this file's own arithmetic."""
        ...


class _Scripted:
    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.silent = False
        self.garbage = False
        self.bend: Callable[[bytes], bytes] = lambda data: data
        self.skip = 0
        self._wires: list[ByteTransport] = []
        self._cut = asyncio.Event()
        self.count = 0

    def drop(self) -> None:
        self._cut.set()

    async def _pace(self) -> None:
        """Wait for the next block, or leave when the wire is cut."""
        await self.clock.sleep(BLOCK_S)
        if self._cut.is_set():
            self._cut.clear()
            raise TransportError("E-LINK-CLOSED", "script", why="cut")

    async def _put(self, wire: ByteTransport, data: bytes) -> None:
        if self.garbage:
            data = bytes(np.random.default_rng(self.count).integers(128, 256, 200, np.uint8))
        if not self.silent:
            await wire.write(self.bend(data))


class ScriptedUmd(_Scripted):
    """A one-axis uMD2 whose count goes up by two a sample."""

    driver = "umd"
    channels = ("displacement_mm",)
    facts = ((1, 10, 126), (2, 8, 100 * RATE_HZ), (3, 3, 2150), (4, 4, 2020), (5, 5, 100_010), (13, 20, 1025))

    def rows(self, count: int) -> np.ndarray:
        """The next lines."""
        numbers = self.count + self.skip + np.arange(count)
        self.count += count + self.skip
        self.skip = 0
        rows = np.zeros((count, 8), np.int64)
        rows[:, 2], rows[:, 3], rows[:, SEQUENCE] = 2 * numbers, 2, numbers
        for slot, code, data in self.facts:
            rows[numbers % 32 == slot, CODE] = code
            rows[numbers % 32 == slot, DATA] = data
        return rows

    async def converse(self, wire: ByteTransport) -> None:
        codec = UmdCodec("server")
        while True:
            rows = self.rows(round(BLOCK_S * RATE_HZ))
            await self._put(wire, codec.send(UmdLines(rows)))
            await self._pace()

    def expected(self, time_s: np.ndarray) -> np.ndarray:
        return (2 * np.rint(time_s * RATE_HZ) * 632.990577e-6 / 8)[:, None]


class ScriptedBridge(_Scripted):
    """A rotary calibrator on an axis that turns at 1 deg/s while the device follows exactly."""

    driver = "bridge"
    channels = ("device_deg", "laser_deg")
    framings: tuple[str, ...] = ("json",)
    sent: tuple[str, ...] = ()

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock)
        self.kind = "rotary_calibrator"
        self.protocol = 1
        self.status = CalibratorStatus(True, False, 87.0)
        self.asked: list[tuple[str, Any]] = []
        self.refusals: dict[str, BridgeRefusal] = {}
        self.id_shift = 0
        self.streaming = False
        self.framed = False
        self.sent_count = 0

    async def converse(self, wire: ByteTransport) -> None:
        self.streaming = False
        stream = asyncio.create_task(self._stream(wire))
        try:
            codec = BridgeCodec("server")
            while True:
                for message in codec.receive(await wire.read(4096)):
                    await self._put(wire, codec.send(self._answer(message)))
        finally:
            stream.cancel()
            await asyncio.gather(stream, return_exceptions=True)

    def _answer(self, message: BridgeMessage) -> BridgeMessage:
        assert isinstance(message, Request)
        self.asked.append((message.method, dict(message.params)))
        if message.method in self.refusals:
            refusal = self.refusals[message.method]
            return BridgeRefusal(message.id, refusal.code, refusal.message)
        return Reply(message.id + self.id_shift, self._result(message))

    def _result(self, message: Request) -> Any:
        match message.method:
            case records.IDENTIFY:
                channels = self.channels if self.kind == "rotary_calibrator" else ("displacement_mm",)
                identity = BridgeIdentity(
                    self.kind, "Example", "RC-1", "K12345", "2.0", channels, 1000.0, protocol=self.protocol,  # type: ignore[arg-type]
                    framings=self.framings, sent=self.sent,
                )  # fmt: skip
                return identity.as_object()
            case records.STATUS:
                return self.status.as_object()
            case records.ENVIRONMENT:
                return environment_as_object(Ambient(21.5, 1000.1, None, (20.2,), 1.0))
            case records.OPTICS:
                return {"kind": "rotary"}
            case records.START | records.STOP:
                self.streaming = message.method == records.START
                self.sent_count = 0
                self.framed = message.params.get("framing") == "binary"
                return {"framing": "binary"} if self.framed else {}
        return {}

    async def _stream(self, wire: ByteTransport) -> None:
        codec, count, now = BridgeCodec("server"), round(BLOCK_S * RATE_HZ), 0
        try:
            while True:
                await self._pace()
                if self.streaming:
                    sequence = self.sent_count + self.skip
                    now += self.skip
                    self.sent_count, self.skip = sequence + count, 0
                    await self._put(wire, codec.send(self._samples(sequence, now, count)))
                now += count
        except TransportError:
            await wire.close()

    def _samples(self, sequence: int, now: int, count: int) -> BridgeMessage:
        time_s = (now + np.arange(count)) / RATE_HZ
        if self.framed:
            columns = [self.channels.index(name) for name in self.sent or self.channels]
            return SampleFrame(sequence, now / RATE_HZ, 1 / RATE_HZ, self.expected(time_s)[:, columns])
        values = dict(zip(self.channels, self.expected(time_s).T, strict=True))
        samples = BridgeSamples(sequence, now / RATE_HZ, 1 / RATE_HZ, values, np.ones(count, bool))
        return Notification(records.SAMPLES, samples.as_object())

    def expected(self, time_s: np.ndarray) -> np.ndarray:
        return np.column_stack((-time_s, np.zeros_like(time_s)))


class ScriptedFrames(ScriptedBridge):
    """The same calibrator sending binary frames, its columns the other way round."""

    framings = ("json", "binary")
    sent = ("laser_deg", "device_deg")
