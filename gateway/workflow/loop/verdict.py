"""What a closing run hands back: before and after of every axis, what was said, and the tooth's figure last."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any, TypeVar

from gateway.config import SiteFile
from gateway.domain.figures import Evaluation
from gateway.domain.outcomes import Verdict
from gateway.domain.proposals import Proposal
from gateway.store import RunFolder
from gateway.tooth import FlankAgreement, ToothProposal, ToothVerdict
from gateway.workflow import stages
from gateway.workflow.outcome import WORSE_EXIT, Outcome
from gateway.workflow.results.conformity import conforming
from gateway.workflow.results.ending import details_of, lines_of, outcome_of
from gateway.workflow.results.reporting import ReportPaths, material_of, write_report

R = TypeVar("R")


def closed(folder: RunFolder, site: SiteFile) -> Outcome:
    """Write the report and gather what the caller shows; exit code 9 when an axis or the tooth got worse."""
    material = material_of(folder)
    paths = write_report(folder, material)
    verdict = _get(folder, stages.VERDICT, Verdict)
    evaluations = {
        axis.name: (
            folder.get(stages.evaluation(axis.name, "before"), Evaluation),
            _get(folder, stages.evaluation(axis.name, "after"), Evaluation),
        )
        for axis in site.axes
        if folder.has(stages.evaluation(axis.name, "before"))
    }
    proposal = folder.get(stages.PROPOSAL, Proposal)
    plain = outcome_of(
        folder.state, str(folder.path), evaluations=evaluations, proposal=proposal, verdict=verdict, paths=paths
    )
    judged = _get(folder, stages.TOOTH_VERDICT, ToothVerdict)
    tooth = folder.get(stages.TOOTH, ToothProposal)
    *told, figure = lines_of(material)
    untried = proposal.warnings if verdict is None else ()
    needed = (line for line in tooth.said if line not in tooth.background)
    lines = (*needed, *told, *untried, figure)
    worse = plain.exit_code or (judged is not None and judged.outcome == "worse")
    data = plain.data | _tooth(judged) | _agreement(folder) | _details(paths, tooth)
    done = replace(plain, lines=lines, details=details_of(material), data=data, exit_code=WORSE_EXIT if worse else 0)
    return conforming(done, material.judged)


def _details(paths: ReportPaths, tooth: ToothProposal) -> dict[str, Any]:
    """What the report shows of the tooth but its raw records: errors, ranking, cures, tables, flanks, gear figures."""
    shown = json.loads(paths.json.read_text(encoding="utf-8"))["tooth"]
    ranking = [asdict(one) for one in tooth.ranking]
    return {"details": {key: value for key, value in shown.items() if key != "records"} | {"ranking": ranking}}


def _tooth(judged: ToothVerdict | None) -> dict[str, Any]:
    if judged is None:
        return {"tooth": None}
    told = {key: value for key, value in asdict(judged).items() if key != "words"}
    return {"tooth": told | {"taken_back": list(map(str, judged.taken_back))}}


def _agreement(folder: RunFolder) -> dict[str, Any]:
    """How the part before compares with the model; None without one."""
    found = _get(folder, stages.AGREEMENT, FlankAgreement)
    return {"agreement": None if found is None else {**asdict(found), "outcome": found.outcome, "ratio": found.ratio}}


def _get(folder: RunFolder, stage: str, kind: type[R]) -> R | None:
    return folder.get(stage, kind) if folder.has(stage) else None
