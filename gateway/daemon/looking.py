"""Looks on at the run for the stream: samples as envelopes ten times a second, stops, and what is waited for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from drivers.clock import Clock
from drivers.message import Message
from drivers.types.sensing import Ambient, SampleBlock
from drivers.types.values import FloatArray
from gateway.audience import Audience, kind_of
from gateway.events import TargetsAdded, received
from gateway.live import Asked, LiveDeviation

EVERY_S = 0.1
MOST_ASKED = 200
MOST_KEPT = 20000


@dataclass(slots=True)
class _Gathered:
    """What an instrument sent since the last frame: lowest, highest, newest of each channel (c,)."""

    low: FloatArray
    high: FloatArray
    last: FloatArray
    begin_s: float
    end_s: float
    count: int = 0
    bad: int = 0
    lost: int = 0

    def take(self, block: SampleBlock) -> None:
        self.low = np.minimum(self.low, block.values.min(axis=0))
        self.high = np.maximum(self.high, block.values.max(axis=0))
        self.last, self.end_s = block.values[-1], float(block.time_s[-1])
        self.count += len(block)
        self.bad += int(np.count_nonzero(~block.valid))
        self.lost += block.lost


@dataclass(slots=True)
class Looking:
    """The onlooker of a daemon. ``tell`` passes an event on; what people ask to be taken again waits here.

    ``part`` counts the parts of a command (axes, set-ups), so that readings of one part stand together in a plot."""

    tell: Callable[[str, Mapping[str, object]], None]
    clock: Clock
    asked: dict[str, list[Asked]] = field(default_factory=dict)
    part: int = 0
    kept: list[dict[str, object]] = field(default_factory=list)
    air: Mapping[str, object] | None = None
    _since: dict[str, _Gathered] = field(default_factory=dict)
    _told_s: dict[str, float] = field(default_factory=dict)
    _samples: dict[str, int] = field(default_factory=dict)

    def said(self, code: str, fields: Mapping[str, object]) -> None:
        """Count the parts by what is said; more targets of one set-up begin none."""
        if kind_of(code) is Audience.STEP and not isinstance(received(code, fields), TargetsAdded):
            self.part += 1

    def begin(self) -> None:
        """Another command is at work: what the last one took, and what people asked of it, is over."""
        self.kept.clear()
        self.asked.clear()

    def samples(self, instrument: str, block: SampleBlock) -> None:
        """Gather; a frame goes out once a tenth of a second of the gateway's clock has passed since the last one."""
        if not len(block):
            return
        known = self._since.get(instrument)
        if known is None:
            first, begin = block.values[0], float(block.time_s[0])
            known = self._since[instrument] = _Gathered(first, high=first, last=first, begin_s=begin, end_s=begin)
        known.take(block)
        if self._is_due(instrument):
            self._flush(instrument, known, block.channels)

    def _is_due(self, key: str) -> bool:
        now = self.clock.now()
        if now - self._told_s.get(key, -EVERY_S) < EVERY_S:
            return False
        self._told_s[key] = now
        return True

    def _flush(self, instrument: str, seen: _Gathered, channels: tuple[str, ...]) -> None:
        del self._since[instrument]
        self._samples[instrument] = self._samples.get(instrument, 0) + seen.count
        self.tell(
            "reading",
            {
                "instrument": instrument,
                "channels": list(channels),
                "low": seen.low.tolist(),
                "high": seen.high.tolist(),
                "last": seen.last.tolist(),
                "begin_s": seen.begin_s,
                "end_s": seen.end_s,
                "count": seen.count,
                "sequence": self._samples[instrument],
                "signal": 1.0 - seen.bad / seen.count,
                "lost": seen.lost,
            },
        )

    def waiting(self, instrument: str, missing: Message, done_s: float, needed_s: float) -> None:
        """Which condition holds up the reading, ten times a second at most."""
        if self._is_due(f"waiting {instrument}"):
            done = max(min(done_s, needed_s), 0.0) if np.isfinite(done_s) else 0.0
            told = {"instrument": instrument, "missing": missing.as_data(), "done_s": round(done, 3)}
            self.tell("waiting", {**told, "needed_s": round(needed_s, 3)})

    def ambient(self, instrument: str, air: Ambient) -> None:
        """Air and material."""
        told = {"air_degc": air.air_degc, "pressure_hpa": air.pressure_hpa, "humidity_pct": air.humidity_pct}
        found = {"instrument": instrument, **told, "material_degc": list(air.material_degc), "age_s": air.age_s}
        self.air = {"utc": self.clock.utc().isoformat(timespec="milliseconds"), **found}
        self.tell("ambient", found)

    def taken(self, axis: str, stop: Asked, seen: LiveDeviation) -> None:
        """A reading of the plot."""
        target, repetition, approach = stop
        told: dict[str, object] = {"axis": axis, "target": target, "repetition": repetition, "approach": approach}
        told |= {"deviation": seen.value, "unit": seen.unit, "expanded": seen.expanded, "raw": seen.raw}
        told["part"] = self.part
        if len(self.kept) < MOST_KEPT:
            self.kept.append(told)
        self.tell("taken", told)

    def ask_again(self, axis: str, stop: Asked) -> bool:
        """A person wants a reading again; false where so many wait already."""
        wanted = self.asked.setdefault(axis, [])
        if len(wanted) >= MOST_ASKED:
            return False
        wanted.append(stop)
        return True

    def asked_again(self, axis: str) -> tuple[Asked, ...]:
        """What people asked for, told once."""
        return tuple(self.asked.pop(axis, ()))
