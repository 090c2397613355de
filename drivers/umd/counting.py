"""Counter rows to samples in millimetres: wraps undone, times counted, doubtful rows marked, pure."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.errors import UnsupportedDevice
from drivers.types.sensing import Ambient, SampleBlock
from drivers.umd.codec import DISPLACEMENT, PHASE, VELOCITY, UmdLines
from drivers.umd.lowspeed import LowSpeed
from drivers.umd.numerals import IntArray
from drivers.umd.sequence import Ordered, SequenceOrder
from drivers.umd.settings import UmdSettings

PHASE_ERRORS = 0x7E00
WRAP = 1 << 32
LEARN_MOVING = 4096

BoolArray = NDArray[np.bool_]


class UmdCounting:
    """One axis of one counter, from its first line on."""

    def __init__(self, settings: UmdSettings, where: str) -> None:
        self._settings = settings
        self._where = where
        self._order = SequenceOrder()
        self._low = LowSpeed(where)
        self._velocity = VelocityCheck()
        self._tick: int | None = None
        self._raw = 0
        self._position = 0
        self._low_signal = False
        self.lines = 0
        self.damaged = 0

    @property
    def sample_rate_hz(self) -> float:
        """The setting, else what the counter says; 0 while unknown."""
        return self._settings.sample_rate_hz or self._low.sample_rate_hz

    @property
    def counts_per_cycle(self) -> int:
        """The setting, else what the counter says; 0 while unknown."""
        return self._settings.counts_per_cycle or self._low.counts_per_cycle

    @property
    def missing(self) -> tuple[int, ...]:
        """Low-speed codes without which no sample can be made."""
        scaled = self._settings.count_size_nm > 0 or self.counts_per_cycle > 0
        return (() if self.sample_rate_hz else (8,)) + (() if scaled else (20,))

    @property
    def low_speed(self) -> LowSpeed:
        """What the counter has said of itself."""
        return self._low

    @property
    def repeats(self) -> int:
        """Rows dropped because they came twice or out of order."""
        return self._order.repeats

    def ambient(self) -> Ambient:
        """Latest readings of the counter's sensors."""
        return self._low.ambient(self._tick or 0, self.sample_rate_hz)

    def take(self, lines: UmdLines) -> list[SampleBlock]:
        """The blocks of one message, cut at every gap; none while `missing`. Raises E-UMD-CHANGED, E-UMD-AXIS."""
        before = self.damaged + self._order.absurd
        self.damaged += lines.damaged
        self.lines += len(lines.rows)
        ordered = self._without_splices(self._order.sort(lines.rows))
        if not len(ordered.rows):
            return []
        self._check_axis(ordered.rows)
        adjacent = ordered.adjacent
        if self._tick is None:
            self._begin(ordered)
            adjacent[0] = False
        ticks = self._tick_of(ordered)
        self._low.read(ordered.rows, ticks)
        moved, position = self._unwrap(ordered.rows)
        if self.missing:
            return []
        marks = self._marks(ordered, moved, adjacent)
        damaged = self.damaged + self._order.absurd - before
        return self._blocks(ordered, ticks, position, marks, damaged)

    def _check_axis(self, rows: IntArray) -> None:
        if DISPLACEMENT[self._settings.axis - 1] >= rows.shape[1]:
            axis = self._settings.axis
            raise UnsupportedDevice("E-UMD-AXIS", self._where, axis=axis, width=rows.shape[1])

    def _without_splices(self, ordered: Ordered) -> Ordered:
        """Where bytes were lost, the front of one line may have met the tail of another and look like a line.

        Such a row follows a gap, and the row after it does not fit it; neither does one that nothing confirms.
        """
        after = np.flatnonzero(ordered.steps[:-1] > 1)
        axis = self._settings.axis - 1
        if ordered.unbroken or not len(after) or DISPLACEMENT[axis] >= ordered.rows.shape[1]:
            return ordered
        counts, velocity = ordered.rows[:, DISPLACEMENT[axis]], ordered.rows[:, VELOCITY[axis]]
        moved = _wrapped(counts[after + 1] - counts[after])
        fits = (ordered.steps[after + 1] == 1) & (moved == _wrapped(velocity[after + 1]))
        return ordered.without(after[~fits])

    def _begin(self, ordered: Ordered) -> None:
        """The first row sets where the count and the clock stand; it has no row before it."""
        self._tick = (self._order.last or 0) - int(ordered.steps.sum())
        self._raw = self._position = int(ordered.rows[0, DISPLACEMENT[self._settings.axis - 1]])

    def _tick_of(self, ordered: Ordered) -> IntArray:
        before = self._tick or 0
        if ordered.unbroken:
            ticks = np.arange(before + 1, before + 1 + len(ordered.rows), dtype=np.int64)
        else:
            ticks = np.asarray(before + np.cumsum(ordered.steps), np.int64)
        self._tick = int(ticks[-1])
        return ticks

    def _unwrap(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Counts moved since the row before and position in counts, both (n,): 32 bits wrapped round."""
        raw = rows[:, DISPLACEMENT[self._settings.axis - 1]]
        moved = np.diff(raw, prepend=self._raw)
        if _within_half(moved):
            position = raw + (self._position - self._raw)
        else:
            moved = _wrapped(moved)
            position = self._position + np.cumsum(moved)
        self._raw, self._position = int(raw[-1]), int(position[-1])
        return moved, position

    def _marks(self, ordered: Ordered, moved: IntArray, adjacent: BoolArray) -> dict[str, BoolArray]:
        """Reasons not to believe rows, each (n,); those that no row gives are left out."""
        axis = self._settings.axis - 1
        phase = ordered.rows[:, PHASE[axis]]
        scale = self._settings.mm_per_count(self.counts_per_cycle or 1)
        most = self._settings.max_speed_mm_s / self.sample_rate_hz / scale
        velocity = ordered.rows[:, VELOCITY[axis]]
        if not _within_half(velocity):
            velocity = _wrapped(velocity)
        marks: dict[str, BoolArray] = {}
        if not ordered.unbroken:
            marks["counter restarted"] = ordered.restarted
        if phase.any():
            marks["phase error"] = (phase >= 0) & ((phase & PHASE_ERRORS) != 0)
        if max(int(moved.max()), -int(moved.min())) > most:
            marks["faster than any axis"] = np.abs(moved) > most * ordered.steps
        if self._settings.least_signal:
            marks["low signal"] = self._weak(ordered.rows)
        marks["count and velocity disagree"] = self._velocity.disagree(moved, velocity, adjacent)
        return {name: mark for name, mark in marks.items() if mark.any()}

    def _weak(self, rows: IntArray) -> BoolArray:
        """Rows (n,) since the counter last told a signal below the least that is believed."""
        at, strength = self._low.signals(rows)
        weak = np.empty(len(rows), np.bool_)
        edges = [0, *at.tolist(), len(rows)]
        for (start, end), now in zip(
            pairwise(edges), [self._low_signal, *(strength < self._settings.least_signal)], strict=True
        ):
            weak[start:end] = now
            self._low_signal = bool(now)
        return weak

    def _blocks(
        self, ordered: Ordered, ticks: IntArray, position: IntArray, marks: dict[str, BoolArray], damaged: int
    ) -> list[SampleBlock]:
        time_s = np.asarray(ticks / self.sample_rate_hz, np.float64)
        scale = self._settings.mm_per_count(self.counts_per_cycle or 1)
        values = self._settings.reading(np.asarray(position * scale, np.float64))[:, None]
        if np.isnan(values).any():
            marks = {**marks, "beyond the optics": np.isnan(values[:, 0])}
            values = np.nan_to_num(values)
        valid = ~np.logical_or.reduce(tuple(marks.values())) if marks else np.ones(len(ticks), np.bool_)
        lost = ordered.steps - 1
        cuts = [0, *(int(at) for at in _gaps(ordered)), len(ticks)]
        blocks = []
        for start, end in pairwise(cuts):
            part = slice(start, end)
            events = _events(time_s[part], {name: mark[part] for name, mark in marks.items()})
            if start == 0 and damaged:
                events = (f"{damaged} damaged lines before {time_s[-1]:.6f} s", *events)
            gap = int(lost[start])
            blocks.append(
                SampleBlock(
                    channels=self._settings.channels,
                    time_s=time_s[part],
                    values=values[part],
                    valid=valid[part],
                    lost=gap,
                    events=events,
                )
            )
        return blocks


def _gaps(ordered: Ordered) -> IntArray:
    """Rows (k,), not the first, before which something was lost."""
    if ordered.unbroken:
        return np.empty(0, np.int64)
    return np.flatnonzero(ordered.steps[1:] != 1) + 1


def _within_half(counts: IntArray) -> bool:
    return int(counts.min()) >= -WRAP // 2 and int(counts.max()) < WRAP // 2


def _wrapped(counts: IntArray) -> IntArray:
    """Differences of 32 bit counts, the shorter way round."""
    return np.asarray((counts + WRAP // 2) % WRAP - WRAP // 2, np.int64)


def _events(time_s: NDArray[np.float64], marks: dict[str, BoolArray]) -> tuple[str, ...]:
    return tuple(f"{name} at {time_s[int(np.argmax(mark))]:.6f} s" for name, mark in marks.items() if mark.any())


class VelocityCheck:
    """The uMD2 sends each count's change beside the count: two numbers that must agree.

    Other counters send zero or a filtered value there, so it is learned first: only a counter whose first
    `LEARN_MOVING` moving rows all agree is held to it.
    """

    def __init__(self) -> None:
        self._agreed = 0
        self._useless = False

    def disagree(self, moved: IntArray, velocity: IntArray, adjacent: BoolArray) -> BoolArray:
        """Rows (n,) whose two numbers differ, once the counter has been seen to keep them equal."""
        if self._useless:
            return np.zeros(len(moved), np.bool_)
        differs = adjacent & (moved != velocity)
        if self._agreed >= LEARN_MOVING:
            return differs
        moving = adjacent & (velocity != 0)
        reached = int(np.searchsorted(self._agreed + np.cumsum(moving), LEARN_MOVING))
        self._useless = bool((differs & (moving | (moved != 0)))[: reached + 1].any())
        self._agreed += int(moving[: reached + 1].sum())
        differs[: reached + 1] = False
        return differs & (not self._useless)
