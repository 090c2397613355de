"""Monte Carlo of a positioning test: how far its parameters would scatter if the test were made again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import sqrt

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from drivers.units import DeviationUnit, deg_to_rad
from gateway.domain.values import COVERED, FloatArray
from gateway.evaluate.standards import readings
from gateway.evaluate.uncertainty import montecarlo, turning
from gateway.evaluate.uncertainty.budget import Budget
from gateway.evaluate.uncertainty.distributions import Distribution, Normal, Rectangular
from gateway.evaluate.uncertainty.montecarlo import TrialOutcome

MOST_TRIALS = 100_000
SCATTER = 4_000_000

Formulas = Callable[[FloatArray], Mapping[str, FloatArray]]


def scatter_of_test(
    targets: ArrayLike,
    deviations: ArrayLike,
    unit: DeviationUnit,
    formulas: Formulas,
    budget: Budget,
    *,
    seed: int = 1,
    digits: int = 2,
    most: int = MOST_TRIALS,
) -> Mapping[str, TrialOutcome]:
    """Outcomes by parameter name; empty where nothing says how much readings scatter.

    Each trial makes the test again: the means of deviations (m, n, 2), NaN where missing, each reading with its
    target's own s (at least eve / 2 where a drift test is given), and the systematic terms as errors common to
    all readings: over a linear axis a slope, over a rotary axis one wave a turn of any phase, and a calibrator's own
    error by its shape (`turning`). Parameters that
    are ranges come out larger on average than on the means, as in a real test; so read the interval, too.
    """
    at, x = readings.checked(targets, deviations)
    sigma = _sigma(x, budget)
    if sigma is None:
        return {}
    mean, gap = readings.means(x)[:, None, :], np.where(np.isfinite(x), 0.0, np.nan)
    common = _common(at, unit, budget)

    def trial(rng: Generator, count: int) -> Mapping[str, FloatArray]:
        noise = rng.standard_normal((count, *x.shape)) * sigma[:, None, :]
        return formulas(mean + gap + noise + common(rng, count)[:, :, None, None])

    block = int(np.clip(SCATTER // x.size, 500, montecarlo.BLOCK))
    return montecarlo.run(trial, probability=COVERED, digits=digits, seed=seed, block=block, most=most)


def _sigma(x: FloatArray, budget: Budget) -> FloatArray | None:
    """Standard deviation of one reading (m, 2): its own s, the pooled one where n = 1, at least eve / 2."""
    s = readings.standard_deviations(x)
    known = s[np.isfinite(s)]
    if not known.size and budget.eve is None:
        return None
    pooled = float(np.sqrt(np.mean(known**2))) if known.size else 0.0
    return np.maximum(np.where(np.isfinite(s), s, pooled), (budget.eve or 0.0) / 2.0)


def _common(at: FloatArray, unit: DeviationUnit, budget: Budget) -> Callable[[Generator, int], FloatArray]:
    parts = _systematic(budget)
    span = float(np.ptp(at))

    def slope(rng: Generator, count: int) -> FloatArray:
        size = np.sum([part.draw(rng, count) for part in parts], axis=0)
        return np.asarray(np.outer(size, (at - at.min()) / span if span else np.zeros_like(at)))

    def wave(rng: Generator, count: int) -> FloatArray:
        size = np.sum([part.draw(rng, count) for part in parts], axis=0)
        phase = rng.uniform(0.0, 2.0 * np.pi, count)
        once = size[:, None] / 2.0 * np.cos(deg_to_rad(at)[None, :] - phase[:, None])
        return np.asarray(once + turning.drawn_errors(at, budget.turning, rng, count))

    return slope if unit == "um" else wave


def _systematic(budget: Budget) -> tuple[Distribution, ...]:
    """Certificates are normal; ranges (misalignment, temperature, expansion) rectangular: U = 2 half / sqrt 3."""
    ranges = (budget.misalignment, budget.temperature, budget.expansion)
    return (Normal(0.0, budget.device / 2.0), *(Rectangular(0.0, U * sqrt(3.0) / 2.0) for U in ranges))
