"""Inspected points by place, and what of them is alike on every flank: the form of the wheel, and how it wears."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import chdtrc

from drivers.message import digits, fixed
from drivers.types.values import FloatArray
from gateway.correct.part.inspected import USUAL_CLAMPING_UM
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.process_drift import bent_by_shift
from gateway.tooth import InspectedFlank, SetupValues

MOST_KNOTS, FEWEST_KNOTS = 16, 4
BEND_ROUNDS = 3
MIXED_UM, MIXED_P = 0.15, 1e-4  # forms of two parts differ by so much, and not by chance
HEIGHT_MM = 0.1  # two heights are one


@dataclass(frozen=True, slots=True)
class ProcessPart:
    """One inspected part and what is known of its grinding.

    Points (N,): space ``k``, profile angle ``theta_rad``, height ``z_mm`` from the middle of the face,
    ``deviation_um``. ``setup`` are the set-up values it was ground with. ``order`` are its spaces in the order of
    grinding; None where nobody knows. ``dressing`` names the dressing it was ground after. ``clamping_um`` (k = 2) is
    how well the inspection clamped it.
    """

    name: str
    k: FloatArray
    theta_rad: FloatArray
    z_mm: FloatArray
    deviation_um: FloatArray
    setup: SetupValues = field(default_factory=SetupValues)
    order: tuple[int, ...] | None = None
    dressing: str = ""
    clamping_um: float = USUAL_CLAMPING_UM

    @classmethod
    def of(
        cls, found: InspectedFlank, *, setup: SetupValues | None = None, order: Sequence[int] | None = None,
        dressing: str = "", clamping_um: float = USUAL_CLAMPING_UM,
    ) -> ProcessPart:  # fmt: skip
        """From the record of an inspection."""
        points = (found.k, found.theta_rad, found.z_mm, found.deviation_um)
        told = None if order is None else tuple(order)
        return cls(found.part, *points, setup or SetupValues(), told, dressing, clamping_um)


# ---- Points and their places.


@dataclass(frozen=True)
class PlacedPoints:
    """All parts' points, N, at P places; each place has its part, space, height and time of grinding.

    ``shape`` (N, 3) is n_x, n_y, h / rp, so that all of A, B, G are um. ``normal`` (P, 3, 3) of each place.
    """

    theta: FloatArray
    arc: FloatArray
    e: FloatArray
    shape: FloatArray
    of: NDArray[np.intp]
    part: NDArray[np.intp]
    k: FloatArray
    z: FloatArray
    ramp: FloatArray
    normal: FloatArray

    def at_places(self, values: FloatArray) -> FloatArray:
        """Least-squares A, B, G (P, 3, ...) of values (N, ...)."""
        wide = values.reshape(values.shape[0], -1)
        right = sums_by_place(self.of, self.shape[:, :, None] * wide[:, None, :])
        return np.asarray(np.linalg.solve(self.normal, right).reshape(-1, 3, *values.shape[1:]))

    def along(self, terms: FloatArray) -> FloatArray:
        """Deviations (N, ...) that A, B, G (P, 3, ...) make."""
        return np.asarray(np.einsum("ni,ni...->n...", self.shape, terms[self.of]))


def place_points(gear: CycloidGear, parts: Sequence[ProcessPart]) -> PlacedPoints:
    """All parts' points with their places, without what large shifts bend. Raises ModelError E-PROCESS-EMPTY."""
    k, theta, z, e = (
        np.concatenate([np.asarray(getattr(part, name), dtype=np.float64) for part in parts])
        for name in ("k", "theta_rad", "z_mm", "deviation_um")
    )
    part = np.repeat(np.arange(len(parts)), [one.k.size for one in parts])
    keys, found = np.unique(np.stack([part, k, np.round(z / HEIGHT_MM)], axis=1), axis=0, return_inverse=True)
    of = np.asarray(found, dtype=np.intp).ravel()
    section = gear.section(theta)
    shape = np.stack([section.nx, section.ny, section.h / gear.rp], axis=1)
    place_part, place_k = keys[:, 0].astype(np.intp), keys[:, 1]
    ramps = np.stack([grinding_ramp(gear, one.order) for one in parts])
    points = PlacedPoints(
        theta=theta,
        arc=np.abs(gear.arc(theta)),
        e=e,
        shape=shape,
        of=of,
        part=place_part,
        k=place_k,
        z=np.bincount(of, weights=z) / np.bincount(of),
        ramp=ramps[place_part, place_k.astype(np.intp)],
        normal=sums_by_place(of, shape[:, :, None] * shape[:, None, :]),
    )
    if np.any(np.linalg.eigvalsh(points.normal)[:, 0] <= 0.0):
        raise ModelError("E-PROCESS-EMPTY", "separation")
    return _straightened(gear, points)


