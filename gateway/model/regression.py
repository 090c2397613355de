"""Weighted least squares with an honest covariance: the scatter of what is left is in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gateway.domain import FloatArray
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
    return Regression(coefficients, inverse @ inverse.T * scatter, residual, np.sum(left**2, axis=1), chi_square)


def slope_of(x: FloatArray, y: FloatArray, u: FloatArray) -> tuple[float, float]:
    """Plain least-squares slope of y (m,) along x (m,), and its standard uncertainty from that of each point (m,)."""
    centred = x - x.mean()
    power = float(centred @ centred)
    if power == 0.0:
        raise NotIdentifiable("E-MODEL-POINTS", "slope", points=int(x.size), unknowns=2)
    return float(centred @ y) / power, float(np.sqrt(np.sum((centred * u) ** 2))) / power


@dataclass(frozen=True, slots=True)
class PolynomialFit:
    """y = sum coef_k (x - origin)^k with covariance and residual standard deviation s (relative weights)."""

    origin: float
    coefficients: FloatArray
    covariance: FloatArray
    s: float

    def at(self, x: float) -> tuple[float, float]:
        """Value and standard uncertainty at x."""
        g = np.vander(np.asarray([x - self.origin]), self.coefficients.size, increasing=True)[0]
        return float(g @ self.coefficients), float(np.sqrt(g @ self.covariance @ g))


def fit_polynomial(x: ArrayLike, y: ArrayLike, degree: int, origin: float = 0.0) -> PolynomialFit:
    """Unweighted polynomial of (x - origin), uncertainties from the residual scatter (GUM H.3).

    Raises NotIdentifiable (E-MODEL-POINTS) unless there are more points than coefficients.
    """
    at, values = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    unknowns = degree + 1
    if at.size <= unknowns:
        raise NotIdentifiable("E-MODEL-POINTS", "polynomial", points=at.size, unknowns=unknowns)
    design = np.vander(at - origin, unknowns, increasing=True)
    left, singular, right = np.linalg.svd(design, full_matrices=False)
    inverse = right.T / singular
    coefficients = inverse @ (left.T @ values)
    s = float(np.sqrt(np.sum((values - design @ coefficients) ** 2) / (at.size - unknowns)))
    return PolynomialFit(origin, coefficients, inverse @ inverse.T * s**2, s)
