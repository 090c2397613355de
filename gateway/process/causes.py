"""What moves wheel or gear, by cause: the A, B, G of all places in columns, with a random effect of the spaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.types.values import FloatArray
from gateway.correct.part.inspected import setup_effects
from gateway.domain.grinding_process import EstimatedValue
from gateway.gear.cycloid import CycloidGear
from gateway.process.wheel_form import HEIGHT_MM, FittedForm, PlacedPoints, ProcessPart, sums_by_place

ORDERS, PER_ORDER, FEWEST_ORDERS = 6, 4, 2


# ---- Step 2: A, B, G of the places by cause.


@dataclass(frozen=True)
class CauseColumn:
    """One column of the field: its cause, its name, and A, B, G (P, 3) per unit."""

    cause: str
    name: str
    value: FloatArray


@dataclass(frozen=True)
class FittedCauses:
    """The field's coefficients (q,) with covariance, and what they leave of A, B, G (P, 3)."""

    columns: tuple[CauseColumn, ...]
    value: FloatArray
    covariance: FloatArray
    left: FloatArray
    drift_known: bool

    def of(self, cause: str) -> NDArray[np.intp]:
        """Places of a cause's columns, or of one column by its name."""
        return np.flatnonzero([cause in (one.cause, one.name) for one in self.columns])

    def estimate(self, name: str, scale: float = 1.0, unit: str = "um") -> EstimatedValue:
        """One coefficient by its name; 0 without a figure where it has no column."""
        at = self.of(name)
        if not at.size:
            return EstimatedValue(0.0, float("inf"), unit)
        u = float(np.sqrt(max(self.covariance[at[0], at[0]], 0.0)))
        return EstimatedValue(scale * float(self.value[at[0]]), abs(scale) * u, unit)


@dataclass(frozen=True)
class CausePlaces:
    """Where the columns are evaluated: part, space angle, height in half faces, ramp, (P,) each."""

    part: NDArray[np.intp]
    angle: FloatArray
    height: FloatArray
    ramp: FloatArray


def cause_columns(at: CausePlaces, parts: int, orders: int, heights: int, drift: bool) -> tuple[CauseColumn, ...]:
    """All causes at these places; ``orders`` harmonics, and powers of z up to ``heights`` - 1."""
    one, none = np.ones_like(at.angle), np.zeros_like(at.angle)

    def alone(which: int, values: FloatArray) -> FloatArray:
        return np.stack([values if i == which else none for i in range(3)], axis=1)

    cos, sin = np.cos(at.angle), np.sin(at.angle)
    found = [CauseColumn("set-up", "x zero", alone(0, one)), CauseColumn("set-up", "dressing offset", alone(1, one))]
    for part in range(parts):
        mine = np.where(at.part == part, 1.0, 0.0)
        found.append(CauseColumn("datum", f"rotation {part}", alone(2, mine)))
        for name, weight in (("eccentricity", mine), ("wobble", mine * at.height)):
            if name == "wobble" and heights < 2:
                continue
            found.append(CauseColumn("clamping", f"{name} x {part}", np.stack([weight * cos, -weight * sin, none], 1)))
            found.append(CauseColumn("clamping", f"{name} y {part}", np.stack([weight * sin, weight * cos, none], 1)))
    for power in range(1, min(heights, 3)):
        bend = at.height**power - (1.0 / 3.0 if power == 2 else 0.0)
        found += [CauseColumn("axes Z", f"{letter} z{power}", alone(i, bend)) for i, letter in enumerate("ABG")]
    for order in range(1, orders + 1):
        wave = (("cos", np.cos(order * at.angle)), ("sin", np.sin(order * at.angle)))
        if order > 1:
            for word, values in wave:
                found += [
                    CauseColumn("axes C", f"{one} {word} {order}", alone(i, values)) for i, one in enumerate("ABG")
                ]
            continue
        found += [CauseColumn("axes C", f"G {w} 1", alone(2, v)) for w, v in wave]
    if drift:
        found += [CauseColumn("wear", name, alone(i, at.ramp)) for i, name in enumerate(("depth", "side", "index"))]
    return tuple(found)


def fit_causes(gear: CycloidGear, points: PlacedPoints, form: FittedForm, parts: Sequence[ProcessPart]) -> FittedCauses:
    """A, B, G of all places by cause: coefficients with covariance, and what the columns leave."""
    orders = min(ORDERS, (gear.zc - 1) // PER_ORDER)
    drift = bool(np.any(points.ramp)) and orders >= FEWEST_ORDERS
    heights = int(np.unique(np.round(points.z / HEIGHT_MM)).size)
    at = CausePlaces(points.part, np.asarray(gear.space_angle(points.k)), points.z / (0.5 * gear.b), points.ramp)
    columns = cause_columns(at, len(parts), orders=orders, heights=heights, drift=drift)
    terms = points.at_places(form.straight)
    terms[:, 0] -= np.array([setup_effects(gear)[0] * one.setup.x_um for one in parts])[points.part]
    terms[:, 1] -= np.array([setup_effects(gear)[1] * one.setup.dressing_um for one in parts])[points.part]
    design = np.stack([one.value for one in columns], axis=2)  # (P, 3, q)
    weighted = points.normal @ design  # (P, 3, q)
    H = np.einsum("piq,pir->qr", design, weighted)
    found = np.linalg.solve(H, np.einsum("piq,pi->q", weighted, terms))
    left = terms - design @ found
    inverse = np.linalg.inv(H)
    covariance = inverse @ _middle(points, weighted, left, orders) @ inverse + form.s**2 * inverse
    return FittedCauses(columns, found, covariance, left, drift_known=drift)


def _middle(points: PlacedPoints, weighted: FloatArray, left: FloatArray, orders: int) -> FloatArray:
    """sum S_k T S_k' over the spaces of all parts: T is the scatter of their mean residuals."""
    keys, of = np.unique(np.stack([points.part, points.k], axis=1), axis=0, return_inverse=True)
    of = np.asarray(of, dtype=np.intp).ravel()
    mean = sums_by_place(of, left) / np.bincount(of)[:, None]
    freedom = max(keys.shape[0] - 2 * orders - 2, 1)
    T = mean.T @ mean / freedom
    S = sums_by_place(of, weighted)  # (spaces, 3, q)
    return np.asarray(np.einsum("kiq,ij,kjr->qr", S, T, S))
