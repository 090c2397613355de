"""What a captured axis' reversal asks for: the change of its constant reversal, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.limits import Limits
from drivers.types.abilities import Capabilities
from drivers.types.tables import LiveSet
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit, deviation_scale
from gateway.config import AxisSection
from gateway.correct.plan.reversal import ReversalAdvice, reversal_advice
from gateway.domain.figures import Component
from gateway.domain.proposals import TableChange
from gateway.domain.values import COVERAGE
from gateway.model.means import fit_means
from gateway.table.limits import told
from gateway.workflow.axes.structure import Structure


@dataclass(frozen=True, slots=True)
class SeenReversal:
    """B (m,) of a capture with its standard uncertainty u (m,), the curve fitted to it, and what it asks for."""

    B: FloatArray
    u: FloatArray
    curve: Component
    advice: ReversalAdvice


def reversal_of_capture(axis: AxisSection, shown: Structure) -> SeenReversal | None:
    """The reversal that a capture shows; None where no target was come to from both sides. Raises as `fit_means`."""
    means, capture = shown.means, shown.capture
    B = means.mean_up - means.mean_down
    known = np.isfinite(B)
    if np.count_nonzero(known) < 2:
        return None
    # The mean of both directions is half as uncertain as their difference; what drift leaves is common to all.
    common = 2.0 * capture.unsteady_u
    own = np.sqrt(np.maximum((2.0 * means.u) ** 2 - common**2, 0.0))
    u = np.maximum(np.where(known, own, np.nan), capture.reading_u if np.isfinite(capture.reading_u) else 0.0)
    u = np.maximum(u, 1e-6)
    curve = fit_means(
        capture.targets[known],
        B[known],
        u[known],
        name=axis.measure.component,
        axis=axis.name,
        axis_unit=axis.unit,
        kind=axis.kind,
        modulo=axis.modulo,
    )
    return SeenReversal(B, u, curve, reversal_advice(curve, B, u, common))


def reversal_change(
    axis: AxisSection, shown: Structure, live: LiveSet, *, can: Capabilities, resolution: float, against: str
) -> TableChange | None:
    """The change of an axis' constant reversal; ``skipped`` says why there is none; None where nothing tells B.

    ``resolution`` is the control's, in the axis unit; ``against`` says why none can be pushed here ("": one can).
    ``predicted`` (m,) is B as it will be at the targets, with
    ``predicted_U``. What lies within its scatter is left alone, and so is what a constant would not make smaller.
    """
    found = reversal_of_capture(axis, shown)
    if found is None:
        return None
    advice, old, unit = found.advice, live.reversal, shown.capture.unit
    step = resolution * deviation_scale(axis.unit)
    acts = old.table.deviations[0]
    wanted = round(float(np.rint((acts + advice.constant) / step)) * step, 9) + 0.0
    skipped = _why_not(axis.name, unit, advice, can, largest=Limits.of(axis.unit).reversal, wanted=wanted)
    skipped = skipped or against
    taken = 0.0 if skipped else wanted - acts
    return TableChange(
        axis=axis.name,
        old=old.table,
        new=old.table if skipped else replace(old.table, deviations=(wanted,)),
        old_enabled=old.enabled,
        base_digest=live.digest,
        targets=shown.capture.targets,
        predicted=found.B - taken,
        predicted_U=COVERAGE * np.hypot(found.u * np.sqrt(2.0), 2.0 * shown.capture.unsteady_u),
        skipped=skipped,
    )


def _why_not(
    axis: str, unit: DeviationUnit, advice: ReversalAdvice, can: Capabilities, *, largest: float, wanted: float
) -> str:
    sizes = {"B": f"{advice.largest:.2g}", "U": f"{advice.U:.2g}", "mean": f"{advice.mean:+.2g}", "unit": unit}
    if advice.within:
        return told("S-REVERSAL-WITHIN", axis, **sizes)
    if can.table("reversal") is None or not can.stops:  # its sign is proved by coming from both sides, by a program
        return told("S-REVERSAL-KIND", axis, **sizes)
    if advice.constant == 0.0:
        return told("S-REVERSAL-NO-GAIN", axis, **sizes)
    if abs(wanted) > largest:
        return told("S-REVERSAL-LARGE", axis, wanted=f"{wanted:+.3g}", limit=f"{largest:g}", unit=unit)
    return ""
