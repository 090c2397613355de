"""Structure finer than the targets, found by check stops or by targets that miss the curve, and the range with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from drivers.message import Message, digits
from drivers.units import DeviationUnit
from gateway.domain.captures import Between, Capture
from gateway.domain.figures import Evaluation
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
ISOLATION_FACTOR = 5.0
ISOLATION_FEWEST = 8


@dataclass(frozen=True, slots=True)
class HiddenStructure:
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
    words: tuple[Message, ...]


def hidden_structure(
    targets: ArrayLike,
    deviations: ArrayLike,
    unit: DeviationUnit,
    *,
    between: Between | None = None,
    curve: Curve | None = None,
    period: float | None = None,
) -> HiddenStructure:
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
        return _no_structure(at, unit)
    if curve is None:
        curve, left = usual_curve(at, means, period)
        if not stops:
            return _by_fit(at, means, left, unit)
    return _no_structure(at, unit) if between is None else _by_stops(at, x, means, between, curve, unit)


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


def isolated_outlier(targets: ArrayLike, means: ArrayLike, u: ArrayLike) -> float | None:
    """The one target (its position) whose mean (m,) stands far out of the line of its neighbours while no other does.

    Nothing tells how wide such a place is: a table would spread it to the neighbouring targets. None where there is no
    such target; the outer two are not judged. ``u`` (m,) are standard uncertainties of the means.
    """
    at, y = np.asarray(targets, dtype=np.float64), np.asarray(means, dtype=np.float64)
    good = np.isfinite(y)
    at, y, known_u = at[good], y[good], np.asarray(u, dtype=np.float64)[good]
    if at.size < ISOLATION_FEWEST:
        return None
    off = out_of_line(at, y)
    worst = int(np.argmax(off))
    others = np.delete(off, np.arange(max(worst - 1, 0), min(worst + 2, off.size)))
    usual = max(float(np.sqrt(np.mean(others**2))), float(np.mean(known_u)), FLOOR)
    return float(at[worst + 1]) if off[worst] > ISOLATION_FACTOR * usual else None


def out_of_line(at: FloatArray, means: FloatArray) -> FloatArray:
    """How far each inner target's mean (m,) lies off the straight line between its neighbours' (m - 2,)."""
    share = (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
    return np.asarray(np.abs(means[1:-1] - (1.0 - share) * means[:-2] - share * means[2:]))


def _reversal(at: FloatArray, means: RobustMeans, places: FloatArray) -> FloatArray:
    """B (k,) between the targets, by straight lines."""
    b = means.mean_up - means.mean_down
    good = np.isfinite(b)
    return np.interp(places, at[good], b[good]) if good.any() else np.zeros(places.size)


def _no_structure(at: FloatArray, unit: DeviationUnit) -> HiddenStructure:
    widest = float(np.max(np.diff(np.sort(at)))) if at.size > 1 else 0.0
    return HiddenStructure(
        u=0.0,
        size=0.0,
        seen=0.0,
        expected=0.0,
        places=0,
        by="nothing",
        words=(Message.of("W-HIDDEN-UNSEEN", widest=digits(widest, 3), unit=unit),),
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


def _by_fit(at: FloatArray, means: RobustMeans, left: float, unit: DeviationUnit) -> HiddenStructure:
    noise = float(np.sqrt(np.nanmean(means.u**2)))
    told = _words(
        "W-HIDDEN-MISFIT" if left > noise else "W-HIDDEN-NONE", at.size, "S-BY-TARGETS", left, noise, left, unit
    )
    return HiddenStructure(u=left, size=left, seen=left, expected=noise, places=int(at.size), by="targets", words=told)


def _by_stops(
    at: FloatArray, x: FloatArray, means: RobustMeans, between: Between, curve: Curve, unit: DeviationUnit
) -> HiddenStructure:
    """A variance ratio decides whether the stops lie on the curve."""
    stood, u = means_between(at, x, between)
    values, u_curve = curve(between.targets)
    good = np.isfinite(stood)
    if not good.any():
        return _no_structure(at, unit)
    expected = float(np.mean((u**2 + u_curve**2 + FLOOR**2)[good]))
    seen, count = float(np.mean((stood - values)[good] ** 2)), int(good.sum())
    freedom = max(int(np.isfinite(means.mean_up).sum() + np.isfinite(means.mean_down).sum()), FEWEST)
    shown = seen / expected > float(scipy.special.fdtri(count, freedom, 1.0 - FALSE_ALARM))
    wide = coverage_factor(COVERED, count) / COVERAGE
    size = sqrt(max(seen - expected, 0.0)) if shown else 0.0
    code = "W-HIDDEN-STOPS" if shown else "W-HIDDEN-NONE"
    told = _words(code, count, "S-BY-STOPS", sqrt(seen), sqrt(expected), wide * size, unit)
    return HiddenStructure(
        u=wide * size, size=size, seen=sqrt(seen), expected=sqrt(expected), places=count, by="check stops", words=told
    )


def _words(
    code: str, count: int, by: str, seen: float, expected: float, u: float, unit: DeviationUnit
) -> tuple[Message, ...]:
    sizes = {"seen": digits(seen), "expected": digits(expected), "u": digits(u)}
    return (Message.of(code, count=count, by=Message.of(by), unit=unit, **sizes),)


# ---- The range of the mean deviation over the whole travel: M is a figure of the targets alone.
#
# Check stops tell how far the axis lies from the curve between its targets, but only as well as few places can: the
# variance is drawn by chi^2 of their number, less what scatter explains (GUM 4.3, JCGM 101:2008). What the structure
# looks like nobody saw, so it is drawn in every gap. Its mean is expected, its spread is in U.

TURN_DEG = 360.0
DRAWS = 2000
PER_GAP = 8
# A turn counts as whole where the last gap is hardly wider than the others.
WIDEST = 1.5
SURE = 2.0
# Fewer stops say next to nothing: those that lack are supposed to have shown scatter alone.
FEW = 4


def over_travel(evaluation: Evaluation, capture: Capture) -> Evaluation:
    """An evaluation with ``M_travel`` and its U (k = 2), in the deviation unit, over the travel that was measured.

    Without anything that shows what lies between the targets there is no such figure, and ``flags`` says so. Raises
    ModelError as `readings.checked`, NotIdentifiable as the usual fit.
    """
    found = _expected_range(capture)
    if found is None or "M" not in evaluation.U:
        return replace(evaluation, flags=(*evaluation.flags, Message.of("S-TRAVEL-UNSEEN")))
    largest, spread = found
    return replace(evaluation, M_travel=largest, U={**evaluation.U, "M_travel": hypot(evaluation.U["M"], spread)})


def _expected_range(capture: Capture) -> tuple[float, float] | None:
    """The range to be expected, and the expanded uncertainty that structure between the targets gives it."""
    at, means = capture.targets, robust_means(capture.targets, capture.deviations)
    if not np.isfinite(means.s) or at.size <= FEWEST:
        return None
    period = _period(capture)
    curve, _ = usual_curve(at, means, period)
    stops = capture.between is not None and capture.between.targets.size > 0
    hidden = hidden_structure(
        at,
        capture.deviations,
        capture.unit,
        between=capture.between,
        curve=curve if stops else None,
        period=period,
    )
    if hidden.by == "nothing":
        return None
    ends = at if period is None else np.append(at, at[0] + period)
    sizes = np.maximum(_sizes(hidden)[:, None], _missed_structure(at, means, curve(at)[0], period))
    ranges = _drawn(ends, curve=lambda q: curve(q)[0], sizes=sizes, seen=_means_everywhere(capture, means))
    largest = float(np.mean(ranges))
    return largest, float(np.quantile(np.abs(ranges - largest), COVERED))


def _period(capture: Capture) -> float | None:
    """A full turn where the targets go all round."""
    gap = float(np.max(np.diff(capture.targets)))
    rest = TURN_DEG - float(np.ptp(capture.targets))
    return TURN_DEG if capture.axis_unit == "deg" and rest <= WIDEST * gap else None


def _sizes(hidden: HiddenStructure) -> FloatArray:
    """Draws of the structure's RMS: of few places it is known as well as their number tells."""
    if hidden.by != "check stops":
        return np.full(DRAWS, hidden.size)
    supposed = max(FEW - hidden.places, 0)
    squares = hidden.seen**2 * hidden.places + hidden.expected**2 * supposed
    variance = squares / np.random.default_rng(1).chisquare(hidden.places + supposed, DRAWS)
    return np.asarray(np.sqrt(np.maximum(variance - hidden.expected**2, 0.0)))


