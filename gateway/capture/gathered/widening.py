"""More targets in a capture that still stands: visited after the others, brought to their level, or left out again.

Some targets of the capture are visited on the way once more. They say how far the zero has moved since then, pass by
pass, so that what is new stands beside what was there as if it had been measured in the same passes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message
from drivers.types.stops import StopPlan
from drivers.types.values import FloatArray
from gateway.capture.collecting import READ, Collection
from gateway.capture.duration import reading_s
from gateway.capture.targets import measuring_plan, plan_of
from gateway.config import AxisSection
from gateway.evaluate.behaviour.repetitions import pass_offsets

ANCHORS = 5  # so many known targets are visited again
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Widening:
    """``found`` with the ``added`` targets (their indices) still to be visited, and ``plan`` that does so.

    ``anchors`` are targets that are there and on the plan; ``before`` the collection as it was.
    """

    before: Collection
    found: Collection
    added: Indices
    anchors: Indices
    plan: StopPlan

    @classmethod
    def of(cls, found: Collection, axis: AxisSection, places: FloatArray) -> Widening:
        """How these places (k,) are added to a collection."""
        wide, added = found.with_targets(places)
        known = np.setdiff1d(np.arange(len(wide.targets)), [*added, *wide.checks])
        anchors = known[np.unique(np.linspace(0, known.size - 1, ANCHORS).round().astype(np.int64))]
        plan = plan_through(axis, wide.targets, np.union1d(added, anchors))
        return cls(found, wide, added, anchors=anchors, plan=plan)

    def end(self) -> tuple[Collection, tuple[Message, ...]]:
        """The collection with every new target that is whole, levelled, and what was done."""
        again = self.found.deviations()
        whole = np.asarray(np.isfinite(again).all(axis=(1, 2)))
        self._as_it_was()
        kept = self.added[whole[self.added]]
        if whole[self.anchors].all():
            self._levelled(again, kept)
        else:
            kept = kept[:0]
        lost = np.setdiff1d(self.added, kept)
        told = Message.of("S-CAP-ADDED", count=kept.size)
        if not lost.size:
            return self.found, (told,)
        return self.found.without(lost), (told, Message.of("S-CAP-ADDED-LOST", count=lost.size))

    def _as_it_was(self) -> None:
        """Put the readings of the anchors back: their second visit only tells how far the zero has moved."""
        old = np.setdiff1d(np.arange(len(self.found.targets)), self.added)
        for name in READ:
            getattr(self.found, name)[self.anchors] = getattr(self.before, name)[np.searchsorted(old, self.anchors)]

    def _levelled(self, again: FloatArray, kept: Indices) -> None:
        own = np.setdiff1d(np.arange(len(again)), [*self.added, *self.found.checks])
        known = self.found.deviations()
        offsets = pass_offsets(known[own])
        level = np.nanmean(known[self.anchors] - offsets[None], axis=1)[:, None] + offsets[None]
        moved = np.nanmedian(again[self.anchors] - level, axis=0)
        for cell in np.ndindex(kept.size, *moved.shape):
            self.found.level((int(kept[cell[0]]), cell[1], cell[2]), float(moved[cell[1:]]))


def plan_through(axis: AxisSection, targets: FloatArray, some: Indices) -> StopPlan:
    """The axis' whole cycle over some of the targets, in a program of their own."""
    plan = measuring_plan(axis, targets[some], "", name=f"TFMORE{axis.letter}")
    stops = tuple(replace(stop, label=int(some[stop.label])) for stop in plan.stops)
    return plan_of(axis, stops, "", name=plan.name, dwell_s=axis.measure.dwell_s)


def cost_s(axis: AxisSection, count: int, span: float) -> float:
    """What ``count`` more targets over a ``span`` (mm or deg) of the axis cost: all passes there and back, s.

    By the site's own feed, dwell, settling and averaging, with the targets visited again on the way.
    """
    measure = axis.measure
    stop_s = measure.dwell_s + reading_s(measure)
    way = 2.0 * (span + 2.0 * measure.overrun) / measure.feed * 60.0
    return measure.repetitions * (2.0 * (count + ANCHORS) * stop_s + way)


def affordable(axis: AxisSection, hours: float, span: float) -> int:
    """How many more targets these hours pay for; 0 where they do not even pay for one."""
    none = cost_s(axis, 0, span)
    each = cost_s(axis, 1, span) - none
    return max(int((hours * 3600.0 - none) / each), 0)
