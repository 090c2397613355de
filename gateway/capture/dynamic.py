"""A dynamic capture: one channel of a stream handed on sample by sample, with its gaps, from a trigger on.

Memory is bounded: before the trigger the newest samples asked for are kept, after it nothing is. Times are the
instrument's; a jump of its clock forward is a gap, one back ends the capture. Nothing is ever interpolated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from drivers.errors import ConfigError
from drivers.message import Message, fixed
from drivers.types.sensing import SampleBlock
from drivers.types.values import FloatArray
from drivers.units import ARCSEC_PER_DEG, ARCSEC_PER_RAD, UM_PER_MM, DeviationUnit
from gateway.errors import CaptureError

EXTERNAL = "trigger"
# Time stamps may differ from even spacing by this part of it before it is a gap.
UNEVEN = 0.5
FEWEST_FOR_RATE = 2
ROUNDING = 2e-6
MOST_PRE_SAMPLES = 1 << 22


class DynamicCapture:
    """One capture. ``begin`` opens the sink once the trigger came; ``view`` hears of it ``views_per_s`` times."""

    def __init__(
        self,
        channels: tuple[str, ...],
        seconds: float,
        begin: Callable[[StreamShape], Sink],
        *,
        channel: str = "",
        trigger: Trigger | None = None,
        view: Callable[[LiveView], None] = lambda _view: None,
        views_per_s: float = 2.0,
    ) -> None:
        name = channel or (channels[0] if channels else "")
        if name not in channels:
            raise ConfigError("E-CAP-CHANNEL", name or "(none)", known=", ".join(channels))
        if not seconds > 0.0:
            raise ConfigError("E-CAP-SECONDS", "dynamic capture", seconds=seconds)
        self._name = name
        self._column = channels.index(name)
        self._seconds = seconds
        self._begin = begin
        self._trigger = trigger or Trigger()
        self._view = view
        self._view_s = 1.0 / views_per_s
        self._unit, self._scale = unit_of(name)
        self._rate_hz = 0.0
        self._next_s = 0.0
        self._sink: Sink | None = None
        self._pre: deque[tuple[FloatArray, int]] = deque()
        self._pre_count = 0
        self._wanted = 0
        self._written = 0
        self._lost = 0
        self._first: float | None = None
        self._last: float | None = None
        self._seen: list[tuple[float, float, float, int]] = []
        self._view_due = -np.inf
        self._notes: list[Message] = []
        self._held: SampleBlock | None = None

    async def follow(self, blocks: AsyncIterator[SampleBlock]) -> CaptureEnd:
        """Take blocks until all is there. Raises CaptureError (E-CAP-CLOCK, E-CAP-RATE), what the stream raises."""
        async for block in blocks:
            if len(block) and self.take(block):
                return self.ended("complete")
            if self._beam_is_lost(block):
                return self.ended("beam")
        return self.ended("stream")

    def ended(self, why: Literal["complete", "beam", "stream"]) -> CaptureEnd:
        """The account so far."""
        return CaptureEnd(why, self._written, self._lost, tuple(self._notes))

    @staticmethod
    def _beam_is_lost(block: SampleBlock) -> bool:
        return not bool(block.valid.all())

    def take(self, block: SampleBlock) -> bool:
        """One block (n > 0); true once everything asked for is handed on."""
        if not self._rate_hz:
            block = self._with_held(block)
            if len(block) < FEWEST_FOR_RATE:
                self._held = block
                return False
            self._settle_rate(block)
        lost = self._gap(block)
        good = len(block) if not self._beam_is_lost(block) else int(np.argmin(block.valid))
        if good < len(block):
            self._notes.append(Message.of("S-DYN-BEAM", time=fixed(float(block.time_s[good]), 6)))
        values = block.values[:good, self._column]
        self._next_s = float(block.time_s[-1]) + 1.0 / self._rate_hz
        if good:
            self._on(values, lost, block)
        self._look(block, values)
        return self._sink is not None and self._written >= self._wanted

    def _with_held(self, block: SampleBlock) -> SampleBlock:
        """A rate needs two samples: a first block of one waits for the second."""
        held, self._held = self._held, None
        if held is None:
            return block
        return SampleBlock(
            block.channels,
            time_s=np.concatenate([held.time_s, block.time_s]),
            values=np.concatenate([held.values, block.values]),
            valid=np.concatenate([held.valid, block.valid]),
            lost=held.lost,
            events=(*held.events, *block.events),
        )

    def _settle_rate(self, block: SampleBlock) -> None:
        first, last = float(block.time_s[0]), float(block.time_s[-1])
        if not last > first:
            raise CaptureError("E-CAP-CLOCK", self._name, before=first, now=last)
        rate = (len(block) - 1) / (last - first)
        # Time stamps are rounded: what is a whole number of samples a second but for that is one.
        whole = float(round(rate))
        self._rate_hz = whole if abs(rate - whole) < ROUNDING * rate else float(f"{rate:.9g}")
        self._next_s = float(block.time_s[0])
        self._wanted = max(round(self._seconds * self._rate_hz), 1)

    def _gap(self, block: SampleBlock) -> int:
        """Samples missing before a block, by the instrument's count and by its clock, whichever is more."""
        step = 1.0 / self._rate_hz
        ahead = (float(block.time_s[0]) - self._next_s) * self._rate_hz
        even = np.abs(np.diff(block.time_s) - step) if len(block) > 1 else np.zeros(1)
        if ahead < -UNEVEN or float(np.max(even)) > UNEVEN * step:
            # Going back, or unevenly within a block: places of samples in time are not known any more.
            before, now = f"{self._next_s:.6f}", f"{float(block.time_s[0]):.6f}"
            raise CaptureError("E-CAP-CLOCK", self._name, before=before, now=now)
        jumped = round(ahead) if ahead > UNEVEN else 0
        if jumped > block.lost:
            self._notes.append(Message.of("S-DYN-MISSING", clock=jumped, count=block.lost))
        return max(jumped, block.lost)

    def _on(self, values: FloatArray, lost: int, block: SampleBlock) -> None:
        if self._sink is not None:
            self._write(values, lost)
            return
        at = self._trigger_index(values, block)
        if at is None:
            self._remember(values, lost)
            return
        kept = self._kept_before(values[:at], lost)
        begins = sum(len(piece) for piece, _lost in kept)
        scale = self._scale
        trigger = None if self._trigger.kind == "none" else begins
        self._sink = self._begin(
            StreamShape(channel=self._name, rate_hz=self._rate_hz, unit=self._unit, scale=scale, trigger=trigger)
        )
        self._wanted += begins
        for piece, missing in kept:
            self._write(piece, missing)
        self._write(values[at:], lost if not at else 0)

    def _trigger_index(self, values: FloatArray, block: SampleBlock) -> int | None:
        """Index of the first sample of the capture in this block, None while the trigger has not come."""
        if self._trigger.kind == "none":
            return 0
        if self._trigger.kind == "external":
            return self._external(block, len(values))
        signal = values * self._scale
        if self._first is None:
            self._first = float(signal[0])
        if self._trigger.kind == "value":
            hits = np.flatnonzero(np.abs(signal - self._first) >= self._trigger.at)
        else:
            before = float(signal[0]) if self._last is None else self._last
            above = np.concatenate([[before], signal]) >= self._trigger.at
            hits = np.flatnonzero(above[1:] != above[:-1])
        self._last = float(signal[-1])
        return int(hits[0]) if len(hits) else None

    def _external(self, block: SampleBlock, good: int) -> int | None:
        """By the event's own instrument time where it says one, else from the block's first sample."""
        for event in block.events:
            if str(event.fields.get("kind", "")).startswith(EXTERNAL):
                said = float(event.fields.get("at_s", block.time_s[0]))
                return min(int(np.searchsorted(block.time_s, said - 1e-9)), good - 1)
        return None

    @property
    def _most_before(self) -> int:
        return min(round(self._trigger.pre_s * self._rate_hz), MOST_PRE_SAMPLES)

    def _remember(self, values: FloatArray, lost: int) -> None:
        most = self._most_before
        self._pre.append((values[-most:].copy() if most else values[:0].copy(), lost if len(values) <= most else 0))
        self._pre_count += len(self._pre[-1][0])
        while self._pre and self._pre_count - len(self._pre[0][0]) >= most:
            self._pre_count -= len(self._pre.popleft()[0])

    def _kept_before(self, values: FloatArray, lost: int) -> list[tuple[FloatArray, int]]:
        """The newest samples before the trigger, oldest first, with what is missing before each piece."""
        pieces, left = [*self._pre, (values, lost)], self._most_before
        self._pre.clear()
        kept: list[tuple[FloatArray, int]] = []
        for piece, missing in reversed(pieces):
            if left <= 0 and len(piece):
                break
            part = piece[-left:] if left < len(piece) else piece
            left -= len(part)
            if len(part):
                kept.append((part, missing if len(part) == len(piece) else 0))
        kept.reverse()
        if kept:
            kept[0] = (kept[0][0], 0)
        return kept

    def _write(self, values: FloatArray, lost: int) -> None:
        if self._sink is None:
            return
        part = values[: self._wanted - self._written]
        if not len(part):
            return
        lost = lost if self._written else 0
        self._sink.append(part, lost)
        self._written += len(part)
        self._lost += lost

    def _look(self, block: SampleBlock, values: FloatArray) -> None:
        if len(values):
            seen = values * self._scale
            self._seen.append((float(seen.min()), float(seen.max()), float(seen.mean()), len(seen)))
        now = float(block.time_s[-1])
        if now < self._view_due or not self._seen:
            return
        low, high = min(one[0] for one in self._seen), max(one[1] for one in self._seen)
        mean = float(np.average([one[2] for one in self._seen], weights=[one[3] for one in self._seen]))
        self._view(
            LiveView(
                time_s=now,
                low=low,
                high=high,
                mean=mean,
                samples=self._written,
                lost=self._lost,
                waiting=self._sink is None,
            )
        )
        self._seen, self._view_due = [], now + self._view_s


