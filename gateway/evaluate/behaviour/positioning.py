"""A positioning test to figures: one function for command, library, day, report and page.

What is measured, what its surroundings and equipment were, and what is asked of it go in; figures by a standard with U,
what U contains, what had to be supposed, doubts and verdicts come out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivers.message import Message, digits
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from drivers.units import DeviationUnit, deviation_unit
from gateway.domain.captures import Capture
from gateway.evaluate.behaviour.doubts import accept_doubts, all_doubts, blocking_doubts
from gateway.evaluate.standards import statistics
from gateway.evaluate.standards.conformity import Decision
from gateway.evaluate.standards.registry import StandardResult, evaluate_by
from gateway.evaluate.uncertainty.budget import Budget, measured_budget, with_lever

PARTS_OF_U = {
    "device": "S-U-DEVICE",
    "misalignment": "S-U-MISALIGNMENT",
    "temperature": "S-U-TEMPERATURE",
    "expansion": "S-U-EXPANSION",
    "turning": "S-U-TURNING",
    "eve": "S-U-EVE",
    "scatter": "S-U-SCATTER",
}
"""What U contains, as people read it."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What is known beside the readings; None and {} leave it to the record.

    ``material_degc`` and ``expansion_ppm_per_k`` of the scale; ``equipment`` as certificates state it (U, k = 2):
    um_per_m, kelvin, arcsec.
    """

    material_degc: float | None = None
    expansion_ppm_per_k: float | None = None
    equipment: Mapping[str, float] | None = None


@dataclass(frozen=True, slots=True)
class PositioningFigures:
    """A test by a standard, with what its U contains.

    ``contributions`` are expanded uncertainties (k = 2) by name, in the deviation unit; ``scatter`` among them is of
    one reading. ``supposed`` says what had to be supposed for them. ``doubts`` are of the readings; a blocking one
    leaves no verdict.
    """

    result: StandardResult
    budget: Budget
    contributions: Mapping[str, float]
    supposed: tuple[Doubt, ...]
    doubts: tuple[Doubt, ...]
    limits: Mapping[str, float]

    @property
    def verdicts(self) -> tuple[Decision, ...]:
        """The limits decided. Raises ModelError (E-EVAL-LIMIT-NAME, E-EVAL-LIMIT)."""
        return withhold_verdicts(self.result.decided(self.limits), self.doubts)

    @property
    def blocked(self) -> bool:
        """Whether a doubt stops verdict and table."""
        return bool(blocking_doubts(self.doubts))


def evaluate_positioning(
    measured: MeasuredSet | Capture,
    standard: str = "2014",
    *,
    known: Surroundings | None = None,
    limits: Mapping[str, float] | None = None,
    accepted: Mapping[str, str] | None = None,
    seed: int = 1,
    monte_carlo: bool = True,
    unit: DeviationUnit | None = None,
    across: bool = False,
) -> PositioningFigures:
    """Figures of deviations by a standard, U with what is known of surroundings and equipment.

    Without ``unit`` deviations are um over mm, arcsec over deg. ``across`` is an error that is none of positioning:
    its U holds the scatter of its readings alone. ``accepted`` are doubts that a person settled, reasons by code.
    Raises ModelError as `evaluate_by`.
    """
    kind = unit or deviation_unit(measured.axis_unit)
    budget, supposed = budget_with(measured, known or Surroundings())
    if across:
        budget, supposed = Budget(), (Doubt("S-U-READINGS"),)
    result = evaluate_by(
        standard,
        measured.targets,
        measured.deviations,
        kind,
        budget=budget,
        seed=seed,
        monte_carlo=monte_carlo,
    )
    found = all_doubts(measured, kind, device_arcsec=dict((known or Surroundings()).equipment or {}).get("arcsec"))
    return PositioningFigures(
        result=result,
        budget=budget,
        contributions=contributions(measured, budget),
        supposed=supposed,
        doubts=accept_doubts(found, accepted or {}),
        limits=limits or {},
    )


def budget_with(measured: MeasuredSet | Capture, known: Surroundings) -> tuple[Budget, tuple[Doubt, ...]]:
    """The budget of U and what had to be supposed: by what is given, else by what the record itself contains."""
    stated = dict(known.equipment or {})
    if isinstance(measured, Capture) and not stated and measured.conditions is not None:
        stated = dict(measured.conditions.stated)
    budget, supposed = measured_budget(measured, known.material_degc, known.expansion_ppm_per_k, stated)
    return (with_lever(budget, measured) if isinstance(measured, Capture) else budget), supposed


def contributions(measured: MeasuredSet | Capture, budget: Budget) -> dict[str, float]:
    """What U contains, k = 2 by name: the budget's parts, and the scatter of one reading where that was repeated."""
    found = budget.contributions()
    s = statistics.standard_deviations(measured.deviations)
    if budget.eve is None and np.isfinite(s).any():
        found["scatter"] = 2.0 * float(np.sqrt(np.nanmean(s**2)))
    return found


def describe_contributions(found: Mapping[str, float], unit: str) -> Message:
    """What U contains, in one line."""
    parts = tuple(
        Message.of("S-U-PART", name=Message.of(PARTS_OF_U[name]), value=digits(value)) for name, value in found.items()
    )
    return Message.of("S-U-CONTAINS", parts=parts or "-", unit=unit)


def withhold_verdicts(decisions: tuple[Decision, ...], doubts: tuple[Doubt, ...]) -> tuple[Decision, ...]:
    """Verdicts, none of them while a doubt blocks: its code is the reason."""
    codes = ", ".join(one.code for one in blocking_doubts(doubts))
    if not codes:
        return decisions
    return tuple(
        replace(one, verdict="not decidable", why=Message.of("S-DOUBT-VERDICT", codes=codes)) for one in decisions
    )
