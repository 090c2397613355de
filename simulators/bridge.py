"""Instruments behind a bridge: the rotary calibrator, and one-channel straightness and angle instruments.

Both answer the requests of docs/instrument-bridge.md and stream samples while a client wants them. The physics is in
`simulators.optics`; this module shares only the codec with the driver, never a meaning.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from itertools import pairwise
from math import isfinite
from typing import Any, cast

import numpy as np

from drivers.bridge.codec import (
    BridgeCodec,
    BridgeMessage,
    BridgeRefusal,
    Damaged,
    Notification,
    Reply,
    Request,
    SampleFrame,
)
from drivers.bridge.records import (
    BATTERY_LOW,
    BEAM_OBSTRUCTED,
    BINARY,
    BUSY,
    DATUM,
    ENVIRONMENT,
    EVENTS,
    HOLD,
    IDENTIFY,
    INVALID_PARAMS,
    JSON,
    METHOD_NOT_FOUND,
    NOT_REFERENCED,
    OPTICS,
    PARSE_ERROR,
    SAMPLES,
    START,
    STATUS,
    STOP,
    TRACK,
    TURN,
    BridgeIdentity,
    BridgeSamples,
    CalibratorStatus,
    Event,
    environment_as_object,
    events_as_object,
)
from drivers.clock import Clock
from drivers.errors import TransportError
from drivers.transport import ByteTransport
from drivers.types.sensing import Ambient
from simulators.instrument_server import InstrumentServer, WireWrapper
from simulators.optics import CalibratorSamples, HeadReader, OpticsBench, RotaryReader, SensorReader, SensorReadings

Answer = Callable[[Mapping[str, Any]], Awaitable[Any]]
CALIBRATOR_CHANNELS = ("device_deg", "laser_deg")
TURN_LIMIT_DEG = 9000.0
EMPTY_PCT = 5.0


class BridgeRefused(Exception):
    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


class BridgeServer(InstrumentServer):
    """Serves one calibrator to one client at a time."""

    def __init__(
        self, reader: RotaryReader, bench: OpticsBench, clock: Clock, block_s: float, around: WireWrapper | None = None
    ) -> None:
        super().__init__(clock, block_s, around)
        self.reader = reader
        self._bench = bench
        self._peer: ByteTransport | None = None
        self._codec = BridgeCodec("server")
        self._sequence: int | None = None
        self._framing = JSON
        self._beam = True
        self._turn = asyncio.Lock()
        self.serial = reader.spec.serial
        self.battery_pct = 87.0
        self.referenced = True

    def _skip_to(self, now_s: float) -> None:
        self.reader.skip_to(now_s)

    async def _converse(self, peer: ByteTransport) -> None:
        codec, first = BridgeCodec("server"), self._peer is None
        if first:
            self._peer, self._codec = peer, codec
        try:
            while True:
                for message in codec.receive(await peer.read(65536)):
                    await peer.write(codec.send(await self._reply(message, first)))
        finally:
            if first:
                self._peer, self._sequence = None, None
                self._listened.clear()

    async def _reply(self, message: BridgeMessage, first: bool) -> Reply | BridgeRefusal:
        if not isinstance(message, Request):
            why = message.why if isinstance(message, Damaged) else "not a request"
            return BridgeRefusal(None, PARSE_ERROR, str(why))
        if not first:
            return BridgeRefusal(message.id, BUSY, "another client uses this calibrator")
        answer = self._answers().get(message.method)
        if answer is None:
            return BridgeRefusal(message.id, METHOD_NOT_FOUND, f"no method {message.method}")
        try:
            return Reply(message.id, await answer(message.params))
        except BridgeRefused as refused:
            return BridgeRefusal(message.id, refused.code, str(refused))

    def _answers(self) -> Mapping[str, Answer]:
        return {
            IDENTIFY: self._identify,
            START: self._start,
            STOP: self._stop,
            DATUM: self._datum,
            ENVIRONMENT: self._environment,
            OPTICS: self._optics,
            HOLD: self._hold,
            TRACK: self._track,
            TURN: self._turn_by,
            STATUS: self._status,
        }

    async def _identify(self, _params: Mapping[str, Any]) -> Any:
        spec = self.reader.spec
        notices = ("simulated instrument: its readings are computed from the cell's truth",)
        return BridgeIdentity(
            kind="rotary_calibrator",
            maker="trueflank",
            model=spec.model,
            serial=self.serial,
            firmware="1.0",
            channels=CALIBRATOR_CHANNELS,
            sample_rate_hz=spec.sample_hz,
            notices=notices,
            framings=(JSON, BINARY),
        ).as_object()

    async def _start(self, params: Mapping[str, Any]) -> Any:
        if not self.referenced:
            raise BridgeRefused(NOT_REFERENCED, "the calibrator has no reference")
        if self.battery_pct < EMPTY_PCT:
            raise BridgeRefused(BATTERY_LOW, f"battery at {self.battery_pct:.0f} %")
        await self._pump()
        self._sequence = 0
        self._listened.set()
        self._framing = BINARY if params.get("framing") == BINARY else JSON
        return {"framing": self._framing}

    async def _stop(self, _params: Mapping[str, Any]) -> Any:
        self._sequence = None
        self._listened.clear()
        return {}

    async def _datum(self, _params: Mapping[str, Any]) -> Any:
        await self._pump()
        name = self.reader.spec.name
        if name in self._bench.broken or self._bench.mounted(name) is None:
            raise BridgeRefused(BEAM_OBSTRUCTED, "no light returns to the laser")
        self.reader.restore_beam()
        return {}

    async def _environment(self, _params: Mapping[str, Any]) -> Any:
        air = self._bench.truth.climate.sensed(self._clock.now())
        return environment_as_object(
            Ambient(air.air_degc, air.pressure_hpa, air.humidity_pct, (air.material_degc,), age_s=3.0)
        )

    async def _optics(self, _params: Mapping[str, Any]) -> Any:
        return {"kind": "unknown"}

    async def _status(self, _params: Mapping[str, Any]) -> Any:
        return CalibratorStatus(self.referenced, self.reader.turning, self.battery_pct).as_object()

    async def _hold(self, _params: Mapping[str, Any]) -> Any:
        await self._pump()
        self.reader.hold()
        return {}

    async def _track(self, _params: Mapping[str, Any]) -> Any:
        await self._pump()
        self.reader.track()
        return {}

    async def _turn_by(self, params: Mapping[str, Any]) -> Any:
        by = params.get("by_deg")
        if isinstance(by, bool) or not isinstance(by, int | float) or not isfinite(by) or abs(by) > TURN_LIMIT_DEG:
            raise BridgeRefused(INVALID_PARAMS, "by_deg must be a number of degrees")
        await self._pump()
        self.reader.turn(float(by))
        while self.reader.turning:
            await self._clock.sleep(self._block_s)
            await self._pump()
        return {}

    async def _produce(self) -> None:
        while True:
            await self._block_over()
            await self._pump()

    async def _pump(self) -> None:
        """Sample up to now and send, so that what follows acts from now on."""
        async with self._turn:
            turns = self.reader.read(self._clock.now())
            peer, sequence = self._peer, self._sequence
            if peer is None or sequence is None or self.silent or not len(turns.time_s):
                return
            self._sequence = sequence + len(turns.time_s)
            try:
                await peer.write(b"".join(self._codec.send(item) for item in self._told(turns, sequence)))
            except TransportError:
                await peer.close()

    def _told(self, turns: CalibratorSamples, sequence: int) -> list[BridgeMessage]:
        """The samples as one line, or as a frame for each stretch with or without the beam."""
        if self._framing == JSON:
            return [self._notification(turns, sequence)]
        events = self._events(turns)
        told: list[BridgeMessage] = [Notification(EVENTS, events_as_object(events))] if events else []
        values = np.column_stack((turns.device_deg, turns.laser_deg)).round(8)
        edges = [0, *(np.flatnonzero(np.diff(turns.beam)) + 1).tolist(), len(turns.time_s)]
        step = 1.0 / self.reader.spec.sample_hz
        for start, end in pairwise(edges):
            at_s, valid = float(turns.time_s[start]), bool(turns.beam[start])
            told.append(SampleFrame(sequence + start, at_s, step, values[start:end], valid=valid))
        return told

    def _notification(self, turns: CalibratorSamples, sequence: int) -> Notification:
        values = {"device_deg": np.round(turns.device_deg, 8), "laser_deg": np.round(turns.laser_deg, 8)}
        samples = BridgeSamples(
            sequence=sequence,
            t0_s=float(turns.time_s[0]),
            dt_s=1.0 / self.reader.spec.sample_hz,
            values=values,
            valid=turns.beam,
            events=self._events(turns),
        )
        return Notification(SAMPLES, samples.as_object())

    def _events(self, turns: CalibratorSamples) -> tuple[Event, ...]:
        before, self._beam = self._beam, bool(turns.beam[-1])
        if turns.beam.all():
            return () if before else (Event("datum", float(turns.time_s[0])),)
        lost_at = float(turns.time_s[int(np.argmin(turns.beam))])
        return (Event("beam_obstructed", lost_at),) if before else ()


# A straightness or angle instrument has one channel, or one for each probe of its head.

SENSOR_CHANNELS = {"straightness": "deviation_um", "angle": "angle_arcsec"}


class SensorServer(BridgeServer):
    """Serves one instrument to one client; it samples only while it streams."""

    def __init__(
        self,
        sensor: SensorReader | HeadReader,
        bench: OpticsBench,
        clock: Clock,
        block_s: float,
        around: WireWrapper | None = None,
    ) -> None:
        super().__init__(cast(Any, sensor), bench, clock, block_s, around)
        self.sensor = sensor
        spec = sensor.spec
        unit = SENSOR_CHANNELS[spec.kind].rpartition("_")[2]
        self._channels = tuple(f"{one.lower()}_{unit}" for one in spec.probes) or (SENSOR_CHANNELS[spec.kind],)
        self._wanted = asyncio.Event()

    def _answers(self) -> Mapping[str, Answer]:
        known = super()._answers()
        return {name: known[name] for name in (IDENTIFY, START, STOP, DATUM, ENVIRONMENT, OPTICS)}

    async def _identify(self, _params: Mapping[str, Any]) -> Any:
        spec = self.sensor.spec
        notices = ("simulated instrument: its readings are computed from the cell's truth",)
        return BridgeIdentity(
            kind=spec.kind,
            maker="trueflank",
            model=spec.model,
            serial=self.serial,
            firmware="1.0",
            channels=self._channels,
            sample_rate_hz=spec.sample_hz,
            notices=notices,
            framings=(JSON, BINARY),
        ).as_object()

    async def _start(self, params: Mapping[str, Any]) -> Any:
        if not self._wanted.is_set():
            self.sensor.skip_to(self._clock.now())
        answer = await super()._start(params)
        self._wanted.set()
        return answer

    async def _datum(self, params: Mapping[str, Any]) -> Any:
        if not self._wanted.is_set():
            self.sensor.skip_to(self._clock.now() - self._block_s)
        return await super()._datum(params)

    async def _optics(self, _params: Mapping[str, Any]) -> Any:
        return {"kind": self.sensor.reported_optics(self._bench.mounted(self.sensor.spec.name))}

    async def _produce(self) -> None:
        while True:
            await self._wanted.wait()
            await self._clock.sleep(self._block_s)
            if self._sequence is None or self._peer is None:
                self._wanted.clear()
            else:
                await self._pump()

    def _told(self, turns: Any, sequence: int) -> list[BridgeMessage]:
        """The samples as one line, or as a frame for each stretch with or without light."""
        readings = cast(SensorReadings, turns)
        step, values = 1.0 / self.sensor.spec.sample_hz, self._columns(readings)
        if self._framing == JSON:
            return [self._line(readings, sequence, step)]
        events = self._events(turns)
        told: list[BridgeMessage] = [Notification(EVENTS, events_as_object(events))] if events else []
        edges = [0, *(np.flatnonzero(np.diff(readings.beam)) + 1).tolist(), len(values)]
        for start, end in pairwise(edges):
            at_s, valid = float(readings.time_s[start]), bool(readings.beam[start])
            told.append(SampleFrame(sequence + start, at_s, step, values[start:end], valid=valid))
        return told

    def _columns(self, readings: SensorReadings) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Values (n, channels) as they are sent."""
        return np.round(readings.value, 6).reshape(len(readings.time_s), len(self._channels))

    def _line(self, readings: SensorReadings, sequence: int, step: float) -> Notification:
        values = dict(zip(self._channels, self._columns(readings).T, strict=True))
        events = self._events(cast(Any, readings))
        samples = BridgeSamples(
            sequence=sequence,
            t0_s=float(readings.time_s[0]),
            dt_s=step,
            values=values,
            valid=readings.beam,
            events=events,
        )
        return Notification(SAMPLES, samples.as_object())
