"""Plays a trace to its driver in virtual time: the same bytes at the same moments, and what becomes of them."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import aclosing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import Clock, LoopClock, run_virtual
from drivers.errors import ConfigError, DeadlineExceeded, FileFormatError, TransportError, TrueflankError
from drivers.local.scrub import HIDDEN
from drivers.message import Message
from drivers.ports.instruments import Instrument
from drivers.replay.recorder import Record, Trace, read_trace
from drivers.transport import ByteTransport, listen_memory
from drivers.types.identity import Identity
from drivers.types.sensing import Ambient, SampleBlock
from drivers.types.values import FloatArray

Factory = Callable[[str, str, Mapping[str, Any], Clock], Instrument]
OPEN_S = 3600.0
ASK_S = 2.0
MOST_EVENTS = 1000
_ID = re.compile(rb'"id"\s*:\s*(\d{1,18})')
_METHOD = re.compile(rb'"method"\s*:\s*"([^"]*)"')


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """What a driver made of a session. ``lowest`` and ``highest`` by channel; ``ended`` how its stream ended.

    ``events`` the first thousand of ``event_count``; ``spans`` (first, last) instrument time in s.
    """

    session: int
    sessions: int
    identity: Identity | None
    channels: tuple[str, ...]
    samples: int
    lost: int
    invalid: int
    gaps: int
    span_s: tuple[float, float]
    lowest: tuple[float, ...]
    highest: tuple[float, ...]
    events: tuple[Message, ...]
    event_count: int
    ambient: Ambient
    ended: TrueflankError | None


class Player:
    """Role "replay": reads a trace with the files it was continued from."""

    def __init__(self, path: Path) -> None:
        """Raises FileFormatError (E-REPLAY-FILE)."""
        self._path = path
        self.trace: Trace = read_trace(_pieces(path), str(path))
        self.sessions = self.trace.sessions()

    @property
    def driver(self) -> str:
        """The driver it was recorded with; "" where it does not say."""
        return str(self.trace.about.get("driver", ""))

    @property
    def settings(self) -> dict[str, Any]:
        """The settings it was recorded with, but for those that were hidden."""
        found = self.trace.about.get("settings")
        return {key: value for key, value in found.items() if value != HIDDEN} if isinstance(found, dict) else {}

    def play(
        self,
        factory: Factory,
        settings: Mapping[str, Any],
        session: int = 1,
        hear: Callable[[SampleBlock], None] = lambda _block: None,
    ) -> ReplayResult:
        """Play one session (from 1); ``hear`` gets every block. Raises ConfigError (E-REPLAY-SESSION)."""
        if not 1 <= session <= len(self.sessions):
            raise ConfigError("E-REPLAY-SESSION", str(self._path), session=session, count=len(self.sessions))
        records = self.sessions[session - 1]
        return run_virtual(lambda: _play(records, factory, settings, (session, len(self.sessions)), hear))


def _pieces(path: Path) -> list[bytes]:
    """The oldest file first."""
    older = [path.with_name(f"{path.name}.{number}") for number in range(99, 0, -1)]
    try:
        return [file.read_bytes() for file in (*older, path) if file == path or file.exists()]
    except OSError as error:
        raise FileFormatError("E-REPLAY-FILE", str(path), line=0, why=str(error)) from error


class _ReplayedDevice:
    """Stands where the device stood: says what it said then, when it said it, to the questions it was asked."""

    def __init__(self, records: tuple[Record, ...], clock: Clock) -> None:
        self._records = records
        self._clock = clock
        self._asked: deque[bytes] = deque()
        self._news = asyncio.Event()
        self._renumbered: dict[bytes, bytes] = {}

    async def converse(self, wire: ByteTransport) -> None:
        """One conversation, then the wire is cut."""
        listener = asyncio.get_running_loop().create_task(self._listen(wire))
        try:
            begun, first = self._clock.now(), self._records[0].at_s
            for record in self._records:
                await self._clock.sleep(max(begun + record.at_s - first - self._clock.now(), 0.0))
                if record.direction == "<":
                    await wire.write(self._said(record.data))
                else:
                    await self._await_question(record.data)
        finally:
            listener.cancel()
            await asyncio.gather(listener, return_exceptions=True)

    async def _listen(self, wire: ByteTransport) -> None:
        rest = b""
        with contextlib.suppress(TransportError):
            while True:
                *lines, rest = (rest + await wire.read(65536)).split(b"\n")
                self._asked.extend(lines)
                self._news.set()

    async def _await_question(self, data: bytes) -> None:
        """Each question of the record, or none where this time it is not asked."""
        for line in data.splitlines():
            number, method = _ID.search(line), _METHOD.search(line)
            asked = await self._next_question(method.group(1) if method else b"")
            if number is not None:
                now = _ID.search(asked) if asked is not None else None
                self._renumbered[number.group(1)] = now.group(1) if now else b""

    async def _next_question(self, method: bytes) -> bytes | None:
        with contextlib.suppress(DeadlineExceeded):
            async with self._clock.deadline(ASK_S, "replay"):
                while not self._asked:
                    self._news.clear()
                    await self._news.wait()
        if not self._asked:
            return None
        found = _METHOD.search(self._asked[0])
        return self._asked.popleft() if (found.group(1) if found else b"") == method else None

    def _said(self, data: bytes) -> bytes:
        """With the numbers of this time's questions, without answers to questions not asked this time."""
        for then, now in self._renumbered.items():
            if not now:
                answer = re.compile(rb'(?m)^\{[^\n]*"id"\s*:\s*%s\b[^\n]*\n' % then)
                data = answer.sub(b"", data)
        numbers = {then: now for then, now in self._renumbered.items() if now and now != then}
        if not numbers:
            return data
        return _ID.sub(lambda found: b'"id":' + numbers.get(found.group(1), found.group(1)), data)


