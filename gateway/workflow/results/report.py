"""A run's report from what its folder holds, and nothing else; what was not stored is left out."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from drivers.errors import ConfigError
from drivers.message import Message, words
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from gateway.capture.collection import RawCapture
from gateway.config import AxisSection, SiteFile, excused_certificate, unprotected_connection
from gateway.correct.outlook.flank_uncertainty import OpenDoubt, what_next
from gateway.domain.captures import Capture
from gateway.domain.equipment import Equipment
from gateway.domain.figures import Component, Evaluation
from gateway.domain.grinding_process import CorrectionOrder, Separation, WheelVerdict
from gateway.domain.outcomes import ActingCheck, AxisVerdict, PushRecord, Verdict
from gateway.domain.proposals import Proposal, TableChange
from gateway.domain.stated import StatedFacts
from gateway.errors import ModelError, StoreError
from gateway.evaluate.uncertainty.budget import budget_of
from gateway.model.error_model import ErrorModel
from gateway.report import (
    TOOTH_PICTURES,
    AxisMaterial,
    FileUsed,
    InstrumentNote,
    PartMaterial,
    ReportMaterial,
    TableMaterial,
    ToothMaterial,
    as_json,
    before_after_png,
    render,
    tooth_pictures,
)
from gateway.report.material import AmbientCourse, Outcome, WheelMaterial
from gateway.report.missing import PUSHED
from gateway.store import RunFolder
from gateway.tooth import AxisOutlook, GearProposal, GroundPart, InspectedFlank, ToothProposal, ToothVerdict
from gateway.workflow.axes.propose import size_of
from gateway.workflow.errors21.measurement import advise, grids
from gateway.workflow.errors21.setups import plan_setups
from gateway.workflow.files.headers import moment_of
from gateway.workflow.results.conformity import judge_limits
from gateway.workflow.results.overview import index_html, lead_of, results_csv
from gateway.workflow.results.particulars import conditions_of, particulars_of
from gateway.workflow.run import stages
from gateway.workflow.run.folder import site_recorded, was_simulated
from gateway.workflow.tooth.proposal import ToothWork, work_of

WRITTEN = ("report.", "calibration-report.", "results.csv", "index.html")

BEFORE_AFTER = "before-after"
CONTROL = "controller"  # the name of the control among the devices of a run
PICTURES = (BEFORE_AFTER, *TOOTH_PICTURES)
FIRST_SEEN = ("tooth-before-after", BEFORE_AFTER, *TOOTH_PICTURES)
PAPER = "calibration-report.pdf"


@dataclass(frozen=True, slots=True)
class ReportPaths:
    """Where a report was written; ``pictures`` are those of tooth and errors."""

    html: Path
    json: Path
    picture: Path
    pictures: tuple[Path, ...] = ()

    def as_data(self) -> dict[str, object]:
        """For --json."""
        paths = {"html": str(self.html), "json": str(self.json), "picture": str(self.picture)}
        return {**paths, "pictures": [str(path) for path in self.pictures]}


def write_report(folder: RunFolder, known: ReportMaterial | None = None) -> ReportPaths:
    """Render report.html, report.json, results.csv, index.html and the pictures into the run folder, of what it holds.

    before-after.png shows the axes; a run without any axis has its first picture in that place. ``known`` is what
    `material_of` told already. Raises StoreError.
    """
    material = known if known is not None else material_of(folder)
    drawn = (
        tooth_pictures(material.tooth, folder.path, simulated=material.simulated) if material.tooth is not None else ()
    )
    picture = folder.path / f"{BEFORE_AFTER}.png"
    if material.axes or not drawn:
        before_after_png(material, picture)
    else:
        picture = drawn[0]
    folder.adopt(picture, *drawn)
    html = folder.write_text("report.html", render(material))
    data = folder.write_text("report.json", json.dumps(as_json(material), indent=1))
    folder.write_text("results.csv", results_csv(material))
    write_index(folder, material)
    return ReportPaths(html, data, picture, drawn)


def write_index(folder: RunFolder, material: ReportMaterial) -> Path:
    """index.html of what the folder holds now, its picture and figures first; returns its path. Raises StoreError."""
    picture = next((f"{one}.png" for one in FIRST_SEEN if (folder.path / f"{one}.png").is_file()), "")
    paper = PAPER if (folder.path / PAPER).is_file() else ""
    lead = lead_of(material, picture)
    text = index_html(folder.facts, simulated=material.simulated, lead=lead, paper=paper)
    return folder.write_text("index.html", text)


def standing_report(folder: RunFolder, material: ReportMaterial) -> ReportPaths | None:
    """The report that lies there, if it was made of the same records by the same software; None else."""
    if not {"report.html", "report.json"} <= set(folder.files):
        return None
    try:
        told = json.loads(folder.read_text("report.json"))
    except StoreError:
        return None
    same = {"hashes": dict(material.hashes), "software": material.software, "simulated": material.simulated}
    if any(told.get(key) != value for key, value in same.items()):
        return None
    drawn = tuple(path for name in PICTURES if (path := folder.path / f"{name}.png").is_file())
    if not drawn:
        return None
    others = tuple(path for path in drawn if path.stem != BEFORE_AFTER)
    return ReportPaths(folder.path / "report.html", folder.path / "report.json", drawn[0], others)


def summary_of(paths: ReportPaths) -> object:
    """The answer in few figures, as the report.json just written has it."""
    return json.loads(paths.json.read_text(encoding="utf-8"))["summary"]


def material_of(folder: RunFolder) -> ReportMaterial:
    """Everything the report shows, read from the folder with every hash checked."""
    site, path = site_recorded(folder)
    equipment = stored_record(folder, stages.EQUIPMENT, Equipment)
    proposal = stored_record(folder, stages.PROPOSAL, Proposal)
    verdict = stored_record(folder, stages.VERDICT, Verdict)
    tooth = tooth_of(folder, site, path)
    facts = folder.facts
    stated = stored_record(folder, stages.STATED, StatedFacts) or StatedFacts()
    axes = tuple(_axis(folder, axis, proposal, verdict, of=(site, stated)) for axis in site.axes)
    measured = tuple(axis for axis in axes if axis.before is not None or axis.after is not None)
    axes = measured if measured or tooth is not None else axes
    items = equipment.items if equipment is not None else ()
    opened = any(item.name == CONTROL for item in items)
    instruments = tuple(InstrumentNote(item.name, item.identity, item.notices) for item in items)
    files = tuple(
        FileUsed(name, digest, words("S-RUN-STORED"))
        for name, digest in facts["files"].items()
        if not name.startswith(WRITTEN)
    )
    began, ended = facts["created_utc"], _last_moment(axes, tooth, facts["created_utc"])
    if equipment is None and any(one.capture_before is not None for one in axes):
        began, ended = _days_of_files(axes)
    material = ReportMaterial(
        site=site.site.name,
        machine=equipment.machine if equipment is not None else _machine(facts["machine"]),
        run_id=folder.run_id,
        outcome=outcome_of(verdict, tooth),
        axes=axes,
        operator=_people(axes),
        started_utc=began,
        ended_utc=ended,
        software=f"trueflank {facts['software']}",
        instruments=instruments,
        files=files,
        hashes={stage: folder.digest(stage) for stage in folder.stages},
        findings=tuple(str(error.get("what", "")) for error in folder.errors),
        tooth=tooth,
        particulars=particulars_of(site, path, ended or facts["created_utc"]),
        simulated=was_simulated(site, instruments),
        unprotected=unprotected_connection(site) if opened else None,
        excused=excused_certificate(site) if opened else ("", ""),
        accepted=equipment.accepted if equipment is not None else (),
        stated=stated,
    )
    return replace(material, judged=judge_limits(site, material))


def _people(axes: Sequence[AxisMaterial]) -> str:
    """Who measured, as the captures say."""
    taken = (one for axis in axes for one in (axis.capture_before, axis.capture_after))
    said = (one.conditions.operator for one in taken if one is not None and one.conditions is not None)
    return ", ".join(dict.fromkeys(name for name in said if name))


def outcome_of(verdict: Verdict | None, tooth: ToothMaterial | None) -> Outcome:
    """The run's answer in one word: the tooth's where it was judged, worse if any axis is; else how far it came."""
    judged = tooth.verdict if tooth is not None else None
    if judged is not None:
        return "worse" if verdict is not None and verdict.outcome == "worse" else judged.outcome
    if verdict is not None:
        return verdict.outcome
    if tooth is None:
        return "not-pushed"
    if any(one.push is not None and one.push.outcome in PUSHED for one in tooth.tables):
        return "pushed"
    if tooth.tables:
        return "not-pushed"
    return "inspected" if tooth.parts else "measured"


def _machine(known: Mapping[str, str]) -> MachineIdentity:
    """The machine as the run's own facts have it, where no equipment was stored."""
    return MachineIdentity(known.get("serial", ""), known.get("version", ""), ())


