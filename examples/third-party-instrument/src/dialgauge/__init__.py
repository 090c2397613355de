"""A digital dial gauge as an instrument: asked for its reading at a steady rate; the protocol is an invented one."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dialgauge.settings import DialSettings
from drivers.clock import Clock
from drivers.errors import RemoteProtocolError, TransportError
from drivers.link import Link, Trace
from drivers.transport import open_transport
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor

# One answer: the gauge's number and its reading in mm. Anything else is no reading.
ANSWER = re.compile(rb"(DG-[0-9]+) ([+-][0-9]+\.[0-9]{4})\Z")
BLOCK = 5


@dataclass(frozen=True, slots=True)
class Reading:
    """An answer: who, and where the spindle stands in mm; ``raw`` alone where it was no answer."""

    raw: bytes
    serial: str = ""
    value_mm: float = 0.0


class DialCodec:
    """Bytes to readings and back, whatever way they were cut on the road."""

    def __init__(self) -> None:
        self._rest = b""

    def send(self, question: bytes) -> bytes:
        """A question is its bytes."""
        return question

    def receive(self, data: bytes) -> list[Reading]:
        """The answers these bytes complete; never raises."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-256:]
        return [self._reading(line.strip()) for line in lines if line.strip()]

    @staticmethod
    def _reading(line: bytes) -> Reading:
        found = ANSWER.match(line)
        if found is None:
            return Reading(line[:80])
        return Reading(line, found.group(1).decode(), float(found.group(2)))


class DialGauge:
    """Driver "dialgauge"."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self.trace: Trace | None = None
        self._url = url
        self._clock = clock
        self._settings = DialSettings.read(settings, name)
        self._link: Link[bytes, Reading] | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """One reading in mm."""
        return ("displacement_mm",)

    @property
    def compensated_for(self) -> CompensatedFor:
        """A mechanical length needs no correction for air."""
        return "air"

    @property
    def notices(self) -> tuple[str, ...]:
        """Printed in every report."""
        return ("a dial gauge touches: its times are those of this computer",)

    async def open(self, timeout_s: float) -> Identity:
        """Connect and ask once, to know who is there."""
        await self.close()
        wire = await open_transport(self._url, self._clock, timeout_s, baudrate=self._settings.baudrate)
        self._link = Link(self.name, wire, DialCodec(), self._clock, is_answer=lambda _message: True, trace=self.trace)
        try:
            reading = await self._ask()
        except BaseException:
            await self.close()
            raise
        return Identity("dialgauge", "dial gauge", reading.serial, notes=self.notices)

    async def _ask(self) -> Reading:
        if self._link is None:
            raise TransportError("E-LINK-CLOSED", self.name, why="this end is closed")
        reading = await self._link.exchange(b"?\n", self._settings.timeout_s)
        if not reading.serial:
            error = RemoteProtocolError("E-LINK-STRAY", self.name, answer=repr(reading.raw), question="?")
            self._link.fail(error)
            raise error
        return reading

    async def close(self) -> None:
        """Let go of the wire; never raises."""
        link, self._link = self._link, None
        if link is not None:
            await link.close()

    async def optics(self) -> Optics:
        """There are none."""
        return Optics()

    async def ambient(self) -> Ambient:
        """It has no sensors."""
        return Ambient()

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        """Ask at the settings' rate; a slow answer is not caught up with."""
        while True:
            times, values = [], []
            for _ in range(BLOCK):
                await self._clock.sleep(1.0 / self._settings.rate_hz)
                values.append((await self._ask()).value_mm)
                times.append(self._clock.now())
            column = np.array(values)[:, None]
            yield SampleBlock(self.channels, np.array(times), column, np.ones(BLOCK, np.bool_))
