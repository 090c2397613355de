"""Before a set-up is left: further targets in the same capture, and readings out of line taken again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.message import Message
from drivers.types.stops import Stop, StopPlan
from drivers.types.values import FloatArray
from gateway.capture.collection import READ, Collection
from gateway.capture.targets import measuring_plan, plan_of, reading_s
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.errors import Incomplete
from gateway.evaluate.behaviour.repetitions import doubtful_readings, good_readings, pass_offsets
from gateway.interlocks import MAX_SUSPECT_SHARE, MIN_REPETITIONS

# More targets in a capture that still stands: visited after the others, brought to their level, or left out again.
#
# Some targets of the capture are visited on the way once more. They say how far the zero has moved since then, pass by
# pass, so that what is new stands beside what was there as if it had been measured in the same passes.

ANCHORS = 5  # so many known targets are visited again
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class AddedTargets:
    """``found`` with the ``added`` targets (their indices) still to be visited, and ``plan`` that does so.

    ``anchors`` are targets that are there and on the plan; ``before`` the collection as it was.
    """

    before: Collection
    found: Collection
    added: Indices
    anchors: Indices
    plan: StopPlan

    @classmethod
    def of(cls, found: Collection, axis: AxisSection, places: FloatArray) -> AddedTargets:
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
            self._level_passes(again, kept)
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

    def _level_passes(self, again: FloatArray, kept: Indices) -> None:
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


# Readings out of line are taken again before a set-up is left, and a capture that is not whole is refused there.
#
# A stop in doubt is visited again together with its nearest neighbours that are in line. They say how far the zero has
# moved since then, so that the new reading stands in its own pass and at its own time.
#
# A reading that is out of line again has not been wrong by itself: its repetitions disagree with it, and two of three
# may agree on what is wrong. Then all repetitions of that stop are taken again.

# Of three, one may be out of line itself.
NEIGHBOURS = 3
# So many may always be taken again, however few stops there are.
ALWAYS = 4
NAMED = 5
# So many good readings make a mean and a doubt of it; an axis that a table is made for needs more.
FEWEST = 2
Cell = tuple[int, int, int]


@dataclass(frozen=True)
class Retake:
    """What is taken again: the ``cells`` in doubt (target, repetition, approach index), and the ``stops`` on the way.

    ``level`` (m, n, 2) is where each reading would lie by its repetitions and its pass; ``values``, ``times`` and
    ``sigmas`` are those of the collection as it was.
    """

    cells: tuple[Cell, ...]
    stops: tuple[Stop, ...]
    level: FloatArray
    values: FloatArray
    times: FloatArray
    sigmas: FloatArray

    @classmethod
    def of(cls, found: Collection, before: Retake | None = None) -> Retake | None:
        """What a collection leaves in doubt; None where nothing is, or so much that the set-up itself is at fault.

        ``before`` is what the round before has taken again. What an onlooker asks for is taken again beside it.
        """
        seen = found.deviations()
        doubted, level = _doubtful_readings(seen, found.checks, () if before is None else before.cells)
        for cell in found.asked():
            doubted[cell] = np.isfinite(seen[cell])
        cells = tuple((int(i), int(j), int(a)) for i, j, a in np.argwhere(doubted))
        if not cells or len(cells) > max(ALWAYS, MAX_SUSPECT_SHARE * np.isfinite(seen).sum()):
            return None
        way = {cell for one in cells for cell in (one, *_neighbours(one, np.isfinite(seen) & ~doubted))}
        stops = tuple(found.stop(cell) for cell in sorted(way, key=_along))
        return cls(
            cells=cells,
            stops=stops,
            level=level,
            values=found.values.copy(),
            times=found.times.copy(),
            sigmas=found.sigmas.copy(),
        )

    def begin(self, found: Collection) -> None:
        """Let the collection miss what is taken again."""
        for stop in self.stops:
            found.times[_cell(stop)] = np.nan

    def end(self, found: Collection) -> Message:
        """Put what was taken into its passes and all else back as it was; what was done."""
        again, there = found.deviations(), np.isfinite(found.times)
        values, sigmas = found.values.copy(), found.sigmas.copy()
        found.values[:], found.times[:], found.sigmas[:] = self.values, self.times, self.sigmas
        usable, done = self._neighbours_on_way(), []
        for cell in self.cells:
            beside = [one for one in _neighbours(cell, usable) if there[one]]
            if not there[cell] or not beside:
                continue
            before = found.deviations()[cell]
            found.values[cell], found.sigmas[cell] = values[cell], sigmas[cell]
            found.level(cell, float(np.median([again[one] - self.level[one] for one in beside])))
            change = found.size(before - found.deviations()[cell])
            done.append(Message.of("S-CAP-AGAIN-ONE", change=change, **found.told(cell)))
        more = [Message.of("S-CAP-AGAIN-MORE", count=len(done) - NAMED)] if len(done) > NAMED else []
        what = (*done[:NAMED], *more) or Message.of("S-CAP-AGAIN-NONE")
        return Message.of("S-CAP-AGAIN", count=len(self.cells), what=what)

    def _neighbours_on_way(self) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Where the neighbours on the way are, (m, n, 2)."""
        on_way = np.zeros(self.times.shape, dtype=np.bool_)
        for stop in self.stops:
            on_way[_cell(stop)] = _cell(stop) not in self.cells
        return on_way