def _axis(
    folder: RunFolder,
    axis: AxisSection,
    proposal: Proposal | None,
    verdict: Verdict | None,
    *,
    of: tuple[SiteFile, StatedFacts],
) -> AxisMaterial:
    name, (site, stated) = axis.name, of
    before = stored_record(folder, stages.capture(name, "before"), Capture)
    change = _change(proposal, name)
    component = stored_record(folder, stages.component(name), Component)
    findings = (change.skipped,) if change is not None and change.skipped else ()
    beside = _reversal_beside_table(folder, proposal, verdict, name)
    after = stored_record(folder, stages.capture(name, "after"), Capture)
    return AxisMaterial(
        axis=name,
        letter=axis.letter,
        unit=axis.unit,
        capture_before=before,
        capture_after=after,
        test_before=_conditions(before, axis, site, stated),
        test_after=_conditions(after, axis, site, stated),
        before=stored_record(folder, stages.evaluation(name, "before"), Evaluation),
        after=stored_record(folder, stages.evaluation(name, "after"), Evaluation),
        components=(component,) if component is not None else (),
        change=change,
        push=stored_record(folder, stages.push(name), PushRecord),
        sign_proof=_proof(verdict, name),
        sense_proof=before.sense if before is not None else None,
        verdict=_axis_verdict(verdict, name),
        beside=beside,
        findings=(*findings, *(_of_table(one.change) for one in beside)),
        acting=stored_record(folder, stages.acting(name), ActingCheck),
        outlook=_outlook(folder, name),
        budget=budget_of(before) if before is not None else None,
        course_before=_course(folder, stages.raw(name, "before"), _setup_raw(site, axis)),
        course_after=_course(folder, stages.raw(name, "after")),
    )


