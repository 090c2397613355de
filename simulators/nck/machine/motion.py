"""How a position moves in time: straight pieces of demand, followed by a servo with a first-order lag."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HISTORY_S = 90.0
_TRIM_ABOVE = 1024
# So many lags after the last piece began nothing of what was left over shows in double precision.
_AT_REST_LAGS = 40.0


class LaggedPath:
    """Demand in straight pieces (jumps allowed) and its response ``lag_s`` behind, exact at any time.

    Within a piece that starts at t0 the demand is v0 + s (t - t0) and the response is the demand minus
    s lag, plus what was left over at t0 dying with exp(-(t - t0)/lag).
    """

    def __init__(self, lag_s: float, start_s: float, value: float) -> None:
        self._lag = max(lag_s, 1e-6)
        self._starts = [start_s]
        self._values = [value]
        self._slopes = [0.0]
        self._rests = [0.0]
        self._arrays: tuple[Array, Array, Array, Array] | None = None
        self._trim_at = _TRIM_ABOVE

    @property
    def lag_s(self) -> float:
        """The lag."""
        return self._lag

    def add(self, start_s: float, value: float, slope: float = 0.0) -> None:
        """A new piece of demand from ``start_s`` on, or from the last piece's start if that is later."""
        start_s = max(start_s, self._starts[-1])
        rest = self.response(start_s) - (value - slope * self._lag)
        self._starts.append(start_s)
        self._values.append(value)
        self._slopes.append(slope)
        self._rests.append(rest)
        self._arrays = None
        if len(self._starts) > self._trim_at:
            self._forget(start_s - HISTORY_S)

    def halt(self, time_s: float) -> None:
        """Drop what was planned after that time; the demand stays where it is then."""
        value = self.demand(time_s)
        keep = bisect_right(self._starts, time_s)
        for column in (self._starts, self._values, self._slopes, self._rests):
            del column[max(keep, 1) :]
        if self._slopes[-1] != 0.0 or self.demand(time_s) != value:
            self.add(time_s, value)
        self._arrays = None

    def _forget(self, before_s: float) -> None:
        keep = max(bisect_right(self._starts, before_s) - 1, 0)
        for column in (self._starts, self._values, self._slopes, self._rests):
            del column[:keep]
        self._trim_at = max(_TRIM_ABOVE, 2 * len(self._starts))

    def _piece(self, time_s: float) -> tuple[int, float]:
        place = max(bisect_right(self._starts, time_s) - 1, 0)
        return place, max(time_s - self._starts[place], 0.0)

    def demand(self, time_s: float) -> float:
        """The demand at a time."""
        place, since = self._piece(time_s)
        return self._values[place] + self._slopes[place] * since

    def slope(self, time_s: float) -> float:
        """The demand's rate at a time, units per s."""
        return self._slopes[self._piece(time_s)[0]]

    def response(self, time_s: float) -> float:
        """The response at a time."""
        place, since = self._piece(time_s)
        slope = self._slopes[place]
        settled = self._values[place] + slope * (since - self._lag)
        return settled + self._rests[place] * math.exp(-since / self._lag)

    def final(self) -> tuple[float, float]:
        """Start of the last piece and its value."""
        return self._starts[-1], self._values[-1]

    def upcoming(self, time_s: float) -> list[tuple[float, float, float]]:
        """The piece at that time, cut there, and all later ones: (start, value, slope)."""
        place, _ = self._piece(time_s)
        first = (time_s, self.demand(time_s), self._slopes[place])
        rest = zip(self._starts[place + 1 :], self._values[place + 1 :], self._slopes[place + 1 :], strict=True)
        return [first, *rest]

    def responses(self, times: Array, earliest: float | None = None) -> Array:
        """The response at many times; ``earliest`` is the first of them, where that is known."""
        if self._slopes[-1] == 0.0 and times.size:
            first = times.min() if earliest is None else earliest
            if first - self._starts[-1] > _AT_REST_LAGS * self._lag:
                return np.full(times.shape, self._values[-1])
        if self._arrays is None:
            self._arrays = (
                np.array(self._starts),
                np.array(self._values),
                np.array(self._slopes),
                np.array(self._rests),
            )
        starts, values, slopes, rests = self._arrays
        if len(starts) == 1 and slopes[0] == 0.0 and rests[0] == 0.0:
            return np.full(times.shape, values[0])
        place = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        since = np.maximum(times - starts[place], 0.0)
        moved = slopes[place] * (since - self._lag)
        settled: Array = values[place] + moved + rests[place] * np.exp(-since / self._lag)
        return settled


class DirectionLog:
    """The sign of the last travel at any time; +1 before the first move."""

    def __init__(self, start_s: float) -> None:
        self._times = [start_s]
        self._signs = [1]

    @property
    def latest(self) -> int:
        """The sign of the last move begun."""
        return self._signs[-1]

    def turn(self, time_s: float, sign: int) -> bool:
        """Travel begins; returns whether it is a reversal."""
        if sign == self._signs[-1]:
            return False
        self._times.append(time_s)
        self._signs.append(sign)
        if len(self._times) > _TRIM_ABOVE:
            keep = max(bisect_right(self._times, time_s - HISTORY_S) - 1, 0)
            del self._times[:keep], self._signs[:keep]
        return True

    def at(self, times: Array) -> Array:
        """The sign at many times."""
        if times.size and times.min() >= self._times[-1]:
            return np.full(times.shape, float(self._signs[-1]))
        place = np.maximum(np.searchsorted(np.array(self._times), times, side="right") - 1, 0)
        signs: Array = np.array(self._signs, dtype=np.float64)[place]
        return signs
