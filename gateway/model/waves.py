"""The one curve of a measured axis: its smooth part, with short waves of screw or worm where these are significant."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import log
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from drivers.units import AxisUnit
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.errors import NotIdentifiable
from gateway.model.components import LONGEST_WAVE, KnownRange, design, is_periodic, value
from gateway.model.fit import (
    SMALLEST_U,
    THROUGH,
    TURN_DEG,
    Regression,
    check_means,
    fit_positioning,
    fit_through,
    solve_weighted,
)

MOST_WAVES = 2
WIDER_THAN = 0.75  # of all gaps
FEWEST_FREE = 10  # targets beyond the unknowns: fewer carry a wave too easily
FALSE_ALARM = 1e-4  # chance that scatter alone looks like a wave, all periods together
SHARE_OF_GAP = 6.0  # periods down to this share of the usual gap between targets are looked for
STEPS_A_PERIOD = 8.0  # how finely frequencies are tried
CLEARLY = 16.0  # so much more chi-square, times its scatter, must the best wave take than any of another period
NO_RIVAL = 0.1  # and by this share of it: between two tried frequencies a wave shows a little less than it is
OWN_PART = 0.15  # of a wave that no smooth part and no other wave may stand for at the targets; alone it is a half
HIGHEST_DEGREE, MOST_KNOTS = 9, 12
Parameters = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class WavedFit:
    """A smooth part with waves, solved: its basis and parameters, and ``unknowns`` with the periods among them."""

    basis: str
    parameters: Parameters
    solved: Regression
    unknowns: int
    criterion: float


def fit_waves(at: FloatArray, mean: FloatArray, u: FloatArray, turn: float | None = None) -> WavedFit | None:
    """The best smooth curve with up to two waves through means (m,) at ascending ``at`` with standard uncertainties u.

    ``turn`` is 360 where the axis closes on itself: waves are then whole orders. None where no wave can be told from
    scatter, or where the targets are too few to carry one.
    """
    rates = _rates(at, turn)
    tried = [one for base in _bases(at, turn) for one in _with_waves(base, at, mean, u, rates)]
    return min(tried, key=lambda one: one.criterion) if tried else None


def usual_gap(at: FloatArray) -> float:
    """The gap that the targets' travel is divided by; those put between others for a reason hardly make it smaller."""
    return float(np.quantile(np.diff(np.unique(at)), WIDER_THAN))


def _rates(at: FloatArray, turn: float | None) -> FloatArray:
    """Frequencies that are tried, 1/mm or 1/deg."""
    gap, span = usual_gap(at), float(np.ptp(at))
    if turn is not None:
        # From the first order on that the smooth part cannot have: no order between the two is left out.
        return np.arange(_highest(at) + 1, int(SHARE_OF_GAP * turn / gap) + 1) / turn
    low, high = 1.0 / (4.0 * gap), SHARE_OF_GAP / gap
    return np.arange(low, high, 1.0 / (STEPS_A_PERIOD * span))


