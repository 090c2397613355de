"""Sequence numbers to ticks of the counter's clock: gaps, repeats, wraps and restarts told apart, pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.umd.codec import SEQUENCE
from drivers.umd.numerals import IntArray

LONGEST_GAP = 600_000
NEIGHBOUR = 64
# uMD0 prints the low 16 bits as a signed number, older firmware 32 bits, uMD2 all 64.
WRAPS = (1 << 16, 1 << 32)


@dataclass(frozen=True, slots=True, eq=False)
class Ordered:
    """Rows in order: ``steps`` (n,) ticks since the row before (1: nothing lost), ``restarted`` (n,).

    ``unbroken``: every step is 1 and nothing restarted.
    """

    rows: IntArray
    steps: IntArray
    restarted: NDArray[np.bool_]
    unbroken: bool = False

    @property
    def adjacent(self) -> NDArray[np.bool_]:
        """Rows (n,) whose counts may be compared with the row before."""
        if self.unbroken:
            return np.ones(len(self.rows), np.bool_)
        return (self.steps == 1) & ~self.restarted

    def without(self, places: NDArray[np.intp]) -> Ordered:
        """Rows at ``places`` taken for lost: their steps go to the rows after them."""
        if not len(places):
            return self
        kept = np.ones(len(self.rows), np.bool_)
        kept[places] = False
        ticks = np.cumsum(self.steps)[kept]
        return Ordered(self.rows[kept], np.diff(ticks, prepend=0), self.restarted[kept])


class SequenceOrder:
    """Follows the sequence field. Repeats are dropped and counted, a lone absurd number with its row too."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._held: IntArray | None = None
        self._begun = False
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
        least, most = int(steps.min()), int(steps.max())
        if least >= 1 and most <= LONGEST_GAP:
            ordered = Ordered(rows, steps, np.zeros(len(rows), np.bool_), most == 1)
        else:
            ordered = self._sort_slowly(rows, first)
        return self._confirmed(ordered, first)

    def _confirmed(self, ordered: Ordered, first: int) -> Ordered:
        """A last row that follows a gap waits for its neighbour: together they show whether it is whole."""
        rows, steps = ordered.rows, ordered.steps
        if self._held is None and len(rows) and steps[-1] > 1:
            self._held = rows[-1:]
            ordered = Ordered(rows[:-1], steps[:-1], ordered.restarted[:-1], bool((steps[:-1] == 1).all()))
        self._last = int(ordered.rows[-1, SEQUENCE]) if len(ordered.rows) else first if self._begun else None
        self._begun = self._begun or bool(len(ordered.rows))
        return ordered

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
            # A jump ahead whose neighbour goes on where the numbers were before is a damaged number, not a gap.
            if step > 1 and believable and at + 1 < len(numbers) and 1 <= forward(last, numbers[at + 1]) < step:
                self.absurd += 1
                continue
            if not believable and not 1 <= numbers[at + 1] - number <= NEIGHBOUR:
                self.absurd += 1
                continue
            kept.append(at)
            steps.append(max(step, 1))
            restarted.append(step < 1)
            last = number
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
