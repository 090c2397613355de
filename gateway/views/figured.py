"""A stored capture's figures by a standard that a person chooses, judged against limits that a person gives."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from drivers.units import deviation_unit
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.evaluate.standards import decision
from gateway.evaluate.standards.registry import evaluate_by, standards
from gateway.evaluate.uncertainty.budget import budget_of
from gateway.store import RunFolder


def known_standards() -> list[dict[str, str]]:
    """Every standard by name, edition and what sets it apart, the newest ISO 230-2 first."""
    return [{"name": one.name, "edition": one.edition, "says": one.says} for one in standards()]


def figures_by(folder: RunFolder, axis: str, phase: str, *, name: str, limits: Mapping[str, float]) -> dict[str, Any]:
    """Figures with U and verdicts of an axis' capture, in um or arcsec; with name "" those of the stored evaluation.

    A vendor's or national figure is made anew from the same readings, without Monte Carlo. Raises ModelError
    (E-EVAL-STANDARD, E-EVAL-LIMIT, E-EVAL-LIMIT-NAME), StoreError (E-STORE-STAGE).
    """
    if not name:
        return _stored(folder.get(f"evaluation-{axis}-{phase}", Evaluation), limits)
    capture = folder.get(f"capture-{axis}-{phase}", Capture)
    unit = deviation_unit(capture.axis_unit)
    budget = budget_of(capture)
    found = evaluate_by(name, capture.targets, capture.deviations, unit, budget=budget, monte_carlo=False)
    verdicts = found.decided(limits)
    return _told(found.standard.name, unit, found.values, found.U, verdicts, found.flags)


def _stored(kept: Evaluation, limits: Mapping[str, float]) -> dict[str, Any]:
    values = {key: getattr(kept, key, None) for key in kept.U}
    verdicts = [
        decision.decide(key, values.get(key), U=kept.U.get(key), limit=limit)
        for key, limit in limits.items()
        if key in values
    ]
    return _told(kept.standard, kept.unit, values, kept.U, verdicts, kept.flags)


def _told(
    name: str, unit: str, values: Mapping[str, float | None], expanded: Mapping[str, float], verdicts: Any, flags: Any
) -> dict[str, Any]:
    judged = {one.parameter: {"limit": one.limit, "verdict": one.verdict, "why": one.why} for one in verdicts}
    rows = [
        {"parameter": key, "value": _finite(value), "U": _finite(expanded.get(key)), **judged.get(key, {})}
        for key, value in values.items()
    ]
    return {"standard": name, "unit": unit, "rows": rows, "rule": decision.RULE, "flags": list(flags)}


def _finite(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None
