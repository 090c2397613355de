"""Morris screening on the unit cube: elementary effects, ranks with their confidence, sweeps over an executor.

Inputs are scaled to [0, 1] on p levels with step D = p / (2 (p - 1)); EE_i = [y(x + D e_i) - y(x)] / D.
On ranges symmetric about zero the mean effect of an even output (maximum, RMS) vanishes, so mu* ranks.
Source: Morris 1991 (sampling: equation 3, written for all trajectories at once), Campolongo 2007.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gateway.domain.values import FloatArray
from gateway.errors import ModelError


@dataclass(frozen=True, slots=True)
class Indices:
    """Statistics of elementary effects, each of shape (d,): mean, mean of |EE| and standard deviation.

    ``mu_share`` and ``sigma_share`` are the normalised indices mu_i / sum |mu_j| and sigma_i / sum sigma_j,
    0 where every index is 0.
    """

    mu: FloatArray
    mu_star: FloatArray
    sigma: FloatArray
    mu_share: FloatArray
    sigma_share: FloatArray


def trajectories(d: int, r: int, p: int = 4, seed: int = 1) -> FloatArray:
    """r Morris trajectories of d + 1 points on p levels, shape (r, d + 1, d), values in [0, 1].

    Raises ModelError (E-SENS-LEVELS) unless p is even and at least 2, (E-SENS-SIZE) for d or r below 1.
    """
    if p < 2 or p % 2:
        raise ModelError("E-SENS-LEVELS", "Morris", levels=p)
    if d < 1 or r < 1:
        raise ModelError("E-SENS-SIZE", "Morris", inputs=d, trajectories=r)
    rng = np.random.default_rng(seed)
    step = p / (2.0 * (p - 1))
    low = rng.integers(0, p // 2, (r, d)) / (p - 1)
    rising = rng.integers(0, 2, (r, d)).astype(bool)
    turn = rng.permuted(np.broadcast_to(np.arange(d), (r, d)), axis=1)
    high = low + step
    first, then = np.where(rising, low, high), np.where(rising, high, low)
    order = np.argsort(turn, axis=1)
    points = np.empty((r, d + 1, d))
    for i in range(r):  # row by row: each is the one before with one input moved
        row = points[i, 0] = first[i].copy()
        for at, (moved, value) in enumerate(zip(order[i].tolist(), then[i, order[i]].tolist(), strict=True), 1):
            row[moved] = value
            points[i, at] = row
    return points


def elementary_effects(points: ArrayLike, outputs: ArrayLike) -> FloatArray:
    """Elementary effects of given trajectories, shape (r, d) or (r, d, outputs).

    ``points`` (r, d+1, d); ``outputs`` (r, d+1) or (r, d+1, k). Each step must move exactly one input, and
    each trajectory every input once (ModelError E-SENS-TRAJECTORY naming the trajectory).
    """
    x, y = np.asarray(points, dtype=np.float64), np.asarray(outputs, dtype=np.float64)
    if x.ndim != 3 or x.shape[1] != x.shape[2] + 1 or y.shape[:2] != x.shape[:2]:
        raise ModelError("E-SENS-SHAPE", "Morris", points=x.shape, outputs=y.shape)
    which, size = _steps(x)
    change = np.diff(y, axis=1)
    ratio = change / size.reshape(size.shape + (1,) * (change.ndim - 2))
    effects = np.empty_like(ratio)
    rows = np.arange(x.shape[0])[:, None]
    effects[rows, which] = ratio
    return effects


def _steps(x: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Which input each step moves, and by how much, (r, d). Raises ModelError (E-SENS-TRAJECTORY)."""
    r, _, d = x.shape
    which, size = np.empty((r, d), dtype=np.intp), np.empty((r, d))
    steps, sizes = np.empty((d, d)), np.empty((d, d))
    for i in range(r):  # one trajectory at a time, in the same memory
        np.subtract(x[i, 1:], x[i, :-1], out=steps)
        at, moved = np.nonzero(np.abs(steps, out=sizes) > 1e-9)
        if not np.array_equal(at, np.arange(d)) or not np.array_equal(np.bincount(moved, minlength=d), np.ones(d)):
            raise ModelError("E-SENS-TRAJECTORY", "Morris", trajectory=i)
        which[i], size[i] = moved, steps[at, moved]
    return which, size


