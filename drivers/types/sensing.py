"""What an instrument tells: air, samples, optics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message
from drivers.types.values import FloatArray


@dataclass(frozen=True, slots=True)
class Ambient:
    """Air and material readings. None means not connected; never assumed to be 20 degC."""

    air_degc: float | None = None
    pressure_hpa: float | None = None
    humidity_pct: float | None = None
    material_degc: tuple[float, ...] = ()
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """A block of consecutive readings of one instrument, stamped in instrument time.

    ``time_s`` shape (n,): instrument time, sequence number / sample frequency or the bridge's time stamp.
    ``values`` shape (n, len(channels)), in the unit that ends each channel's name.
    ``valid`` shape (n,): false while the beam is obstructed or the sample is marked bad.
    ``lost`` counts samples the instrument skipped just before this block.
    ``events`` messages of the instrument about this block: an event at a moment has the fields ``kind`` and ``at_s``
    (instrument time, s), and a kind that begins with "trigger" starts a capture that waits for an external trigger.
    """

    channels: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray
    valid: NDArray[np.bool_]
    lost: int = 0
    events: tuple[Message, ...] = ()

    def __len__(self) -> int:
        return int(self.time_s.shape[0])


@dataclass(frozen=True, slots=True)
class Optics:
    """What is mounted in the beam, as far as the instrument itself can tell ("unknown" else)."""

    kind: str = "unknown"
    detail: str = ""
