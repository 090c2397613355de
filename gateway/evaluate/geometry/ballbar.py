"""Circular tests to ISO 230-4: figures of the circle, and its deviations taken apart into what causes them.

A point is commanded on R (cos t, sin t), first axis x, second axis y, in sense s = +1 (t grows) or -1 at path speed v.
The outward radial deviation of one pass is, to first order in every small quantity,

    d(t) = R0 + cx cos t + cy sin t              radius of the bar and centre: set-up, no fault of the machine
         + (R/2)(sx - sy) cos 2t                 scale mismatch (sx, sy relative errors of the axes)
         - (R/2) e sin 2t                        squareness, e = angle between + axes less 90 deg
         + s (v/2)(tx - ty) sin 2t               servo mismatch, tx, ty lags of the axes
         + (Bx/2) sgn(vx) cos t + (By/2) sgn(vy) sin t      backlash, vx = -s sin t, vy = s cos t
         + a exp(-q/w) after each reversal       spikes: q is the angle since t = 0, 180 (x) or 90, 270 deg (y)
         + (k1 sin p + k2 cos p) cos t           cyclic error of the first axis, p = 2 pi R cos t / pitch; so the second

Every term is linear in its coefficient (w is found on a grid), so one least-squares fit of both senses gives all with
their covariance. sin 2t that is common to both senses is squareness, sin 2t that turns with the sense is servo
mismatch: one sense alone fits their sum. (sx + sy)/2 and R0 are one number unless the bar's length is calibrated.
Backlash and spike of one axis are alike within a few degrees of its reversal: their U shows it, by the covariance.
Residuals of neighbouring samples are not independent: their covariance is multiplied by 1 + 2 sum rho_k, summed to the
first autocorrelation below nought (Bartlett), and U is twice the root.

Figures (ISO 230-4:2005): circular deviation G of one sense, the least distance of two concentric circles about it
(minimum zone by a linear Chebyshev fit; about the least-squares centre stated beside); G(b) of both senses together;
hysteresis H, the largest radial difference of the senses at one angle about one centre; radial deviation F, only with a
calibrated bar. A figure of the turn needs the turn: an arc with a gap of more than 5 deg has none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize

from drivers.message import fixed, words
from drivers.units import rad_to_arcsec
from gateway.domain.values import COVERAGE, FloatArray
from gateway.errors import ModelError

WIDTHS_DEG = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0)
LARGEST_GAP_DEG = 5.0
GRID = np.arange(0.0, 360.0, 1.0)
LARGEST_CONDITION = 1e6
REVERSALS = (("first", "+", 0.0), ("second", "+", 90.0), ("first", "-", 180.0), ("second", "-", 270.0))


@dataclass(frozen=True, slots=True)
class Circle:
    """Samples (n,): angle in deg, outward deviation in um, sense +1 or -1; radius mm and feed mm/min as commanded."""

    angle_deg: FloatArray
    radial_um: FloatArray
    sense: FloatArray
    radius_mm: float
    feed_mm_min: float | None = None
    pitch_mm: Mapping[str, float] | None = None
    calibrated: bool = False


@dataclass(frozen=True, slots=True)
class Cause:
    """One cause with its value, U (k = 2) and the most that it bends the circle, um (half its range)."""

    name: str
    value: float
    unit: str
    U: float
    bends_um: float


@dataclass(frozen=True, slots=True)
class BallbarFigures:
    """Causes, figures of the turn by name in um (None where the arc is none), paths about one centre for a picture.

    ``paths`` are (angle deg, deviation um) by sense; ``residual_um`` is the root mean square that no cause explains;
    ``figures_U`` (k = 2) of every figure is that of a difference of two samples by their noise alone.
    ``spike_width_deg`` is where a spike has fallen to 1/e; ``senses`` are those that were run.
    """

    causes: tuple[Cause, ...]
    figures: Mapping[str, float]
    paths: Mapping[int, tuple[FloatArray, FloatArray]]
    residual_um: float
    spike_width_deg: float
    senses: tuple[int, ...]
    whole: bool
    figures_U: float

    def cause(self, name: str) -> Cause | None:
        """One by its name."""
        return next((one for one in self.causes if one.name == name), None)


def evaluate_ballbar(circle: Circle) -> BallbarFigures:
    """All of a circular test. Raises ModelError (E-CIRCLE-RADIUS, E-CIRCLE-ARC: too short an arc to tell causes)."""
    if not circle.radius_mm > 0.0:
        raise ModelError("E-CIRCLE-RADIUS", "ballbar")
    senses = tuple(one for one in (1, -1) if bool(np.any(circle.sense == one)))
    best = min((_fit(circle, width, senses) for width in WIDTHS_DEG), key=lambda one: one.error)
    t = np.deg2rad(circle.angle_deg)
    centred = circle.radial_um - np.column_stack([np.cos(t), np.sin(t)]) @ best.centre
    level = 0.0 if circle.calibrated else best.level
    whole = all(_gap(circle.angle_deg[circle.sense == one]) <= LARGEST_GAP_DEG for one in senses)
    paths = {}
    for one in senses:
        mine = circle.sense == one
        paths[one] = _turn(circle.angle_deg[mine], centred[mine] - level)
    figures = _figures(paths, calibrated=circle.calibrated) if whole else {}
    return BallbarFigures(
        causes=best.causes,
        figures=figures,
        paths=paths,
        residual_um=best.rms,
        spike_width_deg=best.width,
        senses=senses,
        whole=whole,
        figures_U=COVERAGE * 2.0**0.5 * _noise([circle.radial_um[circle.sense == one] for one in senses]),
    )


def _noise(passes: Sequence[FloatArray]) -> float:
    """Standard deviation of one sample's noise, um, from second differences: what bends slowly leaves nothing in it."""
    squares = np.concatenate([np.diff(one, 2) ** 2 for one in passes])
    return float(np.sqrt(np.median(squares) / _MEDIAN_OF_SQUARE / 6.0))