class _Tally:
    """Counts while blocks pass; nothing else of them is kept."""

    def __init__(self) -> None:
        self.samples = self.lost = self.invalid = self.gaps = self.event_count = 0
        self.span_s = (float("nan"), float("nan"))
        self.lowest: FloatArray | None = None
        self.highest: FloatArray | None = None
        self.events: list[Message] = []

    def take(self, block: SampleBlock) -> None:
        """The next block."""
        self.lost += block.lost
        self.gaps += block.lost > 0
        self.event_count += len(block.events)
        self.events += block.events[: MOST_EVENTS - len(self.events)]
        if not len(block):
            return
        first = self.span_s[0] if self.samples else float(block.time_s[0])
        self.span_s = (first, float(block.time_s[-1]))
        self.samples += len(block)
        self.invalid += int(np.count_nonzero(~block.valid))
        low, high = block.values.min(axis=0), block.values.max(axis=0)
        self.lowest = low if self.lowest is None else np.minimum(self.lowest, low)
        self.highest = high if self.highest is None else np.maximum(self.highest, high)


async def _play(
    records: tuple[Record, ...],
    factory: Factory,
    settings: Mapping[str, Any],
    which: tuple[int, int],
    hear: Callable[[SampleBlock], None],
) -> ReplayResult:
    clock = LoopClock()
    listener = listen_memory("replay", _ReplayedDevice(records, clock).converse)
    device = factory("replay", listener.url, settings, clock)
    tally = _Tally()
    identity: Identity | None = None
    ambient, ended = Ambient(), None
    try:
        identity = await device.open(OPEN_S)
        async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
            async for block in stream:
                tally.take(block)
                hear(block)
    except TrueflankError as error:
        ended = error
    finally:
        if identity is not None and identity.driver == "umd":
            ambient = await device.ambient()  # kept in the driver; others would have to be asked
        await device.close()
        await listener.close()
    return ReplayResult(
        session=which[0],
        sessions=which[1],
        identity=identity,
        channels=device.channels,
        samples=tally.samples,
        lost=tally.lost,
        invalid=tally.invalid,
        gaps=tally.gaps,
        span_s=tally.span_s,
        lowest=tuple(tally.lowest.tolist()) if tally.lowest is not None else (),
        highest=tuple(tally.highest.tolist()) if tally.highest is not None else (),
        events=tuple(tally.events),
        event_count=tally.event_count,
        ambient=ambient,
        ended=ended,
    )
