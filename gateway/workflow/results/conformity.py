"""The site's tolerances held against what was measured: every limit with its U by ISO 14253-1."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from math import hypot, sqrt
from typing import Any

from drivers.message import Message, Quantity, fixed
from gateway.config import GearToleranceSection, SiteFile, ToleranceSection
from gateway.domain.values import COVERAGE
from gateway.evaluate.behaviour.doubts import all_doubts
from gateway.evaluate.behaviour.positioning import withhold_verdicts
from gateway.evaluate.standards.conformity import STANDARD, Decision, class_limits, decide, verdict_word
from gateway.evaluate.standards.registry import evaluate_by, standard
from gateway.report.material import AxisMaterial, Judged, ReportMaterial, ToothMaterial
from gateway.tooth import InspectedFlank
from gateway.workflow.run.outcome import Outcome, of_verdicts

RUN_STANDARD = "ISO 230-2:2014"


def judge_limits(site: SiteFile, material: ReportMaterial) -> tuple[Judged, ...]:
    """Each limit of the site on each axis and on the last part, as left where that was measured, else as found.

    Raises ModelError where a standard cannot evaluate an axis.
    """
    found = [
        one
        for said in site.tolerances
        for axis in material.axes
        if said.axis == _name(site, axis.axis, axis.letter)
        for one in _axis(axis, said)
    ]
    if site.gear_tolerance is not None and material.tooth is not None:
        found += _gear(material.tooth, site.gear_tolerance)
    return tuple(found)


def limits_of_axis(site: SiteFile, axis: str, asked: str) -> dict[str, float]:
    """The site's limits of an axis (its name or letter) by the standard asked for. Raises ModelError."""
    name = _name(site, axis)
    mine = (one.limits for one in site.tolerances if one.axis == name and standard(one.standard) == standard(asked))
    return {key: limit for limits in mine for key, limit in limits.items()}


def limited_axes(site: SiteFile, asked: str) -> tuple[str, ...]:
    """Axes that have limits by the standard asked for, by name. Raises ModelError."""
    return tuple(
        dict.fromkeys(one.axis for one in site.tolerances if standard(one.standard) == standard(asked) and one.limits)
    )


def _name(site: SiteFile, *said: str) -> str | None:
    """Name of the axis that the first of these means."""
    meant = (site.meant(one) for one in said)
    return next((axis.name for axis in meant if axis is not None), None)


def with_conformity(outcome: Outcome, found: Sequence[Judged]) -> Outcome:
    """The outcome with the verdict on every limit of the site before its last line.

    13 or 21 is its exit code, where nothing worse gave one.
    """
    if not found:
        return outcome
    lines = (*outcome.lines[:-1], *(line_of(one) for one in found), *outcome.lines[-1:])
    code = outcome.exit_code or of_verdicts(one.decision.verdict for one in found)
    data = {**outcome.data, "conformity": [data_of(one) for one in found]}
    return replace(outcome, lines=lines, data=data, exit_code=code)


def data_of(one: Judged) -> dict[str, Any]:
    """A decided limit for --json."""
    return {"of": one.of, "standard": one.standard, "as_left": one.as_left, **decision_data(one.decision)}


def decision_data(decision: Decision) -> dict[str, Any]:
    """A decision as JSON data, what kept it open in English."""
    return {**asdict(replace(decision, why=None)), "why": str(decision.why) if decision.why is not None else ""}


def line_of(one: Judged) -> Message:
    """A decided limit in words."""
    decision = one.decision
    figures = {"value": fixed(decision.value), "U": fixed(decision.U), "limit": Quantity(decision.limit)}
    said = {"of": one.of, "parameter": decision.parameter, "verdict": verdict_word(decision.verdict), **figures}
    state = Message.of("S-AS-LEFT" if one.as_left else "S-AS-FOUND")
    why = Message.of("S-VERDICT-WHY", why=decision.why) if decision.why else ""
    return Message.of("W-CONFORMITY", standard=one.standard, state=state, why=why, **said)


def _axis(axis: AxisMaterial, said: ToleranceSection) -> Iterator[Judged]:
    as_left = axis.after is not None
    name = standard(said.standard).name
    for one in _decisions(axis, name, said):
        yield Judged(axis.axis, name, as_left, one)


def _decisions(axis: AxisMaterial, name: str, said: ToleranceSection) -> tuple[Decision, ...]:
    """By the run's own evaluation where that is the standard asked for, else by that standard from the readings."""
    found = axis.after if axis.after is not None else axis.before
    capture = axis.capture_after if axis.after is not None else axis.capture_before
    if found is None:
        return ()
    doubts = all_doubts(capture) if capture is not None else ()
    if name == RUN_STANDARD:
        limits = said.limits.items()
        by_run = (decide(key, getattr(found, key), U=found.U.get(key), limit=limit) for key, limit in limits)
        return withhold_verdicts(tuple(by_run), doubts)
    if capture is None:
        return ()
    unit = axis.deviation_unit
    result = evaluate_by(name, capture.targets, capture.deviations, unit, budget=axis.budget)
    return withhold_verdicts(result.decided(said.limits), doubts)


def _gear(tooth: ToothMaterial, said: GearToleranceSection) -> Iterator[Judged]:
    """The last inspected part."""
    parts = [one for one in tooth.parts if one.flank is not None]
    if not parts:
        return
    last = parts[-1]
    if last.flank is None:
        return
    U = figure_U(last.flank)
    by_class = f"{STANDARD}, {said.grade}" if said.grade is not None else ""
    limits = {name: (limit, by_class) for name, limit in _class(said).items()}
    limits |= {name: (limit, "") for name, limit in said.limits.items()}
    for name, (limit, by) in limits.items():
        if name in last.flank.figures or name in said.limits:
            decision = decide(name, last.flank.figures.get(name), U=U, limit=limit)
            yield Judged(last.part, by, last.part != "before", decision)


def figure_U(flank: InspectedFlank) -> float:
    """U (k = 2) of a gear figure, um: two touched points, and how far the whole flank may lie."""
    return COVERAGE * hypot(sqrt(2.0) * flank.u_um, flank.rms_u_um)


def _class(said: GearToleranceSection) -> dict[str, float]:
    if said.grade is None or said.diameter_mm is None or said.module_mm is None or said.width_mm is None:
        return {}
    return dict(class_limits(said.diameter_mm, said.module_mm, said.width_mm, said.grade))
