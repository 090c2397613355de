"""Readings: an instrument's stream as settled averages, counted in instrument time, never wall time."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from drivers.clock import Clock
from drivers.errors import BeamObstructed, DeadlineExceeded, TrueflankError
from drivers.message import Message, digits, fixed
from drivers.ports.instruments import Instrument
from drivers.types.sensing import SampleBlock
from drivers.types.values import FloatArray
from gateway import live
from gateway.errors import NotMoved, Scattering, Unstable

MOST_EVENTS = 20
History = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class StopReading:
    """A settled average: channel means, their window's standard deviations, its centre in instrument time."""

    values: FloatArray
    sigma: FloatArray
    count: int
    time_s: float


@dataclass(frozen=True, slots=True)
class Window:
    """When a reading counts as settled: instrument times in s, ``stable`` the largest sigma per channel unit.

    ``turn`` is what the reading repeats after (360 deg of a modulo axis, which may take either way round); 0: nothing.
    """

    settle_s: float
    average_s: float
    stable: float
    timeout_s: float
    turn: float = 0.0

    def off(self, read: float, wanted: float) -> float:
        """How far a reading is from the wanted one, whole turns left out."""
        off = read - wanted
        return off - self.turn * round(off / self.turn) if self.turn else off


class Readings:
    """Keeps the newest stretch of a stream and answers "what does it read now that it stands still?"."""

    KEEP_S = 120.0

    def __init__(self, instrument: Instrument, clock: Clock, combine: History) -> None:
        """`combine` turns raw channel columns (n, c) into the one quantity (n,) that must stand still."""
        self._instrument = instrument
        self._clock = clock
        self._combine = combine
        self._blocks: deque[SampleBlock] = deque()
        self._news = asyncio.Event()
        self._failure: TrueflankError | None = None
        self._task: asyncio.Task[None] | None = None
        # (end, lowest, highest) of every block since the last reading: a motion is remembered however late
        # somebody asks, while the samples themselves are kept for `KEEP_S` only.
        self._ranges: list[tuple[float, float, float]] = []
        self.broken_since: float | None = None
        self.restarted = False
        self.lost = 0
        self.events: list[Message] = []
        self._shift_s = 0.0
        self._read: tuple[float, float] | None = None

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self._follow(), name=f"readings of {self._instrument.name}")
        return self

    async def __aexit__(self, *_exc: object) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _follow(self) -> None:
        stream = self._instrument.blocks()
        try:
            async for block in stream:
                self._take(block)
        except TrueflankError as error:
            self._failure = error
        finally:
            self._news.set()
            closer = getattr(stream, "aclose", None)
            if closer is not None:
                await closer()

    def _take(self, block: SampleBlock) -> None:
        if not len(block):
            return
        live.onlooker().samples(self._instrument.name, block)
        self.lost += block.lost
        self.events.extend(block.events[: MOST_EVENTS - len(self.events)])
        block = self._monotonic(block)
        if not bool(block.valid.all()):
            self.broken_since = float(block.time_s[int(np.argmin(block.valid))])
        self._blocks.append(block)
        seen = self._combine(block.values)
        self._ranges.append((float(block.time_s[-1]), float(np.min(seen)), float(np.max(seen))))
        oldest = float(block.time_s[-1]) - self.KEEP_S
        while len(self._blocks) > 1 and self._blocks[0].time_s[-1] < oldest:
            self._blocks.popleft()
        self._news.set()

    def _monotonic(self, block: SampleBlock) -> SampleBlock:
        """A clock that jumps back or a counter that starts anew: time goes on, but what was counted is void."""
        first, latest = float(block.time_s[0]) + self._shift_s, self.latest_s
        if first <= latest:
            self._shift_s += latest - first + self._step(block)
            self.restarted = True
            self.broken_since = latest
        return replace(block, time_s=block.time_s + self._shift_s) if self._shift_s else block

    @staticmethod
    def _step(block: SampleBlock) -> float:
        return float(block.time_s[1] - block.time_s[0]) if len(block) > 1 else 1e-3

    def _forget_before(self, end_s: float) -> None:
        self._ranges = [seen for seen in self._ranges if seen[0] > end_s]

    @property
    def latest_s(self) -> float:
        """Instrument time of the newest sample; minus infinity before the first."""
        return float(self._blocks[-1].time_s[-1]) if self._blocks else -np.inf

    async def _next_block(self, timeout_s: float) -> None:
        self._raise_failure()
        self._news.clear()
        async with self._clock.deadline(timeout_s, self._instrument.name):
            await self._news.wait()
        self._raise_failure()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure
        if self._task is not None and self._task.done():
            raise DeadlineExceeded("E-CAP-STREAM", self._instrument.name)

    def _samples_between(self, start_s: float, end_s: float) -> tuple[FloatArray, FloatArray]:
        times = [block.time_s for block in self._blocks]
        values = [block.values for block in self._blocks]
        time_s, value = np.concatenate(times), np.concatenate(values)
        inside = (time_s >= start_s) & (time_s <= end_s)
        return time_s[inside], value[inside]

    async def settled(
        self,
        window: Window,
        *,
        expect: tuple[float, float] | None = None,
        moved_from: tuple[float, float] | None = None,
    ) -> StopReading:
        """Wait for a stable window that begins after now and return its average.

        ``expect`` (value, tolerance): the combined value must lie there; a stale or foreign stop does not.
        ``moved_from`` (value, distance): the stream must first have left that value by that distance, so
        that samples delivered late from the last stop cannot stand for this one.
        Raises BeamObstructed, Unstable (naming the condition that is missing), or the wire's own error.
        """
        start_wait = self._clock.now()
        self._read = None
        await self._next_block(window.timeout_s)
        left_at = self._left_since(moved_from)
        begin = self.latest_s + window.settle_s
        kind, missing, seen = Unstable, Message.of("W-WAIT-SAMPLES"), Message.of("W-WAIT-SETTLE")
        while self._clock.now() - start_wait < window.timeout_s:
            self._check_beam()
            if left_at is None:
                left_at = self._left_since(moved_from)
            if self.latest_s >= begin + window.average_s:
                found = self._judge(begin, window, expect, left_at)
                if isinstance(found, StopReading):
                    self._forget_before(begin + window.average_s)
                    return found
                kind, missing = found
                seen = missing
                begin = max(begin + window.average_s, self.latest_s - window.average_s)
            else:
                done_s, needed_s = self.latest_s - begin + window.settle_s, window.settle_s + window.average_s
                live.onlooker().waiting(self._instrument.name, seen, done_s, needed_s)
                await self._next_block(window.timeout_s)
        read, wanted = self._read or (None, None)
        where, limit_s = self._instrument.name, window.timeout_s
        raise kind("E-CAP-UNSTABLE", where, missing=missing, timeout_s=limit_s, read=read, wanted=wanted)

    async def at_rest(
        self, window: Window, count: int, *, expect: tuple[float, float] | None = None
    ) -> tuple[StopReading, ...]:
        """``count`` readings one after the other of what does not move; none where it does not settle.

        What scatters in them is the instrument's own: ISO 230-2 sees instrument and axis together, and a reading's own
        window shows only noise faster than itself. Raises BeamObstructed, or the wire's own error.
        """
        try:
            return tuple([await self.settled(window, expect=expect) for _ in range(count)])
        except Unstable:
            return ()

    def _judge(
        self, begin: float, window: Window, expect: tuple[float, float] | None, left_at: float | None
    ) -> StopReading | tuple[type[Unstable], Message]:
        """The reading, or which condition is missing and the class of the error that says so."""
        time_s, values = self._samples_between(begin, begin + window.average_s)
        if len(time_s) < 3:
            return Unstable, Message.of("W-WAIT-FEW")
        combined = self._combine(values)
        sigma, mean = float(np.std(combined, ddof=1)), float(np.mean(combined))
        if left_at is None or left_at > begin:
            return NotMoved, Message.of("W-WAIT-MOVE")
        self._read = None
        off = 0.0 if expect is None else window.off(mean, expect[0])
        if expect is not None and abs(off) > expect[1]:
            self._read = expect[0] + off, expect[0]
            at = {"read": fixed(mean, 6), "room": fixed(expect[1], 6), "wanted": fixed(expect[0], 6)}
            return Unstable, Message.of("W-WAIT-PLACE", **at)
        if sigma > window.stable or self._drifts(combined, sigma, window.stable):
            return Scattering, Message.of("W-WAIT-SIGMA", sigma=digits(sigma, 3), limit=digits(window.stable, 3))
        centre = float(np.mean(time_s))
        return StopReading(values.mean(axis=0), values.std(axis=0, ddof=1), len(time_s), centre)

    @staticmethod
    def _drifts(combined: FloatArray, sigma: float, stable: float) -> bool:
        half = len(combined) // 2
        step = abs(float(np.mean(combined[:half]) - np.mean(combined[half:])))
        return step > max(stable, 3.0 * sigma)

    def _left_since(self, moved_from: tuple[float, float] | None) -> float | None:
        """End of the first block after the last reading that was as far away as `moved_from` asks."""
        if moved_from is None:
            return -np.inf
        value, distance = moved_from
        far = (end_s for end_s, low, high in self._ranges if max(value - low, high - value) >= distance)
        return next(far, None)

    def _check_beam(self) -> None:
        if self.broken_since is not None and self.restarted:
            raise BeamObstructed("E-CAP-RESTART", self._instrument.name, at_s=fixed(self.broken_since, 3))
        if self.broken_since is not None:
            raise BeamObstructed("E-CAP-BEAM", self._instrument.name, at_s=fixed(self.broken_since, 3))

    def datum(self) -> None:
        """Forget a break of the beam: the next reading starts a new count."""
        self.broken_since = None
        self.restarted = False
        self.restarted = False
