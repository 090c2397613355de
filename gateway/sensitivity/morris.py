"""Morris screening: trajectories, elementary effects and their statistics, on the unit cube; pure.

Inputs are scaled to [0, 1] on p levels with step D = p / (2 (p - 1)); EE_i = [y(x + D e_i) - y(x)] / D.
On ranges symmetric about zero the mean effect of an even output (maximum, RMS) vanishes, so mu* ranks.
Source: Morris 1991 (sampling: equation 3, written for all trajectories at once), Campolongo 2007.
"""

from __future__ import annotations

from collections.abc import Callable
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
