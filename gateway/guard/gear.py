"""An inspected gear against the approved one, point by point of the fitted flank; its clamping does not count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.message import Message, words
from drivers.units import mm_to_um
from gateway.domain.values import COVERAGE, FloatArray
from gateway.guard.verdict import Change, GuardVerdict, judged, margin_factor, told, unknown

FEWEST = 30


@dataclass(frozen=True, slots=True)
class Flanks:
    """Normal deviations (N,) in mm of one gear as its fit tells them, with standard uncertainties.

    A fit of A, B, G at each wheel place smooths the probe's noise; what it cannot follow (the wheel's profile) is no
    matter of the machine. ``freedom`` are the degrees of freedom of the noise.
    """

    deviation: FloatArray
    u: FloatArray
    freedom: float = float("inf")


def guard_gear(approved: Flanks, now: Flanks, form: FloatArray, angle_rad: FloatArray, limit_um: float) -> GuardVerdict:
    """Whether the machine still grinds what was approved, within ``limit_um`` of normal deviation at every point.

    Both gears were inspected at the same points: ``form`` (N, 3) their n_x, n_y and h (mm), ``angle_rad`` (N,) where
    their spaces lie around the gear. A rotation and an eccentric clamping are taken off by least squares.
    """
    same = approved.deviation.shape == now.deviation.shape == angle_rad.shape == form.shape[:1]
    if not same:
        return not_alike(limit_um, approved.deviation.size, now.deviation.size)
    difference = np.asarray(mm_to_um(now.deviation - approved.deviation))
    u = np.asarray(mm_to_um(np.hypot(now.u, approved.u)))
    here = np.isfinite(difference) & np.isfinite(u) & (u > 0.0)
    if here.sum() < FEWEST:
        return unknown(limit_um, "um", "S-GUARD-FEW", count=int(here.sum()), least=FEWEST)
    difference, u, form, angle = difference[here], u[here], form[here], angle_rad[here]
    design = _clamping(form, angle)
    inverse = np.linalg.pinv(design / u[:, None])
    change = difference - design @ (inverse @ (difference / u))
    spread = np.sqrt(u**2 + np.sum((design @ inverse) ** 2, axis=1))
    margin = margin_factor(min(approved.freedom, now.freedom)) * spread
    worst = int(np.argmax(np.abs(change) + np.where(np.abs(change) > limit_um, 0.0, margin)))
    changes = _means(change, u, form)
    return GuardVerdict(
        answer=judged(change, margin, limit_um),
        largest=float(change[worst]),
        at=float(np.rad2deg(angle[worst])),
        limit=limit_um,
        margin=float(margin[worst]),
        unit="um",
        changes=changes,
        said=told(changes),
    )


def not_alike(limit_um: float, approved: int, now: int) -> GuardVerdict:
    """Cannot tell: so many points were inspected then, so many now, and not at the same places."""
    return unknown(limit_um, "um", "S-GUARD-PLACES", approved=approved, now=now)


def _clamping(form: FloatArray, angle: FloatArray) -> FloatArray:
    """What a rotation and an eccentricity along X and Y of the gear do to the points, (N, 3)."""
    nx, ny, h = form.T
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack([h, nx * cos - ny * sin, nx * sin + ny * cos])


def _means(change: FloatArray, u: FloatArray, form: FloatArray) -> tuple[Change, ...]:
    """What is common to all spaces: along the infeed, and across it (one rotation is off already)."""
    found = []
    kinds = (
        (0, words("S-GUARD-ALL-INFEED"), "S-GUARD-INFEED"),
        (1, words("S-GUARD-ALL-ACROSS"), "S-GUARD-ACROSS"),
    )
    for column, kind, code in kinds:
        row = form[:, column] - form[:, 2] * float(form[:, 2] @ form[:, column]) / float(form[:, 2] @ form[:, 2])
        power = float(row @ row)
        if power > 0.0:
            spread = float(np.sqrt(np.sum((row * u) ** 2))) / power
            found.append(Change(kind, float(row @ change) / power, COVERAGE * spread, "um", named=Message.of(code)))
    return tuple(found)
