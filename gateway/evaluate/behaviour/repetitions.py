"""Means of repeated readings for the fit: passes levelled against drift, outliers left out; jumps found in one pass."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gateway.domain.values import FloatArray
from gateway.evaluate.standards import statistics

SUSPECT_FACTOR = 6.0
OTHERS_FACTOR = 3.0
# A reading is doubted, while it can still be taken again, a little before it would be left out.
DOUBT = 5.0 / 6.0
MOST_TOLD = 5
FEWEST_PAIRS = 5
TOGETHER = 32  # repetitions compared with their others at a time, for their sets of others fill the memory
MAD_TO_SIGMA = 1.4826
Q80_TO_SIGMA = 1.2816


@dataclass(frozen=True, slots=True)
class RobustMeans:
    """What the fit is given: all arrays (m,), in the deviation unit, NaN where there is no reading.

    ``mean`` is the mean of both approaches (one approach less half the median reversal where the other
    is missing), ``u`` its standard uncertainty from ``s``, the pooled standard deviation of one reading
    with passes levelled. ``pass_offsets`` (n, 2) is the common shift of each pass. ``suspects`` lists
    (target, repetition, approach index) left out here; the ISO evaluation keeps them. An approach whose readings do
    not agree among themselves is left out too, where the other one of its target is known (`lost`).
    """

    mean_up: FloatArray
    mean_down: FloatArray
    mean: FloatArray
    u: FloatArray
    s: float
    pass_offsets: FloatArray
    suspects: tuple[tuple[int, int, int], ...]


def robust_means(targets: ArrayLike, deviations: ArrayLike) -> RobustMeans:
    """Summarise deviations (m, n, 2) robustly.

    A reading is a suspect when it differs from the median of its repetitions by more than 6 robust standard
    deviations (pooled over all targets, passes levelled) and clearly more than those differ among
    themselves; three repetitions at least. A shift shared by a whole pass (drift) is no suspicion.
    Raises ModelError as `readings.checked`.
    """
    _, x = statistics.check_readings(targets, deviations)
    offsets = pass_offsets(x)
    level = x - offsets[None, :, :]
    out = _suspects(level)
    kept = np.where(out, np.nan, level)
    kept = np.where(inconsistent_targets(kept)[:, None, :], np.nan, kept)
    up, down = statistics.means(kept).T
    s = _pooled_scale(kept)
    mean, u = _both(up, down, statistics.counts(kept), s)
    found = tuple((int(i), int(j), int(a)) for i, j, a in np.argwhere(out))
    return RobustMeans(mean_up=up, mean_down=down, mean=mean, u=u, s=s, pass_offsets=offsets, suspects=found)


def consistent_readings(targets: ArrayLike, deviations: ArrayLike) -> FloatArray:
    """The readings (m, n, 2) that `robust_means` takes its means of: those out of line are NaN, passes levelled.

    What is complete and in line is returned as it is: its plain means are the same. Raises ModelError as
    `readings.checked`.
    """
    _, x = statistics.check_readings(targets, deviations)
    offsets = pass_offsets(x)
    level = x - offsets[None, :, :]
    kept = np.where(_suspects(level), np.nan, level)
    kept = np.where(inconsistent_targets(kept)[:, None, :], np.nan, kept)
    ways = np.isfinite(x).any(axis=(0, 1))
    return kept if np.isnan(kept[:, :, ways]).any() else x


def mean_of_both(up: ArrayLike, down: ArrayLike) -> FloatArray:
    """Mean (m,) of means of approach + and - (m,), NaN where one is missing.

    A target reached in one direction alone counts half the median reversal of the others off, so it makes no kink of
    half the reversal; with one direction everywhere that one is the mean.
    """
    plus, minus = np.asarray(up, dtype=np.float64), np.asarray(down, dtype=np.float64)
    reversal = plus - minus
    known = reversal[np.isfinite(reversal)]
    half = float(np.median(known)) / 2.0 if known.size else 0.0
    one_way = np.where(np.isfinite(plus), plus - half, minus + half)
    return np.asarray(np.where(np.isfinite(reversal), (plus + minus) / 2.0, one_way))


def out_of_line(targets: ArrayLike, deviations: ArrayLike) -> list[tuple[tuple[int, int, int], float]]:
    """Each suspect of `robust_means` (target, repetition, approach) and how far off it is, the farthest first.

    Raises ModelError as `readings.checked`.
    """
    _, x = statistics.check_readings(targets, deviations)
    level = x - pass_offsets(x)[None, :, :]
    apart = level - _median(level, axis=1)[:, None, :]
    found = [(int(i), int(j), int(a)) for i, j, a in np.argwhere(_suspects(level))]
    return sorted(((one, float(apart[one])) for one in found), key=lambda one: -abs(one[1]))


def good_readings(deviations: ArrayLike, suspects: Iterable[tuple[int, int, int]]) -> NDArray[np.int64]:
    """How many readings of deviations (m, n, 2) are there and in line, for each target and approach, (m, 2)."""
    good = np.isfinite(np.asarray(deviations, dtype=np.float64))
    for target, repetition, approach in suspects:
        good[target, repetition, approach] = False
    return np.asarray(np.sum(good, axis=1), dtype=np.int64)


def doubtful_readings(level: FloatArray) -> NDArray[np.bool_]:
    """Which levelled readings (m, n, 2) are worth taking again: nearly suspects, and all where no most agree."""
    wild = _scattered_targets(level, DOUBT)[:, None, :] & np.isfinite(level)
    return np.asarray(_suspects(level, DOUBT) | _disagreeing_pairs(level) | wild)


def inconsistent_targets(level: FloatArray) -> NDArray[np.bool_]:
    """Targets and approaches (m, 2) whose levelled readings (m, n, 2) do not agree, while those of the other one do.

    The other approach and the reversal tell more of such a place. A target that scatters whichever way it is reached
    is known no better from either, and stays.
    """
    wild = _scattered_targets(level)
    there = statistics.counts(level) > 0
    return np.asarray(wild & (there & ~wild)[:, ::-1])


def _scattered_targets(level: FloatArray, share: float = 1.0) -> NDArray[np.bool_]:
    """Targets and approaches (m, 2) of three and more levelled readings of which no most agree, as all others do.

    Nobody can say which of them is right: most do not lie within 6 robust standard deviations of their median.
    """
    distance, _ = _from_others(level)
    limit = share * SUSPECT_FACTOR * _scale_of(distance)
    with np.errstate(invalid="ignore"):
        near = np.sum(np.abs(level - _median(level, axis=1)[:, None, :]) <= limit, axis=1)
    count = statistics.counts(level)
    return np.asarray((count >= 3) & (2 * near <= count) & (limit > 0.0))


def _disagreeing_pairs(level: FloatArray) -> NDArray[np.bool_]:
    """Of two readings nobody can say which is out of line; only that these two differ far more than all others."""
    two = statistics.counts(level) == 2
    gap = np.where(two, np.fmax.reduce(level, axis=1) - np.fmin.reduce(level, axis=1), 0.0)
    known = gap[two]
    if known.size < FEWEST_PAIRS:
        return np.zeros(level.shape, dtype=np.bool_)
    scale = _scale(known)
    out = (gap > DOUBT * SUSPECT_FACTOR * scale) & (scale > 0.0)
    return np.asarray(out[:, None, :] & np.isfinite(level))


def pass_offsets(x: FloatArray) -> FloatArray:
    """The shift (n, 2) that each pass of deviations (m, n, 2) has in common; the mean of each approach's is zero."""
    offsets = np.zeros(x.shape[1:])
    for _ in range(3):
        centre = _median(x - offsets[None], axis=1)
        residual = x - centre[:, None, :]
        step = _median(residual - offsets[None], axis=0)
        offsets = offsets + step
    for approach in range(2):
        known = np.isfinite(x[:, :, approach]).any(axis=0)
        shift = float(np.mean(offsets[known, approach])) if known.any() else 0.0
        offsets[:, approach] -= shift
    return offsets


