"""The range of the mean deviation over the whole travel, beside M, which is a figure of the targets alone; pure.

Check stops tell how far the axis lies from the curve between its targets, but only as well as few places can: the
variance is drawn by chi^2 of their number, less what scatter explains (GUM 4.3, JCGM 101:2008). What the structure
looks like nobody saw, so it is drawn in every gap. Its mean is expected, its spread is in U.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import hypot

import numpy as np

from drivers.message import Message
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.values import COVERED, FloatArray
from gateway.evaluate.behaviour.fine_structure import FEWEST, Hidden, hidden_structure, means_between, usual_curve
from gateway.evaluate.behaviour.repetitions import RobustMeans, robust_means

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
    found = _expected(capture)
    if found is None or "M" not in evaluation.U:
        return replace(evaluation, flags=(*evaluation.flags, Message.of("S-TRAVEL-UNSEEN")))
    largest, spread = found
    return replace(evaluation, M_travel=largest, U={**evaluation.U, "M_travel": hypot(evaluation.U["M"], spread)})


def _expected(capture: Capture) -> tuple[float, float] | None:
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
    sizes = np.maximum(_sizes(hidden)[:, None], _missed(at, means, curve(at)[0], period))
    ranges = _drawn(ends, curve=lambda q: curve(q)[0], sizes=sizes, seen=_seen(capture, means))
    largest = float(np.mean(ranges))
    return largest, float(np.quantile(np.abs(ranges - largest), COVERED))


def _period(capture: Capture) -> float | None:
    """A full turn where the targets go all round."""
    gap = float(np.max(np.diff(capture.targets)))
    rest = TURN_DEG - float(np.ptp(capture.targets))
    return TURN_DEG if capture.axis_unit == "deg" and rest <= WIDEST * gap else None


def _sizes(hidden: Hidden) -> FloatArray:
    """Draws of the structure's RMS: of few places it is known as well as their number tells."""
    if hidden.by != "check stops":
        return np.full(DRAWS, hidden.size)
    supposed = max(FEW - hidden.places, 0)
    squares = hidden.seen**2 * hidden.places + hidden.expected**2 * supposed
    variance = squares / np.random.default_rng(1).chisquare(hidden.places + supposed, DRAWS)
    return np.asarray(np.sqrt(np.maximum(variance - hidden.expected**2, 0.0)))


def _missed(at: FloatArray, means: RobustMeans, fitted: FloatArray, period: float | None) -> FloatArray:
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


def _seen(capture: Capture, means: RobustMeans) -> FloatArray:
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
