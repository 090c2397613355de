"""Rotary calibration: device and interferometer angles combined to deviations of a rotary axis in arcsec."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import arcsec_to_deg, deg_to_arcsec, wrap_deg
from gateway.domain.values import FloatArray
from gateway.errors import ModelError


def axis_deg(device_deg: ArrayLike, laser_deg: ArrayLike, sense: Literal[1, -1] = 1) -> FloatArray:
    """Angle of the axis in deg: sense x laser - device; the device counts against the axis."""
    laser, device = np.asarray(laser_deg, dtype=np.float64), np.asarray(device_deg, dtype=np.float64)
    return sense * laser - device


def rotary_deviations(
    device_deg: ArrayLike,
    laser_deg: ArrayLike,
    targets_deg: ArrayLike,
    *,
    reference_deg: float,
    sense: Literal[1, -1] = 1,
    zero_deg: float | None = None,
) -> FloatArray:
    """Deviations in arcsec, shape of the readings, zero at the reference target, wrapped the shortest way.

    ``device_deg``, ``laser_deg`` (m, n, 2) or (m,), NaN where missing, of any number of turns;
    ``targets_deg`` (m,) machine coordinates. ``zero_deg`` is the axis angle read when the axis stood at
    `reference_deg`; None takes the mean of the readings at the target nearest to it.
    Raises ModelError (E-EVAL-SHAPE, E-EVAL-DATUM when no reading exists there).
    """
    angle, targets = axis_deg(device_deg, laser_deg, sense), np.asarray(targets_deg, dtype=np.float64)
    if targets.ndim != 1 or angle.ndim == 0 or angle.shape[0] != targets.size:
        raise ModelError("E-EVAL-SHAPE", "rotary", targets=targets.shape, deviations=angle.shape)
    commanded = targets.reshape((-1,) + (1,) * (angle.ndim - 1))
    offset = _datum(angle - commanded, targets, reference_deg) if zero_deg is None else zero_deg - reference_deg
    return deg_to_arcsec(wrap_deg(angle - commanded - offset))


def _datum(difference: FloatArray, targets: FloatArray, reference_deg: float) -> float:
    # Of targets that are the same place of the turn the one in the same turn: another turn has another deviation.
    away = np.abs(targets - reference_deg)
    nearest = int(np.lexsort((away, np.round(np.abs(wrap_deg(targets - reference_deg)), 9)))[0])
    known = np.ravel(difference[nearest])
    known = known[np.isfinite(known)]
    if not known.size:
        raise ModelError("E-EVAL-DATUM", "rotary", reference=reference_deg)
    # Differences to the first one are small, so their mean is safe across the wrap.
    return float(known[0] + np.mean(wrap_deg(known - known[0])))


def combine(command_deg: ArrayLike, device_deg: ArrayLike, laser_arcsec: ArrayLike, reference_deg: float) -> FloatArray:
    """Deviations (m,) in arcsec of one pass, the interferometer's remainder given in arcsec."""
    laser = arcsec_to_deg(np.asarray(laser_arcsec, dtype=np.float64))
    return rotary_deviations(device_deg, laser, command_deg, reference_deg=reference_deg)


@dataclass(frozen=True, slots=True)
class Closure:
    """The closing error of whole turns in arcsec, the later place less the earlier; ``u`` is what runs scatter by.

    ``u`` is the standard uncertainty of that mean from the runs, each of which is compared with itself; 0 where a
    single run was made, so that no scatter is known.
    """

    gap: float
    u: float


def closure(targets_deg: ArrayLike, deviations_arcsec: ArrayLike) -> Closure | None:
    """The largest difference between targets (m,) whole turns apart, the later less the earlier; None without such.

    Deviations (m,) or (m, n, 2), NaN where missing. Each approach is compared with itself where both places have it: a
    drift that goes on through both closes with opposite signs, and their mean would not show it. Each run is compared
    with itself, so a slip of every turn is no scatter. On an axis with a direct encoder the gap is drift, slip or lost
    counts; it is reported, never spread. Raises ModelError (E-EVAL-SHAPE).
    """
    targets = np.asarray(targets_deg, dtype=np.float64)
    values = np.asarray(deviations_arcsec, dtype=np.float64)
    if targets.ndim != 1 or not targets.size or values.shape[:1] != targets.shape:
        raise ModelError("E-EVAL-SHAPE", "closure", targets=str(targets.shape), deviations=str(values.shape))
    apart = targets[None, :] - targets[:, None]
    pairs = np.argwhere((apart >= 180.0) & (np.abs(wrap_deg(apart)) <= 1e-6))
    known = [one for first, last in pairs for one in _gaps(values[first], values[last])]
    return max(known, key=lambda one: abs(one.gap)) if known else None


def _gaps(first: FloatArray, last: FloatArray) -> list[Closure]:
    """Last less first for each approach that both have; of all readings where they share none."""
    ways = (first.T, last.T) if first.ndim == 2 else (first[None], last[None])
    shared = [
        _closure_of(np.atleast_1d(here), np.atleast_1d(there))
        for here, there in zip(*ways, strict=True)
        if np.isfinite(here).any() and np.isfinite(there).any()
    ]
    if shared or not (np.isfinite(first).any() and np.isfinite(last).any()):
        return shared
    return [Closure(float(np.nanmean(last) - np.nanmean(first)), 0.0)]


def _closure_of(here: FloatArray, there: FloatArray) -> Closure:
    """Of one approach (n,): the difference of the means, and the scatter of what the single runs differ by."""
    gap = float(np.nanmean(there) - np.nanmean(here))
    runs = (there - here)[np.isfinite(there - here)]
    return Closure(gap, float(np.std(runs, ddof=1) / np.sqrt(runs.size)) if runs.size > 1 else 0.0)
