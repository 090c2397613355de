"""The law of propagation of uncertainty (GUM clause 5, annex G), and whether Monte Carlo bears it out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import floor, isfinite, sqrt

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain import FloatArray
from gateway.errors import ModelError
from gateway.evaluate.montecarlo import Outcome, numerical_tolerance
from gateway.evaluate.uncertainty import coverage_factor

Function = Callable[[Mapping[str, float]], float]


@dataclass(frozen=True, slots=True)
class Input:
    """An input quantity: estimate, standard uncertainty, degrees of freedom (infinite when u is given)."""

    estimate: float
    u: float
    freedom: float = float("inf")


@dataclass(frozen=True, slots=True)
class Combined:
    """Result y with u_c, effective degrees of freedom, k and U = k u_c; ``share`` is each input's |c u|."""

    y: float
    u: float
    freedom: float
    k: float
    U: float
    share: Mapping[str, float]


def law(
    function: Function,
    inputs: Mapping[str, Input],
    *,
    correlation: ArrayLike | None = None,
    probability: float = 0.95,
) -> Combined:
    """First-order propagation; sensitivities by central differences of one standard uncertainty.

    ``correlation`` (k, k) in the order of `inputs`; k from Student's t at the truncated Welch-Satterthwaite
    degrees of freedom (GUM G.4). Raises ModelError (E-EVAL-CORRELATION) for a matrix that is none.
    """
    parts = np.array([_part(function, inputs, name) for name in inputs])
    r = _correlation(correlation, parts.size)
    u = sqrt(max(float(parts @ r @ parts), 0.0))
    freedom = _freedom(u, parts, [item.freedom for item in inputs.values()])
    k = coverage_factor(probability, floor(freedom) if isfinite(freedom) else 1e12)
    y = function({name: item.estimate for name, item in inputs.items()})
    return Combined(y, u, freedom, k, k * u, dict(zip(inputs, np.abs(parts).tolist(), strict=True)))


def _part(function: Function, inputs: Mapping[str, Input], name: str) -> float:
    at = {key: item.estimate for key, item in inputs.items()}
    step = inputs[name].u
    if step == 0.0:
        return 0.0
    return (function({**at, name: at[name] + step}) - function({**at, name: at[name] - step})) / 2.0


def _correlation(given: ArrayLike | None, size: int) -> FloatArray:
    if given is None:
        return np.eye(size)
    r = np.asarray(given, dtype=np.float64)
    if r.shape != (size, size) or not np.allclose(r, r.T) or not np.allclose(np.diag(r), 1.0):
        raise ModelError("E-EVAL-CORRELATION", "law of propagation", shape=r.shape, inputs=size)
    return r


def _freedom(u: float, parts: FloatArray, freedoms: list[float]) -> float:
    below = sum(float(part) ** 4 / nu for part, nu in zip(parts, freedoms, strict=True))
    return u**4 / below if below > 0.0 else float("inf")


@dataclass(frozen=True, slots=True)
class Agreement:
    """Differences of the interval ends of both methods, the tolerance, and whether both are within it."""

    low: float
    high: float
    tolerance: float
    agrees: bool


def agreement(by_law: Combined, by_trials: Outcome, digits: int = 2) -> Agreement:
    """Whether y +/- U agrees with the symmetric Monte Carlo interval of the same probability (S1, clause 8.1)."""
    low = abs(by_law.y - by_law.U - by_trials.symmetric[0])
    high = abs(by_law.y + by_law.U - by_trials.symmetric[1])
    tolerance = numerical_tolerance(by_law.u, digits)
    return Agreement(low, high, tolerance, max(low, high) <= tolerance)
