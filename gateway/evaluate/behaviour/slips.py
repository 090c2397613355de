"""Jumps within a pass that neither the neighbours nor the other pass share: a slipped fringe, a bumped optic; pure.

With three repetitions and more a reading is compared with its repetitions (`repetitions.out_of_line`). With one or two
nobody can vote, but a jump still shows against the scatter of the set itself.

Theory. Two passes of one way, or where there is one repetition the pass up and the pass down, have the axis in common:
their difference y is scatter, reversal and drift, all of which change little from target to target. Of it the first
differences are taken. A single pass has nothing to be subtracted: of it the distances from the line through both
neighbours are taken, in which a curve that is smooth over three targets vanishes. Either way r = W y with rows of unit
length, so white scatter of standard deviation s gives each r the variance s^2.

A jump of size J behind one target (a slip: all later readings are shifted) or at one target (a bump: one reading) adds
J W h with h a step or a single one. Its estimate is J = (t.r) / |t|^2, t = W h; it stands out by
    T = |t.r| / |t| / s,   s^2 = (|r|^2 - (t.r)^2 / |t|^2) / (m - 1),
where s is that of what the jump leaves over, so a large jump does not hide itself. T is the largest over all places.
What the limit must be follows from normal scatter alone, whatever s is: the 99.8 % quantile of T for m differences,
simulated (100 000 sets for each m) and bounded by a + b / (m - c). Two such sequences of a set then raise a false
alarm in less than 1 of 200 sets. Curves with waves, random walks and rounded readings raise fewer (see the tests).
s is at least what rounding to the readings' last digit leaves; less than half a wavelength is no slip of a counter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gateway.domain.values import FloatArray

FEWEST, MOST_REPETITIONS = 6, 2
LEAST = 0.32
"""um or arcsec: half a wavelength of a red laser is the least that a counter of fringes slips by."""
_BOUND = {1: (5.4, 28.0, 2.2), 2: (6.0, 40.0, 2.6)}
"""a, b, c of the limit, by the order of the differences."""
DIGITS, WIDE = 9, 2.0
"""Across a step that is wider than so many usual ones a curve bends too much for its neighbours to say anything."""


class Slip(NamedTuple):
    """A jump by ``size`` between two neighbouring targets, or at one of them (``low`` = ``high``).

    ``limit`` is what a jump must exceed in this set. ``repetition`` and ``way`` (0 or 1) name the pass; where two
    passes were compared it may have been the other one.
    """

    low: float
    high: float
    size: float
    limit: float
    repetition: int
    way: int


def limit_of(differences: int, order: int) -> float:
    """The largest T that normal scatter reaches in 99.8 % of all sets of so many differences of an order."""
    a, b, c = _BOUND[order]
    return a + b / (differences - c)


def slips(targets: FloatArray, deviations: FloatArray) -> list[Slip]:
    """The clearest jump of each pass (or pair of passes) of deviations (m, n, 2), n at most 2, the largest first.

    None with more repetitions, which say more themselves, and none of a pass of fewer than six readings.
    """
    if deviations.shape[1] > MOST_REPETITIONS:
        return []
    order = np.argsort(targets, kind="stable")
    at, x = targets[order], deviations[order]
    found = [_clearest(at, y, where) for y, where in _sequences(x)]
    return sorted((one for one in found if one is not None), key=lambda one: -abs(one.size))


def _sequences(x: FloatArray) -> list[tuple[FloatArray, tuple[int, int, int]]]:
    """What is looked at, each (m,), with repetition, way and the order of its differences."""
    there = np.asarray(np.isfinite(x).any(axis=0))
    both = [way for way in (0, 1) if x.shape[1] == MOST_REPETITIONS and bool(there[:, way].all())]
    if both:
        return [(x[:, 1, way] - x[:, 0, way], (1, way, 1)) for way in both]
    passes = [(int(run), int(way)) for run, way in np.argwhere(there)]
    if len(passes) == 2:
        (run, way), (other, back) = passes
        return [(x[:, run, way] - x[:, other, back], (run, way, 1))]
    return [(x[:, run, way], (run, way, 2)) for run, way in passes]


def _clearest(at: FloatArray, y: FloatArray, where: tuple[int, int, int]) -> Slip | None:
    run, way, order = where
    known = np.isfinite(y)
    at, y = at[known], y[known]
    if y.size < FEWEST or not np.ptp(at) > 0.0:
        return None
    w = _rows(at, order)
    count = y.size
    # Before the second and behind the last but one a step is that of one reading.
    steps = [np.arange(count) > place for place in range(1, count - 2)]
    shapes = np.array([*steps, *np.eye(count)], dtype=np.float64)
    t = shapes @ w.T
    length = np.linalg.norm(t, axis=1)
    r = w @ y
    if r.size < FEWEST - order:
        return None
    along = np.divide(t @ r, length, out=np.zeros(length.shape), where=length > 0.1 * float(length.max()))
    best = int(np.argmax(np.abs(along)))
    rest = max(float(r @ r) - float(along[best]) ** 2, 0.0) / (r.size - 1)
    scatter = max(float(np.sqrt(rest)), _rounding(y))
    far = limit_of(r.size, order) * scatter / float(length[best])
    size, limit = float(along[best] / length[best]), max(far, LEAST)
    if abs(size) <= limit:
        return None
    low, high = (best + 1, best + 2) if best < len(steps) else (best - len(steps),) * 2
    return Slip(float(at[low]), float(at[high]), size, limit, repetition=run, way=way)


def _rows(at: FloatArray, order: int) -> FloatArray:
    """Rows of unit length that take the differences: of neighbours, or from the line through both neighbours."""
    count = at.size
    w = np.zeros((count - order, count))
    rows = np.arange(count - order)
    if order == 1:
        w[rows, rows], w[rows, rows + 1] = -1.0, 1.0
    else:
        steps = np.maximum(np.diff(at), float(np.ptp(at)) * 1e-9)
        share = steps[:-1] / (steps[:-1] + steps[1:])
        w[rows, rows], w[rows, rows + 1], w[rows, rows + 2] = share - 1.0, 1.0, -share
        w = w[np.maximum(steps[:-1], steps[1:]) <= WIDE * np.median(steps)]
    return np.asarray(w / np.linalg.norm(w, axis=1, keepdims=True))


def _rounding(y: FloatArray) -> float:
    """The standard deviation that rounding leaves: the least step between values is their last digit."""
    steps = np.diff(np.unique(np.round(y, DIGITS)))
    return float(steps.min()) / float(np.sqrt(12.0)) if steps.size else 0.0