def _missed_structure(at: FloatArray, means: RobustMeans, fitted: FloatArray, period: float | None) -> FloatArray:
    """Beyond scatter, beside each gap: how far the curve misses a target, and half of what bends from target to target.

    A curve that goes through every target misses none; a corner there is steeper or flatter than it shows.
    """
    turns = period is not None
    off = np.maximum(np.abs(means.mean - fitted), 0.5 * np.abs(_corners(at, means.mean, period)))
    left = np.nan_to_num(np.sqrt(np.maximum(off**2 - (SURE * means.u) ** 2, 0.0)))
    either = np.maximum(left, np.roll(left, -1))
    return np.asarray(either if turns else either[:-1])


def _corners(at: FloatArray, mean: FloatArray, period: float | None) -> FloatArray:
    """How far each target lies off the line between its neighbours; the outer two of a line are no corners."""
    lap = period if period is not None else np.nan
    places = np.concatenate([at[-1:] - lap, at, at[:1] + lap])
    values = np.concatenate([mean[-1:], mean, mean[:1]])
    share = (places[1:-1] - places[:-2]) / (places[2:] - places[:-2])
    return np.asarray(np.nan_to_num(values[1:-1] - (1.0 - share) * values[:-2] - share * values[2:]))


def _means_everywhere(capture: Capture, means: RobustMeans) -> FloatArray:
    """Means at all places that were read."""
    found = [means.mean]
    if capture.between is not None and capture.between.targets.size:
        found.append(means_between(capture.targets, capture.deviations, capture.between)[0])
    whole = np.concatenate(found)
    return np.asarray(whole[np.isfinite(whole)])


def _drawn(
    ends: FloatArray, curve: Callable[[FloatArray], FloatArray], sizes: FloatArray, seen: FloatArray
) -> FloatArray:
    """Ranges (draws,) of the curve with structure of these sizes in every gap, and never less than was seen."""
    share = np.arange(PER_GAP) / PER_GAP
    places = np.append((ends[:-1, None] + share * np.diff(ends)[:, None]).ravel(), ends[-1])
    bent = np.random.default_rng(2).standard_normal((*sizes.shape, 1)) * sizes[:, :, None]
    arcs = (bent * np.sin(np.pi * share)).reshape(len(sizes), -1)
    drawn = curve(places) + np.append(arcs, np.zeros((len(sizes), 1)), axis=1)
    high, low = np.max(drawn, axis=1), np.min(drawn, axis=1)
    return np.asarray(np.maximum(high, np.max(seen)) - np.minimum(low, np.min(seen)))
