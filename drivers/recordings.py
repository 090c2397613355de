"""A long equidistant record of one signal, looked at piece by piece: a dynamic capture, live or from a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message
from drivers.units import DeviationUnit

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RecordingGap:
    """``lost`` samples are missing just before sample ``index`` of the record."""

    index: int
    lost: int


@dataclass(frozen=True, slots=True)
class Recording:
    """Samples (n,) of one signal at ``rate_hz``; t = k / rate_hz between gaps.

    ``raw`` may be memory-mapped, so nothing is read before it is asked for; ``raw * scale`` is in ``unit``
    (um or arcsec). ``trigger`` is the index of the trigger, None where the record does not say.
    """

    raw: FloatArray
    rate_hz: float
    unit: DeviationUnit
    scale: float = 1.0
    trigger: int | None = None
    gaps: tuple[RecordingGap, ...] = ()
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()

    def __len__(self) -> int:
        return int(self.raw.shape[0])

    @property
    def duration_s(self) -> float:
        """From the first sample to the last in s, lost ones included."""
        return max(len(self) - 1 + sum(gap.lost for gap in self.gaps), 0) / self.rate_hz

    def values(self, start: int = 0, stop: int | None = None) -> FloatArray:
        """Samples start .. stop-1 in ``unit``, shape (stop - start,)."""
        return np.asarray(self.raw[start:stop], dtype=np.float64) * self.scale

    def times(self, start: int = 0, stop: int | None = None) -> FloatArray:
        """Times of samples start .. stop-1 in s, lost samples counted."""
        index = np.arange(len(self))[start:stop]
        return (index + self._lost_before(index)) / self.rate_hz

    def _lost_before(self, index: NDArray[np.int64]) -> NDArray[np.int64]:
        places = np.asarray([gap.index for gap in self.gaps], dtype=np.int64)
        total = np.concatenate(([0], np.cumsum([gap.lost for gap in self.gaps], dtype=np.int64)))
        return np.asarray(total[np.searchsorted(places, index, side="right")])

    def blocks(self, count: int = 1 << 16) -> Iterator[FloatArray]:
        """All samples in ``unit``, ``count`` at a time."""
        for start in range(0, len(self), count):
            yield self.values(start, start + count)

    def stretches(self) -> Iterator[tuple[int, int]]:
        """(start, stop) of every stretch without a gap inside."""
        edges = sorted({0, *(gap.index for gap in self.gaps if 0 < gap.index < len(self)), len(self)})
        yield from pairwise(edges)

    def envelope(self, points: int = 2000) -> tuple[FloatArray, FloatArray, FloatArray]:
        """For drawing: middle times in s, smallest and largest value of each of at most ``points`` pieces, (p,)."""
        width = max(-(-len(self) // max(points, 1)), 1)
        pieces = [self.values(start, start + width) for start in range(0, len(self), width)]
        middle = [min(start + width // 2, len(self) - 1) for start in range(0, len(self), width)]
        low, high = (np.asarray([pick(piece) for piece in pieces]) for pick in (np.min, np.max))
        index = np.asarray(middle, dtype=np.int64)
        return (index + self._lost_before(index)) / self.rate_hz, low, high
