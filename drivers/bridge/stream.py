"""Bridge samples and frames to sample blocks: order and loss checked, what follows a broken beam marked, pure."""

from __future__ import annotations

import numpy as np

from drivers.bridge.frames import SampleFrame
from drivers.bridge.records import BREAKS, BridgeSamples, Event
from drivers.errors import RemoteProtocolError
from drivers.types.sensing import SampleBlock
from drivers.types.values import FloatArray


class BridgeStream:
    """One stream from its start on.

    ``order`` names, for each channel, its column in a frame; the first sample after the start has number 0.
    """

    def __init__(self, channels: tuple[str, ...], where: str, order: tuple[int, ...] | None = None) -> None:
        self._channels = channels
        self._order = None if order in (None, tuple(range(len(channels)))) else order
        self._where = where
        self._next = 0
        self._began_s = np.nan
        self._latest_s = -np.inf
        self._said: list[Event] = []
        self._damaged = 0
        self.repeats = 0
        self.damaged_bytes = 0

    def note(self, events: tuple[Event, ...]) -> None:
        """Events that were told apart from samples: they belong to the next block."""
        self._said += events

    def spoil(self, skipped: int) -> None:
        """Bytes that could not be read: the next block tells of them."""
        self._damaged += skipped
        self.damaged_bytes += skipped

    def take(self, samples: BridgeSamples) -> SampleBlock | None:
        """The block, None for one that came twice. Raises RemoteProtocolError (E-BRIDGE-CLOCK)."""
        lost = self._lost(samples.sequence, samples.t0_s, len(samples.valid), samples.lost)
        if lost is None:
            return None
        time_s = self._times(samples.t0_s, samples.dt_s, len(samples.valid))
        values = np.column_stack([samples.values[name] for name in self._channels])
        events = (*self._told(), *samples.events)
        valid = samples.valid & ~_broken(events, time_s)
        return SampleBlock(
            channels=self._channels, time_s=time_s, values=values, valid=valid, lost=lost, events=self._texts(events)
        )

    def take_frame(self, frame: SampleFrame) -> SampleBlock | None:
        """As `take`. Raises RemoteProtocolError (E-BRIDGE-CLOCK, E-BRIDGE-FIELD: another number of channels)."""
        if frame.values.shape[1] != len(self._channels):
            wanted, got = f"{len(self._channels)}", f"{frame.values.shape[1]}"
            raise RemoteProtocolError("E-BRIDGE-FIELD", self._where, field="channels", wanted=wanted, got=got)
        lost = self._lost(frame.sequence, frame.t0_s, len(frame), frame.lost)
        if lost is None:
            return None
        time_s = self._times(frame.t0_s, frame.dt_s, len(frame))
        events = self._told()
        valid = np.full(len(frame), frame.valid)
        if events:
            valid &= ~_broken(events, time_s)
        values = frame.values if self._order is None else frame.values[:, list(self._order)]
        return SampleBlock(
            channels=self._channels, time_s=time_s, values=values, valid=valid, lost=lost, events=self._texts(events)
        )

    def _told(self) -> tuple[Event, ...]:
        said, self._said = tuple(self._said), []
        return said

    def _texts(self, events: tuple[Event, ...]) -> tuple[str, ...]:
        texts = tuple(map(str, events))
        if self._damaged:
            texts = (f"{self._damaged} damaged bytes", *texts)
            self._damaged = 0
        return texts

    def _lost(self, sequence: int, t0_s: float, count: int, lost: int) -> int | None:
        """Samples lost just before; None for what came already. A stream that begins anew starts at 0."""
        fresh = sequence == 0 and t0_s != self._began_s
        gap = 0 if fresh else sequence - self._next
        if gap < 0:
            self.repeats += 1
            return None
        self._next = sequence + count
        if fresh:
            self._began_s = t0_s
        return 0 if fresh else max(gap, lost)

    def _times(self, t0_s: float, dt_s: float, count: int) -> FloatArray:
        time_s = np.arange(count, dtype=np.float64)
        time_s *= dt_s
        time_s += t0_s
        if count and time_s[0] <= self._latest_s:
            before, now = f"{self._latest_s:.6f}", f"{time_s[0]:.6f}"
            raise RemoteProtocolError("E-BRIDGE-CLOCK", self._where, before=before, now=now)
        self._latest_s = float(time_s[-1]) if count else self._latest_s
        return time_s


def _broken(events: tuple[Event, ...], time_s: FloatArray) -> np.ndarray:
    """Samples (n,) from a break to the datum after it, or to the block's end."""
    broken = np.zeros(len(time_s), np.bool_)
    for event in events:
        if event.kind in BREAKS:
            broken |= time_s >= event.at_s
        elif event.kind == "datum":
            broken &= time_s < event.at_s
    return broken
