"""How sure a ranking is: bootstrap intervals of mu* and of ranks, and which ranks cannot be told apart; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gateway.domain.values import FloatArray
from gateway.sensitivity.morris import Indices, indices

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Ranked:
    """One input of a ranking, most important first.

    ``rank`` from 1; ``low``, ``high`` bound mu* and ``rank_low``, ``rank_high`` the rank with the asked
    confidence; ``tied_with`` names inputs whose order against this one is not settled.
    """

    name: str
    rank: int
    mu: float
    mu_star: float
    sigma: float
    mu_share: float
    sigma_share: float
    low: float
    high: float
    rank_low: int
    rank_high: int
    tied_with: tuple[str, ...]


def ranking(
    names: Sequence[str], effects: ArrayLike, *, confidence: float = 0.95, resamples: int = 1000, seed: int = 1
) -> tuple[Ranked, ...]:
    """Rank inputs by mu* with bootstrap intervals over the trajectories of effects (r, d).

    Two inputs are tied when the bootstrap puts either before the other with a probability between
    (1 - confidence)/2 and (1 + confidence)/2.
    """
    ee = np.asarray(effects, dtype=np.float64)
    stats = indices(ee)
    draws = _bootstrap(np.abs(ee), resamples, seed)
    order = np.argsort(-stats.mu_star, kind="stable")
    drawn_ranks = np.argsort(np.argsort(-draws, axis=1, kind="stable"), axis=1) + 1
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(draws, [tail, 1.0 - tail], axis=0)
    rank_low = np.quantile(drawn_ranks, tail, axis=0, method="nearest")
    rank_high = np.quantile(drawn_ranks, 1.0 - tail, axis=0, method="nearest")
    ties = _ties(draws, tail)
    return tuple(
        _one(names, position, int(i), stats, (low, high), (rank_low, rank_high), ties)
        for position, i in enumerate(order)
    )


def sigma_intervals(
    effects: ArrayLike, *, confidence: float = 0.95, resamples: int = 1000, seed: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Bootstrap bounds (d,) of sigma over the trajectories of effects (r, d), as `ranking` bounds mu*."""
    ee = np.asarray(effects, dtype=np.float64)
    weights = _weights(ee.shape[0], resamples, seed)
    spread = np.sqrt(np.maximum(weights @ ee**2 - (weights @ ee) ** 2, 0.0) * ee.shape[0] / max(ee.shape[0] - 1, 1))
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(spread, [tail, 1.0 - tail], axis=0)
    return np.asarray(low), np.asarray(high)


def _bootstrap(sizes: FloatArray, resamples: int, seed: int) -> FloatArray:
    return _weights(sizes.shape[0], resamples, seed) @ sizes


def _weights(count: int, resamples: int, seed: int) -> FloatArray:
    """Share of each trajectory in each resample, (resamples, count)."""
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, count, (resamples, count))
    weights = np.zeros((resamples, count))
    np.add.at(weights, (np.arange(resamples)[:, None], picks), 1.0 / count)
    return weights


def _ties(draws: FloatArray, tail: float) -> BoolArray:
    """Which inputs' order is not settled, (d, d), of draws (resamples, d).

    P(i before j) counts equal draws half. Pairs whose outer bounds do not meet are settled without counting: were a
    draw of j above one of i, either i would be below its bound or j above its own, and both are rare enough.
    """
    low = np.quantile(draws, tail / 2.0, axis=0, method="lower")
    high = np.quantile(draws, 1.0 - tail / 2.0, axis=0, method="higher")
    by_input = np.ascontiguousarray(draws.T)
    tied = np.zeros((by_input.shape[0], by_input.shape[0]), dtype=bool)
    for i, own in enumerate(by_input):
        others = i + 1 + np.flatnonzero((low[i + 1 :] <= high[i]) & (high[i + 1 :] >= low[i]))
        drawn = by_input[others]
        before = (np.count_nonzero(own > drawn, axis=1) + np.count_nonzero(own >= drawn, axis=1)) / (2.0 * own.size)
        tied[i, others] = (before > tail) & (before < 1.0 - tail)
    return np.asarray(tied | tied.T)


def _one(
    names: Sequence[str],
    position: int,
    i: int,
    stats: Indices,
    bounds: tuple[FloatArray, FloatArray],
    ranks: tuple[FloatArray, FloatArray],
    ties: BoolArray,
) -> Ranked:
    return Ranked(
        name=names[i],
        rank=position + 1,
        mu=float(stats.mu[i]),
        mu_star=float(stats.mu_star[i]),
        sigma=float(stats.sigma[i]),
        mu_share=float(stats.mu_share[i]),
        sigma_share=float(stats.sigma_share[i]),
        low=float(bounds[0][i]),
        high=float(bounds[1][i]),
        rank_low=int(ranks[0][i]),
        rank_high=int(ranks[1][i]),
        tied_with=tuple(names[int(j)] for j in np.flatnonzero(ties[i])),
    )
