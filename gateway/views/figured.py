"""A stored capture's figures by a standard that a person chooses, judged against limits that a person gives."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.evaluate.behaviour import positioning
from gateway.evaluate.behaviour.doubts import all_doubts, remarks
from gateway.evaluate.standards import conformity
from gateway.evaluate.standards.registry import standards
from gateway.store import RunFolder


def known_standards() -> list[dict[str, Any]]:
    """Every standard by name, edition and what sets it apart, the newest ISO 230-2 first."""
    return [
        {"name": one.name, "edition": one.edition, "says": one.says.as_data(), "iso": one.iso} for one in standards()
    ]


def figures_by(folder: RunFolder, axis: str, phase: str, *, name: str, limits: Mapping[str, float]) -> dict[str, Any]:
    """Figures with U and verdicts of an axis' capture, in um or arcsec; with name "" those of the stored evaluation.

    A vendor's or national figure is made anew from the same readings, without Monte Carlo. Raises ModelError
    (E-EVAL-STANDARD, E-EVAL-LIMIT, E-EVAL-LIMIT-NAME), StoreError (E-STORE-STAGE).
    """
    capture = folder.get(f"capture-{axis}-{phase}", Capture)
    if not name:
        return _stored(folder.get(f"evaluation-{axis}-{phase}", Evaluation), capture, limits)
    figured = positioning.evaluate_positioning(capture, name, limits=limits, monte_carlo=False)
    found = figured.result
    flags = (*found.flags, *remarks(figured.doubts), *(one.message for one in figured.supposed))
    contained = positioning.describe_contributions(figured.contributions, found.unit)
    return _told(found.standard.name, found.unit, found.values, found.U, figured.verdicts, (*flags, contained))


def _stored(kept: Evaluation, capture: Capture, limits: Mapping[str, float]) -> dict[str, Any]:
    values = {key: getattr(kept, key, None) for key in kept.U}
    doubts = all_doubts(capture)
    verdicts = positioning.withhold_verdicts(
        tuple(
            conformity.decide(key, values.get(key), U=kept.U.get(key), limit=limit)
            for key, limit in limits.items()
            if key in values
        ),
        doubts,
    )
    return _told(
        kept.standard,
        kept.unit,
        values,
        kept.U,
        verdicts,
        (*kept.flags, *remarks(doubts)),
    )


def _told(
    name: str, unit: str, values: Mapping[str, float | None], expanded: Mapping[str, float], verdicts: Any, flags: Any
) -> dict[str, Any]:
    judged = {
        one.parameter: {
            "limit": one.limit,
            "verdict": one.verdict,
            "why": one.why.as_data() if one.why is not None else "",
        }
        for one in verdicts
    }
    rows = [
        {"parameter": key, "value": _finite(value), "U": _finite(expanded.get(key)), **judged.get(key, {})}
        for key, value in values.items()
    ]
    return {
        "standard": name,
        "unit": unit,
        "rows": rows,
        "rule": conformity.RULE.as_data(),
        "flags": [one.as_data() for one in flags],
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None
