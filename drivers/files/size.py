"""Room for what a result file holds: a short file may claim a huge grid, and is refused before it gets one."""

from __future__ import annotations

import numpy as np

from drivers.errors import FileFormatError
from drivers.types.values import FloatArray

MOST_READINGS = 4_000_000


def no_readings(targets: int, repetitions: int, where: str) -> FloatArray:
    """Room for readings of both directions, all NaN, shape (targets, repetitions, 2).

    Raises FileFormatError (E-FILE-SIZE) where the file asks for more than any measurement has.
    """
    if 2 * targets * repetitions > MOST_READINGS:
        raise FileFormatError("E-FILE-SIZE", where, targets=targets, repetitions=repetitions, limit=MOST_READINGS)
    return np.full((targets, repetitions, 2), np.nan)
