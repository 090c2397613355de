"""The end of a run: its report is written, and what its rows, lines and data say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from typing import Any

from drivers.message import Message, Quantity, fixed
from gateway.domain.figures import Evaluation
from gateway.domain.outcomes import ActingCheck, Verdict
from gateway.domain.proposals import Proposal
from gateway.report import ReportMaterial, parameter_rows
from gateway.report.lines import acting_lines, axis_lines, details, tooth_lines
from gateway.report.parameters import PARAMETERS, ParameterRow
from gateway.report.sentences import ABSENT, still_on
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.outcome import WORSE_EXIT, Outcome, of_table
from gateway.workflow.results.conformity import conforming
from gateway.workflow.results.reporting import ReportPaths, material_of, write_report


def finish(
    folder: RunFolder, measured: Mapping[str, MeasuredAxis], proposal: Proposal, verdict: Verdict | None
) -> Outcome:
    """Write the report and gather what the caller shows."""
    if verdict is not None:
        folder.set_state(verdict.outcome)
    material = material_of(folder)
    paths = write_report(folder, material)
    after: dict[str, Evaluation | None] = dict.fromkeys(measured)
    for name in measured:
        if folder.has(stages.evaluation(name, "after")):
            after[name] = folder.get(stages.evaluation(name, "after"), Evaluation)
    pairs = {name: (item.evaluation, after[name]) for name, item in measured.items()}
    done = outcome_of(
        folder.state, str(folder.path), evaluations=pairs, proposal=proposal, verdict=verdict, paths=paths
    )
    acting = [folder.get(stages.acting(one), ActingCheck) for one in measured if folder.has(stages.acting(one))]
    told = details(verdict.axes if verdict is not None else (), acting)
    return conforming(replace(done, lines=(*acting_lines(acting), *done.lines), details=told), material.judged)


def lines_of(material: ReportMaterial) -> tuple[Message, ...]:
    """What a run did for axes and tooth; the last line is the tooth's figure."""
    return (*still_on(material), *tooth_lines(material))


def details_of(material: ReportMaterial) -> tuple[Message, ...]:
    """What `lines_of` leaves to the report."""
    axes = material.axes
    acting = (one.acting for one in axes if one.acting is not None)
    background = material.tooth.proposal.background if material.tooth and material.tooth.proposal else ()
    told = details((one.verdict for one in axes if one.verdict is not None), acting)
    return (*told, *background)


AGAIN, ONCE = Message.of("S-TITLE-AGAIN"), Message.of("S-TITLE-ONCE")


def outcome_of(
    state: str,
    run_folder: str,
    evaluations: dict[str, tuple[Evaluation, Evaluation | None]],
    proposal: Proposal,
    verdict: Verdict | None,
    paths: ReportPaths,
) -> Outcome:
    """Gather what a run's end shows."""
    lines = [of_table(change.name, change.skipped) for change in proposal.changes if change.skipped]
    lines += axis_lines(verdict.axes) if verdict is not None else proposal.warnings
    places = (Message.of("S-REPORT-FOLDER", path=run_folder), Message.of("S-REPORT-PAGE", path=str(paths.html)))
    axes = verdict.axes if verdict is not None else ()
    data = {
        "outcome": verdict.outcome if verdict is not None else "not-pushed",
        "axes": {axis: _data(*pair) for axis, pair in evaluations.items()},
        "worse": [one.axis for one in axes if one.worse],
        "not_corrected": {change.name: str(change.skipped) for change in proposal.changes if change.skipped},
        "warnings": list(map(str, proposal.warnings)),
        "report": paths.as_data(),
    }
    return Outcome(
        state=state,
        run_folder=run_folder,
        rows=_rows(evaluations),
        title=AGAIN if any(after is not None for _, after in evaluations.values()) else ONCE,
        headings=("", *(f"{axis}, {before.unit}" for axis, (before, _) in evaluations.items())),
        lines=tuple(lines),
        places=places,
        data=data,
        exit_code=WORSE_EXIT if verdict is not None and verdict.outcome == "worse" else 0,
    )


def _rows(evaluations: Mapping[str, tuple[Evaluation, Evaluation | None]]) -> tuple[tuple[Message | str, ...], ...]:
    """One row a figure, one column an axis: before -> after, or what was measured once."""
    axes = [
        {row.parameter: row for row in parameter_rows(axis, before, after)}
        for axis, (before, after) in evaluations.items()
    ]
    names = dict.fromkeys(name for rows in axes for name in rows)
    return tuple((name, *(_cell(rows.get(name)) for rows in axes)) for name in names)


def _cell(row: ParameterRow | None) -> Message | str:
    if row is None:
        return ""
    if row.after is None:
        return Message.of("S-CELL-ONE", value=_figure(row.before))
    return Message.of("S-CELL-BOTH", before=_figure(row.before), after=_figure(row.after))


def _figure(value: float | None) -> Quantity | str:
    return ABSENT if value is None or not isfinite(value) else fixed(value)


def _data(before: Evaluation, after: Evaluation | None) -> dict[str, Any]:
    def figures(evaluation: Evaluation | None) -> dict[str, float | None] | None:
        if evaluation is None:
            return None
        return {name: getattr(evaluation, name) for name in PARAMETERS}

    return {"unit": before.unit, "before": figures(before), "after": figures(after)}
