"""The raw record of a capture: averages as the instrument gave them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.message import Message
from drivers.types.sensing import Ambient
from drivers.types.tables import LiveSet
from drivers.types.values import FloatArray
from gateway.capture.collecting import Collection


@dataclass(frozen=True, slots=True)
class RawCapture:
    """Averages as the instrument gave them, sense not yet applied.

    ``values`` shape (m, n, 2, channels): target, repetition, approach + then -; ``time_s`` (m, n, 2) in
    instrument time; ``window_sigma`` (m, n, 2) of the combined quantity in the axis unit.
    ``ambient`` is the environment at the start of each one-way pass and after the last. ``notes`` tell what
    was taken again. ``checks`` are indices of targets that are check stops only, ``added`` those of targets that came
    later than the others. ``standing`` are readings at rest.
    """

    targets: FloatArray
    channels: tuple[str, ...]
    values: FloatArray
    time_s: FloatArray
    window_sigma: FloatArray
    window_count: int
    ambient: tuple[Ambient, ...]
    ambient_time_s: FloatArray
    live: LiveSet
    started_utc: str
    ended_utc: str
    lost_samples: int
    notes: tuple[Message, ...] = ()
    checks: tuple[int, ...] = ()
    added: tuple[int, ...] = ()
    standing: tuple[float, ...] = ()


def raw_capture(
    found: Collection,
    targets: FloatArray,
    channels: tuple[str, ...],
    live: LiveSet,
    times: tuple[str, str],
    lost: int,
) -> RawCapture:
    """What was collected as a record; ``times`` are start and end in UTC."""
    started, ended = times
    return RawCapture(
        targets=targets,
        channels=channels,
        values=found.values,
        time_s=found.times,
        window_sigma=found.sigmas,
        window_count=int(np.median(found.counts)),
        ambient=tuple(found.ambients),
        ambient_time_s=np.asarray(found.ambient_times),
        live=live,
        started_utc=started,
        ended_utc=ended,
        lost_samples=lost,
        notes=tuple(found.notes),
        standing=found.standing,
    )
