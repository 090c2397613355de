"""Weighted least squares with an honest covariance: the scatter of what is left is in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gateway.domain.values import FloatArray
from gateway.errors import NotIdentifiable

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
