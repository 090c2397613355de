"""What a run hands back to whoever started it: rows, lines, data and an exit code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from drivers.errors import words
from gateway.domain import Evaluation, Proposal, Verdict
from gateway.report import parameter_rows
from gateway.report.lines import tooth_lines
from gateway.report.parameters import PARAMETERS
from gateway.report.words import number, percent, still_on
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.measure import Measured
from gateway.workflow.reporting import ReportPaths, material_of, write_report

WORSE_EXIT = 9


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished run: before/after rows (axis, parameter, before, after, unit, change) and where all is kept."""

    state: str
    run_folder: str
    rows: tuple[tuple[str, str, str, str, str, str], ...]
    lines: tuple[str, ...]
    data: dict[str, Any]
    exit_code: int = 0

    def as_data(self) -> dict[str, Any]:
        """The outcome as JSON data."""
        return {"state": self.state, "run_folder": self.run_folder, **self.data}


def finish(folder: RunFolder, measured: Mapping[str, Measured], proposal: Proposal, verdict: Verdict | None) -> Outcome:
    """Write the report and gather what the caller shows."""
    if verdict is not None:
        folder.set_state(verdict.outcome)
    paths = write_report(folder)
    after: dict[str, Evaluation | None] = dict.fromkeys(measured)
    for name in measured:
        if folder.has(stages.evaluation(name, "after")):
            after[name] = folder.get(stages.evaluation(name, "after"), Evaluation)
    pairs = {name: (item.evaluation, after[name]) for name, item in measured.items()}
    return outcome_of(folder.state, str(folder.path), pairs, proposal, verdict, paths)


def shown(folder: RunFolder, proposal: Proposal, refusals: Mapping[str, list[str]]) -> Outcome:
    """What `push` without consent shows: each table's difference and every reason against writing it."""
    lines: list[str] = []
    for change in proposal.changes:
        old, new = change.old, change.new
        lines.append(f"{change.name}: {new.name} {len(new.deviations)} points, live {len(old.deviations)} points")
        if not change.skipped:
            places = new.positions
            for place, was, becomes in zip(places, old.at(places), new.deviations, strict=True):
                acts = float(was) if change.old_enabled else 0.0
                lines.append(f"  {place:10.3f} {acts:+9.3f} -> {becomes:+9.3f} {new.deviation_unit}")
        lines += [f"  {reason}" for reason in refusals[change.name]] or ["  nothing speaks against it"]
    lines.append("nothing was written; live tables are compared when the push is applied")
    data = {"refusals": dict(refusals), "not_corrected": {c.axis: c.skipped for c in proposal.changes if c.skipped}}
    return Outcome(folder.state, str(folder.path), (), tuple(lines), data)


def alarmed(outcome: Outcome, alarms: tuple[str, ...]) -> Outcome:
    """The outcome of a run that has met alarms: it says them and ends with exit code 9."""
    if not alarms:
        return outcome
    lines = (*outcome.lines, *(words("W-TABLE-ALARM", alarm=alarm) for alarm in alarms))
    data = {**outcome.data, "alarms": list(alarms)}
    return replace(outcome, lines=lines, data=data, exit_code=outcome.exit_code or WORSE_EXIT)


def closing_lines(folder: RunFolder) -> tuple[str, ...]:
    """What a run did for axes and tooth, from what its folder holds; the last line is the tooth's figure."""
    material = material_of(folder)
    return (*still_on(material), *tooth_lines(material))


def outcome_of(
    state: str,
    run_folder: str,
    evaluations: dict[str, tuple[Evaluation, Evaluation | None]],
    proposal: Proposal,
    verdict: Verdict | None,
    paths: ReportPaths,
) -> Outcome:
    """Gather what a run's end shows."""
    rows = tuple(row for axis, pair in evaluations.items() for row in _rows(axis, *pair))
    lines = [f"{change.axis}: {change.skipped}" for change in proposal.changes if change.skipped]
    lines += [f"{axis.axis}: {axis.words}" for axis in verdict.axes] if verdict is not None else []
    lines += [f"run folder: {run_folder}", f"report: {paths.html}"]
    worse = verdict is not None and verdict.outcome == "worse"
    data = {
        "outcome": verdict.outcome if verdict is not None else "not-pushed",
        "axes": {axis: _data(*pair) for axis, pair in evaluations.items()},
        "not_corrected": {change.axis: change.skipped for change in proposal.changes if change.skipped},
        "report": paths.as_data(),
    }
    return Outcome(state, run_folder, rows, tuple(lines), data, WORSE_EXIT if worse else 0)


def _rows(axis: str, before: Evaluation, after: Evaluation | None) -> list[tuple[str, str, str, str, str, str]]:
    return [
        (row.axis, row.parameter, number(row.before), number(row.after), row.unit, percent(row.change_pct))
        for row in parameter_rows(axis, before, after)
    ]


def _data(before: Evaluation, after: Evaluation | None) -> dict[str, Any]:
    def figures(evaluation: Evaluation | None) -> dict[str, float | None] | None:
        if evaluation is None:
            return None
        return {name: getattr(evaluation, name) for name in PARAMETERS}

    return {"unit": before.unit, "before": figures(before), "after": figures(after)}