def indices(effects: ArrayLike, *, population: bool = False) -> Indices:
    """Statistics over the r trajectories of effects (r, d); sigma with r - 1 (``population``: with r)."""
    ee = np.asarray(effects, dtype=np.float64)
    freedom = 0 if population or ee.shape[0] == 1 else 1
    mu, sigma = ee.mean(axis=0), ee.std(axis=0, ddof=freedom)
    return Indices(mu=mu, mu_star=np.abs(ee).mean(axis=0), sigma=sigma, mu_share=_share(mu), sigma_share=_share(sigma))


def _share(values: FloatArray) -> FloatArray:
    total = float(np.abs(values).sum())
    return values / total if total > 0.0 else np.zeros_like(values)


def exhaustive(function: Callable[[FloatArray], ArrayLike] | ArrayLike, levels: int, inputs: int = 0) -> Indices:
    """Indices over every grid step of the p-level cube: no sampling, so closed forms are met exactly.

    ``function`` takes points (n, d) of d = ``inputs`` inputs; coefficients (d,) stand for the linear y = a.x (mu = a,
    mu* = |a|, sigma = 0). sigma counts with n. Raises ModelError E-SENS-LEVELS.
    """
    if levels < 2 or levels % 2:
        raise ModelError("E-SENS-LEVELS", "Morris", levels=levels)
    a = np.zeros(inputs) if callable(function) else np.asarray(function, dtype=np.float64)
    step = levels / (2.0 * (levels - 1))
    grid = np.stack(np.meshgrid(*[np.arange(levels) / (levels - 1)] * a.size, indexing="ij"), axis=-1).reshape(
        -1, a.size
    )
    effects = []
    for i in range(a.size):
        low = grid[grid[:, i] + step <= 1.0 + 1e-12]
        high = low.copy()
        high[:, i] += step
        above, below = (function(x) if callable(function) else x @ a for x in (high, low))
        effects.append((np.asarray(above) - np.asarray(below)) / step)
    return indices(np.stack(effects, axis=1), population=True)


# ---- How sure a ranking is: bootstrap intervals of mu* and of ranks, and which ranks cannot be told apart.

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class RankedInput:
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


def rank_inputs(
    names: Sequence[str], effects: ArrayLike, *, confidence: float = 0.95, resamples: int = 1000, seed: int = 1
) -> tuple[RankedInput, ...]:
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
) -> RankedInput:
    return RankedInput(
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


# ---- A sweep of model runs over an executor: processes of this machine, a cluster, or none (then one after the other).

Model = Callable[[FloatArray], FloatArray]
"""Outputs (n, k) of points (n, d); must be plain data with a call, so that it can be sent to another process."""


@dataclass(frozen=True)
class ScreeningResult:
    """Elementary effects (r, d, k) of every input on every output, and the ranking of each output by name."""

    names: tuple[str, ...]
    outputs: tuple[str, ...]
    effects: FloatArray
    rankings: dict[str, tuple[RankedInput, ...]]


def run_sweep(
    model: Model, points: ArrayLike, executor: Executor | None = None, parts: int | None = None
) -> FloatArray:
    """Outputs (..., k) of points (..., d), cut along the first axis into ``parts`` pieces sent to the executor.

    Without an executor everything runs here, in one piece. The order of the results is that of the points.
    Raises ModelError E-SENS-WORKERS if a worker is lost.
    """
    x = np.asarray(points, dtype=np.float64)
    if x.ndim < 2 or not x.size:
        raise ModelError("E-SENS-SHAPE", "sweep", points=x.shape, outputs="none yet")
    if executor is None:
        return _piece(model, x)
    pieces = np.array_split(x, min(parts or x.shape[0], x.shape[0]))
    futures = [executor.submit(_piece, model, piece) for piece in pieces]
    try:
        return np.concatenate([future.result() for future in futures])
    except (BrokenExecutor, OSError) as error:
        raise ModelError("E-SENS-WORKERS", "sweep", why=f"{type(error).__name__} {error}") from error
    finally:
        for future in futures:
            future.cancel()


def screen(
    model: Model,
    names: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    r: int = 20,
    levels: int = 4,
    seed: int = 1,
    executor: Executor | None = None,
    parts: int | None = None,
) -> ScreeningResult:
    """Morris screening of a model with len(names) inputs in the unit cube and len(outputs) outputs."""
    points = trajectories(len(names), r, levels, seed)
    effects = elementary_effects(points, run_sweep(model, points, executor, parts))
    found = {name: rank_inputs(names, effects[..., i], seed=seed) for i, name in enumerate(outputs)}
    return ScreeningResult(names, outputs, effects, found)


def _piece(model: Model, points: FloatArray) -> FloatArray:
    flat = points.reshape(-1, points.shape[-1])
    return np.asarray(model(flat)).reshape(*points.shape[:-1], -1)
