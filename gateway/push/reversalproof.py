"""The sign proof of a constant reversal: B with and without it, measured by coming from both sides.

A trial value of 3 um or 3 arcsec is switched on and off while the axis goes away and comes back: what changes is
B = mean(+) - mean(-), so it does not matter whether a control takes a new value up at once or at the next turn.
"""

from __future__ import annotations

import numpy as np

from drivers.types.stops import Stop
from drivers.types.tables import CompensationTable, reversal_of
from gateway.axes import AxisRecord

ROUNDS = 6
"""Four stops make one step, so one reading out of line must not decide: the median of so many does not heed it."""
_WAYS = (1, -1, 1)  # the first stop switches and is not read; the two others give B


def trial_of(axis: AxisRecord, peak: float) -> tuple[CompensationTable, float]:
    """The trial value of an axis, and the place in its room where B is measured."""
    return reversal_of(axis.name, axis.unit, peak, axis.encoder), float(np.mean(axis.room))


def stops_at(place: float, times: int) -> tuple[Stop, ...]:
    """Off, then on, each measured from - and from +; as often as asked."""
    one_round = [(way, number, on) for on in (False, True) for number, way in enumerate(_WAYS)]
    return tuple(
        Stop(place, 1 if way > 0 else -1, repetition, label, switch=on if number == 0 else None)
        for repetition in range(times)
        for label, (way, number, on) in enumerate(one_round)
    )


def reversals(readings: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """B with its u from readings after - and + in turn, off and on alternating as `signproof.steps_of` wants them."""
    after = np.asarray(readings, dtype=np.float64).reshape(-1, 2, 2)
    B = after[:, 1, 0] - after[:, 0, 0]
    u = np.hypot(after[:, 1, 1], after[:, 0, 1])
    return [(float(value), float(doubt)) for value, doubt in zip(B, u, strict=True)]