def _highest(at: FloatArray) -> int:
    """The highest order of the smooth part of a turn: fewer targets carry fewer orders."""
    return min(LONGEST_WAVE, at.size // 8)


def _bases(at: FloatArray, turn: float | None) -> Iterator[tuple[str, dict[str, Any]]]:
    most = at.size // 4
    if turn is not None:
        for highest in range(1, _highest(at) + 1):
            yield "fourier", {"period": turn, "orders": tuple(range(1, highest + 1))}
        return
    low, high = float(at[0]), float(at[-1])
    for degree in range(1, min(HIGHEST_DEGREE, most) + 1):
        yield "polynomial", {"centre": (low + high) / 2.0, "scale": (high - low) / 2.0, "degree": degree}
    for count in range(2, min(most - 4, MOST_KNOTS), 2):
        interior = np.quantile(at, np.linspace(0.0, 1.0, count + 2)[1:-1])
        yield "bspline", {"knots": (low,) * 4 + tuple(float(one) for one in interior) + (high,) * 4}


def _with_waves(
    base: tuple[str, dict[str, Any]], at: FloatArray, mean: FloatArray, u: FloatArray, rates: FloatArray
) -> Iterable[WavedFit]:
    """The base with one and with two waves, as far as each is told from scatter."""
    found: tuple[float, ...] = ()
    try:
        before = _solve_wave(base, found, at, mean, u)
        for _ in range(MOST_WAVES):
            if at.size - before.unknowns - 3 < FEWEST_FREE:
                return
            rate, rival = _strongest(base, found, at, mean, u, rates)
            found = (*found, rate)
            after = _solve_wave(base, found, at, mean, u)
            if not _is_significant(before, after, at.size, rates.size) or not _alone(before, after, at.size, rival):
                return
            yield after
            before = after
    except NotIdentifiable:
        return


def _is_significant(before: WavedFit, after: WavedFit, m: int, tries: int) -> bool:
    """Whether a wave takes more of chi-square than the best of all that were tried would of scatter."""
    taken, left = before.solved.chi_square - after.solved.chi_square, after.solved.chi_square
    freedom = m - after.unknowns
    ratio = (taken / 3.0) / max(left / freedom, 1.0)
    return float(scipy.special.fdtrc(3, freedom, max(ratio, 0.0))) * tries < FALSE_ALARM


def _alone(before: WavedFit, after: WavedFit, m: int, rival: float) -> bool:
    """Whether no wave of another rate, which takes ``rival`` of chi-square, would do nearly as well."""
    scatter = max(after.solved.chi_square / (m - after.unknowns), 1.0)
    best = before.solved.chi_square - after.solved.chi_square
    return best - rival > max(CLEARLY * scatter, NO_RIVAL * best)


def _solve_wave(
    base: tuple[str, dict[str, Any]], rates: tuple[float, ...], at: FloatArray, mean: FloatArray, u: FloatArray
) -> WavedFit:
    name, parameters = base
    if name == "fourier":
        orders = tuple(round(rate * parameters["period"]) for rate in rates)
        named, kept = name, {**parameters, "orders": (*parameters["orders"], *orders)}
    else:
        named, kept = "waved", {**parameters, "smooth": name, "lengths": tuple(1.0 / rate for rate in rates)}
    solved = solve_weighted(design(named, kept, at), mean, u, named)
    unknowns = int(solved.coefficients.size) + len(rates)
    per_point = solved.chi_square / at.size
    misfit = at.size * (log(per_point) + 1.0 if per_point > 1.0 else per_point)
    criterion = misfit + 2.0 * unknowns * at.size / max(at.size - unknowns - 1, 0.5)
    return WavedFit(basis=named, parameters=kept, solved=solved, unknowns=unknowns, criterion=criterion)


def _strongest(
    base: tuple[str, dict[str, Any]],
    found: tuple[float, ...],
    at: FloatArray,
    mean: FloatArray,
    u: FloatArray,
    rates: FloatArray,
) -> tuple[float, float]:
    """The rate whose wave takes most of what the base and the waves ``found`` leave, and what another would take."""
    columns = np.column_stack([design(*base, at), *(_wave(rate, at) for rate in found)]) / u[:, None]
    q = np.linalg.qr(columns)[0]
    taken = _chi_square_gain(q, at, mean / u, u, rates)
    best, fourier = float(rates[int(np.argmax(taken))]), base[0] == "fourier"
    others = np.abs(rates - best) > (0.0 if fourier else 1.5 / float(np.ptp(at)))
    rival = float(np.max(taken[others], initial=0.0))
    if fourier:
        return best, rival
    near = best + np.linspace(-1.0, 1.0, 41) * float(np.diff(rates[:2])[0])
    return float(near[int(np.argmax(_chi_square_gain(q, at, mean / u, u, near)))]), rival


def _chi_square_gain(q: FloatArray, at: FloatArray, y: FloatArray, u: FloatArray, rates: FloatArray) -> FloatArray:
    """How much of chi-square a wave of each rate takes beyond the columns ``q``."""
    phase = 2.0 * np.pi * np.outer(at, rates)
    c, s = ((one / u[:, None]) for one in (np.cos(phase), np.sin(phase)))
    whole = np.sum(c * c + s * s, axis=0)
    c, s = c - q @ (q.T @ c), s - q @ (q.T @ s)
    cc, ss, cs = (np.sum(one, axis=0) for one in (c * c, s * s, c * s))
    yc, ys, det = y @ c, y @ s, cc * ss - cs**2
    own = det > (OWN_PART * whole) ** 2
    return np.divide(ss * yc**2 - 2.0 * cs * yc * ys + cc * ys**2, det, out=np.zeros(det.shape), where=own)


def _wave(rate: float, at: FloatArray) -> FloatArray:
    phase = 2.0 * np.pi * rate * at
    return np.stack([np.cos(phase), np.sin(phase)], axis=1)


# ---- The one curve of a measured axis, for its table and for the error model: smooth, with waves, or through the
# means.

LEAVES, FAR_ABOVE = 0.15, 4.0
"""What a smooth fit may leave at a target: um or arcsec, and times the standard uncertainty of a mean."""
WAVE_LEAVES = 0.25
"""A curve with waves may leave this share of what the smooth one does."""


def fit_means(
    targets: ArrayLike,
    means: ArrayLike,
    u: ArrayLike,
    *,
    name: str,
    axis: str,
    axis_unit: AxisUnit,
    kind: Literal["linear", "rotary"],
    modulo: bool = False,
) -> Component:
    """The one curve of a measured axis; arguments as `fit_positioning`.

    Where a smooth curve leaves far more than the scatter at a target it is one with short waves, if the targets can
    tell these, and on a linear axis else one through the means.
    """
    at, mean, own = check_means(targets, means, u)
    named: dict[str, Any] = {"name": name, "axis": axis, "axis_unit": axis_unit}
    smooth = fit_positioning(at, mean, own, kind=kind, modulo=modulo, **named)
    known = np.isfinite(mean)
    at, mean, own = at[known], mean[known], own[known]
    through = smooth.basis in THROUGH
    # What goes through the means leaves nothing at the targets: what they miss is told by each that is left out.
    left = smooth.residual_rms if through else float(np.max(np.abs(mean - value(smooth, at))))
    allowed = max(LEAVES, FAR_ABOVE * float(np.max(own)))
    if left <= allowed:
        return smooth
    waved = _fit_with_waves(smooth, at, mean, np.maximum(own, SMALLEST_U))
    if waved is not None and float(np.max(np.abs(mean - value(waved, at)))) <= max(allowed, WAVE_LEAVES * left):
        return waved
    return smooth if through or kind == "rotary" else fit_through(at, mean, own, **named)


def _fit_with_waves(smooth: Component, at: FloatArray, mean: FloatArray, u: FloatArray) -> Component | None:
    """The curve with waves that the means tell; None where they tell none."""
    at = KnownRange.of(smooth).inside(at)
    order = np.argsort(at, kind="stable")
    fit = fit_waves(at[order], mean[order], u[order], TURN_DEG if is_periodic(smooth) else None)
    if fit is None:
        return None
    freedom = max(at.size - fit.unknowns, 1)
    spread = float(np.sum(fit.solved.residual**2)) / freedom - float(np.mean(u**2))
    return Component(
        name=smooth.name,
        axis=smooth.axis,
        axis_unit=smooth.axis_unit,
        basis=fit.basis,
        domain=smooth.domain,
        coefficients=fit.solved.coefficients,
        covariance=fit.solved.covariance,
        parameters=fit.parameters,
        residual_rms=float(np.sqrt(max(spread, 0.0))),
    )
