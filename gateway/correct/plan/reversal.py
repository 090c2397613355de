"""Reversal of an axis: what the control's constant reversal takes, and what varies with position as a pair of tables.

B = mean(+) - mean(-) at each position (ISO 230-2). The constant takes its mean, or beside a pair its value at the
reference; a pair of cross tables of the axis over itself, one for each direction, takes plus and minus half of the
rest. Nothing is taken twice, and nothing that lies within what B scatters by at one place. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import AxisUnit
from gateway.domain.figures import Component
from gateway.domain.values import COVERAGE
from gateway.errors import ModelError
from gateway.model.components import is_periodic, value
from gateway.table import Grid, project
from gateway.table.limits import check_reach
from gateway.table.merging import curve_for_grid, travel_places, zero_at_reference
from gateway.table.proposal import band

SHARE = 0.1  # of the largest |B|: less than this may stay of what depends on position


@dataclass(frozen=True, slots=True)
class ReversalAdvice:
    """What of B is to be taken, beyond what acts, um or arcsec (sign convention: the deviation that it cancels).

    ``mean`` of B with ``mean_U``, its ``largest`` amount on the fitted curve, and ``U`` of B at one place by its
    scatter (k = 2): nothing smaller is taken. ``constant`` is what the control's constant reversal takes (0: nothing),
    ``left`` the largest |B| that it leaves. ``depends``: B depends on the position by more than its uncertainty, U and
    a tenth.
    """

    mean: float
    mean_U: float
    U: float
    largest: float
    constant: float
    left: float
    depends: bool

    @property
    def within(self) -> bool:
        """Whether B lies within its scatter everywhere."""
        return self.largest <= self.U


def reversal_advice(curve: Component, B: ArrayLike, u: ArrayLike, common_u: float = 0.0) -> ReversalAdvice:
    """Advice from B (m,) with standard uncertainties u (m,), um or arcsec, and the ``curve`` fitted to it.

    ``common_u`` is a standard uncertainty that all of B share. NaN is missing. Raises ModelError E-CORRECT-REVERSAL.
    """
    b = np.asarray(B, dtype=np.float64)
    doubt = np.broadcast_to(np.asarray(u, dtype=np.float64), b.shape)
    known = np.isfinite(b)
    if not np.any(known) or not np.all(doubt[known] > 0.0):
        raise ModelError("E-CORRECT-REVERSAL", curve.axis, positions=b.size)
    b, doubt = b[known], doubt[known]
    fitted = value(curve, travel_places(curve))
    mean = float(np.mean(b))
    mean_U = COVERAGE * float(np.hypot(np.sqrt(np.mean(doubt**2) / b.size), common_u))
    U = COVERAGE * float(np.hypot(np.median(doubt), common_u))
    largest = max(float(np.max(np.abs(fitted))), abs(mean))
    off = float(np.max(np.abs(fitted - mean)))
    constant = mean if abs(mean) > U and off < largest else 0.0
    depends = _depends(curve) and float(np.max(np.abs(fitted - np.mean(fitted)))) > max(U, SHARE * largest)
    return ReversalAdvice(
        mean=mean,
        mean_U=mean_U,
        U=U,
        largest=largest,
        constant=constant,
        left=off if constant else largest,
        depends=depends,
    )


def _depends(curve: Component) -> bool:
    """Whether the curve leaves its own mean by more than its band, which holds for all positions at once (99 %)."""
    at = travel_places(curve)
    fitted = value(curve, at)
    U = np.hypot(band(curve, at), COVERAGE * curve.residual_rms)
    return bool(np.any(np.abs(fitted - np.mean(fitted)) > U))


def reversal_pair(
    curve: Component, unit: AxisUnit, grid: Grid, *, reference: float, modulo: bool
) -> tuple[CompensationTable, CompensationTable]:
    """The pair for what the curve is more than at the reference: +half coming from -, -half coming from +.

    Both are zero at the reference, not rounded, and have no number until they have a place; beyond what was measured
    they hold their last values, a twentieth of the table at most. Raises Gap (E-COMP-REACH) for more, and as
    `gateway.table.project`.
    """
    if not is_periodic(curve):
        check_reach(curve.domain, (grid.minimum, grid.maximum), unit, curve.axis)
    at_reference = float(curve_for_grid(curve, np.asarray([reference]))[0])
    projected = project(lambda q: 0.5 * (curve_for_grid(curve, q) - at_reference), grid, modulo=modulo)
    half = zero_at_reference(projected, grid, reference, modulo=modulo)
    up, down = (_table(curve.axis, unit, grid, sign * half, modulo, sign) for sign in (1, -1))
    return up, down


def _table(axis: str, unit: AxisUnit, grid: Grid, values: FloatArray, modulo: bool, sign: int) -> CompensationTable:
    return CompensationTable(
        kind="cross",
        input_axis=axis,
        output_axis=axis,
        minimum=grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        deviations=tuple(float(one) for one in values),
        modulo=modulo,
        input_unit=unit,
        output_unit=unit,
        direction=1 if sign > 0 else -1,
    )
