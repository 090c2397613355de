"""Harmonics of a periodic deviation by least squares, for targets at any angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, degrees, hypot

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import deg_to_rad
from gateway.domain import FloatArray
from gateway.errors import NotIdentifiable


@dataclass(frozen=True, slots=True)
class Harmonic:
    """amplitude x cos(order x angle - phase), amplitude in the unit of the deviations."""

    amplitude: float
    phase_deg: float


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Mean, harmonics by order, and what they leave (m,) with its range."""

    mean: float
    harmonics: Mapping[int, Harmonic]
    residual: FloatArray
    residual_range: float


def harmonics(angles_deg: ArrayLike, deviations: ArrayLike, orders: Sequence[int]) -> Spectrum:
    """Fit mean and the given orders to deviations (m,) at angles (m,); do not give 0 and 360 deg twice.

    Raises NotIdentifiable (E-EVAL-ORDERS) when the angles cannot tell the orders apart.
    """
    angle = deg_to_rad(np.asarray(angles_deg, dtype=np.float64))
    y = np.asarray(deviations, dtype=np.float64)
    columns = [np.ones_like(angle)]
    for order in orders:
        columns += [np.cos(order * angle), np.sin(order * angle)]
    design = np.stack(columns, axis=1)
    if design.shape[0] < design.shape[1] or np.linalg.cond(design) > 1e8:
        raise NotIdentifiable("E-EVAL-ORDERS", "harmonics", orders=list(orders), targets=angle.size)
    found = np.linalg.lstsq(design, y, rcond=None)[0]
    residual = y - design @ found
    pairs = {order: (found[1 + 2 * i], found[2 + 2 * i]) for i, order in enumerate(orders)}
    named = {k: Harmonic(hypot(a, b), degrees(atan2(b, a))) for k, (a, b) in pairs.items()}
    return Spectrum(float(found[0]), named, residual, float(np.ptp(residual)))
