"""A short check of one axis against its approved curve: place by place, and as offset, slope and harmonics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.message import Message, Quantity
from drivers.units import DeviationUnit
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE, FloatArray, component_unit
from gateway.guard.verdict import Change, GuardVerdict, judged, margin_factor, told, unknown
from gateway.model.components import is_periodic, motion_uncertainty, value

FEWEST = 3
SAME = 1e-4
HIGHEST_ORDER = 3
OFFSET = Message.of("S-GUARD-OFFSET")


@dataclass(frozen=True, slots=True)
class Approved:
    """The approved curve, and the means (m,) it was fitted to at targets (m,) with their standard uncertainties.

    A check at those very targets is compared with the means; elsewhere with the curve, and structure that it does not
    follow counts as uncertainty. ``freedom`` are the degrees of freedom of the means' scatter.
    """

    curve: Component
    targets: FloatArray = field(default_factory=lambda: np.empty(0))
    means: FloatArray = field(default_factory=lambda: np.empty(0))
    u: FloatArray = field(default_factory=lambda: np.empty(0))
    freedom: float = float("inf")

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and standard uncertainties (k,) at places (k,)."""
        values = value(self.curve, places)
        u = motion_uncertainty(self.curve, places)
        for index, target in enumerate(self.targets):
            same = np.abs(places - target) < SAME
            if np.isfinite(self.means[index]) and np.isfinite(self.u[index]):
                values, u = np.where(same, self.means[index], values), np.where(same, self.u[index], u)
        return values, u


@dataclass(frozen=True, slots=True)
class Check:
    """What a short check found: means (m,) at targets (m,) with standard uncertainties (NaN: not measured).

    ``freedom`` are the degrees of freedom of their scatter; ``mounting`` the standard uncertainty by which a new
    mounting may differ from the approved one's at any place.
    """

    targets: FloatArray
    means: FloatArray
    u: FloatArray
    freedom: float = float("inf")
    mounting: float = 0.0


def guard_axis(approved: Approved, check: Check, limit: float) -> GuardVerdict:
    """Whether the curve still holds within ``limit`` (um or arcsec) at the places checked.

    The common offset is the datum's and does not count. Between the places nothing is claimed. Never "still valid"
    where a place has really changed by more than the limit, but for one case in thirty thousand at its very edge.
    """
    unit = component_unit(approved.curve.name, approved.curve.axis_unit)
    at, mean, u = _known(check)
    if at.size < FEWEST:
        return unknown(limit, unit, "S-GUARD-FEW", count=at.size, least=FEWEST)
    low, high = approved.curve.domain
    if not is_periodic(approved.curve) and (at.min() < low - 1e-6 or at.max() > high + 1e-6):
        return unknown(limit, unit, "S-GUARD-DOMAIN", low=f"{low:g}", high=f"{high:g}")
    curve, curve_u = approved.at(at)
    whole = np.sqrt(u**2 + curve_u**2 + check.mounting**2)
    weight = 1.0 / whole**2
    difference = mean - curve
    offset = float(weight @ difference / weight.sum())
    change = difference - offset
    margin = margin_factor(min(check.freedom, approved.freedom)) * np.sqrt(whole**2 + 1.0 / weight.sum())
    worst = int(np.argmax(np.abs(change) + np.where(np.abs(change) > limit, 0.0, margin)))
    changes = _shapes(at, difference, whole, unit, turning=is_periodic(approved.curve))
    answer = judged(change, margin, limit)
    return GuardVerdict(
        answer=answer,
        largest=float(change[worst]),
        at=float(at[worst]),
        limit=limit,
        margin=float(margin[worst]),
        unit=unit,
        changes=changes,
        said=told(changes),
    )


def _known(check: Check) -> tuple[FloatArray, FloatArray, FloatArray]:
    here = np.isfinite(check.means) & np.isfinite(check.u) & np.isfinite(check.targets)
    return check.targets[here], check.means[here], check.u[here]


def _shapes(
    at: FloatArray, difference: FloatArray, u: FloatArray, unit: DeviationUnit, *, turning: bool
) -> tuple[Change, ...]:
    """Weighted least squares of the difference by offset and slope, or offset and as many harmonics as at tells."""
    if not turning:
        span = float(np.ptp(at))
        found, spread = _solved(np.column_stack([np.ones_like(at), (at - at.mean()) / span]), difference, u)
        slope = Message.of("S-GUARD-SLOPE", span=Quantity(float(span)))
        return (
            Change("offset", float(found[0]), COVERAGE * float(spread[0]), unit, named=OFFSET),
            Change(f"slope over {span:g} mm", float(found[1]), COVERAGE * float(spread[1]), unit, named=slope),
        )
    orders = range(1, min(HIGHEST_ORDER, (at.size - 2) // 2) + 1)
    q = np.deg2rad(at)
    columns = [np.ones_like(q), *(wave(order * q) for order in orders for wave in (np.cos, np.sin))]
    found, spread = _solved(np.column_stack(columns), difference, u)
    return (
        Change("offset", float(found[0]), COVERAGE * float(spread[0]), unit, named=OFFSET),
        *_waves(orders, found, spread, unit),
    )


def _waves(orders: Sequence[int], found: FloatArray, spread: FloatArray, unit: DeviationUnit) -> list[Change]:
    pairs = [(order, slice(2 * order - 1, 2 * order + 1)) for order in orders]
    return [
        Change(
            f"harmonic {order}",
            float(np.hypot(*found[pair])),
            COVERAGE * float(np.max(spread[pair])),
            unit,
            named=Message.of("S-GUARD-HARMONIC", order=order),
        )
        for order, pair in pairs
    ]


def _solved(columns: FloatArray, y: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    rows = columns / u[:, None]
    inverse = np.linalg.pinv(rows)
    return np.asarray(inverse @ (y / u)), np.sqrt(np.sum(inverse**2, axis=1))