def _conditions(capture: Capture | None, axis: AxisSection, site: SiteFile, stated: StatedFacts) -> Mapping[str, str]:
    """The test conditions of a capture; what measured it is named where the run did so itself."""
    file = capture.source if capture is not None else ""
    said = conditions_of(capture, stated, file, site, axis=axis)
    own = axis.measure.instrument if capture is not None and capture.source == "live" else ""
    return {"instrument": own, **said} if own else said


def _outlook(folder: RunFolder, axis: str) -> AxisOutlook | None:
    """How the axis is to deviate with everything that the run proposes for the tooth."""
    tooth = stored_record(folder, stages.TOOTH, ToothProposal)
    return next((one for one in tooth.axes if one.axis == axis), None) if tooth is not None else None


def _course(folder: RunFolder, *of: str) -> AmbientCourse | None:
    """Air and material over a capture, by the first of these stages that is there."""
    stage = next((one for one in of if folder.has(one)), "")
    raw = folder.get(stage, RawCapture) if stage else None
    return AmbientCourse(raw.ambient_time_s, raw.ambient) if raw is not None else None


def _setup_raw(site: SiteFile, axis: AxisSection) -> str:
    """The stage of an axis' positioning where a plan of set-ups measured it."""
    own = (
        (one.key for one in plan_setups(site) if one.positioning and one.axis.name == axis.name) if site.setups else ()
    )
    return stages.setup_raw(next(iter(own), ""))


def _change(proposal: Proposal | None, axis: str) -> TableChange | None:
    changes = proposal.changes if proposal is not None else ()
    return next((change for change in changes if change.name == axis), None)


def _reversal_beside_table(
    folder: RunFolder, proposal: Proposal | None, verdict: Verdict | None, axis: str
) -> tuple[TableMaterial, ...]:
    """What of an axis' own layer is beside its table: the reversal."""
    changes = proposal.changes if proposal is not None else ()
    mine = [one for one in changes if (one.axis, one.layer) == (axis, "axis") and one.new.kind != "axis"]
    proofs = verdict.proofs if verdict is not None else ()
    return tuple(
        TableMaterial(one, stored_record(folder, stages.push(one.name), PushRecord), proof_of(proofs, one))
        for one in mine
    )


def _proof(verdict: Verdict | None, axis: str) -> SignProof | None:
    proofs = verdict.proofs if verdict is not None else ()
    own = (proof for proof in proofs if (proof.kind, proof.output_axis) == ("axis", axis))
    return next(own, None)


def _of_table(change: TableChange) -> Message:
    return Message.of("S-TABLE-OF", table=change.name, size=change.skipped or size_of(change))


def _axis_verdict(verdict: Verdict | None, axis: str) -> AxisVerdict | None:
    axes = verdict.axes if verdict is not None else ()
    return next((item for item in axes if item.axis == axis), None)


def _days_of_files(axes: tuple[AxisMaterial, ...]) -> tuple[str, str]:
    """First and last moment that the files of a run without devices state; "" where they state none."""
    texts = [one.capture_before.started_utc for one in axes if one.capture_before is not None]
    dated = sorted(filter(None, map(moment_of, texts)))
    return (dated[0], dated[-1]) if dated else ("", "")


def _last_moment(axes: tuple[AxisMaterial, ...], tooth: ToothMaterial | None, otherwise: str) -> str:
    captures = [capture for axis in axes for capture in (axis.capture_before, axis.capture_after)]
    moments = [capture.ended_utc for capture in captures if capture is not None]
    for part in tooth.parts if tooth is not None else ():
        moments += [part.ground.ended_utc] if part.ground is not None else []
        moments += [part.flank.measured_utc] if part.flank is not None else []
    return max((moment for moment in moments if moment), default=otherwise)


