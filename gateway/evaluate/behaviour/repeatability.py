"""How an axis repeats: the scatter of one approach without the instrument's noise, and whether R grew beyond chance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.message import Message, digits, fixed
from drivers.units import DeviationUnit
from gateway.domain.captures import Capture
from gateway.domain.values import FloatArray
from gateway.evaluate.behaviour.repetitions import MAD_TO_SIGMA, SUSPECT_FACTOR, pass_offsets, robust_means
from gateway.evaluate.standards import statistics
from gateway.evaluate.uncertainty.budget import variance_limit

SURE, MANY = 0.95, 1000  # of an F test, and the windows' degrees of freedom
ENOUGH = 3  # repetitions that show by themselves which reading is out of line


@dataclass(frozen=True, slots=True)
class Approach:
    """Standard deviations in the deviation unit: ``scatter`` of one approach from one side, ``reversal`` of half B.

    ``reversal`` says how half the reversal varies from place to place, beyond what its scatter makes of it: coming
    from one side makes only its mean a constant.
    """

    scatter: float
    reversal: float


def approach_of(capture: Capture) -> Approach:
    """What a positioning capture tells, robustly: passes levelled against drift, readings out of line left out.

    What the instrument scatters is none of the axis' and taken off in squares (`instrument_noise`). What it adds from
    reading to reading and no standstill test has shown cannot be told from the axis and stays. Raises ModelError as
    `robust_means`.
    """
    means = robust_means(capture.targets, capture.deviations)
    level = capture.deviations - means.pass_offsets[None, :, :]
    for target, repetition, side in means.suspects:
        level[target, repetition, side] = np.nan
    shown = _scatter(level, means.s)
    half = (means.mean_up - means.mean_down) / 2.0
    spread = _without_outliers(half - np.nanmedian(half)) if np.isfinite(half).any() else 0.0
    return Approach(_less(shown, instrument_noise(capture)), _less(spread, _of_half(shown, level)))


def instrument_noise(capture: Capture) -> float:
    """Standard deviation that the instrument gives one reading: as its window shows, or more as it scatters at rest.

    Few readings at rest scatter themselves: they count where an F test says that they show more than the windows do.
    """
    within = capture.reading_u if np.isfinite(capture.reading_u) else 0.0
    if capture.rest_count < ENOUGH:
        return within
    limit = variance_limit(SURE, capture.rest_count - 1, MANY)
    return capture.rest_u if capture.rest_u**2 > limit * within**2 else within


def _scatter(level: FloatArray, pooled: float) -> float:
    """Of one reading; two readings at a place do not say which is out of line: there all places together do."""
    if level.shape[1] == 1 or level.shape[1] >= ENOUGH:
        return pooled if np.isfinite(pooled) else 0.0
    counts = statistics.counts(level)[:, None, :]
    apart = level - statistics.means(level)[:, None, :]
    # A reading is one of its own mean's; levelling took one degree of freedom in as many as there are places.
    freedom = np.where(counts > 1, counts / np.maximum(counts - 1, 1), np.nan)
    return _without_outliers(apart * np.sqrt(freedom)) * (1.0 + 0.5 / level.shape[0])


def _of_half(scatter: float, level: FloatArray) -> float:
    """Standard deviation that scatter alone gives half the reversal."""
    counts = statistics.counts(level)
    both = np.all(counts > 0, axis=1)
    if not np.any(both):
        return 0.0
    return scatter / 2.0 * float(np.sqrt(np.mean(np.sum(1.0 / counts[both], axis=1))))


def _without_outliers(deviations: FloatArray) -> float:
    """Root mean square of deviations from a centre, those beyond six robust standard deviations left out."""
    known = np.abs(deviations[np.isfinite(deviations)])
    if not known.size:
        return 0.0
    limit = SUSPECT_FACTOR * MAD_TO_SIGMA * float(np.median(known))
    kept = known[known <= limit] if limit > 0.0 else known
    return float(np.sqrt(np.mean(kept**2)))


def _less(whole: float, part: float) -> float:
    """What is left of a standard deviation without an independent part of it."""
    left = whole**2 - part**2 if np.isfinite(part) else whole**2
    return float(np.sqrt(max(left, 0.0)))


# ---- Change of repeatability: R is the largest of many small samples and jumps by itself.
#
# R takes the place that scattered most, so a fifth more after a push is what chance alone does. The rule is an F
# test: the pooled variances of both captures, each about the means of its own targets and approaches, their quotient
# against F at 97.5 % with both degrees of freedom. Where it is beyond, the same test without readings out of line,
# and then with the passes levelled, says what made it.

CONFIDENCE = 0.975
# A smaller growth of R is not worth a sentence.
WORTH = 0.05
GrowthCause = Literal["chance", "reversal", "outliers", "drift", "scatter"]


@dataclass(frozen=True, slots=True)
class SpreadChange:
    """R before and after in ``unit``, the quotient of variances with its limit, and what made R larger."""

    before: float
    after: float
    quotient: float
    limit: float
    why: GrowthCause
    unit: DeviationUnit

    @property
    def words(self) -> tuple[Message, ...]:
        """What is to be said of it; nothing where R did not grow."""
        if self.after <= (1.0 + WORTH) * self.before:
            return ()
        sizes = {"before": digits(self.before), "after": digits(self.after), "unit": self.unit}
        percent = fixed(100.0 * (self.after / self.before - 1.0) if self.before > 0.0 else None, 0)
        test = {"F": fixed(self.quotient), "limit": fixed(self.limit)}
        return (Message.of(_SAID[self.why], percent=percent, **sizes, **test),)


_SAID: dict[GrowthCause, str] = {
    "chance": "W-SPREAD-CHANCE",
    "reversal": "W-SPREAD-REVERSAL",
    "outliers": "W-SPREAD-OUTLIERS",
    "drift": "W-SPREAD-DRIFT",
    "scatter": "W-SPREAD-SCATTER",
}


def compare_spread(before: Capture, after: Capture, R: tuple[float | None, float | None]) -> SpreadChange | None:
    """What two captures of an axis say of R (before, after); None where there is none. Raises as `robust_means`."""
    if R[0] is None or R[1] is None:
        return None
    plain = _Test.of(before.deviations, after.deviations)
    if plain is None:
        return None
    why = _why(before, after, plain)
    return SpreadChange(before=R[0], after=R[1], quotient=plain.quotient, limit=plain.limit, why=why, unit=after.unit)


@dataclass(frozen=True, slots=True)
class _Test:
    quotient: float
    limit: float

    @classmethod
    def of(cls, before: FloatArray, after: FloatArray, levelled: int = 0) -> _Test | None:
        """``levelled``: degrees of freedom that levelling took from each."""
        (old, old_freedom), (new, new_freedom) = _variance(before), _variance(after)
        old_freedom, new_freedom = old_freedom - levelled, new_freedom - levelled
        if old_freedom < 1 or new_freedom < 1 or old <= 0.0:
            return None
        quotient = (new / new_freedom) / (old / old_freedom)
        return cls(float(quotient), variance_limit(CONFIDENCE, new_freedom, old_freedom))

    @property
    def grown(self) -> bool:
        """Whether the variance did, beyond chance."""
        return self.quotient > self.limit


def _why(before: Capture, after: Capture, plain: _Test) -> GrowthCause:
    if not plain.grown:
        return "reversal" if _reversal_grown(before, after) else "chance"
    old, new = (
        _without_suspects(one.deviations, robust_means(one.targets, one.deviations).suspects) for one in (before, after)
    )
    test = _Test.of(old, new)
    if test is None or not test.grown:
        return "outliers"
    passes = 2 * (min(old.shape[1], new.shape[1]) - 1)
    test = _Test.of(old - pass_offsets(old)[None], new - pass_offsets(new)[None], passes)
    return "drift" if test is None or not test.grown else "scatter"


def _reversal_grown(before: Capture, after: Capture) -> bool:
    """Whether the largest |B| is larger by more than both its uncertainties; s pooled as in the test."""
    sizes, doubts = [], []
    for one in (before, after):
        square, freedom = _variance(one.deviations)
        means, count = statistics.means(one.deviations), float(np.max(statistics.counts(one.deviations)))
        sizes.append(float(np.nanmax(np.abs(means[:, 0] - means[:, 1]))))
        doubts.append(2.0 * square / freedom / count)
    return sizes[1] - sizes[0] > 2.0 * float(np.sqrt(sum(doubts)))


def _variance(x: FloatArray) -> tuple[float, int]:
    """Sum of squares about the means of each target and approach, and its degrees of freedom."""
    n = statistics.counts(x)
    return float(np.nansum((x - statistics.means(x)[:, None, :]) ** 2)), int(np.sum(np.maximum(n - 1, 0)))


def _without_suspects(x: FloatArray, suspects: Iterable[tuple[int, int, int]]) -> FloatArray:
    kept = x.copy()
    for place in suspects:
        kept[place] = np.nan
    return kept
