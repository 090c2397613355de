"""Harmonics of a periodic deviation by least squares, for targets at any angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, degrees, hypot

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import deg_to_rad
from gateway.domain.values import FloatArray
from gateway.errors import ModelError, NotIdentifiable
from gateway.evaluate.standards.readings import numbers


@dataclass(frozen=True, slots=True)
class FittedHarmonic:
    """amplitude x cos(order x angle - phase), amplitude in the unit of the deviations."""

    amplitude: float
    phase_deg: float


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Mean, harmonics by order, and what they leave (m,) with its range."""

    mean: float
    harmonics: Mapping[int, FittedHarmonic]
    residual: FloatArray
    residual_range: float


def harmonics(angles_deg: ArrayLike, deviations: ArrayLike, orders: Sequence[int]) -> Spectrum:
    """Fit mean and the given orders to deviations (m,) at angles (m,).

    Angles a whole turn apart (0 and 360) are one position and weigh as one. Raises NotIdentifiable
    (E-EVAL-ORDERS) when the angles cannot tell the orders apart, ModelError (E-EVAL-LINE) for other shapes,
    E-EVAL-NUMBER.
    """
    angle, y = deg_to_rad(numbers("angles", angles_deg)), numbers("deviations", deviations)
    if angle.ndim != 1 or angle.shape != y.shape or not np.isfinite(angle).all() or not np.isfinite(y).all():
        raise ModelError("E-EVAL-LINE", "harmonics", positions=angle.size, deviations=y.size)
    columns = [np.ones_like(angle)]
    for order in orders:
        columns += [np.cos(order * angle), np.sin(order * angle)]
    design = np.stack(columns, axis=1)
    weight, positions = _once_a_position(np.asarray(angles_deg, dtype=np.float64))
    if positions < design.shape[1] or np.linalg.cond(design) > 1e8:
        raise NotIdentifiable("E-EVAL-ORDERS", "harmonics", orders=list(orders), targets=positions)
    found = np.linalg.lstsq(design * weight[:, None], y * weight, rcond=None)[0]
    residual = y - design @ found
    pairs = {order: (found[1 + 2 * i], found[2 + 2 * i]) for i, order in enumerate(orders)}
    named = {k: FittedHarmonic(hypot(a, b), degrees(atan2(b, a))) for k, (a, b) in pairs.items()}
    return Spectrum(float(found[0]), named, residual, float(np.ptp(residual)))


def _once_a_position(angles_deg: FloatArray) -> tuple[FloatArray, int]:
    """Square roots of the weights that make angles a whole turn apart count once, and how many positions."""
    turned = np.round(angles_deg % 360.0, 9) % 360.0
    _, inverse, count = np.unique(turned, return_inverse=True, return_counts=True)
    return 1.0 / np.sqrt(count[inverse]), int(count.size)
