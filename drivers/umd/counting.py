"""Counter rows to samples in millimetres: sequence to ticks, low-speed codes, wraps, doubtful rows marked; pure.

A sequence number is 32 bits of the counter's clock: a gap is lost rows, an equal number a repeat, a small number
after a large one a wrap or a restart. The displacement wraps too; between neighbours the shorter way round is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RemoteProtocolError, UnsupportedDevice
from drivers.message import Message
from drivers.types.sensing import Ambient, SampleBlock
from drivers.umd.codec import (
    AIR_TEMPERATURE,
    CODE,
    DATA,
    DISPLACEMENT,
    FIRMWARE,
    HOMODYNE,
    HUMIDITY,
    LASER_POWER,
    MATERIAL_TEMPERATURE,
    PHASE,
    PRESSURE,
    SAMPLE_FREQUENCY,
    SEQUENCE,
    SIGNAL_STRENGTH,
    VELOCITY,
    IntArray,
    UmdLines,
)
from drivers.umd.settings import UmdSettings

# Sequence numbers to ticks of the counter's clock: gaps, repeats, wraps and restarts told apart, pure.

LONGEST_GAP = 600_000
NEIGHBOUR = 64
# What comes twice comes in order: so many lines, each numbered below the one before, are no repeat.
BACKWARDS = 8
# uMD0 prints the low 16 bits as a signed number, older firmware 32 bits, uMD2 all 64.
WRAPS = (1 << 16, 1 << 32)


@dataclass(frozen=True, slots=True, eq=False)
class Ordered:
    """Rows in order: ``steps`` (n,) ticks since the row before (1: nothing lost), ``restarted`` (n,).

    ``unbroken``: every step is 1 and nothing restarted.
    """

    rows: IntArray
    steps: IntArray
    restarted: NDArray[np.bool_]
    unbroken: bool = False

    @property
    def adjacent(self) -> NDArray[np.bool_]:
        """Rows (n,) whose counts may be compared with the row before."""
        if self.unbroken:
            return np.ones(len(self.rows), np.bool_)
        return (self.steps == 1) & ~self.restarted

    def without(self, places: NDArray[np.intp]) -> Ordered:
        """Rows at ``places`` taken for lost: their steps go to the rows after them."""
        if not len(places):
            return self
        kept = np.ones(len(self.rows), np.bool_)
        kept[places] = False
        ticks = np.cumsum(self.steps)[kept]
        return Ordered(self.rows[kept], np.diff(ticks, prepend=0), self.restarted[kept])


class SequenceOrder:
    """Follows the sequence field. Repeats are dropped and counted, a lone absurd number with its row too.

    ``backwards`` is the longest run of rows so far that were numbered downwards.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._held: IntArray | None = None
        self._begun = False
        self.repeats = 0
        self.absurd = 0
        self.backwards = 0

    @property
    def last(self) -> int | None:
        """The newest sequence number accepted."""
        return self._last

    def sort(self, rows: IntArray) -> Ordered:
        """Rows (n, w) as received to the rows to believe, in order."""
        if self._held is not None and self._held.shape[1] == rows.shape[1]:
            rows = np.concatenate((self._held, rows))
        self._held = None
        if not len(rows):
            return Ordered(rows, np.empty(0, np.int64), np.empty(0, np.bool_))
        numbers = rows[:, SEQUENCE]
        first = int(numbers[0]) - 1 if self._last is None else self._last
        steps = np.diff(numbers, prepend=first)
        least, most = int(steps.min()), int(steps.max())
        if least >= 1 and most <= LONGEST_GAP:
            ordered = Ordered(rows, steps, np.zeros(len(rows), np.bool_), most == 1)
        else:
            self.backwards = max(self.backwards, _longest_fall(numbers))
            ordered = self._sort_slowly(rows, first)
        return self._confirmed(ordered, first)

    def _confirmed(self, ordered: Ordered, first: int) -> Ordered:
        """A last row that follows a gap waits for its neighbour: together they show whether it is whole."""
        rows, steps = ordered.rows, ordered.steps
        if self._held is None and len(rows) and steps[-1] > 1:
            self._held = rows[-1:]
            ordered = Ordered(rows[:-1], steps[:-1], ordered.restarted[:-1], bool((steps[:-1] == 1).all()))
        self._last = int(ordered.rows[-1, SEQUENCE]) if len(ordered.rows) else first if self._begun else None
        self._begun = self._begun or bool(len(ordered.rows))
        return ordered

    def _sort_slowly(self, rows: IntArray, last: int) -> Ordered:
        numbers: list[int] = rows[:, SEQUENCE].tolist()
        kept: list[int] = []
        steps: list[int] = []
        restarted: list[bool] = []
        for at, number in enumerate(numbers):
            step = ticks_forward(last, number)
            if -NEIGHBOUR < step <= 0:
                self.repeats += 1
                continue
            believable = 1 <= step <= LONGEST_GAP
            if not believable and at + 1 == len(numbers):
                self._held = rows[at:]
                break
            # A jump ahead whose neighbour goes on where the numbers were before is a damaged number, not a gap.
            if step > 1 and believable and at + 1 < len(numbers) and 1 <= ticks_forward(last, numbers[at + 1]) < step:
                self.absurd += 1
                continue
            if not believable and not 1 <= numbers[at + 1] - number <= NEIGHBOUR:
                self.absurd += 1
                continue
            kept.append(at)
            steps.append(max(step, 1))
            restarted.append(step < 1)
            last = number
        return Ordered(rows[kept], np.array(steps, np.int64), np.array(restarted, np.bool_))


