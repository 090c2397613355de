"""What a run hands back at its end: report, rows, lines and data of any run; the preview of a stored proposal."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, replace
from math import isfinite
from typing import Any, TypeVar

import numpy as np

from drivers.errors import ConfigError
from drivers.limits import Limits
from drivers.local.names import shown as shown_name
from drivers.message import Message, Quantity, fixed
from gateway.config import SiteFile
from gateway.domain.figures import Evaluation
from gateway.domain.outcomes import ActingCheck, Verdict
from gateway.domain.proposals import Proposal, TableChange, torn
from gateway.interlocks import largest_change, steepest
from gateway.report import ReportMaterial, parameter_rows
from gateway.report.lines import acting_lines, axis_lines, details, tooth_lines
from gateway.report.parameters import PARAMETERS, ParameterRow
from gateway.report.sentences import ABSENT, still_on
from gateway.store import RunFolder
from gateway.tooth import FlankAgreement, ToothProposal, ToothVerdict
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.results.conformity import with_conformity
from gateway.workflow.results.report import ReportPaths, material_of, write_report
from gateway.workflow.run import stages
from gateway.workflow.run.outcome import WORSE_EXIT, Outcome, of_table


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
    return with_conformity(replace(done, lines=(*acting_lines(acting), *done.lines), details=told), material.judged)


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
        rows=_figure_rows(evaluations),
        title=AGAIN if any(after is not None for _, after in evaluations.values()) else ONCE,
        headings=("", *(f"{axis}, {before.unit}" for axis, (before, _) in evaluations.items())),
        lines=tuple(lines),
        places=places,
        data=data,
        exit_code=WORSE_EXIT if verdict is not None and verdict.outcome == "worse" else 0,
    )


def _figure_rows(
    evaluations: Mapping[str, tuple[Evaluation, Evaluation | None]],
) -> tuple[tuple[Message | str, ...], ...]:
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


# What a closing run hands back: before and after of every axis, what was said, and the tooth's figure last.

R = TypeVar("R")


def closing_outcome(folder: RunFolder, site: SiteFile) -> Outcome:
    """Write the report and gather what the caller shows; exit code 9 when an axis or the tooth got worse."""
    material = material_of(folder)
    paths = write_report(folder, material)
    verdict = _stored_or_none(folder, stages.VERDICT, Verdict)
    evaluations = {
        axis.name: (
            folder.get(stages.evaluation(axis.name, "before"), Evaluation),
            _stored_or_none(folder, stages.evaluation(axis.name, "after"), Evaluation),
        )
        for axis in site.axes
        if folder.has(stages.evaluation(axis.name, "before"))
    }
    proposal = folder.get(stages.PROPOSAL, Proposal)
    plain = outcome_of(
        folder.state, str(folder.path), evaluations=evaluations, proposal=proposal, verdict=verdict, paths=paths
    )
    judged = _stored_or_none(folder, stages.TOOTH_VERDICT, ToothVerdict)
    tooth = folder.get(stages.TOOTH, ToothProposal)
    *told, figure = lines_of(material)
    untried = proposal.warnings if verdict is None else ()
    needed = (line for line in tooth.said if line not in tooth.background)
    lines = (*needed, *told, *untried, figure)
    worse = plain.exit_code or (judged is not None and judged.outcome == "worse")
    data = plain.data | _tooth_line(judged) | _agreement(folder) | _closing_details(paths, tooth)
    done = replace(plain, lines=lines, details=details_of(material), data=data, exit_code=WORSE_EXIT if worse else 0)
    return with_conformity(done, material.judged)


def _closing_details(paths: ReportPaths, tooth: ToothProposal) -> dict[str, Any]:
    """What the report shows of the tooth but its raw records: errors, ranking, cures, tables, flanks, gear figures."""
    shown = json.loads(paths.json.read_text(encoding="utf-8"))["tooth"]
    ranking = [asdict(one) for one in tooth.ranking]
    return {"details": {key: value for key, value in shown.items() if key != "records"} | {"ranking": ranking}}


def _tooth_line(judged: ToothVerdict | None) -> dict[str, Any]:
    if judged is None:
        return {"tooth": None}
    told = {key: value for key, value in asdict(judged).items() if key != "words"}
    return {"tooth": told | {"taken_back": list(map(str, judged.taken_back))}}


def _agreement(folder: RunFolder) -> dict[str, Any]:
    """How the part before compares with the model; None without one."""
    found = _stored_or_none(folder, stages.AGREEMENT, FlankAgreement)
    return {"agreement": None if found is None else {**asdict(found), "outcome": found.outcome, "ratio": found.ratio}}


def _stored_or_none(folder: RunFolder, stage: str, kind: type[R]) -> R | None:
    return folder.get(stage, kind) if folder.has(stage) else None


# What a look at a stored proposal shows: one row a table, its points where they are wanted, each reason said once.

HEADINGS = tuple(
    map(
        Message.of,
        (
            "S-HEAD-TABLE",
            "S-HEAD-UNIT",
            "S-HEAD-POINTS",
            "S-HEAD-NOW",
            "S-HEAD-NEW",
            "S-HEAD-CHANGE",
            "S-HEAD-STEEPEST",
            "S-HEAD-PREDICTED",
        ),
    )
)


def preview_proposal(
    folder: RunFolder, proposal: Proposal, refusals: Mapping[str, list[Message]], *, refused_by: Collection[str]
) -> Outcome:
    """What `push` without consent shows: peak, change, prediction and limits of each table, every reason against it.

    ``refused_by``: codes of the reasons that would refuse the push; the others are told beforehand.
    """
    rows = tuple(_row(change) for change in proposal.changes if not change.skipped)
    lines = [of_table(names, reason) for names, reason in once((c.name, refusals[c.name]) for c in proposal.changes)]
    fine = [change.name for change in proposal.changes if not refusals[change.name]]
    lines += [Message.of("W-PUSH-FINE", tables=", ".join(fine))] if fine else []
    lines.append(Message.of("W-PUSH-SHOWN"))
    data: dict[str, Any] = {
        "refused": bool(refused_by),
        "refused_by": sorted(refused_by),
        "refusals": {name: list(map(str, against)) for name, against in refusals.items()},
        "not_corrected": {c.name: str(c.skipped) for c in proposal.changes if c.skipped},
    }
    return Outcome(
        state=folder.state,
        run_folder=str(folder.path),
        rows=rows,
        lines=tuple(lines),
        data=data,
        title=Message.of("S-TITLE-TABLES"),
        headings=HEADINGS,
        points=tuple(line for change in proposal.changes if not change.skipped for line in points_of(change)),
    )


def select_tables(proposal: Proposal, tables: Collection[str]) -> Proposal:
    """The proposal of these tables alone, by their names. Raises ConfigError (E-RUN-AXIS, E-RUN-PAIR)."""
    known = [change.name for change in proposal.changes]
    for name in tables:
        if name not in known:
            raise ConfigError("E-RUN-AXIS", "proposal", axis=shown_name(name), known=", ".join(known))
    chosen = tuple(change for change in proposal.changes if change.name in tables)
    missing = torn(chosen, proposal.changes)
    if missing:
        raise ConfigError("E-RUN-PAIR", chosen[0].axis, missing=", ".join(missing))
    return replace(proposal, changes=chosen) if chosen else proposal


def once(told: Iterable[tuple[str, Iterable[R]]]) -> list[tuple[str, R]]:
    """(names, reason) with each reason once, in the order in which it came up first."""
    names: dict[R, list[str]] = {}
    for name, reasons in told:
        for reason in reasons:
            names.setdefault(reason, []).append(name)
    return [(", ".join(dict.fromkeys(found)), reason) for reason, found in names.items()]


def points_of(change: TableChange) -> list[Message]:
    """Every interpolation point: where, what acts there now, what would."""
    new, places = change.new, change.new.positions
    count, live = len(new.deviations), len(change.old.deviations)
    lines = [Message.of("S-POINTS-OF", name=change.name, table=new.name, count=count, live=live)]
    for place, was, becomes in zip(places, change.old.at(places), new.deviations, strict=True):
        acts = float(was) if change.old_enabled else 0.0
        told = {"place": fixed(float(place), 3), "was": fixed(acts, 3, signed=True), "unit": new.deviation_unit}
        lines.append(Message.of("S-POINT-CHANGE", becomes=fixed(becomes, 3, signed=True), **told))
    return lines


def _row(change: TableChange) -> tuple[Message | str, ...]:
    new, limits = change.new, Limits.of(change.new.output_unit)
    acting = change.old.deviations if change.old_enabled else (0.0,)
    return (
        change.name,
        new.deviation_unit,
        str(len(new.deviations)),
        _span(acting),
        _span(new.deviations),
        _of(largest_change(change), limits.change),
        _of(steepest(new), limits.slope),
        _predicted_deviation(change),
    )


def _of(value: float, limit: float) -> Message:
    return Message.of("S-CELL-OF", value=fixed(value), limit=Quantity(limit))


def _span(values: Iterable[float]) -> Message:
    low, high = float(min(values)), float(max(values))
    if low == high:
        return Message.of("S-CELL-ONE", value=fixed(low, 1))
    return Message.of("S-CELL-SPAN", low=fixed(low, 1, signed=True), high=fixed(high, 1, signed=True))


def _predicted_deviation(change: TableChange) -> Message:
    """Largest deviation the axis will show, with its uncertainty; a cross table is judged on the flank instead."""
    if not change.predicted.size or change.layer == "cross":
        return Message.of("S-CELL-FLANK")
    largest, U = float(np.nanmax(np.abs(change.predicted))), float(np.nanmax(change.predicted_U))
    return Message.of("S-CELL-WITH-U", value=fixed(largest), U=fixed(U))
