"""Error motions of a rotating axis: radial, axial and tilt by ISO 230-7; harmonics of a periodic deviation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, degrees, hypot
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import words
from drivers.message import Message
from drivers.units import ARCSEC_PER_RAD, deg_to_rad, um_to_mm
from gateway.domain.values import FloatArray
from gateway.errors import ModelError, NotIdentifiable
from gateway.evaluate.standards.statistics import SECONDARY, Certainty, numbers

# ---- Harmonics of a periodic deviation by least squares, for targets at any angles.


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


Kind = Literal["radial, fixed direction", "radial, rotating direction", "axial", "tilt"]
STANDARD = "ISO 230-7"
USUAL_TURNS = 20


@dataclass(frozen=True, slots=True)
class ErrorMotion:
    """Error motion values: widths of the polar plot about its least-squares-circle centre, in `unit`.

    ``synchronous`` is the range of the average per angle, ``asynchronous`` the largest spread at one angle,
    ``total`` the range of all readings. ``average`` (k,) and ``residual`` (turns, k) have mean and, where
    `removed`, the fundamental taken out. ``fundamental`` is the once-per-turn part either way: of a radial plot
    it is the artefact's eccentricity or the axis' own, which only a reversal can tell apart; of an axial one
    it is error motion and stays in. ``residual_synchronous`` is `synchronous` without it.
    """

    kind: Kind
    unit: Literal["um", "arcsec"]
    total: float
    synchronous: float
    residual_synchronous: float
    asynchronous: float | None
    fundamental: FittedHarmonic
    removed: bool
    average: FloatArray
    residual: FloatArray
    flags: tuple[str, ...]
    standard: str = STANDARD
    certainty: Certainty = SECONDARY


def radial_fixed(angles_deg: ArrayLike, readings_um: ArrayLike) -> ErrorMotion:
    """One indicator at rest (sensitive direction fixed): readings (turns, k) at angles (k,) of every turn.

    NaN marks a missing reading. Raises ModelError (E-EVAL-TURNS: shapes, an angle without reading, 0 and 360
    both) and NotIdentifiable for too few angles.
    """
    return _motion("radial, fixed direction", "um", angles_deg, readings_um, removed=True)


def radial_rotating(angles_deg: ArrayLike, x_um: ArrayLike, y_um: ArrayLike) -> ErrorMotion:
    """Two indicators at 90 deg, direction turning with the axis: r = x cos(angle) + y sin(angle)."""
    angle = deg_to_rad(np.asarray(angles_deg, dtype=np.float64))
    x, y = np.asarray(x_um, dtype=np.float64), np.asarray(y_um, dtype=np.float64)
    if x.shape != y.shape or x.shape[-1:] != angle.shape:
        raise ModelError("E-EVAL-TURNS", "ISO 230-7", angles=angle.shape, readings=x.shape)
    polar = x * np.cos(angle) + y * np.sin(angle)
    return _motion("radial, rotating direction", "um", angles_deg, polar, removed=True)


def axial(angles_deg: ArrayLike, readings_um: ArrayLike) -> ErrorMotion:
    """An indicator along the axis, on it: the fundamental is kept."""
    return _motion("axial", "um", angles_deg, readings_um, removed=False)


def tilt(angles_deg: ArrayLike, far_um: ArrayLike, near_um: ArrayLike, distance_mm: float) -> ErrorMotion:
    """Two radial indicators `distance_mm` apart along the axis: (far - near) / distance, in arcsec."""
    far, near = np.asarray(far_um, dtype=np.float64), np.asarray(near_um, dtype=np.float64)
    if far.shape != near.shape or not distance_mm > 0.0:
        raise ModelError("E-EVAL-TURNS", "ISO 230-7", angles=near.shape, readings=far.shape)
    angle = um_to_mm(far - near) / distance_mm * ARCSEC_PER_RAD
    return _motion("tilt", "arcsec", angles_deg, angle, removed=True)


def _motion(
    kind: Kind, unit: Literal["um", "arcsec"], angles_deg: ArrayLike, readings: ArrayLike, *, removed: bool
) -> ErrorMotion:
    angles, x = _check_turns(angles_deg, readings)
    level = x - np.nanmean(x)
    average = np.nanmean(level, axis=0)
    spectrum = harmonics(angles, average, (1,))
    once = average - spectrum.mean - spectrum.residual
    taken = spectrum.mean + (once if removed else np.zeros_like(once))
    residual = level - taken
    contour = np.nanmean(residual, axis=0)
    return ErrorMotion(
        kind,
        unit,
        total=float(np.nanmax(residual) - np.nanmin(residual)),
        synchronous=float(np.ptp(contour)),
        residual_synchronous=spectrum.residual_range,
        asynchronous=_asynchronous(x),
        fundamental=spectrum.harmonics[1],
        removed=removed,
        average=contour,
        residual=residual,
        flags=_flags(x, removed),
    )


def _check_turns(angles_deg: ArrayLike, readings: ArrayLike) -> tuple[FloatArray, FloatArray]:
    angles, x = np.asarray(angles_deg, dtype=np.float64), np.asarray(readings, dtype=np.float64)
    fits = angles.ndim == 1 and x.ndim == 2 and x.shape[1] == angles.size and np.isfinite(angles).all()
    if not fits or not np.isfinite(x).any(axis=0).all() or np.isinf(x).any():
        raise ModelError("E-EVAL-TURNS", "ISO 230-7", angles=angles.shape, readings=x.shape)
    if np.unique(np.round(angles % 360.0, 9) % 360.0).size != angles.size:
        raise ModelError("E-EVAL-TURNS", "ISO 230-7", angles=Message.of("W-EVAL-ANGLE-TWICE"), readings=x.shape)
    return angles, x


def _asynchronous(x: FloatArray) -> float | None:
    repeated = np.isfinite(x).sum(axis=0) > 1
    if not repeated.any():
        return None
    return float((np.fmax.reduce(x, axis=0) - np.fmin.reduce(x, axis=0))[repeated].max())


def _flags(x: FloatArray, removed: bool) -> tuple[str, ...]:
    turns = x.shape[0]
    found = [words("S-EVAL-ONE-TURN")] if turns == 1 else []
    if 1 < turns < USUAL_TURNS:
        found.append(words("S-EVAL-TURNS", turns=turns, usual=USUAL_TURNS))
    missing = int((~np.isfinite(x)).sum())
    if missing:
        found.append(words("S-EVAL-MISSING", missing=missing))
    if removed:
        found.append(words("S-EVAL-ECCENTRIC"))
    return tuple(found)
