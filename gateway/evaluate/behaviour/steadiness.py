"""Whether a machine and its instrument stood still while they measured: drift and jumps in the order of time; pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.message import Message, digits, fixed
from drivers.units import DeviationUnit
from gateway.domain.values import FloatArray

DEGREE = 3
SIDE = 8
FEWEST = 16
# With two repetitions nothing says which of them is off.
TELLS_WHICH = 3
SURE = 7.0
# Steps and drifts below this are no news on any machine, um or arcsec.
SMALL = 0.5
MAD_TO_SIGMA = 1.4826
MEDIAN = 1.25
OUT_OF_LINE = 6.0
CLEAR = 3.0
# Less than this, um or arcsec, within a capture says nothing of an hour, however clear it is.
LEAST = 0.1


@dataclass(frozen=True, slots=True)
class Steadiness:
    """Drift and largest jump of one capture, in the deviation unit; ``drift`` from first to last reading.

    ``per_h`` is the drift in an hour where it is clear, 0 else. ``jump_at_s`` is instrument time of the first reading
    after the jump (NaN: none). ``u`` is the standard uncertainty (RMS) that both leave in the targets' means: what
    hits all targets alike is not in it.
    """

    drift: float
    drift_u: float
    jump: float
    jump_at_s: float
    u: float
    said: tuple[Message, ...]
    per_h: float = 0.0


def steadiness(times_s: ArrayLike, deviations: ArrayLike, unit: DeviationUnit) -> Steadiness:
    """Judge deviations (m, n, 2) by when each was read, times_s (m, n, 2), NaN where missing; n >= 2.

    A target read again after a while shows what changed meanwhile. Drift is a cubic in time through these
    differences. A jump is a step between the readings before and after a moment that no drift explains; in a cycle
    that finishes one target before the next, it can only be seen among the readings of one target.
    """
    t, x = np.asarray(times_s, dtype=np.float64), np.asarray(deviations, dtype=np.float64)
    repeated = np.isfinite(x).sum(axis=1, keepdims=True) > 1
    good = np.isfinite(x) & np.isfinite(t) & repeated
    if good.sum() < FEWEST:
        return Steadiness(drift=0.0, drift_u=float("nan"), jump=0.0, jump_at_s=float("nan"), u=0.0, said=())
    powers = _powers(t, good)
    course = _course(x, good, powers)
    at_s = _moment(t[good], course.left) if np.max(good.sum(axis=1)) >= TELLS_WHICH else float("nan")
    late = np.where(t >= at_s, 1.0, 0.0)
    if np.isfinite(at_s):
        course = _course(x, good, [*powers, late])
    drifted = course.found[:DEGREE]
    jump = float(course.found[DEGREE]) if np.isfinite(at_s) else 0.0
    ones = np.ones(DEGREE)
    drift_u = float(np.sqrt(ones @ course.covariance[:DEGREE, :DEGREE] @ ones))
    left = np.stack([_per_target(power, good) for power in powers], axis=-1) @ drifted + jump * _per_target(late, good)
    drift = float(drifted.sum())
    return Steadiness(
        drift=drift,
        drift_u=drift_u,
        jump=jump,
        jump_at_s=at_s,
        u=float(np.std(left)),
        said=_said(drift, drift_u, jump, at_s, unit),
        per_h=3600.0 * drift / float(np.ptp(t[good])) if abs(drift) > max(LEAST, CLEAR * drift_u) else 0.0,
    )


def _said(drift: float, drift_u: float, jump: float, at_s: float, unit: DeviationUnit) -> tuple[Message, ...]:
    told: tuple[Message, ...] = ()
    if jump:
        told += (Message.of("W-STEADY-JUMP", jump=digits(jump, signed=True), at_s=fixed(at_s, 0), unit=unit),)
    if abs(drift) > max(2.0 * SMALL, CLEAR * drift_u):
        told += (Message.of("W-STEADY-DRIFT", drift=digits(drift, signed=True), unit=unit),)
    return told


def _apart(values: FloatArray, good: FloatArray) -> FloatArray:
    """Values (m, n, 2) less their mean over the repetitions of the same target and approach."""
    count = np.maximum(good.sum(axis=1, keepdims=True), 1)
    mean = np.sum(np.where(good, values, 0.0), axis=1, keepdims=True) / count
    return np.asarray(values - mean)


def _per_target(values: FloatArray, good: FloatArray) -> FloatArray:
    """Mean over all readings of each target (m',), targets without any left out."""
    count = good.sum(axis=(1, 2))
    sums = np.sum(np.where(good, values, 0.0), axis=(1, 2))
    return np.asarray(sums[count > 0] / count[count > 0])


@dataclass(frozen=True, slots=True)
class _Course:
    """Least squares through what changed between visits: step and powers of time, and their covariance."""

    found: FloatArray
    covariance: FloatArray
    left: FloatArray


def _course(x: FloatArray, good: FloatArray, columns: list[FloatArray]) -> _Course:
    """Readings far out of line are left out, as in the means of the targets."""
    design = np.stack([_apart(column, good)[good] for column in columns], axis=-1)
    y = _apart(x, good)[good]
    keep = np.ones(y.size, dtype=np.bool_)
    for _ in range(3):
        inverse = np.linalg.pinv(design[keep].T @ design[keep], rcond=1e-9)
        found = inverse @ (design[keep].T @ y[keep])
        left = y - design @ found
        middle = float(np.median(left))
        keep = np.abs(left - middle) <= OUT_OF_LINE * max(MAD_TO_SIGMA * float(np.median(np.abs(left - middle))), 1e-9)
    freedom = max(int(keep.sum()) - len(columns) - 2 * x.shape[0], 1)
    return _Course(found, inverse * float(left[keep] @ left[keep]) / freedom, left)


def _powers(t: FloatArray, good: FloatArray) -> list[FloatArray]:
    first, last = float(np.min(t[good])), float(np.max(t[good]))
    share = (t - first) / max(last - first, 1e-9)
    return [share**k for k in range(1, DEGREE + 1)]


def _moment(t: FloatArray, apart: FloatArray) -> float:
    """Time (of t (k,)) of the first reading after the clearest step in ``apart`` (k,), NaN where there is none."""
    order = np.argsort(t)
    times, y = t[order], apart[order]
    if y.size < 2 * SIDE:
        return float("nan")
    medians = np.median(np.lib.stride_tricks.sliding_window_view(y, SIDE), axis=1)
    steps = medians[SIDE:] - medians[:-SIDE]
    steps = steps - np.median(steps)
    # What neighbours in time differ by is scatter alone; a drift adds nothing to it.
    scatter = MAD_TO_SIGMA * float(np.median(np.abs(np.diff(y)))) / np.sqrt(2.0)
    worst = int(np.argmax(np.abs(steps)))
    if abs(steps[worst]) <= max(SURE * MEDIAN * scatter * np.sqrt(2.0 / SIDE), SMALL):
        return float("nan")
    return float(times[worst + _split(y[worst : worst + 2 * SIDE])])


def _split(y: FloatArray) -> int:
    """Where two levels explain a stretch of readings best."""
    left = [float(np.sum(np.abs(part - np.median(part)))) for k in range(2, y.size - 1) for part in (y[:k], y[k:])]
    return int(np.argmin(np.asarray(left).reshape(-1, 2).sum(axis=1))) + 2
