"""Propagation of distributions by Monte Carlo, adaptive, with coverage intervals (JCGM 101:2008, clauses 6.4 and 7)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, floor, log10, sqrt
from typing import Protocol

import numpy as np
from numpy.random import Generator

from gateway.domain.values import FloatArray
from gateway.errors import ModelError

Trial = Callable[[Generator, int], Mapping[str, FloatArray]]
BLOCK, MOST = 10_000, 1_000_000


@dataclass(frozen=True, slots=True)
class TrialOutcome:
    """One output: mean, standard uncertainty, and two coverage intervals (low, high) of `probability`.

    ``symmetric`` leaves equal probability on both sides, ``shortest`` is as narrow as can be. ``tolerance`` is
    the numerical tolerance asked of mean, u and interval ends; ``converged`` says whether it was reached within
    `trials`. The same seed gives the same figures.
    """

    mean: float
    u: float
    symmetric: tuple[float, float]
    shortest: tuple[float, float]
    probability: float
    trials: int
    seed: int
    tolerance: float
    converged: bool

    @property
    def U(self) -> float:
        """Half the width of the symmetric interval."""
        return (self.symmetric[1] - self.symmetric[0]) / 2.0


def run_trials(
    trial: Trial,
    *,
    probability: float = 0.95,
    digits: int = 2,
    share: float = 0.0,
    seed: int = 1,
    block: int = BLOCK,
    most: int = MOST,
) -> Mapping[str, TrialOutcome]:
    """The adaptive procedure (clause 7.9) on a function that makes `count` trials of named outputs (count,).

    ``digits`` and ``share`` give the tolerance (`numerical_tolerance`), ``most`` how many trials are made at most.
    Outputs that are NaN in any trial do not exist for these inputs and are left out.
    """
    _check(probability, digits, block, most)
    rng = np.random.default_rng(seed)
    blocks: list[dict[str, FloatArray]] = []
    stable = False
    while not stable and (len(blocks) + 1) * block <= most:
        drawn = trial(rng, block)
        blocks.append({name: y for name, y in drawn.items() if np.isfinite(y).all()})
        stable = len(blocks) > 1 and all(_is_stable(name, blocks, probability, (digits, share)) for name in blocks[0])
    return {name: _outcome(name, blocks, probability, (digits, share), seed) for name in blocks[0]}


def _check(probability: float, digits: int, block: int, most: int) -> None:
    least = ceil(100.0 / (1.0 - probability)) if 0.0 < probability < 1.0 else 0
    if not least or digits < 1 or block < 100 or most < 2 * block or most < least:
        raise ModelError("E-EVAL-TRIALS", "Monte Carlo", probability=probability, digits=digits, trials=most)


def numerical_tolerance(u: float, digits: int, share: float = 0.0) -> float:
    """Half a unit of the last of `digits` significant digits of u (clause 7.9.2), at least ``share`` u; 0 for u = 0."""
    return max(0.5 * 10.0 ** (floor(log10(u)) - digits + 1), share * u) if u > 0.0 else 0.0


def _is_stable(name: str, blocks: list[dict[str, FloatArray]], probability: float, wanted: tuple[int, float]) -> bool:
    figures = np.array([_figures(part[name], probability) for part in blocks])
    tolerance = numerical_tolerance(float(figures[:, 1].mean()), *wanted)
    scatter = figures.std(axis=0, ddof=1) / np.sqrt(len(blocks))
    return bool((2.0 * scatter <= tolerance).all())


def _figures(y: FloatArray, probability: float) -> tuple[float, float, float, float]:
    return (float(y.mean()), float(y.std(ddof=1)), *symmetric_interval(np.sort(y), probability))


def _outcome(
    name: str, blocks: list[dict[str, FloatArray]], probability: float, wanted: tuple[int, float], seed: int
) -> TrialOutcome:
    y = np.sort(np.concatenate([part[name] for part in blocks]))
    u = float(y.std(ddof=1))
    return TrialOutcome(
        mean=float(y.mean()),
        u=u,
        symmetric=symmetric_interval(y, probability),
        shortest=shortest_interval(y, probability),
        probability=probability,
        trials=y.size,
        seed=seed,
        tolerance=numerical_tolerance(u, *wanted),
        converged=len(blocks) > 1 and _is_stable(name, blocks, probability, wanted),
    )


def _inside(count: int, probability: float) -> int:
    """How many of the sorted values lie in the interval (clause 7.7.2)."""
    return min(floor(probability * count + 0.5), count - 1)


def symmetric_interval(ordered: FloatArray, probability: float) -> tuple[float, float]:
    """The interval of sorted values (count,) that leaves as many below as above."""
    inside = _inside(ordered.size, probability)
    first = max((ordered.size - inside + 1) // 2 - 1, 0)
    return float(ordered[first]), float(ordered[first + inside])


def shortest_interval(ordered: FloatArray, probability: float) -> tuple[float, float]:
    """The narrowest interval of sorted values (count,) that holds the probability."""
    inside = _inside(ordered.size, probability)
    first = int(np.argmin(ordered[inside:] - ordered[: ordered.size - inside]))
    return float(ordered[first]), float(ordered[first + inside])


# ---- Distributions of input quantities (JCGM 101:2008, clause 6.4).


class Distribution(Protocol):
    """An input quantity: its estimate, its standard uncertainty, and draws of it."""

    @property
    def estimate(self) -> float:
        """Expectation."""
        ...

    @property
    def u(self) -> float:
        """Standard deviation."""
        ...

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Independent draws (count,)."""
        ...


@dataclass(frozen=True, slots=True)
class Normal:
    """Known by estimate and standard uncertainty (6.4.7)."""

    estimate: float
    u: float

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Draws (count,)."""
        return self.estimate + self.u * rng.standard_normal(count)


@dataclass(frozen=True, slots=True)
class Rectangular:
    """Anywhere within +/- `half` of the estimate (6.4.2)."""

    estimate: float
    half: float

    @property
    def u(self) -> float:
        """half / sqrt 3."""
        return self.half / sqrt(3.0)

    def draw(self, rng: Generator, count: int) -> FloatArray:
        """Draws (count,)."""
        return self.estimate + self.half * rng.uniform(-1.0, 1.0, count)