def _longest_fall(numbers: IntArray) -> int:
    """How many neighbours in a row fall, at most."""
    falls = np.concatenate(([False], np.diff(numbers) < 0, [False]))
    edges = np.flatnonzero(falls[1:] != falls[:-1])
    return int((edges[1::2] - edges[::2]).max()) if len(edges) else 0


def ticks_forward(last: int, number: int) -> int:
    """Ticks from `last` to `number`, over a wrap where that gives a believable step."""
    step = number - last
    if step > -NEIGHBOUR:
        return step
    for wrap in WRAPS:
        signed = number < 0 <= last
        unsigned = number >= 0 and last >= wrap - LONGEST_GAP and wrap > 1 << 16
        if (signed or unsigned) and 1 <= step + wrap <= min(LONGEST_GAP, wrap >> 4):
            return step + wrap
    return step


# The counter's low-speed codes: what it says of itself and of the air, one number a line, pure.

# Divisors of the numbers sent: hundredths of degC, of mbar (= hPa), of Hz; tenths of a per cent.
_DIVISOR = {AIR_TEMPERATURE: 100.0, MATERIAL_TEMPERATURE: 100.0, PRESSURE: 100.0, HUMIDITY: 10.0}
FIRMWARE_SCALE = 100
# What no shop floor has is no reading: a sensor that is missing or broken.
_POSSIBLE = {AIR_TEMPERATURE: (-40.0, 80.0), MATERIAL_TEMPERATURE: (-40.0, 150.0), PRESSURE: (500.0, 1200.0)}
_POSSIBLE[HUMIDITY] = (0.0, 100.0)
DIAGNOSTICS = (101, 102, 111, 112, 121, 122)


@dataclass(slots=True)
class ConfirmedFact:
    """A number that must not change; it counts once it has come twice in a row, for one may be damaged."""

    value: int | None = None
    candidate: int | None = None

    def offer(self, value: int) -> bool:
        """Hear the number again; true when it has turned into another one for good."""
        if value == self.value:
            self.candidate = None
        elif value == self.candidate:
            changed = self.value is not None
            self.value, self.candidate = value, None
            return changed
        else:
            self.candidate = value
        return False


class LowSpeedData:
    """Collects the codes of one counter."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._facts = {SAMPLE_FREQUENCY: ConfirmedFact(), FIRMWARE: ConfirmedFact(), HOMODYNE: ConfirmedFact()}
        self._ambient: dict[int, tuple[float, int]] = {}
        self._latest: dict[int, int] = {}

    def read(self, rows: IntArray, ticks: IntArray) -> None:
        """Take in rows and their ticks (n,). Raises RemoteProtocolError (E-UMD-CHANGED)."""
        said = np.flatnonzero(rows[:, CODE])
        codes, data = rows[said, CODE], rows[said, DATA]
        for code, fact in self._facts.items():
            values: list[int] = data[codes == code].tolist()
            if values and not (fact.candidate is None and set(values) == {fact.value}):
                self._offer(code, fact, values)
        for code, divisor in _DIVISOR.items():
            at = (codes == code).nonzero()[0]
            if len(at):
                self._ambient[code] = float(data[at[-1]]) / divisor, int(ticks[said[at[-1]]])
        for code in (LASER_POWER, SIGNAL_STRENGTH, *DIAGNOSTICS):
            at = (codes == code).nonzero()[0]
            if len(at):
                self._latest[code] = int(data[at[-1]])

    def signals(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Rows (k,) that say a signal strength (code 2), and what they say."""
        at = np.flatnonzero(rows[:, CODE] == SIGNAL_STRENGTH)
        return at, rows[at, DATA]

    @property
    def signal_strength(self) -> int | None:
        """Code 2, in the counter's own unit; None while not heard."""
        return self._latest.get(SIGNAL_STRENGTH)

    def _offer(self, code: int, fact: ConfirmedFact, values: list[int]) -> None:
        before = fact.value
        for value in values:
            if fact.offer(value):
                raise RemoteProtocolError("E-UMD-CHANGED", self._where, number=code, before=before, now=value)

    @property
    def sample_rate_hz(self) -> float:
        """Code 8; 0 while not heard."""
        return (self._facts[SAMPLE_FREQUENCY].value or 0) / 100.0

    @property
    def counts_per_cycle(self) -> int:
        """Second byte of code 20; 0 while not heard."""
        return ((self._facts[HOMODYNE].value or 0) >> 8) & 0xFF

    @property
    def axes(self) -> int | None:
        """Low byte of code 20: homodyne axes, 0 for a heterodyne counter; None while not heard."""
        value = self._facts[HOMODYNE].value
        return None if value is None else value & 0xFF

    @property
    def firmware(self) -> str:
        """Code 10: version in the low 16 bits, times 100, sub-version in the high ones; "" while not heard."""
        value = self._facts[FIRMWARE].value
        if value is None:
            return ""
        low, sub = value & 0xFFFF, value >> 16
        version = f"{low // FIRMWARE_SCALE}.{low % FIRMWARE_SCALE:02d}"
        return f"{version}.{sub}" if sub > 0 else version

    def ambient(self, tick: int, sample_rate_hz: float) -> Ambient:
        """Latest readings, as old as the oldest of them; an impossible one is a sensor that is not there."""
        possible = {code: _POSSIBLE[code] for code in self._ambient}
        here = {
            code: found for code, found in self._ambient.items() if possible[code][0] <= found[0] <= possible[code][1]
        }
        oldest = min((at for _value, at in here.values()), default=tick)
        value = {code: found[0] for code, found in here.items()}
        material = value.get(MATERIAL_TEMPERATURE)
        return Ambient(
            air_degc=value.get(AIR_TEMPERATURE),
            pressure_hpa=value.get(PRESSURE),
            humidity_pct=value.get(HUMIDITY),
            material_degc=() if material is None else (material,),
            age_s=(tick - oldest) / sample_rate_hz if sample_rate_hz else 0.0,
        )