def _doubtful_readings(
    seen: FloatArray, checks: tuple[int, ...], taken: tuple[Cell, ...]
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.bool_]], FloatArray]:
    """Which readings (m, n, 2) are in doubt, and where each would lie by its repetitions and its pass."""
    kept = np.setdiff1d(np.arange(len(seen)), checks)
    offsets = pass_offsets(seen[kept])
    level = seen - offsets[None]
    doubted = np.zeros(seen.shape, dtype=np.bool_)
    for rows in (kept, np.asarray(checks, dtype=np.int64)):
        if rows.size:
            doubted[rows] = doubtful_readings(level[rows])
    for index, repetition, approach in taken:
        if doubted[index, repetition, approach]:
            doubted[index, :, approach] = np.isfinite(seen[index, :, approach])
    good = np.where(doubted, np.nan, level)
    n = np.isfinite(good).sum(axis=1)
    centre = np.divide(np.nansum(good, axis=1), n, out=np.full(n.shape, np.nan), where=n > 0)
    return doubted, np.asarray(centre[:, None, :] + offsets[None])


def _neighbours(cell: Cell, usable: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> list[Cell]:
    """The nearest usable readings of the same pass."""
    index, repetition, approach = cell
    others = [int(i) for i in np.flatnonzero(usable[:, repetition, approach]) if i != index]
    nearest = sorted(others, key=lambda i: abs(i - index))[:NEIGHBOURS]
    return [(i, repetition, approach) for i in nearest]


def _along(cell: Cell) -> tuple[int, int, int]:
    """Pass after pass, each in its own direction."""
    index, repetition, approach = cell
    return repetition, approach, index if approach == 0 else -index


def _cell(stop: Stop) -> Cell:
    return stop.label, stop.repetition, 0 if stop.approach == 1 else 1


def require_complete(capture: Capture) -> None:
    """Raises Incomplete (E-CAP-INCOMPLETE) while the set-up still stands, where a place has too few good readings.

    As many as the push of a table asks for, 2 of an error motion, and never more than were taken.
    """
    needed = min(MIN_REPETITIONS if capture.sense is not None else FEWEST, capture.deviations.shape[1])
    short = np.argwhere(good_readings(capture.deviations, capture.suspects) < needed)
    if not short.size:
        return
    places = [f"{capture.targets[i]:g}{'+-'[a]}" for i, a in short[:NAMED]]
    named = ", ".join(places) + (" ..." if len(short) > NAMED else "")
    fields = {"places": len(short), "total": capture.targets.size * 2, "needed": needed, "named": named}
    raise Incomplete("E-CAP-INCOMPLETE", capture.axis, component=capture.component, axis=capture.axis, **fields)
