"""Makes a run's report from what its folder holds, and nothing else."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from drivers.types import SignProof
from gateway.config import AxisSection
from gateway.domain import (
    AxisVerdict,
    Capture,
    Component,
    Equipment,
    Evaluation,
    Proposal,
    PushRecord,
    TableChange,
    Verdict,
)
from gateway.report import AxisMaterial, FileUsed, InstrumentNote, ReportMaterial, as_json, before_after_png, render
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.bench import site_of

R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class ReportPaths:
    """Where a report was written."""

    html: Path
    json: Path
    picture: Path


def write_report(folder: RunFolder) -> ReportPaths:
    """Render report.html, report.json and before-after.png into the run folder."""
    material = material_of(folder)
    picture = folder.path / "before-after.png"
    before_after_png(material, picture)
    html = folder.write_text("report.html", render(material))
    data = folder.write_text("report.json", json.dumps(as_json(material), indent=1))
    return ReportPaths(html, data, picture)


def material_of(folder: RunFolder) -> ReportMaterial:
    """Everything the report shows, read from the folder with every hash checked."""
    site, _path = site_of(folder)
    equipment = folder.get(stages.EQUIPMENT, Equipment)
    proposal = folder.get(stages.PROPOSAL, Proposal) if folder.has(stages.PROPOSAL) else None
    verdict = folder.get(stages.VERDICT, Verdict) if folder.has(stages.VERDICT) else None
    facts = folder.facts
    axes = tuple(_axis(folder, axis, proposal, verdict) for axis in site.axes)
    instruments = tuple(InstrumentNote(item.name, item.identity, item.notices) for item in equipment.items)
    files = tuple(
        FileUsed(name, digest, "stored with the run")
        for name, digest in facts["files"].items()
        if not name.startswith("report.")
    )
    return ReportMaterial(
        site.site.name,
        equipment.machine,
        folder.run_id,
        verdict.outcome if verdict is not None else "not-pushed",
        axes,
        facts["created_utc"],
        _last_moment(axes, facts["created_utc"]),
        f"trueflank {facts['software']}",
        instruments=instruments,
        files=files,
        hashes={stage: folder.digest(stage) for stage in folder.stages},
        findings=tuple(str(error.get("what", "")) for error in facts["errors"]),
    )


def _axis(folder: RunFolder, axis: AxisSection, proposal: Proposal | None, verdict: Verdict | None) -> AxisMaterial:
    name = axis.name
    before = _get(folder, stages.capture(name, "before"), Capture)
    change = _change(proposal, name)
    component = _get(folder, stages.component(name), Component)
    findings = (change.skipped,) if change is not None and change.skipped else ()
    return AxisMaterial(
        name,
        axis.letter,
        axis.unit,
        before,
        _get(folder, stages.capture(name, "after"), Capture),
        _get(folder, stages.evaluation(name, "before"), Evaluation),
        _get(folder, stages.evaluation(name, "after"), Evaluation),
        (component,) if component is not None else (),
        change,
        _get(folder, stages.push(name), PushRecord),
        _proof(verdict, name),
        before.sense if before is not None else None,
        _axis_verdict(verdict, name),
        findings,
    )


def _get(folder: RunFolder, stage: str, kind: type[R]) -> R | None:
    return folder.get(stage, kind) if folder.has(stage) else None


def _change(proposal: Proposal | None, axis: str) -> TableChange | None:
    changes = proposal.changes if proposal is not None else ()
    return next((change for change in changes if change.axis == axis), None)


def _proof(verdict: Verdict | None, axis: str) -> SignProof | None:
    proofs = verdict.proofs if verdict is not None else ()
    return next((proof for proof in proofs if proof.output_axis == axis), None)


def _axis_verdict(verdict: Verdict | None, axis: str) -> AxisVerdict | None:
    axes = verdict.axes if verdict is not None else ()
    return next((item for item in axes if item.axis == axis), None)


def _last_moment(axes: tuple[AxisMaterial, ...], otherwise: str) -> str:
    moments = [
        capture.ended_utc
        for axis in axes
        for capture in (axis.capture_before, axis.capture_after)
        if capture is not None and capture.ended_utc
    ]
    return max(moments, default=otherwise)
