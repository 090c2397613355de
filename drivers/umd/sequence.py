"""Sequence numbers to ticks of the counter's clock: gaps, repeats, wraps and restarts told apart, pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.umd.codec import SEQUENCE, IntArray

LONGEST_GAP = 600_000
NEIGHBOUR = 64
# uMD0 prints the low 16 bits as a signed number, older firmware 32 bits, uMD2 all 64.
WRAPS = (1 << 16, 1 << 32)


@dataclass(frozen=True, slots=True, eq=False)
class Ordered:
    """Rows in order: ``steps`` (n,) ticks since the row before (1: nothing lost), ``restarted`` (n,)."""

    rows: IntArray
    steps: IntArray
    restarted: NDArray[np.bool_]


class SequenceOrder:
    """Follows the sequence field. Repeats are dropped and counted, a lone absurd number with its row too."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._held: IntArray | None = None
        self.repeats = 0
        self.absurd = 0

    @property
    def last(self) -> int | None:
        """The newest sequence number accepted."""
        return self._last

    def sort(self, rows: IntArray) -> Ordered:
        """Rows (n, w) as received to the rows to believe, in order."""
        if self._held is not None and self._held.shape[1] == rows.shape[1]:
            rows = np.concatenate((self._held, rows))
        self._held = None
        if not len(rows):
            return Ordered(rows, np.empty(0, np.int64), np.empty(0, np.bool_))
        numbers = rows[:, SEQUENCE]
        first = int(numbers[0]) - 1 if self._last is None else self._last
        steps = np.diff(numbers, prepend=first)
        if bool((steps >= 1).all()) and bool((steps <= LONGEST_GAP).all()):
            self._last = int(numbers[-1])
            return Ordered(rows, steps, np.zeros(len(rows), np.bool_))
        return self._sort_slowly(rows, first)

    def _sort_slowly(self, rows: IntArray, last: int) -> Ordered:
        numbers: list[int] = rows[:, SEQUENCE].tolist()
        kept: list[int] = []
        steps: list[int] = []
        restarted: list[bool] = []
        for at, number in enumerate(numbers):
            step = forward(last, number)
            if -NEIGHBOUR < step <= 0:
                self.repeats += 1
                continue
            believable = 1 <= step <= LONGEST_GAP
            if not believable and at + 1 == len(numbers):
                self._held = rows[at:]
                break
            if not believable and not 1 <= numbers[at + 1] - number <= NEIGHBOUR:
                self.absurd += 1
                continue
            kept.append(at)
            steps.append(max(step, 1))
            restarted.append(step < 1)
            last = number
        self._last = last
        return Ordered(rows[kept], np.array(steps, np.int64), np.array(restarted, np.bool_))


def forward(last: int, number: int) -> int:
    """Ticks from `last` to `number`, over a wrap where that gives a believable step."""
    step = number - last
    if step > -NEIGHBOUR:
        return step
    for wrap in WRAPS:
        signed = number < 0 <= last
        unsigned = number >= 0 and last >= wrap - LONGEST_GAP and wrap > 1 << 16
        if (signed or unsigned) and 1 <= step + wrap <= min(LONGEST_GAP, wrap >> 4):
            return step + wrap
    return step
