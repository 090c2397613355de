"""Weighted least squares with an honest covariance: the scatter of what is left is in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain.values import FloatArray
from gateway.errors import ModelError, NotIdentifiable

LARGEST_CONDITION = 1e10


@dataclass(frozen=True, slots=True)
class Regression:
    """A solved fit: coefficients (p,), covariance (p, p), residual (m,), leverage (m,) and chi-square.

    ``covariance`` is (A'WA)^-1 times the larger of 1 and chi-square / (m - p).
    """

    coefficients: FloatArray
    covariance: FloatArray
    residual: FloatArray
    leverage: FloatArray
    chi_square: float

    @property
    def left_out(self) -> FloatArray:
        """What each point would be off if it had not been fitted (PRESS residual), shape (m,)."""
        return self.residual / np.maximum(1.0 - self.leverage, 1e-9)


def alike(targets: ArrayLike, means: ArrayLike, u: ArrayLike | float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Targets, means and uncertainties (m,) as numbers; a target without a place is one without a mean (NaN).

    Raises ModelError (E-MODEL-SHAPE) where they are no numbers or not as many.
    """
    try:
        at, values, sigma = (np.asarray(one, dtype=np.float64) for one in (targets, means, u))
    except (TypeError, ValueError):
        at, values, sigma = (np.zeros((0, 0)) for _ in range(3))
    if at.ndim != 1 or values.shape != at.shape or sigma.shape not in ((), at.shape):
        raise ModelError("E-MODEL-SHAPE", "fit", targets=str(at.shape), means=str(values.shape), u=str(sigma.shape))
    return at, np.where(np.isfinite(at), values, np.nan), np.broadcast_to(sigma, at.shape)


def weighted(design: FloatArray, values: FloatArray, u: FloatArray, where: str = "fit") -> Regression:
    """Fit values (m,) with standard uncertainties u (m,) by the columns of design (m, p).

    Raises NotIdentifiable (E-MODEL-POINTS: fewer points than unknowns; E-MODEL-CONDITION).
    """
    m, p = design.shape
    if m < p:
        raise NotIdentifiable("E-MODEL-POINTS", where, points=m, unknowns=p)
    rows, target = design / u[:, None], values / u
    left, singular, right = np.linalg.svd(rows, full_matrices=False)
    if singular[-1] <= singular[0] / LARGEST_CONDITION:
        raise NotIdentifiable("E-MODEL-CONDITION", where, unknowns=p, points=m)
    inverse = right.T / singular
    coefficients = inverse @ (left.T @ target)
    residual = values - design @ coefficients
    chi_square = float(np.sum((residual / u) ** 2))
    scatter = max(1.0, chi_square / (m - p)) if m > p else 1.0
    return Regression(
        coefficients=coefficients,
        covariance=inverse @ inverse.T * scatter,
        residual=residual,
        leverage=np.sum(left**2, axis=1),
        chi_square=chi_square,
    )
