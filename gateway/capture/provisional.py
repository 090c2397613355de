"""The deviation of one reading while others are still to come: corrected with the last air and material; pure.

The capture corrects at its end with air and material linear in time between its first and last reading of them
(`gateway.capture.corrected`). Meanwhile only the last ones are known, so what is shown may still change: by the change
that air and material have made so far, which is a part of its uncertainty.
"""

from __future__ import annotations

from math import hypot

from drivers.types.sensing import Ambient
from drivers.types.values import CompensatedFor
from gateway.config import AxisSection
from gateway.domain.values import COVERAGE
from gateway.evaluate.optics import air, displacement
from gateway.evaluate.uncertainty.budget import LATERAL_RANGE_MM, UNKNOWN_OFF_20_K, linear_budget, misalignment_um


def provisional_um(
    axis: AxisSection,
    optical_mm: float,
    target_mm: float,
    *,
    datum_mm: float,
    span_mm: float,
    reading_u_um: float,
    ambient: tuple[Ambient, Ambient],
    already: CompensatedFor,
) -> tuple[float, float]:
    """Corrected deviation and its U (k = 2) in um of a reading on a linear axis.

    ``optical_mm`` is the reading from the datum, positive in the axis' plus direction, ``span_mm`` the length that is
    measured, ``ambient`` the first and the last reading of air and material. U is the budget of a laser over the
    length from the datum (device, material, expansion, and the cosine error of a beam that runs off over the span), the
    scatter of the reading, and what air and material have changed since the first one. Raises AmbientOutOfRange.
    """
    first, last = ambient
    setup = displacement.LinearSetup(
        datum_mm=datum_mm,
        dead_path_mm=axis.measure.dead_path_mm,
        expansion_ppm_per_k=axis.measure.expansion_ppm_per_k,
        beam=axis.measure.beam,
    )

    def corrected(now: Ambient) -> float:
        values, _ = displacement.linear_deviations(
            [optical_mm], [target_mm], setup, start=first, end=now, fraction=1.0, already=already
        )
        return float(values[0])

    value, length = corrected(last), abs(target_mm - datum_mm)
    off_20_k = air.material_degc(last) - air.REFERENCE_DEGC if last.material_degc else UNKNOWN_OFF_20_K
    budget = (
        linear_budget(length, expansion_ppm_per_k=axis.measure.expansion_ppm_per_k, off_20_k=off_20_k)
        if (length)
        else None
    )
    parts = (budget.device, budget.temperature, budget.expansion) if budget is not None else ()
    runs_off = misalignment_um(span_mm, LATERAL_RANGE_MM) * length / span_mm if span_mm else 0.0
    return value, hypot(*parts, runs_off, COVERAGE * reading_u_um, value - corrected(first))
