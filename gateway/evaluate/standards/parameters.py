"""The parameters of ISO 230-2 from means and standard deviations, of one test or of many trials at once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gateway.domain.values import FloatArray

NAMES = ("B", "B_mean", "M", "E", "E_up", "E_down", "R", "R_up", "R_down", "A", "A_up", "A_down")
"""In the order of the standard; every one carries the deviation unit, B_mean and B_i with their sign."""


def of_table(mean: FloatArray, s: FloatArray, k: float) -> Mapping[str, FloatArray]:
    """All parameters of means and standard deviations (..., m, 2); ``k`` is 2, in the edition of 1988 3.

    A mean that stands on one reading takes no part in R and A, a target without one approach none in B, M, R. Absent
    (NaN) are R, A where nothing is repeated; E, A, B, M, R of one direction only (ISO 230-2:2014, clause 3; gaps by our
    own policy).
    """
    reversal = mean[..., 0] - mean[..., 1]
    return {
        "B": top(np.abs(reversal)),
        "B_mean": average(reversal),
        "R": top(repeatability(mean, s, k)),
        "R_up": top(2.0 * k * s[..., 0]),
        "R_down": top(2.0 * k * s[..., 1]),
        **ranges(mean, s, k),
    }


def ranges(mean: FloatArray, s: FloatArray, k: float) -> Mapping[str, FloatArray]:
    """Those of `of_table` that are ranges over the travel: what is wrong by another amount elsewhere is in them."""
    both = np.isfinite(mean).any(axis=-2).all(axis=-1)
    repeated = np.isfinite(s).any(axis=-2).all(axis=-1)
    high, low = mean + k * s, mean - k * s
    return {
        "M": span(centres := mean.mean(axis=-1), centres),
        "E": np.where(both, whole_span(mean, mean), np.nan),
        "E_up": span(mean[..., 0], mean[..., 0]),
        "E_down": span(mean[..., 1], mean[..., 1]),
        "A": np.where(both & repeated, whole_span(high, low), np.nan),
        "A_up": span(high[..., 0], low[..., 0]),
        "A_down": span(high[..., 1], low[..., 1]),
    }


def repeatability(mean: FloatArray, s: FloatArray, k: float) -> FloatArray:
    """R_i (..., m) = max(k s+ + k s- + |B_i|, 2k s+, 2k s-), NaN where it cannot be had."""
    both = k * s.sum(axis=-1) + np.abs(mean[..., 0] - mean[..., 1])
    return np.asarray(np.maximum(both, np.max(2.0 * k * s, axis=-1)))


def top(values: FloatArray) -> FloatArray:
    """Largest over the last axis, NaN left out; NaN where nothing is known."""
    return np.asarray(np.fmax.reduce(values, axis=-1))


def average(values: FloatArray) -> FloatArray:
    """Mean over the last axis, NaN left out; NaN where nothing is known."""
    n = np.isfinite(values).sum(axis=-1)
    return np.asarray(np.where(n > 0, np.nansum(values, axis=-1) / np.maximum(n, 1), np.nan))


def span(high: FloatArray, low: FloatArray) -> FloatArray:
    """Largest of `high` less smallest of `low` over the last axis, NaN left out."""
    return np.asarray(np.fmax.reduce(high, axis=-1) - np.fmin.reduce(low, axis=-1))


def whole_span(high: FloatArray, low: FloatArray) -> FloatArray:
    """As `span`, over the last two axes."""
    return np.asarray(np.fmax.reduce(high, axis=(-2, -1)) - np.fmin.reduce(low, axis=(-2, -1)))


def stated(values: Mapping[str, FloatArray]) -> dict[str, float | None]:
    """One test's parameters as numbers, None for what does not exist."""
    return {name: float(value) if np.isfinite(value) else None for name, value in values.items()}