_MEDIAN_OF_SQUARE = 0.4549
"""Of a normal variate of variance 1; the median passes over the steps at reversals."""


# ---------------------------------------------------------------------------------------------------------- the causes


@dataclass(frozen=True, slots=True)
class _Fit:
    error: float
    rms: float
    width: float
    level: float
    centre: FloatArray
    causes: tuple[Cause, ...]


def _terms(circle: Circle, width: float, senses: Sequence[int]) -> list[tuple[str, str, FloatArray]]:
    """Name, unit and column (n,) of each cause, um by one of its unit."""
    t, s = np.deg2rad(circle.angle_deg), circle.sense
    half = 0.5e-3 * circle.radius_mm  # um by ppm, or by um/m
    both = len(senses) > 1
    found = [
        ("scale mismatch", "ppm", half * np.cos(2 * t)),
        ("squareness" if both else words("S-EVAL-SQUARE-SERVO"), "um/m", -half * np.sin(2 * t)),
        ("backlash first axis", "um", 0.5 * np.sign(-s * np.sin(t)) * np.cos(t)),
        ("backlash second axis", "um", 0.5 * np.sign(s * np.cos(t)) * np.sin(t)),
    ]
    if both and circle.feed_mm_min:
        found.append(("servo mismatch", "ms", 0.5 * s * circle.feed_mm_min / 60.0 * np.sin(2 * t)))
    elif both:
        found.append(("servo mismatch", "um", s * np.sin(2 * t)))
    for axis, side, at in REVERSALS:
        since = (s * (circle.angle_deg - at)) % 360.0
        found.append((f"reversal spike {axis} axis {side}", "um", np.exp(-since / width)))
    for axis, way in (("first", np.cos(t)), ("second", np.sin(t))):
        pitch = (circle.pitch_mm or {}).get(axis)
        if pitch:
            phase = 2 * np.pi * circle.radius_mm * way / pitch
            found += [(f"cyclic {axis} axis {part}", "um", of(phase) * way) for part, of in _PARTS]
    return found


_PARTS = (("sin", np.sin), ("cos", np.cos))


def _fit(circle: Circle, width: float, senses: Sequence[int]) -> _Fit:
    t = np.deg2rad(circle.angle_deg)
    terms = _terms(circle, width, senses)
    setup = [np.ones_like(t), np.cos(t), np.sin(t)]
    A = np.column_stack([*setup, *(column for _name, _unit, column in terms)])
    norms = np.linalg.norm(A, axis=0)
    scaled = A / norms
    if A.shape[0] <= A.shape[1] or np.linalg.cond(scaled) > LARGEST_CONDITION:
        raise ModelError("E-CIRCLE-ARC", "ballbar", arc=fixed(_arc(circle.angle_deg), 0), samples=t.size)
    x, *_ = np.linalg.lstsq(scaled, circle.radial_um, rcond=None)
    left = circle.radial_um - scaled @ x
    free = t.size - A.shape[1]
    error = float(left @ left)
    covariance = np.linalg.inv(scaled.T @ scaled) * (error / free) * _inflation(left)
    value, own = x / norms, np.sqrt(np.diag(covariance)) / norms
    causes, first = [], len(setup)
    for k, (name, unit, column) in enumerate(terms, first):
        bends = 0.5 * abs(value[k]) * float(np.ptp(column))
        causes.append(Cause(name=name, value=float(value[k]), unit=unit, U=float(COVERAGE * own[k]), bends_um=bends))
    return _Fit(
        error=error,
        rms=float(np.sqrt(error / free)),
        width=width,
        level=float(value[0]),
        centre=value[1:first],
        causes=tuple(_with_cyclic(causes)),
    )


