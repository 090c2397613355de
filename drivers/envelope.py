"""A long stream as a picture of bounded size: lowest and highest value of ever wider pieces of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Envelope:
    """Takes samples for ever and keeps between ``pieces`` / 2 and ``pieces`` pairs (lowest, highest).

    Every piece holds the same number of samples; when all are used, neighbours are joined and the pieces become
    twice as wide. Nothing is left out: a single high sample of an hour is still in the picture.
    """

    def __init__(self, pieces: int = 2048, width: int = 1) -> None:
        """``width`` samples make the first pieces. Raises ValueError for less than two pieces or an odd number."""
        if pieces < 2 or pieces % 2 or width < 1:
            raise ValueError("an envelope needs an even number of pieces, of one sample or more")
        self._pieces = pieces
        self._width = width
        self._used = 0
        self._begin_s = np.zeros(pieces)
        self._low = np.zeros(pieces)
        self._high = np.zeros(pieces)
        self._rest: tuple[FloatArray, FloatArray] = (np.empty(0), np.empty(0))
        self.count = 0

    @property
    def width(self) -> int:
        """Samples in each piece now."""
        return self._width

    def take(self, time_s: FloatArray, values: FloatArray) -> None:
        """The next samples, both (n,)."""
        self.count += len(values)
        if len(self._rest[1]):
            time_s = np.concatenate((self._rest[0], time_s))
            values = np.concatenate((self._rest[1], values))
        while len(values) >= self._width:
            room = self._pieces - self._used
            whole = min(len(values) // self._width, room)
            used = whole * self._width
            self._fill(time_s[:used], values[:used], whole)
            time_s, values = time_s[used:], values[used:]
        self._rest = (time_s.copy(), values.copy())

    def _fill(self, time_s: FloatArray, values: FloatArray, whole: int) -> None:
        table = values.reshape(whole, self._width)
        part = slice(self._used, self._used + whole)
        self._begin_s[part] = time_s[:: self._width]
        self._low[part], self._high[part] = table.min(axis=1), table.max(axis=1)
        self._used += whole
        if self._used == self._pieces:
            self._join()

    def _join(self) -> None:
        half = self._pieces // 2
        self._begin_s[:half] = self._begin_s[::2]
        self._low[:half] = np.minimum(self._low[::2], self._low[1::2])
        self._high[:half] = np.maximum(self._high[::2], self._high[1::2])
        self._used = half
        self._width *= 2

    def picture(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """When each piece begins in s, its lowest and its highest value, each (p,); the last may be incomplete."""
        begin, low, high = (part[: self._used].copy() for part in (self._begin_s, self._low, self._high))
        time_s, values = self._rest
        if not len(values):
            return begin, low, high
        last = (time_s[0], values.min(), values.max())
        begin, low, high = (np.append(part, item) for part, item in zip((begin, low, high), last, strict=True))
        return begin, low, high
