"""Structure finer than the targets: told by check stops between them, or by targets that miss the curve; pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from drivers.errors import words
from drivers.units import DeviationUnit
from gateway.domain.captures import Between
from gateway.domain.values import COVERAGE, COVERED, FloatArray
from gateway.evaluate.behaviour.repetitions import RobustMeans, robust_means
from gateway.evaluate.uncertainty.budget import coverage_factor
from gateway.model.components import standard_uncertainty, value
from gateway.model.fit import fit_positioning

Curve = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
FALSE_ALARM = 0.005
# Optics, air and rounding make even an exact machine miss a curve by so much, um or arcsec.
FLOOR = 0.05
# A median of few readings scatters by so much more than their mean.
MEDIAN = 1.25
FEWEST = 4
LONELY = 5.0
LONELY_FEWEST = 8


@dataclass(frozen=True, slots=True)
class Hidden:
    """How far the axis may lie from a curve between its targets, all in the deviation unit (um or arcsec).

    ``size`` is the best estimate, RMS over the travel, 0 where nothing beyond scatter was seen; ``u`` the standard
    uncertainty to add to the curve's own: from few places it is wider, as Student's factor asks (GUM, annex G).
    ``seen`` is the RMS by which ``places`` missed the curve, ``expected`` what scatter and the curve's own uncertainty
    explain.
    """

    u: float
    size: float
    seen: float
    expected: float
    places: int
    by: Literal["check stops", "targets", "nothing"]
    words: str


def hidden_structure(
    targets: ArrayLike,
    deviations: ArrayLike,
    unit: DeviationUnit,
    *,
    between: Between | None = None,
    curve: Curve | None = None,
    period: float | None = None,
) -> Hidden:
    """What targets (m,) with deviations (m, n, 2) do not show of an axis, as an extra standard uncertainty and words.

    Stops ``between`` the targets are held against ``curve`` (positions (k,) -> values and standard uncertainties (k,));
    left out, it is fitted here, ``period`` 360 for a full turn. Without stops it is what the fit leaves at the targets:
    that tells fine structure at random offsets, and nothing of what repeats at the targets' spacing or lies between
    two of them; with a curve given and no stops nothing is told, since its fit has said that already.
    Raises ModelError as `readings.checked`, NotIdentifiable as `fit_positioning`.
    """
    at, x = np.asarray(targets, dtype=np.float64), np.asarray(deviations, dtype=np.float64)
    means = robust_means(at, x)
    stops = between is not None and between.targets.size > 0
    if not np.isfinite(means.s) or at.size <= FEWEST or (curve is not None and not stops):
        return _nothing(at, unit)
    if curve is None:
        curve, left = usual_curve(at, means, period)
        if not stops:
            return _by_fit(at, means, left, unit)
    return _nothing(at, unit) if between is None else _by_stops(at, x, means, between, curve, unit)


def means_between(targets: ArrayLike, deviations: ArrayLike, between: Between) -> tuple[FloatArray, FloatArray]:
    """Mean of both directions (k,) at check stops, comparable with `robust_means` of the targets, and its u (k,).

    Medians, so that one reading out of line does no harm; half the reversal and the pass' offset are taken off.
    NaN where a stop has no reading. Raises ModelError as `readings.checked`.
    """
    at, x = np.asarray(targets, dtype=np.float64), np.asarray(deviations, dtype=np.float64)
    means = robust_means(at, x)
    passes = min(x.shape[1], between.deviations.shape[1])
    half = 0.5 * _reversal(at, means, between.targets)
    shift = np.nan_to_num(means.pass_offsets)[None, :passes] + np.stack([half, -half], axis=-1)[:, None, :]
    level = (between.deviations[:, :passes] - shift).reshape(between.targets.size, -1)
    counts = np.isfinite(level).sum(axis=1)
    found = np.full(between.targets.size, np.nan)
    for i in np.flatnonzero(counts):
        found[i] = float(np.nanmedian(level[i]))
    return found, np.asarray(MEDIAN * means.s / np.sqrt(np.maximum(counts, 1)))


def lonely(targets: ArrayLike, means: ArrayLike, u: ArrayLike) -> float | None:
    """The one target (its position) whose mean (m,) stands far out of the line of its neighbours while no other does.

    Nothing tells how wide such a place is: a table would spread it to the neighbouring targets. None where there is no
    such target; the outer two are not judged. ``u`` (m,) are standard uncertainties of the means.
    """
    at, y = np.asarray(targets, dtype=np.float64), np.asarray(means, dtype=np.float64)
    good = np.isfinite(y)
    at, y, known_u = at[good], y[good], np.asarray(u, dtype=np.float64)[good]
    if at.size < LONELY_FEWEST:
        return None
    off = out_of_line(at, y)
    worst = int(np.argmax(off))
    others = np.delete(off, np.arange(max(worst - 1, 0), min(worst + 2, off.size)))
    usual = max(float(np.sqrt(np.mean(others**2))), float(np.mean(known_u)), FLOOR)
    return float(at[worst + 1]) if off[worst] > LONELY * usual else None


def out_of_line(at: FloatArray, means: FloatArray) -> FloatArray:
    """How far each inner target's mean (m,) lies off the straight line between its neighbours' (m - 2,)."""
    share = (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
    return np.asarray(np.abs(means[1:-1] - (1.0 - share) * means[:-2] - share * means[2:]))


def _reversal(at: FloatArray, means: RobustMeans, places: FloatArray) -> FloatArray:
    """B (k,) between the targets, by straight lines."""
    b = means.mean_up - means.mean_down
    good = np.isfinite(b)
    return np.interp(places, at[good], b[good]) if good.any() else np.zeros(places.size)


def _nothing(at: FloatArray, unit: DeviationUnit) -> Hidden:
    widest = float(np.max(np.diff(np.sort(at)))) if at.size > 1 else 0.0
    return Hidden(
        u=0.0,
        size=0.0,
        seen=0.0,
        expected=0.0,
        places=0,
        by="nothing",
        words=words("W-HIDDEN-UNSEEN", widest=f"{widest:.3g}", unit=unit),
    )


def usual_curve(at: FloatArray, means: RobustMeans, period: float | None) -> tuple[Curve, float]:
    """The usual curve through the means, and the RMS of what it leaves beyond scatter."""
    turns = period is not None
    fit = fit_positioning(
        at,
        means.mean,
        means.u,
        name="",
        axis="",
        axis_unit="deg" if turns else "mm",
        kind="rotary" if turns else "linear",
        modulo=turns,
    )
    return (lambda places: (value(fit, places), standard_uncertainty(fit, places))), fit.residual_rms


def _by_fit(at: FloatArray, means: RobustMeans, left: float, unit: DeviationUnit) -> Hidden:
    noise = float(np.sqrt(np.nanmean(means.u**2)))
    told = _words("W-HIDDEN-MISFIT" if left > noise else "W-HIDDEN-NONE", at.size, "targets", left, noise, left, unit)
    return Hidden(u=left, size=left, seen=left, expected=noise, places=int(at.size), by="targets", words=told)


def _by_stops(
    at: FloatArray, x: FloatArray, means: RobustMeans, between: Between, curve: Curve, unit: DeviationUnit
) -> Hidden:
    """A variance ratio decides whether the stops lie on the curve."""
    stood, u = means_between(at, x, between)
    values, u_curve = curve(between.targets)
    good = np.isfinite(stood)
    if not good.any():
        return _nothing(at, unit)
    expected = float(np.mean((u**2 + u_curve**2 + FLOOR**2)[good]))
    seen, count = float(np.mean((stood - values)[good] ** 2)), int(good.sum())
    freedom = max(int(np.isfinite(means.mean_up).sum() + np.isfinite(means.mean_down).sum()), FEWEST)
    shown = seen / expected > float(scipy.special.fdtri(count, freedom, 1.0 - FALSE_ALARM))
    wide = coverage_factor(COVERED, count) / COVERAGE
    size = sqrt(max(seen - expected, 0.0)) if shown else 0.0
    code = "W-HIDDEN-STOPS" if shown else "W-HIDDEN-NONE"
    told = _words(code, count, "check stops", sqrt(seen), sqrt(expected), wide * size, unit)
    return Hidden(
        u=wide * size, size=size, seen=sqrt(seen), expected=sqrt(expected), places=count, by="check stops", words=told
    )


def _words(code: str, count: int, by: str, seen: float, expected: float, u: float, unit: DeviationUnit) -> str:
    sizes = {"seen": f"{seen:.2g}", "expected": f"{expected:.2g}", "u": f"{u:.2g}"}
    return words(code, count=count, by=by, unit=unit, **sizes)
