"""A straightness or angle instrument behind a bridge: one channel, streamed while a client wants it."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, cast

import numpy as np

from drivers.bridge.codec import Message, Notification
from drivers.bridge.frames import SampleFrame
from drivers.bridge.records import (
    BINARY,
    DATUM,
    ENVIRONMENT,
    EVENTS,
    IDENTIFY,
    JSON,
    OPTICS,
    SAMPLES,
    START,
    STOP,
    BridgeIdentity,
    BridgeSamples,
    events_as_object,
)
from drivers.clock import Clock
from simulators.bridge import Answer, BridgeAnswerer
from simulators.instrument_wire import Around
from simulators.optics import OpticsBench, SensorReader, SensorReadings

CHANNELS = {"straightness": "deviation_um", "angle": "angle_arcsec"}


class SensorAnswerer(BridgeAnswerer):
    """Serves one instrument to one client; it samples only while it streams."""

    def __init__(
        self, sensor: SensorReader, bench: OpticsBench, clock: Clock, block_s: float, around: Around | None = None
    ) -> None:
        super().__init__(cast(Any, sensor), bench, clock, block_s, around)
        self.sensor = sensor
        self._channel = CHANNELS[sensor.spec.kind]
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
            channels=(self._channel,),
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
        return {"kind": self.sensor.told(self._bench.mounted(self.sensor.spec.name))}

    async def _produce(self) -> None:
        while True:
            await self._wanted.wait()
            await self._clock.sleep(self._block_s)
            if self._sequence is None or self._peer is None:
                self._wanted.clear()
            else:
                await self._pump()

    def _told(self, turns: Any, sequence: int) -> list[Message]:
        """The samples as one line, or as a frame for each stretch with or without light."""
        readings = cast(SensorReadings, turns)
        step, values = 1.0 / self.sensor.spec.sample_hz, np.round(readings.value, 6)
        if self._framing == JSON:
            return [self._line(readings, sequence, step)]
        events = self._events(turns)
        told: list[Message] = [Notification(EVENTS, events_as_object(events))] if events else []
        edges = [0, *(np.flatnonzero(np.diff(readings.beam)) + 1).tolist(), len(values)]
        for start, end in pairwise(edges):
            at_s, valid = float(readings.time_s[start]), bool(readings.beam[start])
            told.append(SampleFrame(sequence + start, at_s, step, values[start:end, None], valid=valid))
        return told

    def _line(self, readings: SensorReadings, sequence: int, step: float) -> Notification:
        values = {self._channel: np.round(readings.value, 6)}
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