def _with_cyclic(causes: Sequence[Cause]) -> list[Cause]:
    """Sine and cosine of a cyclic error as its amplitude."""
    found = [one for one in causes if not one.name.startswith("cyclic")]
    for axis in ("first", "second"):
        parts = [one for one in causes if one.name.startswith(f"cyclic {axis}")]
        if parts:
            size = float(np.linalg.norm([one.value for one in parts]))
            U = max(one.U for one in parts)
            found.append(Cause(name=f"cyclic {axis} axis", value=size, unit="um", U=U, bends_um=size))
    return found


def _inflation(left: FloatArray) -> float:
    """1 + 2 sum of the residuals' autocorrelation to its first value below nought; at least 1."""
    centred = left - left.mean()
    power = float(centred @ centred)
    if power == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, left.size // 4):
        rho = float(centred[lag:] @ centred[:-lag]) / power
        if rho <= 0.0:
            break
        total += 2.0 * rho
    return total


def squareness_arcsec(um_per_m: float) -> float:
    """um/m is urad; in arcsec."""
    return float(rad_to_arcsec(um_per_m * 1e-6))


# --------------------------------------------------------------------------------------------------------- the figures


def _gap(angle: FloatArray) -> float:
    """Largest gap round the turn, deg."""
    at = np.sort(angle % 360.0)
    return float(np.max(np.diff(np.append(at, at[0] + 360.0))))


def _arc(angle: FloatArray) -> float:
    return 360.0 - _gap(angle)


def _turn(angle: FloatArray, radial: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Samples of one pass in the order of the turn: of a longer way the middle turn, without its overshoots."""
    way = np.unwrap(angle, period=360.0)
    middle = 0.5 * (way.min() + way.max())
    inside = np.abs(way - middle) <= 180.0
    order = np.argsort(angle[inside] % 360.0, kind="stable")
    return angle[inside][order] % 360.0, radial[inside][order]


def _figures(paths: Mapping[int, tuple[FloatArray, FloatArray]], *, calibrated: bool) -> dict[str, float]:
    found: dict[str, float] = {}
    names = {1: "G ccw", -1: "G cw"}
    for sense, (angle, radial) in paths.items():
        found[names[sense]] = zone(angle, radial)
        found[words("S-EVAL-LS-CENTRE", names=names[sense])] = _about_lsq(angle, radial)
    if len(paths) > 1:
        angle, radial = (np.concatenate([path[k] for path in paths.values()]) for k in (0, 1))
        found["G(b)"] = zone(angle, radial)
        even = [np.interp(GRID, path[0], path[1], period=360.0) for path in paths.values()]
        found["H"] = float(np.max(np.abs(even[0] - even[1])))
    if calibrated:
        for sense, (_angle, radial) in paths.items():
            word = "ccw" if sense > 0 else "cw"
            found |= {f"F max {word}": float(radial.max()), f"F min {word}": float(radial.min())}
    return found


def _about_lsq(angle: FloatArray, radial: FloatArray) -> float:
    t = np.deg2rad(angle)
    A = np.column_stack([np.ones_like(t), np.cos(t), np.sin(t)])
    return float(np.ptp(radial - A @ np.asarray(np.linalg.lstsq(A, radial, rcond=None)[0])))


def zone(angle_deg: FloatArray, radial_um: FloatArray) -> float:
    """Least distance of two concentric circles about a path (n,): a linear Chebyshev fit of centre and radius."""
    t = np.deg2rad(angle_deg)
    A = np.column_stack([np.ones_like(t), np.cos(t), np.sin(t)])
    ones = np.ones((t.size, 1))
    answer: Any = scipy.optimize.linprog(
        [0.0, 0.0, 0.0, 1.0],
        A_ub=np.vstack([np.hstack([A, -ones]), np.hstack([-A, -ones])]),
        b_ub=np.concatenate([radial_um, -radial_um]),
        bounds=[(None, None)] * 3 + [(0.0, None)],
        method="highs",
    )
    if not answer.success:
        raise ModelError("E-CIRCLE-ZONE", "ballbar", why=str(answer.message))
    return float(2.0 * answer.x[3])