# What a run folder holds of errors and tooth, for the report; whatever was not stored is left out.

R = TypeVar("R")
ALWAYS = (stages.ERRORS, stages.TOOTH, stages.TOOTH_VERDICT, stages.FROM_GEAR)
ORDER = ("before", "trial", "after")


def tooth_of(folder: RunFolder, site: SiteFile, site_path: Path) -> ToothMaterial | None:
    """Errors, proposal, parts, tables and verdict of a run, every hash checked; None where it has none of them."""
    parts = part_names(folder)
    if not parts and not any(folder.has(stage) for stage in ALWAYS):
        return None
    work = _work(site, site_path)
    errors = stored_record(folder, stages.ERRORS, ErrorModel)
    proposal = stored_record(folder, stages.TOOTH, ToothProposal)
    alone = errors is not None and proposal is None and not parts
    opened = _open_errors(errors, work, site) if errors is not None and alone else ()
    return ToothMaterial(
        errors=errors,
        proposal=proposal,
        verdict=stored_record(folder, stages.TOOTH_VERDICT, ToothVerdict),
        parts=tuple(_part(folder, name) for name in parts),
        tables=_tables(folder),
        from_gear=stored_record(folder, stages.FROM_GEAR, GearProposal),
        wheel=_wheel(folder),
        gear=work.gear if work is not None else None,
        gear_name=work.name if work is not None else "",
        letters={axis.name: axis.letter for axis in site.axes},
        open=opened,
        advice=_advice(folder, site, opened, asked=work is not None) if alone else (),
    )


def _wheel(folder: RunFolder) -> WheelMaterial | None:
    """The part that the corrections were ordered by, else the one that was separated last; None without any."""
    order = stored_record(folder, stages.ORDER, CorrectionOrder)
    parts = [one.removeprefix(stages.separated("")) for one in folder.stages if one.startswith(stages.separated(""))]
    if not parts:
        return None
    found = folder.get(stages.separated(order.part if order is not None else parts[-1]), Separation)
    return WheelMaterial(found, order, stored_record(folder, stages.WHEEL_VERDICT, WheelVerdict))


def part_names(folder: RunFolder) -> tuple[str, ...]:
    """Parts ground or inspected: before, trial, after as far as they are there, others in the order they came."""
    names: list[str] = []
    for stage in folder.stages:
        for kind in ("ground-", "inspected-"):
            if stage.startswith(kind) and not stage.endswith("-raw"):
                names.append(stage.removeprefix(kind))
    known = dict.fromkeys(names)
    others = [name for name in known if name not in ORDER]
    return (*(name for name in ORDER[:2] if name in known), *others, *(name for name in ORDER[2:] if name in known))


def stored_record(folder: RunFolder, stage: str, kind: type[R]) -> R | None:
    """A stage's record; None where it was never stored."""
    return folder.get(stage, kind) if folder.has(stage) else None


def _part(folder: RunFolder, name: str) -> PartMaterial:
    ground = stored_record(folder, stages.ground(name), GroundPart)
    return PartMaterial(name, ground, stored_record(folder, stages.inspected(name), InspectedFlank))


def _work(site: SiteFile, site_path: Path) -> ToothWork | None:
    """The site's gear; None where it names none or its file can no longer be read: the report does without."""
    try:
        return work_of(site, site_path)
    except (ConfigError, ModelError):
        return None


def _tables(folder: RunFolder) -> tuple[TableMaterial, ...]:
    proposal = stored_record(folder, stages.PROPOSAL, Proposal)
    verdict = stored_record(folder, stages.VERDICT, Verdict)
    proofs = verdict.proofs if verdict is not None else ()
    changes = proposal.changes if proposal is not None else ()
    return tuple(
        TableMaterial(one, stored_record(folder, stages.push(one.name), PushRecord), proof_of(proofs, one))
        for one in changes
    )


def proof_of(proofs: tuple[SignProof, ...], change: TableChange) -> SignProof | None:
    """The proof of the layer and axis a change belongs to."""
    same = (one for one in proofs if (one.kind, one.output_axis) == (change.new.kind, change.axis))
    return next(same, None)


def _open_errors(errors: ErrorModel, work: ToothWork | None, site: SiteFile) -> tuple[OpenDoubt, ...]:
    if work is None:
        return ()
    try:
        return what_next(errors, work.tooth, grids(site))
    except ModelError:
        return ()


def _advice(folder: RunFolder, site: SiteFile, opened: tuple[OpenDoubt, ...], *, asked: bool) -> tuple[Message, ...]:
    plan = plan_setups(site) if site.setups else ()
    remaining = [one.key for one in plan if one.measured and not folder.has(stages.setup(one.key))]
    return advise(plan, remaining, opened, asked=asked)
