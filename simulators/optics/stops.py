"""What differs from stop to stop: reproducibility noise and the odd reading that is off for one stop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulators.cellfile import Noise
from simulators.truth import generator

FloatArray = NDArray[np.float64]


class Stops:
    """Counts the stops of one axis and gives each its own reading offset, in um or arcsec.

    A new stop begins as soon as the axis has left the place where it stood for half a second; a switch of
    a compensation table, which moves it by micrometres, does not make a new stop.
    """

    LEFT = 0.01
    STOOD_S = 0.5

    def __init__(self, noise: Noise, every: int, seed: int, name: str) -> None:
        self._noise = noise
        self._every = noise.outliers.every or max(every, 1)
        self._seed = seed
        self._name = name
        self._known: dict[tuple[int, int], float] = {}
        self._rest_s = 0.0
        self._anchor: float | None = None
        self._place: float | None = None
        self._stood_s = 0.0
        self.index = 0

    def offsets(self, position: FloatArray, spacing_s: float) -> FloatArray:
        """The offset of each of these successive samples (n,), `spacing_s` apart."""
        if self._place is None:
            self._anchor = self._place = float(position[0])
        if self._anchor is not None and np.all(np.abs(position - self._anchor) < self.LEFT):
            return self._at_rest(len(position), spacing_s)
        indices = self._follow(position, spacing_s)
        offsets = {index: self.offset(index) for index in dict.fromkeys(indices)}
        return np.asarray([offsets[index] for index in indices])

    def _at_rest(self, count: int, spacing_s: float) -> FloatArray:
        """So many samples while the axis stands: air that moves makes another reading of the same stop."""
        if not self._noise.stop_s:
            return np.full(count, self.offset(self.index))
        since = self._rest_s + spacing_s * np.arange(count)
        self._rest_s += spacing_s * count
        return np.asarray([self.offset(self.index, int(rest)) for rest in since // self._noise.stop_s])

    def _follow(self, position: FloatArray, spacing_s: float) -> list[int]:
        indices = []
        for place in position.tolist():
            still = abs(place - (self._place or 0.0)) < 1e-6
            self._place = place
            self._stood_s = self._stood_s + spacing_s if still else 0.0
            if self._anchor is not None and abs(place - self._anchor) > self.LEFT:
                self.index += 1
                self._anchor, self._rest_s = None, 0.0
            elif self._anchor is None and self._stood_s >= self.STOOD_S:
                self._anchor = place
            indices.append(self.index)
        return indices

    def offset(self, index: int, rest: int = 0) -> float:
        """The offset of the stop with this number, in this stretch of its rest."""
        if (index, rest) not in self._known:
            name = f"stop {index} rest {rest}" if rest else f"stop {index}"
            ordinary = float(generator(self._seed, self._name, name).normal())
            self._known[index, rest] = ordinary * self._noise.stop + self.outlier(index)
        return self._known[index, rest]

    def outlier(self, index: int) -> float:
        """How far the reading of this stop is off beyond noise; 0 for nearly all."""
        spec = self._noise.outliers
        window, place = divmod(index, self._every)
        rng = generator(self._seed, self._name, f"outliers {window}")
        first = min(8, self._every - 1)
        count = min(spec.count, self._every - first)
        chosen = rng.choice(np.arange(first, self._every), size=count, replace=False)
        signs = rng.choice((-1.0, 1.0), size=count)
        return float(spec.size * np.sum(signs[chosen == place]))
