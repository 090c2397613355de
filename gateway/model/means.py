"""The one curve of a measured axis, for its table and for the error model: smooth, with waves, or through the means."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import AxisUnit
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.model.components import KnownRange, is_periodic, value
from gateway.model.fit import SMALLEST_U, THROUGH, TURN_DEG, fit_positioning, fit_through
from gateway.model.regression import alike
from gateway.model.waves import fit_waves

LEAVES, FAR_ABOVE = 0.15, 4.0
"""What a smooth fit may leave at a target: um or arcsec, and times the standard uncertainty of a mean."""
WAVE_LEAVES = 0.25
"""A curve with waves may leave this share of what the smooth one does."""


def fit_means(
    targets: ArrayLike,
    means: ArrayLike,
    u: ArrayLike,
    *,
    name: str,
    axis: str,
    axis_unit: AxisUnit,
    kind: Literal["linear", "rotary"],
    modulo: bool = False,
) -> Component:
    """The one curve of a measured axis; arguments as `fit_positioning`.

    Where a smooth curve leaves far more than the scatter at a target it is one with short waves, if the targets can
    tell these, and on a linear axis else one through the means.
    """
    at, mean, own = alike(targets, means, u)
    named: dict[str, Any] = {"name": name, "axis": axis, "axis_unit": axis_unit}
    smooth = fit_positioning(at, mean, own, kind=kind, modulo=modulo, **named)
    known = np.isfinite(mean)
    at, mean, own = at[known], mean[known], own[known]
    through = smooth.basis in THROUGH
    # What goes through the means leaves nothing at the targets: what they miss is told by each that is left out.
    left = smooth.residual_rms if through else float(np.max(np.abs(mean - value(smooth, at))))
    allowed = max(LEAVES, FAR_ABOVE * float(np.max(own)))
    if left <= allowed:
        return smooth
    waved = _waved(smooth, at, mean, np.maximum(own, SMALLEST_U))
    if waved is not None and float(np.max(np.abs(mean - value(waved, at)))) <= max(allowed, WAVE_LEAVES * left):
        return waved
    return smooth if through or kind == "rotary" else fit_through(at, mean, own, **named)


def _waved(smooth: Component, at: FloatArray, mean: FloatArray, u: FloatArray) -> Component | None:
    """The curve with waves that the means tell; None where they tell none."""
    at = KnownRange.of(smooth).inside(at)
    order = np.argsort(at, kind="stable")
    fit = fit_waves(at[order], mean[order], u[order], TURN_DEG if is_periodic(smooth) else None)
    if fit is None:
        return None
    freedom = max(at.size - fit.unknowns, 1)
    spread = float(np.sum(fit.solved.residual**2)) / freedom - float(np.mean(u**2))
    return Component(
        name=smooth.name,
        axis=smooth.axis,
        axis_unit=smooth.axis_unit,
        basis=fit.basis,
        domain=smooth.domain,
        coefficients=fit.solved.coefficients,
        covariance=fit.solved.covariance,
        parameters=fit.parameters,
        residual_rms=float(np.sqrt(max(spread, 0.0))),
    )
