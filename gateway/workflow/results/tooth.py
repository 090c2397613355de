"""What a run folder holds of errors and tooth, for the report; whatever was not stored is left out."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.types.orders import SignProof
from gateway.config import SiteFile
from gateway.correct.outlook.flank_uncertainty import OpenDoubt, what_next
from gateway.domain.outcomes import PushRecord, Verdict
from gateway.domain.proposals import Proposal, TableChange
from gateway.errors import ModelError
from gateway.model.error_model import ErrorModel
from gateway.report import PartMaterial, TableMaterial, ToothMaterial
from gateway.store import RunFolder
from gateway.tooth import GearProposal, GroundPart, InspectedFlank, ToothProposal, ToothVerdict
from gateway.workflow import stages
from gateway.workflow.errors21.components import advise, grids
from gateway.workflow.errors21.setups import planned
from gateway.workflow.tooth.proposal import ToothWork, work_of

R = TypeVar("R")
ALWAYS = (stages.ERRORS, stages.TOOTH, stages.TOOTH_VERDICT, stages.FROM_GEAR)
ORDER = ("before", "trial", "after")


def tooth_of(folder: RunFolder, site: SiteFile, site_path: Path) -> ToothMaterial | None:
    """Errors, proposal, parts, tables and verdict of a run, every hash checked; None where it has none of them."""
    parts = part_names(folder)
    if not parts and not any(folder.has(stage) for stage in ALWAYS):
        return None
    work = _work(site, site_path)
    errors = found(folder, stages.ERRORS, ErrorModel)
    proposal = found(folder, stages.TOOTH, ToothProposal)
    alone = errors is not None and proposal is None and not parts
    opened = _opened(errors, work, site) if errors is not None and alone else ()
    return ToothMaterial(
        errors=errors,
        proposal=proposal,
        verdict=found(folder, stages.TOOTH_VERDICT, ToothVerdict),
        parts=tuple(_part(folder, name) for name in parts),
        tables=_tables(folder),
        from_gear=found(folder, stages.FROM_GEAR, GearProposal),
        gear=work.gear if work is not None else None,
        gear_name=work.name if work is not None else "",
        letters={axis.name: axis.letter for axis in site.axes},
        open=opened,
        advice=_advice(folder, site, opened, asked=work is not None) if alone else (),
    )


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


def found(folder: RunFolder, stage: str, kind: type[R]) -> R | None:
    """A stage's record; None where it was never stored."""
    return folder.get(stage, kind) if folder.has(stage) else None


def _part(folder: RunFolder, name: str) -> PartMaterial:
    ground = found(folder, stages.ground(name), GroundPart)
    return PartMaterial(name, ground, found(folder, stages.inspected(name), InspectedFlank))


def _work(site: SiteFile, site_path: Path) -> ToothWork | None:
    """The site's gear; None where it names none or its file can no longer be read: the report does without."""
    try:
        return work_of(site, site_path)
    except (ConfigError, ModelError):
        return None


def _tables(folder: RunFolder) -> tuple[TableMaterial, ...]:
    proposal = found(folder, stages.PROPOSAL, Proposal)
    verdict = found(folder, stages.VERDICT, Verdict)
    proofs = verdict.proofs if verdict is not None else ()
    changes = proposal.changes if proposal is not None else ()
    return tuple(
        TableMaterial(one, found(folder, stages.push(one.name), PushRecord), proof_of(proofs, one)) for one in changes
    )


def proof_of(proofs: tuple[SignProof, ...], change: TableChange) -> SignProof | None:
    """The proof of the layer and axis a change belongs to."""
    same = (one for one in proofs if (one.kind, one.output_axis) == (change.new.kind, change.axis))
    return next(same, None)


def _opened(errors: ErrorModel, work: ToothWork | None, site: SiteFile) -> tuple[OpenDoubt, ...]:
    if work is None:
        return ()
    try:
        return what_next(errors, work.tooth, grids(site))
    except ModelError:
        return ()


def _advice(folder: RunFolder, site: SiteFile, opened: tuple[OpenDoubt, ...], *, asked: bool) -> tuple[Message, ...]:
    plan = planned(site) if site.setups else ()
    remaining = [one.key for one in plan if one.measured and not folder.has(stages.setup(one.key))]
    return advise(plan, remaining, opened, asked=asked)
