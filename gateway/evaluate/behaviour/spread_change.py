"""Whether an axis repeats worse than before, and why: R is the largest of many small samples and jumps by itself; pure.

R takes the place that scattered most, so a fifth more after a push is what chance alone does. The rule is an F test:
the pooled variances of both captures, each about the means of its own targets and approaches, their quotient against
F at 97.5 % with both degrees of freedom. Where it is beyond, the same test without readings out of line, and then with
the passes levelled, says what made it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.message import Message, digits, fixed
from drivers.units import DeviationUnit
from gateway.domain.captures import Capture
from gateway.domain.values import FloatArray
from gateway.evaluate.behaviour.repetitions import pass_offsets, robust_means
from gateway.evaluate.standards import readings
from gateway.evaluate.uncertainty.budget import variance_limit

SURE = 0.975
# A smaller growth of R is not worth a sentence.
WORTH = 0.05
Why = Literal["chance", "reversal", "outliers", "drift", "scatter"]


@dataclass(frozen=True, slots=True)
class SpreadChange:
    """R before and after in ``unit``, the quotient of variances with its limit, and what made R larger."""

    before: float
    after: float
    quotient: float
    limit: float
    why: Why
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


_SAID: dict[Why, str] = {
    "chance": "W-SPREAD-CHANCE",
    "reversal": "W-SPREAD-REVERSAL",
    "outliers": "W-SPREAD-OUTLIERS",
    "drift": "W-SPREAD-DRIFT",
    "scatter": "W-SPREAD-SCATTER",
}


def spread_change(before: Capture, after: Capture, R: tuple[float | None, float | None]) -> SpreadChange | None:
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
        return cls(float(quotient), variance_limit(SURE, new_freedom, old_freedom))

    @property
    def grown(self) -> bool:
        """Whether the variance did, beyond chance."""
        return self.quotient > self.limit


def _why(before: Capture, after: Capture, plain: _Test) -> Why:
    if not plain.grown:
        return "reversal" if _reversal_grown(before, after) else "chance"
    old, new = (_without(one.deviations, robust_means(one.targets, one.deviations).suspects) for one in (before, after))
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
        means, count = readings.means(one.deviations), float(np.max(readings.counts(one.deviations)))
        sizes.append(float(np.nanmax(np.abs(means[:, 0] - means[:, 1]))))
        doubts.append(2.0 * square / freedom / count)
    return sizes[1] - sizes[0] > 2.0 * float(np.sqrt(sum(doubts)))


def _variance(x: FloatArray) -> tuple[float, int]:
    """Sum of squares about the means of each target and approach, and its degrees of freedom."""
    n = readings.counts(x)
    return float(np.nansum((x - readings.means(x)[:, None, :]) ** 2)), int(np.sum(np.maximum(n - 1, 0)))


def _without(x: FloatArray, suspects: Iterable[tuple[int, int, int]]) -> FloatArray:
    kept = x.copy()
    for place in suspects:
        kept[place] = np.nan
    return kept
