"""A person as an instrument: asked for one reading at a time, each kept with who typed it and when."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, replace
from getpass import getuser
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import TransportError, catalogue, words
from drivers.link import Trace
from drivers.manual.entry import FAR, EntryRefused, ExpectedReading, read_entry
from drivers.manual.person import DeskMaker, TypingDesk, open_desk
from drivers.manual.settings import ManualSettings
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor

TURN_S = 0.01
_AIR = ("air_degc", "pressure_hpa", "humidity_pct")


@dataclass(frozen=True, slots=True)
class Typed:
    """One reading: what it is of, the text as typed, its value in the channel's unit, who and when (UTC)."""

    label: str
    text: str
    value: float
    who: str
    utc: str
    insisted: bool = False

    def __str__(self) -> str:
        far = ", typed twice because it lay outside the limits" if self.insisted else ""
        return f"typed {self.text!r} for {self.label or 'the next reading'} by {self.who} at {self.utc}{far}"


class ManualEntry:
    """Driver "manual": url ``terminal://`` or ``folder:///path``; one channel."""

    def __init__(
        self, name: str, url: str, settings: Mapping[str, Any], clock: Clock, desk: DeskMaker = open_desk
    ) -> None:
        self.name = name
        self.trace: Trace | None = None
        self._url = url
        self._clock = clock
        self._settings = ManualSettings.read(settings, name)
        self._ambient = _typed_ambient(self._settings)
        self._make_desk = desk
        self._desk: TypingDesk | None = None
        self._expected = ExpectedReading()
        self._time_s = 0.0
        self.typed: tuple[Typed, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """The one channel of the settings."""
        return (self._settings.channel,)

    @property
    def compensated_for(self) -> CompensatedFor:
        """Nothing is known of where a typed number comes from."""
        return "nothing"

    @property
    def notices(self) -> tuple[str, ...]:
        """That these numbers were typed."""
        return (catalogue()["N-MANUAL-TYPED"]["what"],)

    async def open(self, timeout_s: float) -> Identity:  # noqa: ARG002 - a person is there or is not
        """Get ready to ask. Raises ConfigError (E-LINK-URL, E-MANUAL-FOLDER)."""
        await self.close()
        self._desk = self._make_desk(self._url, self._clock, self.name)
        return Identity("manual", "typed readings", self._url, notes=self.notices)

    async def close(self) -> None:
        """Ask no more; never raises."""
        desk, self._desk = self._desk, None
        if desk is not None:
            await desk.close()

    def expect(self, label: str, value: float, limit: float) -> None:
        """The next reading is of ``label`` and lies within ``limit`` of ``value``, else it is asked for again."""
        self._expected = ExpectedReading(label, value, limit)

    async def optics(self) -> Optics:
        """Unknown."""
        return Optics()

    async def ambient(self) -> Ambient:
        """The environment typed into the site file; None where nothing was."""
        return self._ambient

    async def blocks(self) -> AsyncIterator[SampleBlock]:
        """One block for each typed reading, its value held for ``hold_s``. Raises TransportError (E-LINK-CLOSED)."""
        while True:
            typed = await self._reading()
            self.typed = (*self.typed, typed)
            for block in self._halves(typed):
                yield block
                # Who waits for a stop to settle needs a first sign that samples come, and then the samples.
                await self._clock.sleep(TURN_S)

    def _halves(self, typed: Typed) -> tuple[SampleBlock, SampleBlock]:
        whole = self._block(typed)
        first, rest = (
            replace(whole, time_s=whole.time_s[part], values=whole.values[part], valid=whole.valid[part])
            for part in (slice(1), slice(1, None))
        )
        return first, replace(rest, events=())

    def _block(self, typed: Typed) -> SampleBlock:
        count = self._settings.samples
        self._time_s = max(self._time_s, self._clock.now())
        time_s = self._time_s + self._settings.hold_s / count * np.arange(1, count + 1, dtype=np.float64)
        self._time_s = float(time_s[-1])
        values = np.full((count, 1), typed.value, np.float64)
        return SampleBlock(self.channels, time_s, values, np.ones(count, np.bool_), events=(str(typed),))

    async def _reading(self) -> Typed:
        """Ask until a number comes that may be one; a value outside the limits must be typed twice."""
        expected, before, trouble = self._expected, "", ""
        while True:
            text = (await self._asked(expected, trouble)).strip()
            shown = replace(expected, value=expected.value * self._settings.scale)
            sure = bool(text) and text == before
            value = read_entry(text, self._settings.mark, shown, self._settings.unit, sure=sure)
            if not isinstance(value, EntryRefused):
                self._expected = ExpectedReading()
                utc = self._clock.utc().isoformat(timespec="seconds")
                who = self._settings.who or getuser()
                return Typed(
                    label=expected.label, text=text, value=self._settings.scale * value, who=who, utc=utc, insisted=sure
                )
            before = text if value.code == FAR else ""
            trouble = words(value.code, **value.fields)

    async def _asked(self, expected: ExpectedReading, trouble: str) -> str:
        if self._desk is None:
            raise TransportError("E-LINK-CLOSED", self.name, why="this end is closed")
        label = expected.label or f"reading {len(self.typed) + 1}"
        question = words("P-MANUAL-ASK", label=label, unit=self._settings.unit, mark=self._settings.decimal)
        return await self._desk.ask(f"{trouble}\n{question}" if trouble else question)


def _typed_ambient(settings: ManualSettings) -> Ambient:
    """The typed surroundings, judged when the settings were read."""

    def number(text: str) -> float:
        return float(text.strip().replace(",", "."))

    air, pressure, humidity = (number(text) if (text := getattr(settings, key)) else None for key in _AIR)
    material = tuple(number(text) for text in settings.material_degc.split(";") if text)
    return Ambient(air, pressure, humidity, material)
