"""An attocube IDS3010 as an instrument: asked for its displacement again and again, told as optical path."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from drivers.attocube.codec import Answer, Ask, AttocubeCodec, DamagedReply, Result
from drivers.attocube.settings import AttocubeSettings
from drivers.clock import Clock
from drivers.errors import DeviceRefused, RemoteProtocolError, TransportError, UnsupportedDevice, catalogue
from drivers.link import Link, Trace
from drivers.message import Message, digits
from drivers.transport import open_transport
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor

MM_PER_PM = 1e-9
CHANNELS = ("displacement_mm",)
ALL_AXES = -1
INDEX_EVERY_S = 10.0
LARGEST_INDEX = 1.01
SYSTEM, ECU, DISPLACEMENT = "com.attocube.system", "com.attocube.ecu", "com.attocube.ids.displacement"


@dataclass(frozen=True, slots=True)
class _Sample:
    time_s: float
    path_mm: float
    warning: int


class AttocubeIds:
    """Driver "attocube-ids": one axis of an IDS3010; url tcp://host:9090.

    The device's lengths hold the refractive index it was told; they are multiplied by it again, so that
    ``displacement_mm`` is the optical path in vacuum and the air is corrected in one place.
    """

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self.trace: Trace | None = None
        self._url = url
        self._clock = clock
        self._settings = AttocubeSettings.read(settings, name)
        self._link: Link[Ask, Answer] | None = None
        self._asked = 0
        self._index, self._index_at = 1.0, float("-inf")

    @property
    def channels(self) -> tuple[str, ...]:
        """("displacement_mm",): optical path in mm of vacuum, positive as the device counts."""
        return CHANNELS

    @property
    def compensated_for(self) -> CompensatedFor:
        """Nothing: the device's own index is taken out again."""
        return "nothing"

    @property
    def notices(self) -> tuple[str, ...]:
        """That times are the gateway's, because the device gives none."""
        return (catalogue()["N-IDS-CLOCK"]["what"],)

    async def open(self, timeout_s: float) -> Identity:
        """Connect, identify, and check that a measurement runs.

        Raises what `open_transport` raises; DeadlineExceeded; DeviceRefused (E-IDS-OFF, E-IDS-ERROR);
        UnsupportedDevice (E-IDS-INDEX); RemoteProtocolError (E-IDS-ANSWER).
        """
        await self.close()
        async with self._clock.deadline(timeout_s, self.name):
            wire = await open_transport(self._url, self._clock, timeout_s)
            self._link = Link(
                self.name,
                wire,
                AttocubeCodec(),
                self._clock,
                is_answer=lambda _message: True,
                matches=lambda ask, answer: isinstance(answer, DamagedReply) or answer.id == ask.id,
                trace=self.trace,
            )
            try:
                return await self._identified()
            except BaseException:
                await self.close()
                raise

    async def _identified(self) -> Identity:
        serial = await self._text(f"{SYSTEM}.getSerialNumber")
        firmware = await self._text(f"{SYSTEM}.getFirmwareVersion")
        if not (await self._call(f"{DISPLACEMENT}.getMeasurementEnabled"))[-1]:
            raise DeviceRefused("E-IDS-OFF", self.name)
        await self._refresh_index()
        return Identity(
            driver="attocube-ids", model="attocube IDS3010", serial=serial, firmware=firmware, notes=self.notices
        )

    async def _refresh_index(self) -> None:
        """The index the device's lengths hold; asked again every few seconds, because it may follow sensors."""
        if self._settings.refractive_index:
            self._index, self._index_at = self._settings.refractive_index, float("inf")
        if self._clock.now() - self._index_at < INDEX_EVERY_S:
            return
        try:
            found = await self._numbers(f"{ECU}.getRefractiveIndexForCompensation", 1, ALL_AXES)
        except DeviceRefused as error:
            raise UnsupportedDevice("E-IDS-INDEX", self.name, said=error.fields.get("said")) from error
        if not 1.0 <= found[0] < LARGEST_INDEX:
            raise UnsupportedDevice("E-IDS-INDEX", self.name, said=digits(found[0], 6))
        self._index, self._index_at = found[0], self._clock.now()

    async def _call(self, method: str, *params: int) -> tuple[object, ...]:
        """The items of the result, its error number first. Raises DeviceRefused (E-IDS-ERROR)."""
        if self._link is None:
            raise TransportError("E-LINK-CLOSED", self.name, why=Message.of("W-LINK-CLOSED"))
        self._asked += 1
        answer = await self._link.exchange(Ask(self._asked, method, params), self._settings.timeout_s)
        if isinstance(answer, Result) and not answer.error:
            return answer.items
        if isinstance(answer, DamagedReply):
            error = RemoteProtocolError("E-IDS-ANSWER", self.name, method=method, why=answer.why, raw=repr(answer.raw))
            self._link.fail(error)
            raise error
        raise DeviceRefused("E-IDS-ERROR", self.name, method=method, said=answer.error)

    async def _text(self, method: str) -> str:
        """The last item: older firmware leaves the error number out where a text is answered."""
        return str((await self._call(method))[-1])

    async def _numbers(self, method: str, count: int, *params: int) -> tuple[float, ...]:
        """``count`` numbers after an error number that must be 0."""
        number, values = await self._measured(method, count, *params)
        if number:
            raise DeviceRefused("E-IDS-ERROR", self.name, method=method, said=f"error {number}")
        return values

    async def _measured(self, method: str, count: int, *params: int) -> tuple[int, tuple[float, ...]]:
        """Error or warning number and ``count`` numbers. Raises RemoteProtocolError (E-IDS-ANSWER)."""
        items = await self._call(method, *params)
        if len(items) != count + 1 or not all(type(item) in (int, float) for item in items):
            why = Message.of("W-ATTO-NUMBERS", count=count + 1)
            raise RemoteProtocolError("E-IDS-ANSWER", self.name, method=method, why=why, raw=repr(items))
        number, *values = (float(item) for item in items if isinstance(item, int | float))
        if not np.isfinite([number, *values]).all():
            raise RemoteProtocolError("E-IDS-ANSWER", self.name, method=method, why="not finite", raw=repr(items))
        return int(number), tuple(values)

    async def close(self) -> None:
        """Let go of the wire; never raises."""
        link, self._link = self._link, None
        self._index_at = float("-inf")
        if link is not None:
            await link.close()

    async def optics(self) -> Optics:
        """Unknown: fibre heads do not say what they look at."""
        return Optics()

    async def ambient(self) -> Ambient:
        """Readings of the environment unit; empty where none is connected."""
        try:
            if not (await self._call(f"{ECU}.getConnected"))[-1]:
                return Ambient()
            air = (await self._numbers(f"{ECU}.getTemperatureInDegrees", 1))[0]
            pressure = (await self._numbers(f"{ECU}.getPressureInHPa", 1))[0]
            humidity = (await self._numbers(f"{ECU}.getHumidityInPercent", 1))[0]
        except DeviceRefused:
            return Ambient()
        return Ambient(air, pressure, humidity)

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        """Samples from now on; a warning number of the device makes them invalid and an event.

        Raises TransportError, DeadlineExceeded, RemoteProtocolError (E-IDS-ANSWER), DeviceRefused (E-IDS-ERROR).
        """
        step = 1.0 / self._settings.poll_hz
        most = max(round(self._settings.block_s * self._settings.poll_hz), 1)
        due = self._clock.now()
        before = 0
        while True:
            await self._refresh_index()
            samples: list[_Sample] = []
            while len(samples) < most:
                await self._clock.sleep(max(due - self._clock.now(), 0.0))
                samples.append(await self._sample())
                # A slow answer is not caught up with: the next sample is due a step after it.
                due = max(due + step, self._clock.now())
            yield _block(samples, before)
            before = samples[-1].warning

    async def _sample(self) -> _Sample:
        asked = self._clock.now()
        number, values = await self._measured(f"{DISPLACEMENT}.getAxesDisplacement", 3)
        path_mm = values[self._settings.axis - 1] * MM_PER_PM * self._index
        return _Sample(0.5 * (asked + self._clock.now()), path_mm, number)


def _block(samples: list[_Sample], before: int) -> SampleBlock:
    warnings = [before, *(sample.warning for sample in samples)]
    changed = [now for was, now in pairwise(warnings) if now and now != was]
    return SampleBlock(
        CHANNELS,
        np.array([sample.time_s for sample in samples]),
        np.array([[sample.path_mm] for sample in samples]),
        np.array([sample.warning == 0 for sample in samples]),
        events=tuple(Message.of("W-ATTO-WARNING", number=number) for number in changed),
    )
