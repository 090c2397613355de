"""How an axis repeats when it comes to a place from one side: no outlier in it and none of the instrument's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gateway.domain.captures import Capture
from gateway.domain.values import FloatArray
from gateway.evaluate.behaviour.repetitions import MAD_TO_SIGMA, SUSPECT_FACTOR, robust_means
from gateway.evaluate.standards import readings
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
    counts = readings.counts(level)[:, None, :]
    apart = level - readings.means(level)[:, None, :]
    # A reading is one of its own mean's; levelling took one degree of freedom in as many as there are places.
    freedom = np.where(counts > 1, counts / np.maximum(counts - 1, 1), np.nan)
    return _without_outliers(apart * np.sqrt(freedom)) * (1.0 + 0.5 / level.shape[0])


def _of_half(scatter: float, level: FloatArray) -> float:
    """Standard deviation that scatter alone gives half the reversal."""
    counts = readings.counts(level)
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
