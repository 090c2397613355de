"""Bridge samples to sample blocks: order and loss checked, samples after a broken beam marked, pure."""

from __future__ import annotations

import numpy as np

from drivers.bridge.records import BREAKS, BridgeSamples
from drivers.errors import RemoteProtocolError
from drivers.types import SampleBlock


class BridgeStream:
    """One stream from its start on."""

    def __init__(self, channels: tuple[str, ...], where: str) -> None:
        self._channels = channels
        self._where = where
        self._next: int | None = None
        self._latest_s = -np.inf
        self.repeats = 0

    def take(self, samples: BridgeSamples) -> SampleBlock | None:
        """The block, None for one that came twice. Raises RemoteProtocolError (E-BRIDGE-CLOCK)."""
        count = len(samples.valid)
        fresh = self._next is None or samples.sequence == 0
        gap = 0 if fresh else samples.sequence - (self._next or 0)
        if gap < 0:
            self.repeats += 1
            return None
        self._next = samples.sequence + count
        time_s = samples.t0_s + samples.dt_s * np.arange(count, dtype=np.float64)
        if count and time_s[0] <= self._latest_s:
            before, now = f"{self._latest_s:.6f}", f"{time_s[0]:.6f}"
            raise RemoteProtocolError("E-BRIDGE-CLOCK", self._where, before=before, now=now)
        self._latest_s = float(time_s[-1]) if count else self._latest_s
        values = np.column_stack([samples.values[name] for name in self._channels])
        events = tuple(str(event) for event in samples.events)
        valid = samples.valid & ~_broken(samples, time_s)
        return SampleBlock(self._channels, time_s, values, valid, 0 if fresh else max(gap, samples.lost), events)


def _broken(samples: BridgeSamples, time_s: np.ndarray) -> np.ndarray:
    """Samples (n,) from a break to the datum after it, or to the block's end."""
    broken = np.zeros(len(time_s), np.bool_)
    for event in samples.events:
        if event.kind in BREAKS:
            broken |= time_s >= event.at_s
        elif event.kind == "datum":
            broken &= time_s < event.at_s
    return broken