# What a dynamic capture is told and tells: its trigger, the signal, the live view, how it ended.

# What a channel's last word means: unit of the record and how many of them one is.
CHANNEL_UNITS: dict[str, tuple[DeviationUnit, float]] = {
    "mm": ("um", UM_PER_MM),
    "um": ("um", 1.0),
    "nm": ("um", 1e-3),
    "deg": ("arcsec", ARCSEC_PER_DEG),
    "arcsec": ("arcsec", 1.0),
    "mrad": ("arcsec", ARCSEC_PER_RAD / 1e3),
    "urad": ("arcsec", ARCSEC_PER_RAD / 1e6),
}
TriggerKind = Literal["none", "value", "level", "external"]


@dataclass(frozen=True, slots=True)
class Trigger:
    """When a capture begins.

    "none": at once. "value": the signal has gone ``at`` away from where it stood first. "level": it crosses
    ``at``, upward or downward. "external": the instrument says so by an event that begins with "trigger".
    ``at`` in the record's unit; ``pre_s`` of the samples before are kept.
    """

    kind: TriggerKind = "none"
    at: float = 0.0
    pre_s: float = 0.1


@dataclass(frozen=True, slots=True)
class StreamShape:
    """The signal's description, known with the first samples: ``values * scale`` is in ``unit``."""

    channel: str
    rate_hz: float
    unit: DeviationUnit
    scale: float
    trigger: int | None


class Sink(Protocol):
    """Where samples go; the store's recorder is one."""

    def append(self, block: FloatArray, lost: int = 0) -> None:
        """Take samples (n,); ``lost`` are missing just before them."""
        ...


@dataclass(frozen=True, slots=True)
class LiveView:
    """A decimated look at the last while: smallest, largest and mean in the record's unit; counts since the start."""

    time_s: float
    low: float
    high: float
    mean: float
    samples: int
    lost: int
    waiting: bool


@dataclass(frozen=True, slots=True)
class CaptureEnd:
    """How a capture ended: "complete", or "beam" where the beam was lost (what was before is whole)."""

    why: Literal["complete", "beam", "stream"]
    samples: int
    lost: int
    notes: tuple[Message, ...] = ()


def unit_of(channel: str) -> tuple[DeviationUnit, float]:
    """Unit and scale of a channel by its name. Raises ConfigError (E-CAP-CHANNEL)."""
    word = channel.rpartition("_")[2]
    if word not in CHANNEL_UNITS:
        raise ConfigError("E-CAP-CHANNEL", channel, known=", ".join(CHANNEL_UNITS))
    return CHANNEL_UNITS[word]