def _straightened(gear: CycloidGear, points: PlacedPoints) -> PlacedPoints:
    """Without what the curvature makes of large shifts."""
    straight = points.e
    unit = np.array([1.0, 1.0, 1.0 / gear.rp])
    for _ in range(BEND_ROUNDS):
        terms = points.at_places(straight) * unit
        straight = points.e - bent_by_shift(gear, points.theta, terms[points.of])
    return replace(points, e=straight)


def grinding_ramp(gear: CycloidGear, order: tuple[int, ...] | None) -> FloatArray:
    """-1/2 for the space that was ground first to 1/2 for the last, (K,); zeros where nobody knows."""
    found = np.zeros(gear.zc)
    if order is not None:
        found[list(order)] = np.linspace(-0.5, 0.5, gear.zc)
    return found


def sums_by_place(of: NDArray[np.intp], values: FloatArray) -> FloatArray:
    """Sums of rows (N, ...) by their place, (P, ...)."""
    flat = values.reshape(values.shape[0], -1)
    out = np.stack([np.bincount(of, weights=column) for column in flat.T], axis=1)
    return np.asarray(out.reshape(-1, *values.shape[1:]), dtype=np.float64)


# ---- Step 1: the form of the wheel, and how it wears.


@dataclass(frozen=True)
class FormBasis:
    """Splines over the arc of each flank without what shifts and a turn make: rows (., m) for profile angles."""

    knots: tuple[FloatArray, FloatArray]
    mixed: FloatArray  # (splines, m): combinations orthogonal to the three shapes over the points

    def splines(self, theta: FloatArray, arc: FloatArray) -> FloatArray:
        """Cardinal splines of the right flank, then of the left one; 0 on the other flank."""
        parts = []
        for side, knots in zip((-1.0, 1.0), self.knots, strict=True):
            rows = CubicSpline(knots, np.eye(knots.size), bc_type="not-a-knot")(np.clip(arc, knots[0], knots[-1]))
            parts.append(np.where(np.sign(theta)[:, None] == side, rows, 0.0))
        return np.concatenate(parts, axis=1)

    def rows(self, theta: FloatArray, arc: FloatArray) -> FloatArray:
        """The basis (., m)."""
        return np.asarray(self.splines(theta, arc) @ self.mixed)


@dataclass(frozen=True)
class FittedForm:
    """Coefficients (m,) of w, and of w' where the order is known, with covariance; ``basis`` maps (theta) to (., m).

    ``s`` is the scatter of one point, ``freedom`` its degrees; ``left`` (N,) what nothing explains.
    """

    basis: FormBasis
    value: FloatArray
    covariance: FloatArray
    growth: FloatArray | None
    growth_covariance: FloatArray
    s: float
    freedom: int
    left: FloatArray
    straight: FloatArray  # e less the form (N,): for the places