# Counting.

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
        self._low = LowSpeedData(where)
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
    def low_speed(self) -> LowSpeedData:
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
        """The blocks of one message, cut at every gap; none while `missing`.

        Raises RemoteProtocolError (E-UMD-CHANGED, E-UMD-BACKWARDS), UnsupportedDevice (E-UMD-AXIS).
        """
        before = self.damaged + self._order.absurd
        self.damaged += lines.damaged
        self.lines += len(lines.rows)
        ordered = self._without_splices(self._order.sort(lines.rows))
        if self._order.backwards >= BACKWARDS:
            raise RemoteProtocolError("E-UMD-BACKWARDS", self._where, lines=self._order.backwards)
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

    def _marks(self, ordered: Ordered, moved: IntArray, adjacent: BoolArray) -> dict[Message, BoolArray]:
        """Reasons not to believe rows, each (n,); those that no row gives are left out."""
        axis = self._settings.axis - 1
        phase = ordered.rows[:, PHASE[axis]]
        scale = self._settings.mm_per_count(self.counts_per_cycle or 1)
        most = self._settings.max_speed_mm_s / self.sample_rate_hz / scale
        velocity = ordered.rows[:, VELOCITY[axis]]
        if not _within_half(velocity):
            velocity = _wrapped(velocity)
        marks: dict[Message, BoolArray] = {}
        if not ordered.unbroken:
            marks[Message.of("W-UMD-RESTARTED")] = ordered.restarted
        if phase.any():
            marks[Message.of("W-UMD-PHASE")] = (phase >= 0) & ((phase & PHASE_ERRORS) != 0)
        if max(int(moved.max()), -int(moved.min())) > most:
            marks[Message.of("W-UMD-FAST")] = np.abs(moved) > most * ordered.steps
        if self._settings.least_signal:
            marks[Message.of("W-UMD-LOW")] = self._weak(ordered.rows)
        marks[Message.of("W-UMD-DISAGREE")] = self._velocity.disagree(moved, velocity, adjacent)
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
        self, ordered: Ordered, ticks: IntArray, position: IntArray, marks: dict[Message, BoolArray], damaged: int
    ) -> list[SampleBlock]:
        time_s = np.asarray(ticks / self.sample_rate_hz, np.float64)
        scale = self._settings.mm_per_count(self.counts_per_cycle or 1)
        values = self._settings.reading(np.asarray(position * scale, np.float64))[:, None]
        if np.isnan(values).any():
            marks = {**marks, Message.of("W-UMD-OPTICS"): np.isnan(values[:, 0])}
            values = np.nan_to_num(values)
        valid = ~np.logical_or.reduce(tuple(marks.values())) if marks else np.ones(len(ticks), np.bool_)
        lost = ordered.steps - 1
        cuts = [0, *(int(at) for at in _gaps(ordered)), len(ticks)]
        blocks = []
        for start, end in pairwise(cuts):
            part = slice(start, end)
            events = _events(time_s[part], {name: mark[part] for name, mark in marks.items()})
            if start == 0 and damaged:
                events = (Message.of("W-UMD-DAMAGED", damaged=damaged, time_s=time_s[-1]), *events)
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


def _events(time_s: NDArray[np.float64], marks: dict[Message, BoolArray]) -> tuple[Message, ...]:
    return tuple(
        Message.of("W-UMD-MARK", mark=name, time_s=time_s[int(np.argmax(mark))])
        for name, mark in marks.items()
        if mark.any()
    )


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
