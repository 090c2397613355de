"""Readings of a positioning test (m, n, 2), checked; their moments, and the parameters calculated from these."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message
from gateway.domain.values import FloatArray
from gateway.errors import ModelError


def check_readings(targets: ArrayLike, deviations: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Targets (m,) and deviations (m, n, 2) as float arrays; NaN marks a missing reading.

    Raises ModelError: E-EVAL-NUMBER (no numbers), E-EVAL-SHAPE (shapes do not fit), E-EVAL-INFINITE, E-EVAL-EMPTY (no
    reading, or a target without any).
    """
    at, x = numbers("targets", targets), numbers("deviations", deviations)
    if at.ndim != 1 or x.ndim != 3 or x.shape[0] != at.size or x.shape[2] != 2:
        raise ModelError("E-EVAL-SHAPE", "evaluate", targets=at.shape, deviations=x.shape)
    if np.isinf(x).any() or not np.isfinite(at).all():
        raise ModelError("E-EVAL-INFINITE", "evaluate")
    silent = ~np.isfinite(x).any(axis=(1, 2))
    if at.size == 0 or silent.any():
        raise ModelError("E-EVAL-EMPTY", "evaluate", targets=[int(i) + 1 for i in np.flatnonzero(silent)])
    return at, x


def numbers(key: str, values: ArrayLike) -> FloatArray:
    """Values as a float array. Raises ModelError (E-EVAL-NUMBER) for what is none, or no regular table."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        must = Message.of("W-EVAL-REGULAR")
        raise ModelError("E-EVAL-NUMBER", "evaluate", key=key, value=type(values).__name__, must=must) from error


def from_rows(up: ArrayLike | None = None, down: ArrayLike | None = None) -> FloatArray:
    """Two tables of rows (m, n), approach + and -, as (m, n, 2); a missing table is all NaN.

    Rows are readings in order of repetition; None or NaN is a missing reading, and the shorter table's repetitions that
    the other has more are missing ones. Raises ModelError (E-EVAL-NUMBER, E-EVAL-SHAPE).
    """
    tables = [np.empty((0, 0)) if rows is None else numbers("rows", rows) for rows in (up, down)]
    shapes = {table.shape for table in tables if table.size}
    if not shapes or any(len(shape) != 2 for shape in shapes) or len({shape[0] for shape in shapes}) != 1:
        raise ModelError("E-EVAL-SHAPE", "evaluate", targets="rows", deviations=sorted(shapes))
    filled = np.full((*np.max(sorted(shapes), axis=0), 2), np.nan)
    for approach, table in enumerate(tables):
        filled[: table.shape[0], : table.shape[1], approach] = table
    return filled


def counts(deviations: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """How many readings each target has in each approach: (..., m, n, 2) gives (..., m, 2)."""
    return np.isfinite(deviations).sum(axis=-2, dtype=np.int64)


def means(deviations: FloatArray) -> FloatArray:
    """Mean of each target and approach over its own n, (..., m, 2); NaN where there is no reading."""
    n = counts(deviations)
    total = np.nansum(deviations, axis=-2)
    return np.divide(total, n, out=np.full(n.shape, np.nan), where=n > 0)


def standard_deviations(deviations: FloatArray) -> FloatArray:
    """Sample standard deviation (n-1, two passes) of each target and approach, (..., m, 2); NaN where n < 2."""
    return moments(deviations)[1]


def moments(deviations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means and standard deviations (..., m, 2) at once, as `means` and `standard_deviations`."""
    if np.isfinite(deviations).all() and deviations.shape[-2] > 1:
        return _complete(deviations)
    n, mean = counts(deviations), means(deviations)
    centred = deviations - mean[..., None, :]
    # The second sum removes the rounding of the mean (corrected two-pass algorithm).
    squares = np.nansum(centred**2, axis=-2) - np.nansum(centred, axis=-2) ** 2 / np.maximum(n, 1)
    variance = np.divide(squares, n - 1, out=np.full(n.shape, np.nan), where=n > 1)
    return mean, np.sqrt(np.maximum(variance, 0.0))


def _complete(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same sums without looking for gaps: many trials are made of complete tests."""
    n, mean = x.shape[-2], x.sum(axis=-2) / x.shape[-2]
    centred = x - mean[..., None, :]
    squares = np.einsum("...ij,...ij->...j", centred, centred) - centred.sum(axis=-2) ** 2 / n
    return mean, np.sqrt(np.maximum(squares / (n - 1), 0.0))


def gaps(n: np.ndarray[tuple[int, ...], np.dtype[np.int64]], wanted: int, lost: str) -> tuple[Message, ...]:
    """What is missing in counts (m, 2): always said, never filled in.

    ``wanted`` is the standard's number of repetitions, ``lost`` what single readings cannot give ("s, R, A").
    """
    used = n[:, n.any(axis=0)]
    found = [Message.of("S-EVAL-ONE-WAY")] if used.shape[1] == 1 else []
    if n.shape[0] == 1:
        found.append(Message.of("S-EVAL-ONE-TARGET"))
    found += [Message.of("S-EVAL-NO-WAY", way="+-"[a], at=i + 1) for i, a in np.argwhere(used == 0)]
    runs = int(used.max())
    fewer = np.argwhere((used > 0) & (used < runs))
    found += [Message.of("S-EVAL-FEWER", n=used[i, a], runs=runs, at=i + 1) for i, a in fewer]
    if runs < wanted:
        few = "S-EVAL-SINGLE" if runs == 1 else "S-EVAL-RUNS"
        found.append(Message.of(few, runs=runs, lost=lost, wanted=wanted))
    elif 1 in used:
        found.append(Message.of("S-EVAL-LEFT-OUT", lost=lost.removeprefix("s, ")))
    return tuple(found)


# ---- The parameters of ISO 230-2 from means and standard deviations, of one test or of many trials at once.

NAMES = ("B", "B_mean", "M", "E", "E_up", "E_down", "R", "R_up", "R_down", "A", "A_up", "A_down")
"""In the order of the standard; every one carries the deviation unit, B_mean and B_i with their sign."""


def parameters_of_moments(mean: FloatArray, s: FloatArray, k: float) -> Mapping[str, FloatArray]:
    """All parameters of means and standard deviations (..., m, 2); ``k`` is 2, in the edition of 1988 3.

    A mean that stands on one reading takes no part in R and A, a target without one approach none in B, M, R. Absent
    (NaN) are R, A where nothing is repeated; E, A, B, M, R of one direction only (ISO 230-2:2014, clause 3; gaps by our
    own policy).
    """
    reversal = mean[..., 0] - mean[..., 1]
    return {
        "B": largest(np.abs(reversal)),
        "B_mean": average(reversal),
        "R": largest(repeatability(mean, s, k)),
        "R_up": largest(2.0 * k * s[..., 0]),
        "R_down": largest(2.0 * k * s[..., 1]),
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


def largest(values: FloatArray) -> FloatArray:
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


def stated_values(values: Mapping[str, FloatArray]) -> dict[str, float | None]:
    """One test's parameters as numbers, None for what does not exist."""
    return {name: float(value) if np.isfinite(value) else None for name, value in values.items()}


# How sure we are of a standard's formulas; stated with every result.

Certainty = Literal["from the text of the standard", "from secondary sources", "recalled"]

FROM_TEXT: Final = "from the text of the standard"
SECONDARY: Final = "from secondary sources"
RECALLED: Final = "recalled"
