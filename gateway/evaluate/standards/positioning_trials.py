"""Monte Carlo of a positioning test: how far its parameters would scatter if the test were made again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import sqrt

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from drivers.units import DeviationUnit, deg_to_rad
from gateway.domain.values import COVERED, FloatArray
from gateway.evaluate.standards import statistics
from gateway.evaluate.uncertainty import budget as turning
from gateway.evaluate.uncertainty import montecarlo
from gateway.evaluate.uncertainty.budget import Budget
from gateway.evaluate.uncertainty.montecarlo import Distribution, Normal, Rectangular, TrialOutcome

MOST_TRIALS, LEAST_TRIALS = 100_000, 3000
SHARE = 0.1
"""Of u: the numerical tolerance that an interval's ends are known to, which is 5 % of its half width.

Half a unit of the second digit of u is between 0.5 % and 5 % of it; 0.5 % takes more than a million trials, so that the
rule of clause 7.9 could not be met for half of all tests. 10 % takes 20 000 to 50 000.
"""
SCATTER = 4_000_000
DRAWN = 100_000_000
"""Numbers drawn together, and in all. Tests of up to 2000 targets never come near: a block of trials is drawn at once,
and as many blocks as their figures ask for. Larger ones get fewer trials, `LEAST_TRIALS` at least (an interval of 95 %
needs 2000, JCGM 101 clause 7.2.2), and what has not settled by then is reported. Where even those would take more than
`DRAWN` numbers, none are drawn (`too_many`), and the result says that it has no such intervals.
"""

Formulas = Callable[[FloatArray], Mapping[str, FloatArray]]
TableFormulas = Callable[[FloatArray, FloatArray], Mapping[str, FloatArray]]

Common = Callable[[Generator, int], FloatArray]


def scatter_of_test(
    targets: ArrayLike,
    deviations: ArrayLike,
    unit: DeviationUnit,
    formulas: Formulas | None,
    budget: Budget,
    *,
    of_table: TableFormulas | None = None,
    seed: int = 1,
    digits: int = 2,
    most: int = MOST_TRIALS,
) -> Mapping[str, TrialOutcome]:
    """Outcomes by parameter name; empty where nothing says how much readings scatter, or where there are `too_many`.

    Each trial makes the test again: the means of deviations (m, n, 2), NaN where missing, each reading with its
    target's own s (at least eve / 2 where a drift test is given), and the systematic terms as errors common to
    all readings: over a linear axis a slope, over a rotary axis one wave a turn of any phase, and a calibrator's own
    error by its shape (`turning`). Parameters that
    are ranges come out larger on average than on the means, as in a real test; so read the interval, too.

    A standard has either formulas on readings (..., m, n, 2), which are drawn one by one, or ``of_table`` on means and
    standard deviations (..., m, 2): of n normal readings the mean is normal and the variance chi-squared with n - 1
    degrees of freedom, independent of each other (Cochran), so that these are drawn themselves.
    """
    at, x = statistics.check_readings(targets, deviations)
    sigma = _sigma(x, budget)
    if sigma is None:
        return {}
    common = _common(at, unit, budget)
    if too_many(x, of_table):
        return {}
    if of_table is not None:
        trial, size = _of_moments(x, sigma, common, of_table), statistics.means(x).size
    elif formulas is not None:
        trial, size = _of_readings(x, sigma, common, formulas), x.size
    else:
        raise TypeError("a standard has formulas on readings or on their table")
    block = int(np.clip(SCATTER // size, 500, montecarlo.BLOCK))
    trial, most = _in_parts(trial, SCATTER // size), min(most, max(DRAWN // size, LEAST_TRIALS))
    return montecarlo.run_trials(
        trial, probability=COVERED, digits=digits, share=SHARE, seed=seed, block=block, most=most
    )


def too_many(x: FloatArray, of_table: TableFormulas | None) -> bool:
    """Whether the fewest trials of a test (m, n, 2) would draw more than `DRAWN` numbers."""
    return LEAST_TRIALS * (x.size if of_table is None else x.shape[0] * 2) > DRAWN


def _in_parts(trial: montecarlo.Trial, together: int) -> montecarlo.Trial:
    """The same trials, no more than ``together`` of them (one at least) in memory at a time."""

    def parts(rng: Generator, count: int) -> Mapping[str, FloatArray]:
        most = max(together, 1)
        found = [trial(rng, min(most, count - done)) for done in range(0, count, most)]
        return (
            found[0] if len(found) == 1 else {name: np.concatenate([one[name] for one in found]) for name in found[0]}
        )

    return parts


# Trials lie along the last axis in memory: reductions over targets, repetitions and directions run along it.


def _of_readings(x: FloatArray, sigma: FloatArray, common: Common, formulas: Formulas) -> montecarlo.Trial:
    mean = (statistics.means(x)[:, None, :] + np.where(np.isfinite(x), 0.0, np.nan))[..., None]

    def trial(rng: Generator, count: int) -> Mapping[str, FloatArray]:
        noise = rng.standard_normal((*x.shape, count)) * sigma[:, None, :, None]
        return formulas(np.moveaxis(mean + noise + common(rng, count).T[:, None, None, :], -1, 0))

    return trial


def _of_moments(x: FloatArray, sigma: FloatArray, common: Common, of_table: TableFormulas) -> montecarlo.Trial:
    n = statistics.counts(x)
    mean = np.where(n > 0, statistics.means(x), np.nan)
    u = np.where(n > 0, sigma / np.sqrt(np.maximum(n, 1)), np.nan)
    freedom = np.maximum(n - 1, 1)
    spread = np.where(n > 1, sigma / np.sqrt(freedom), np.nan)

    def trial(rng: Generator, count: int) -> Mapping[str, FloatArray]:
        drawn = mean[..., None] + u[..., None] * rng.standard_normal((*n.shape, count))
        drawn += common(rng, count).T[:, None, :]
        s = spread[..., None] * np.sqrt(2.0 * rng.standard_gamma(freedom[..., None] / 2.0, (*n.shape, count)))
        return of_table(np.moveaxis(drawn, -1, 0), np.moveaxis(s, -1, 0))

    return trial


def _sigma(x: FloatArray, budget: Budget) -> FloatArray | None:
    """Standard deviation of one reading (m, 2): its own s, the pooled one where n = 1, at least eve / 2."""
    s = statistics.standard_deviations(x)
    known = s[np.isfinite(s)]
    if not known.size and budget.eve is None:
        return None
    pooled = float(np.sqrt(np.mean(known**2))) if known.size else 0.0
    return np.maximum(np.where(np.isfinite(s), s, pooled), (budget.eve or 0.0) / 2.0)


def _common(at: FloatArray, unit: DeviationUnit, budget: Budget) -> Common:
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
