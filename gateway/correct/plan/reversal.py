"""Reversal of an axis: what the control's backlash can take, and what varies with position as a pair of tables.

B = mean(+) - mean(-) at each position (ISO 230-2). The backlash value takes the mean everywhere; what varies beyond its
uncertainty goes to two cross tables of the axis over itself, one for each direction, +/- half of it (d = deviation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import AxisUnit, deviation_scale
from gateway.errors import ModelError
from gateway.table import Grid, project
from gateway.table.projection import zeroed


@dataclass(frozen=True, slots=True)
class ReversalAdvice:
    """Mean reversal (um or arcsec) with U, the backlash it asks for (axis unit, advice only), and the pair if needed.

    ``backlash`` None: the mean lies within its uncertainty. ``varies`` is the largest |B - mean B| / U.
    """

    mean: float
    U: float
    backlash: float | None
    varies: float
    pair: tuple[CompensationTable, CompensationTable] | None


def reversal_advice(
    axis: str,
    unit: AxisUnit,
    positions: ArrayLike,
    B: ArrayLike,
    U: ArrayLike,
    grid: Grid,
    *,
    resolution: float,
    reference: float,
    live_backlash: float = 0.0,
    modulo: bool = False,
    indices: tuple[int, int] = (0, 1),
) -> ReversalAdvice:
    """Advice from reversal values B (m,) with expanded uncertainties U (m,), um or arcsec, at positions (axis unit).

    A lagging axis (B < 0) asks for a positive backlash value. The pair is zero at the reference and leaves the mean to
    the control's backlash, so that nothing is compensated twice. Raises ModelError E-CORRECT-REVERSAL.
    """
    at, b = np.asarray(positions, dtype=np.float64), np.asarray(B, dtype=np.float64)
    u = np.broadcast_to(np.asarray(U, dtype=np.float64), b.shape)
    known = np.isfinite(b)
    if at.shape != b.shape or not np.any(known) or not np.all(u[known] > 0.0):
        raise ModelError("E-CORRECT-REVERSAL", axis, positions=at.size)
    at, b, u = at[known], b[known], u[known]
    order = np.argsort(at)
    at, b, u = at[order], b[order], u[order]
    mean, mean_u = float(np.mean(b)), float(np.sqrt(np.mean(u**2) / u.size))
    ratio = float(np.max(np.abs(b - mean) / u))
    backlash = None
    if abs(mean) > mean_u:
        backlash = live_backlash - mean / deviation_scale(unit)
    if ratio <= 1.0 or at.size < 2:
        return ReversalAdvice(mean=mean, U=mean_u, backlash=backlash, varies=ratio, pair=None)
    curve = 0.5 * (b - mean)
    values = project(lambda q: np.interp(_into(q, at, modulo), at, curve), grid, modulo=modulo)
    half = zeroed(values, grid, reference, modulo=modulo)
    up, down = (_table(axis, unit, grid, sign * half, resolution, modulo, indices, sign) for sign in (1, -1))
    return ReversalAdvice(mean=mean, U=mean_u, backlash=backlash, varies=ratio, pair=(up, down))


def _into(q: FloatArray, at: FloatArray, modulo: bool) -> FloatArray:
    return at[0] + np.mod(q - at[0], 360.0) if modulo else q


def _table(
    axis: str,
    unit: AxisUnit,
    grid: Grid,
    values: FloatArray,
    resolution: float,
    modulo: bool,
    indices: tuple[int, int],
    sign: int,
) -> CompensationTable:
    step = resolution * deviation_scale(unit)
    return CompensationTable(
        kind="cross",
        input_axis=axis,
        output_axis=axis,
        minimum=grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        deviations=tuple(float(v) + 0.0 for v in np.round(np.rint(values / step) * step, 9)),
        modulo=modulo,
        index=indices[0] if sign > 0 else indices[1],
        input_unit=unit,
        output_unit=unit,
        direction=1 if sign > 0 else -1,
    )