def _median(values: FloatArray, axis: int) -> FloatArray:
    """Medians of the readings there are, 0 where there is none; numpy's own goes by masked arrays, 30 times slower."""
    ordered, size = np.sort(values, axis=axis), values.shape[axis]  # what is missing comes last
    there = np.isfinite(values)
    if there.all():
        return np.asarray(0.5 * (np.take(ordered, (size - 1) // 2, axis=axis) + np.take(ordered, size // 2, axis=axis)))
    count = np.sum(there, axis=axis, keepdims=True)
    low = np.take_along_axis(ordered, np.maximum((count - 1) // 2, 0), axis=axis)
    high = np.take_along_axis(ordered, np.minimum(count // 2, size - 1), axis=axis)
    return np.squeeze(np.where(count > 0, 0.5 * (low + high), 0.0), axis=axis)


def _suspects(level: FloatArray, share: float = 1.0) -> NDArray[np.bool_]:
    distance, spread = _from_others(level)
    far, apart = share * SUSPECT_FACTOR * _scale_of(distance), share * OTHERS_FACTOR * spread
    with np.errstate(invalid="ignore"):
        return np.asarray((distance > far) & (distance > apart))


def _from_others(level: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far each reading (m, n, 2) lies from the median of its repetitions, and how far those spread; NaN if few."""
    n = level.shape[1]
    distance, spread = np.full(level.shape, np.nan), np.full(level.shape, np.nan)
    each, rest = np.arange(n), np.arange(n - 1)
    for first in range(0, n if n >= 3 else 0, TOGETHER):
        some = each[first : first + TOGETHER]
        others = level[:, rest + (rest >= some[:, None])]  # (m, some, n - 1, 2)
        enough = np.isfinite(others).sum(axis=2) >= 2
        centre = np.where(enough, _median(others, axis=2), np.nan)
        distance[:, some] = np.abs(level[:, some] - centre)
        spread[:, some] = MAD_TO_SIGMA * _median(np.abs(others - centre[:, :, None]), axis=2)
    return distance, spread


def _scale_of(distance: FloatArray) -> float:
    """Robust standard deviation of distances; NaN where they are too few to tell."""
    known = distance[np.isfinite(distance)]
    return _scale(known) if known.size >= 3 else float("nan")


def _scale(known: FloatArray) -> float:
    """Robust standard deviation of distances that are nearly all ordinary ones."""
    ordered = np.sort(known)
    median = 0.5 * (ordered[(known.size - 1) // 2] + ordered[known.size // 2])
    at = 0.8 * (known.size - 1)
    low, share = ordered[int(at)], at - int(at)
    high = ordered[min(int(at) + 1, known.size - 1)]
    # As numpy's own quantile, to the last bit and without what that asks first.
    quantile = high - (high - low) * (1.0 - share) if share >= 0.5 else low + (high - low) * share
    return max(MAD_TO_SIGMA * float(median), float(quantile) / Q80_TO_SIGMA)


def _pooled_scale(level: FloatArray) -> float:
    n = statistics.counts(level)
    centre = statistics.means(level)
    used = n[n > 1]
    # Levelling took one degree of freedom for each pass beyond the first of its approach.
    passes = int(np.isfinite(level).any(axis=0).sum() - np.isfinite(level).any(axis=(0, 1)).sum())
    freedom = int(np.sum(used - 1)) - passes
    if freedom > 0:
        return float(np.sqrt(np.nansum((level - centre[:, None, :]) ** 2) / freedom))
    return _from_reversal(centre[:, 0] - centre[:, 1])


def _from_reversal(reversal: FloatArray) -> float:
    """Single readings each way: the scatter of B_i along the axis is all there is to see (an upper bound)."""
    known = reversal[np.isfinite(reversal)]
    return float(np.std(known, ddof=1) / np.sqrt(2.0)) if known.size > 2 else float("nan")


def _both(up: FloatArray, down: FloatArray, n: NDArray[np.int64], s: float) -> tuple[FloatArray, FloatArray]:
    with np.errstate(divide="ignore"):
        inverse = np.where(n > 0, 1.0 / n, 0.0)
    both = (n > 0).sum(axis=1)
    return mean_of_both(up, down), s * np.sqrt(inverse.sum(axis=1)) / np.maximum(both, 1)


# ---- Jumps within a pass that neither the neighbours nor the other pass share: a slipped fringe, a bumped optic.
#
# With three repetitions and more a reading is compared with its repetitions (`out_of_line`). With one or
# two nobody can vote, but a jump still shows against the scatter of the set itself.
#
# Theory. Two passes of one way, or where there is one repetition the pass up and the pass down, have the axis in
# common: their difference y is scatter, reversal and drift, all of which change little from target to target. Of it
# the first differences are taken. A single pass has nothing to be subtracted: of it the distances from the line
# through both neighbours are taken, in which a curve that is smooth over three targets vanishes. Either way r = W y
# with rows of unit length, so white scatter of standard deviation s gives each r the variance s^2.
#
# A jump of size J behind one target (a slip: all later readings are shifted) or at one target (a bump: one reading)
# adds J W h with h a step or a single one. Its estimate is J = (t.r) / |t|^2, t = W h; it stands out by
#     T = |t.r| / |t| / s,   s^2 = (|r|^2 - (t.r)^2 / |t|^2) / (m - 1),
# where s is that of what the jump leaves over, so a large jump does not hide itself. T is the largest over all places.
# What the limit must be follows from normal scatter alone, whatever s is: the 99.8 % quantile of T for m differences,
# simulated (100 000 sets for each m) and bounded by a + b / (m - c). Two such sequences of a set then raise a false
# alarm in less than 1 of 200 sets. Curves with waves, random walks and rounded readings raise fewer (see the tests).
# s is at least what rounding to the readings' last digit leaves; less than half a wavelength is no slip of a counter.

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


def slip_limit(differences: int, order: int) -> float:
    """The largest T that normal scatter reaches in 99.8 % of all sets of so many differences of an order."""
    a, b, c = _BOUND[order]
    return a + b / (differences - c)


def find_slips(targets: FloatArray, deviations: FloatArray) -> list[Slip]:
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
    far = slip_limit(r.size, order) * scatter / float(length[best])
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