def _basis(points: PlacedPoints) -> FormBasis:
    knots = []
    for side in (-1.0, 1.0):
        arc = points.arc[np.sign(points.theta) == side]
        if arc.size == 0 or float(np.ptp(arc)) <= 0.0:
            raise ModelError("E-PROCESS-EMPTY", "separation")
        apart = float(np.ptp(arc)) / 200.0
        different = 1 + int(np.count_nonzero(np.diff(np.sort(arc)) > apart))
        count = int(np.clip(different - 1, FEWEST_KNOTS, MOST_KNOTS))
        knots.append(np.linspace(arc.min(), arc.max(), count))
    plain = FormBasis((knots[0], knots[1]), np.eye(knots[0].size + knots[1].size))
    splines = plain.splines(points.theta, points.arc)
    moments = points.shape.T @ splines  # (3, splines)
    null = np.linalg.svd(moments)[2][3:].T
    return replace(plain, mixed=null)


def fit_form(points: PlacedPoints) -> FittedForm:
    """The form common to all flanks by least squares beside free A, B, G. Raises ModelError E-PROCESS-EMPTY."""
    basis = _basis(points)
    rows = basis.rows(points.theta, points.arc)
    m = rows.shape[1]
    known = bool(np.any(points.ramp))
    design = np.concatenate([rows, rows * points.ramp[points.of][:, None]], axis=1) if known else rows
    free = design - points.along(points.at_places(design))
    found: FloatArray = np.asarray(np.linalg.lstsq(free, points.e, rcond=None)[0])
    straight = points.e - design @ found
    left = straight - points.along(points.at_places(straight))
    freedom = left.size - 3 * points.k.size - found.size
    if freedom < 1:
        raise ModelError("E-PROCESS-EMPTY", "separation")
    s = float(np.sqrt(left @ left / freedom))
    covariance: FloatArray = np.asarray(s**2 * np.linalg.pinv(free.T @ free, hermitian=True), dtype=np.float64)
    growth = found[m:] if known else None
    return FittedForm(
        basis=basis,
        value=found[:m],
        covariance=covariance[:m, :m],
        growth=growth,
        growth_covariance=covariance[m:, m:],
        s=s,
        freedom=freedom,
        left=left,
        straight=straight,
    )


def demand_one_wheel(points: PlacedPoints, form: FittedForm, parts: Sequence[ProcessPart]) -> None:
    """Refuse parts whose forms differ: the wheel was dressed between them. Raises ModelError E-PROCESS-MIXED."""
    if len(parts) < 2:
        return
    rows = form.basis.rows(points.theta, points.arc)
    rest = points.e - points.along(points.at_places(points.e))
    free = rows - points.along(points.at_places(rows))
    which = points.part[points.of]
    own, weights = [], []
    for number in range(len(parts)):
        here = which == number
        normal = free[here].T @ free[here]
        own.append(np.linalg.lstsq(normal, free[here].T @ rest[here], rcond=None)[0])
        weights.append(normal)
    mean = np.linalg.solve(np.sum(weights, axis=0), np.sum([w @ c for w, c in zip(weights, own, strict=True)], axis=0))
    scatter = _own_scatter(points, free, rest, own, which)
    apart = [one - mean for one in own]
    test = sum(float(d @ w @ d) for d, w in zip(apart, weights, strict=True)) / scatter**2
    sizes = [float(np.sqrt(np.mean((free[which == n] @ d) ** 2))) for n, d in enumerate(apart)]
    chance = float(chdtrc(mean.size * (len(parts) - 1), test))
    if chance < MIXED_P and max(sizes) > MIXED_UM:
        worst = int(np.argmax(sizes))
        raise ModelError(
            "E-PROCESS-MIXED", parts[worst].name, differs=fixed(sizes[worst], 2), limit=digits(MIXED_UM, 6)
        )


def _own_scatter(
    points: PlacedPoints, free: FloatArray, rest: FloatArray, own: Sequence[FloatArray], which: NDArray[np.intp]
) -> float:
    """Scatter of one point beside each part's own form, um."""
    left = rest - np.einsum("nm,nm->n", free, np.stack(own)[which])
    return float(np.sqrt(left @ left / max(left.size - 3 * points.k.size - len(own) * own[0].size, 1)))
