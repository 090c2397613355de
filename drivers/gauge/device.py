"""A gauge as an instrument: its display is asked for one reading after another, each stamped on its way."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceRefused, RemoteProtocolError, TransportError, UnsupportedDevice, catalogue
from drivers.gauge.codec import DamagedLine, GaugeAnswer, GaugeAsk, GaugeCodec, GaugeError, GaugeReading
from drivers.gauge.settings import GaugeSettings
from drivers.link import Link, Trace
from drivers.message import Message, digits, words
from drivers.transport import hardware_of, open_transport
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor
from drivers.units import MM_PER_INCH

UM_OF = {"mm": 1000.0, "inch": 1000.0 * MM_PER_INCH, "um": 1.0}
STEP_SLACK = 1e-3  # of a step: decimal digits in binary


@dataclass(frozen=True, slots=True)
class _Sample:
    time_s: float
    value: float
    error: int


class QueriedGauge:
    """Driver "gauge": a dial gauge or probe whose display answers a question; url COM5, /dev/ttyUSB0, usb://SERIAL."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self.trace: Trace | None = None
        self._url = url
        self._clock = clock
        self._settings = GaugeSettings.read(settings, name)
        self._link: Link[GaugeAsk, GaugeAnswer] | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """The one channel of the settings, in the unit that ends its name."""
        return (self._settings.channel,)

    @property
    def compensated_for(self) -> CompensatedFor:
        """Nothing: what a touching gauge reads is no optical path."""
        return "nothing"

    @property
    def notices(self) -> tuple[str, ...]:
        """That times are this computer's."""
        return (catalogue()["N-GAUGE-CLOCK"]["what"],)

    async def open(self, timeout_s: float) -> Identity:
        """Connect and take one reading, which must be one: of this unit and resolution.

        Raises what `open_transport` raises; DeadlineExceeded; DeviceRefused (E-GAUGE-ERROR); UnsupportedDevice
        (E-GAUGE-UNIT, E-GAUGE-RESOLUTION); RemoteProtocolError (E-GAUGE-ANSWER).
        """
        await self.close()
        told = self._settings
        async with self._clock.deadline(timeout_s, self.name):
            wire = await open_transport(
                self._url, self._clock, timeout_s, baudrate=told.baudrate, parity=told.parity,
                data_bits=told.data_bits, stop_bits=told.stop_bits,
            )  # fmt: skip
            self._link = Link(
                self.name,
                wire,
                GaugeCodec(),
                self._clock,
                is_answer=lambda _message: True,
                matches=lambda _ask, _answer: True,
                trace=self.trace,
            )
            try:
                first = await self._asked()
                if isinstance(first, GaugeError):
                    raise DeviceRefused("E-GAUGE-ERROR", self.name, number=first.number, question=told.question)
                self._value(first)
            except BaseException:
                await self.close()
                raise
        serial = hardware_of(wire) or self._url
        return Identity("gauge", words("W-GAUGE-KIND"), serial, notes=self.notices)

    async def close(self) -> None:
        """Let go of the wire; never raises."""
        link, self._link = self._link, None
        if link is not None:
            await link.close()

    async def optics(self) -> Optics:
        """Unknown: a gauge touches."""
        return Optics()

    async def ambient(self) -> Ambient:
        """No sensors."""
        return Ambient()

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        """Samples from now on; an error number of the display makes one invalid, and an event.

        Raises TransportError, DeadlineExceeded, RemoteProtocolError (E-GAUGE-ANSWER), UnsupportedDevice.
        """
        step = 1.0 / self._settings.poll_hz
        most = max(round(self._settings.block_s * self._settings.poll_hz), 1)
        due, before = self._clock.now(), 0
        while True:
            samples: list[_Sample] = []
            while len(samples) < most:
                await self._clock.sleep(max(due - self._clock.now(), 0.0))
                samples.append(await self._sample())
                # A slow answer is not caught up with: the next question is due a step after it.
                due = max(due + step, self._clock.now())
            yield _block(samples, self.channels, before)
            before = samples[-1].error

    async def _sample(self) -> _Sample:
        asked = self._clock.now()
        answer = await self._asked()
        at = 0.5 * (asked + self._clock.now())
        if isinstance(answer, GaugeError):
            return _Sample(at, 0.0, answer.number)
        return _Sample(at, self._value(answer), 0)

    async def _asked(self) -> GaugeReading | GaugeError:
        """One answer. Raises TransportError, DeadlineExceeded, RemoteProtocolError (E-GAUGE-ANSWER)."""
        if self._link is None:
            raise TransportError("E-LINK-CLOSED", self.name, why=Message.of("W-LINK-CLOSED"))
        answer = await self._link.exchange(GaugeAsk(self._settings.question), self._settings.timeout_s)
        if isinstance(answer, DamagedLine):
            error = RemoteProtocolError("E-GAUGE-ANSWER", self.name, raw=repr(answer.raw))
            self._link.fail(error)
            raise error
        return answer

    def _value(self, read: GaugeReading) -> float:
        """A reading in the channel's unit and sense. Raises UnsupportedDevice (E-GAUGE-UNIT, E-GAUGE-RESOLUTION)."""
        told = self._settings
        unit = read.unit or told.unit
        if not unit or (told.unit and read.unit and read.unit != told.unit):
            raise UnsupportedDevice("E-GAUGE-UNIT", self.name, found=read.unit or "-", declared=told.unit or "-")
        um = read.value * UM_OF[unit]
        if told.resolution_um:
            steps = um / told.resolution_um
            if abs(steps - round(steps)) > STEP_SLACK * max(1.0, abs(steps) * STEP_SLACK):
                raise UnsupportedDevice(
                    "E-GAUGE-RESOLUTION",
                    self.name,
                    value=digits(read.value, 6),
                    unit=unit,
                    step=digits(told.resolution_um, 6),
                )
        return um * told.scale / (1000.0 if told.channel.endswith("_mm") else 1.0)


def _block(samples: list[_Sample], channels: tuple[str, ...], before: int) -> SampleBlock:
    errors = [before, *(one.error for one in samples)]
    events = tuple(Message.of("W-GAUGE-ERROR", now=now) for was, now in pairwise(errors) if now and now != was)
    return SampleBlock(
        channels,
        np.array([one.time_s for one in samples]),
        np.array([[one.value] for one in samples]),
        np.array([one.error == 0 for one in samples]),
        events=events,
    )
