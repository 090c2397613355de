"""A person as an instrument: asked for one reading at a time on a terminal or through a folder of small files."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from getpass import getuser
from pathlib import Path
from typing import Any, Protocol, TextIO

import numpy as np

from drivers.clock import Clock
from drivers.errors import ConfigError, TransportError, catalogue, words
from drivers.link import Trace
from drivers.local.names import visible
from drivers.manual.settings import FAR, EntryRefused, ExpectedReading, ManualSettings, read_entry
from drivers.message import Message
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, Optics, SampleBlock
from drivers.types.values import CompensatedFor

# Where a person is asked: on the terminal, or through a folder of small files that another program shows.

POLL_S = 0.2


class ReadingPrompt(Protocol):
    """One person, asked one thing at a time."""

    async def ask(self, question: str) -> str:
        """The answer as typed; raises TransportError (E-LINK-CLOSED) when nobody can answer any more."""
        ...

    async def close(self) -> None:
        """Ask no more."""
        ...


class TerminalPrompt:
    """Asks on a terminal; reading it waits in a thread of its own, which a closed terminal ends."""

    def __init__(self, where: str, reads: TextIO | None = None, writes: TextIO | None = None) -> None:
        self._where = where
        self._reads = reads or sys.stdin
        self._writes = writes or sys.stderr

    async def ask(self, question: str) -> str:
        """Print the question and wait for a line."""
        self._writes.write(f"{visible(question)} ")
        self._writes.flush()
        line = await asyncio.get_running_loop().run_in_executor(None, self._reads.readline)
        if not line:
            raise TransportError("E-LINK-CLOSED", self._where, why=Message.of("W-MANUAL-CLOSED"))
        return line

    async def close(self) -> None:
        """Nothing is held between questions."""


class FolderPrompt:
    """Asks by ``question.txt`` and takes the answer from ``answer.txt``, which it then removes.

    An answer counts only if it ends with a line end, so one that is still being written is waited for.
    """

    def __init__(self, folder: Path, clock: Clock, where: str) -> None:
        self._question = folder / "question.txt"
        self._answer = folder / "answer.txt"
        self._clock = clock
        self._where = where
        if not folder.is_dir():
            raise ConfigError("E-MANUAL-FOLDER", where, folder=str(folder))

    async def ask(self, question: str) -> str:
        """Write the question, wait for the answer."""
        with _as_transport(self._where):
            self._answer.unlink(missing_ok=True)
            self._question.write_text(question + "\n", encoding="utf-8")
        while True:
            with _as_transport(self._where):
                text = self._answer.read_text(encoding="utf-8", errors="replace") if self._answer.exists() else ""
                if text.endswith("\n"):
                    self._answer.unlink()
                    self._question.unlink(missing_ok=True)
                    return text
            await self._clock.sleep(POLL_S)

    async def close(self) -> None:
        """Take the question back."""
        with contextlib.suppress(OSError):
            self._question.unlink(missing_ok=True)


@contextlib.contextmanager
def _as_transport(where: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise TransportError("E-LINK-CLOSED", where, why=str(error)) from error


class QueuePrompt:
    """Asks inside this program: a page or a test puts the answers in."""

    def __init__(self) -> None:
        self.questions: asyncio.Queue[str] = asyncio.Queue()
        self.answers: asyncio.Queue[str] = asyncio.Queue()

    async def ask(self, question: str) -> str:
        """Hand the question out and wait for an answer."""
        self.questions.put_nowait(question)
        return await self.answers.get()

    async def close(self) -> None:
        """Nothing is held."""


PromptFactory = Callable[[str, Clock, str], ReadingPrompt]


def open_prompt(url: str, clock: Clock, where: str) -> ReadingPrompt:
    """``terminal://`` or ``folder:///path``. Raises ConfigError (E-LINK-URL, E-MANUAL-FOLDER)."""
    scheme, mark, rest = url.partition("://")
    if mark and scheme == "terminal" and not rest:
        return TerminalPrompt(where)
    if mark and scheme == "folder" and rest:
        return FolderPrompt(Path(rest), clock, where)
    raise ConfigError("E-LINK-URL", url, why=Message.of("W-MANUAL-WIRE"))


TURN_S = 0.01
_AIR = ("air_degc", "pressure_hpa", "humidity_pct")


@dataclass(frozen=True, slots=True)
class TypedReading:
    """One reading: what it is of, the text as typed, its value in the channel's unit, who and when (UTC)."""

    label: str
    text: str
    value: float
    who: str
    utc: str
    insisted: bool = False

    @property
    def message(self) -> Message:
        """The reading as a message: what was typed, for what, by whom and when."""
        label = self.label or Message.of("W-MANUAL-NEXT")
        code = "W-MANUAL-TYPED-TWICE" if self.insisted else "W-MANUAL-TYPED"
        return Message.of(code, text=self.text, label=label, who=self.who, utc=self.utc)


class ManualEntry:
    """Driver "manual": url ``terminal://`` or ``folder:///path``; one channel."""

    def __init__(
        self, name: str, url: str, settings: Mapping[str, Any], clock: Clock, desk: PromptFactory = open_prompt
    ) -> None:
        self.name = name
        self.trace: Trace | None = None
        self._url = url
        self._clock = clock
        self._settings = ManualSettings.read(settings, name)
        self._ambient = _typed_ambient(self._settings)
        self._make_desk = desk
        self._desk: ReadingPrompt | None = None
        self._expected = ExpectedReading()
        self._time_s = 0.0
        self.typed: tuple[TypedReading, ...] = ()

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

    def _halves(self, typed: TypedReading) -> tuple[SampleBlock, SampleBlock]:
        whole = self._block(typed)
        first, rest = (
            replace(whole, time_s=whole.time_s[part], values=whole.values[part], valid=whole.valid[part])
            for part in (slice(1), slice(1, None))
        )
        return first, replace(rest, events=())

    def _block(self, typed: TypedReading) -> SampleBlock:
        count = self._settings.samples
        self._time_s = max(self._time_s, self._clock.now())
        time_s = self._time_s + self._settings.hold_s / count * np.arange(1, count + 1, dtype=np.float64)
        self._time_s = float(time_s[-1])
        values = np.full((count, 1), typed.value, np.float64)
        return SampleBlock(self.channels, time_s, values, np.ones(count, np.bool_), events=(typed.message,))

    async def _reading(self) -> TypedReading:
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
                return TypedReading(
                    label=expected.label, text=text, value=self._settings.scale * value, who=who, utc=utc, insisted=sure
                )
            before = text if value.code == FAR else ""
            trouble = words(value.code, **value.fields)

    async def _asked(self, expected: ExpectedReading, trouble: str) -> str:
        if self._desk is None:
            raise TransportError("E-LINK-CLOSED", self.name, why=Message.of("W-LINK-CLOSED"))
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
