"""Uncertainty beside any geometric result (straightness, squareness, location ...) by Monte Carlo of its readings."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from gateway.domain import FloatArray
from gateway.errors import ModelError
from gateway.evaluate import montecarlo
from gateway.evaluate.montecarlo import Outcome

Result = Callable[[FloatArray], Mapping[str, float]]


def beside(
    result: Result,
    values: ArrayLike,
    u: ArrayLike,
    *,
    covariance: bool = False,
    probability: float = 0.9545,
    seed: int = 1,
    most: int = 4000,
) -> Mapping[str, Outcome]:
    """Outcomes of `result`, called once a trial on readings (any shape) drawn about `values`.

    ``u``: standard uncertainty of the readings, one number or one a reading; with `covariance` the covariance
    matrix (k, k) of readings (k,), for errors they share. Few trials, because the result may be slow: the
    outcome says whether its digits hold. Raises ModelError (E-EVAL-SHAPE, E-EVAL-TRIALS).
    """
    centre, given = np.asarray(values, dtype=np.float64), np.asarray(u, dtype=np.float64)
    fits = given.shape == 2 * centre.shape if covariance else given.shape in ((), centre.shape)
    if not fits or not np.isfinite(given).all() or (not covariance and (given < 0.0).any()):
        raise ModelError("E-EVAL-SHAPE", "Monte Carlo", targets=centre.shape, deviations=given.shape)
    root = np.linalg.cholesky(given + 1e-12 * np.trace(given) * np.eye(len(given))) if covariance else given

    def trial(rng: Generator, count: int) -> Mapping[str, FloatArray]:
        noise = rng.standard_normal((count, *centre.shape))
        drawn = centre + (noise @ root.T if covariance else noise * root)
        found = [result(row) for row in drawn]
        return {name: np.array([each[name] for each in found]) for name in found[0]}

    return montecarlo.run(trial, probability=probability, digits=2, seed=seed, block=500, most=most)
