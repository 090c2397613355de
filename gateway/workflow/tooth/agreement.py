"""The part that a run ground before it proposes anything, asked whether the model of the errors is right."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.errors import words
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.correct.outlook.part_agreement import compare_part
from gateway.correct.plan.plan import Plan
from gateway.errors import CaptureError, WriteRefused
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder
from gateway.tooth import Explanation, FlankAgreement, GroundPart, InspectedFlank
from gateway.workflow import stages
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.bench import Bench
from gateway.workflow.errors21.setups import planned

BEFORE = "before"
_SAID = {"reversed": "S-PART-REVERSED", "absent": "S-PART-ABSENT", "factor": "S-PART-FACTOR"}
_NAMED = {"reversed": "S-PART-REVERSED-SHORT", "absent": "S-PART-ABSENT-SHORT", "factor": "S-PART-FACTOR-SHORT"}


def ask_part(
    at: Bench,
    measured: Mapping[str, MeasuredAxis],
    grinding: Grinding,
    grid: FlankGrid,
    *,
    plan: Plan,
    model: ErrorModel,
    shop: ProcessUncertainty,
) -> dict[str, str]:
    """Compare the run's part "before" with the model, store and tell what was found; nothing where there is no part.

    Hands back what a second look is due for, as the fields of W-PART-LOOK; empty where both agree. Raises CaptureError
    (E-PART-APART) where they are more than three standard uncertainties apart.
    """
    folder = at.folder
    if not folder.has(stages.inspected(BEFORE)) or not _alike(at, measured):
        return {}
    part = folder.get(stages.inspected(BEFORE), InspectedFlank)
    found = compare_part(grinding, grid, plan, model=model, shop=shop, part=part)
    parents = folder.digest(stages.ERRORS), folder.digest(stages.inspected(BEFORE))
    folder.put(stages.AGREEMENT, found, parents)
    if found.outcome == "apart":
        raise _apart(at, found)
    figures = _figures(found)
    if found.outcome == "agrees":
        at.say("P-PART-AGREES", **figures)
        return {}
    told = {**figures, "why": why_of(found), "again": _again(at, found)}
    at.say("P-PART-LOOK", **told)
    return told


def demand_agreement(folder: RunFolder) -> None:
    """Refuse to write the tables of a run whose part contradicts its model. Raises WriteRefused (E-PART-WRITES)."""
    if folder.has(stages.AGREEMENT):
        found = folder.get(stages.AGREEMENT, FlankAgreement)
        if found.outcome == "apart":
            raise WriteRefused("E-PART-WRITES", folder.run_id, **_figures(found), run=folder.run_id, why=why_of(found))


def unexplained(folder: RunFolder) -> bool:
    """Whether the run's part, as inspected, contradicts the model and no error explains it: it is inspected again."""
    seen = stages.inspected(BEFORE)
    if not folder.has(stages.AGREEMENT) or folder.digest(seen) not in folder.parents(stages.AGREEMENT):
        return False
    found = folder.get(stages.AGREEMENT, FlankAgreement)
    return found.outcome == "apart" and not found.explanations


def _alike(at: Bench, measured: Mapping[str, MeasuredAxis]) -> bool:
    """Whether the part was ground while the tables acted with which the errors were measured."""
    if not at.folder.has(stages.ground(BEFORE)):
        return False
    acted = at.folder.get(stages.ground(BEFORE), GroundPart).live
    seen = {name: one.capture.live.digest for name, one in measured.items() if one.capture.live is not None}
    other = [name for name, digest in seen.items() if acted.get(name, digest) != digest]
    if other:
        at.say("P-PART-OTHER-TABLES", part=BEFORE, axes=", ".join(other))
    return not other


def _apart(at: Bench, found: FlankAgreement) -> CaptureError:
    told = {**_figures(found), "why": why_of(found), "again": _again(at, found), "run": at.folder.run_id}
    return CaptureError("E-PART-APART", at.folder.run_id, **told)


def _again(at: Bench, found: FlankAgreement) -> str:
    """What to measure again, in words: the set-ups of the errors that explain it, or the part."""
    setups = ", ".join(setups_of(at, found))
    return words("S-PART-AGAIN", setups=setups) if setups else words("S-PART-AGAIN-PART", part=found.part)


def setups_of(at: Bench, found: FlankAgreement) -> tuple[str, ...]:
    """Keys of the set-ups that measured the errors by which a difference is explained."""
    names = {one.error for one in found.explanations}
    return tuple(one.key for one in planned(at.site) if one.measured and one.setup.name in names)


def why_of(found: FlankAgreement) -> str:
    """Which error explains a difference, in words; that several do where they cannot be told apart, or none."""
    every = found.explanations
    if not every:
        return "" if found.outcome == "agrees" else words("S-PART-UNEXPLAINED")
    first = _explained(every[0])
    others = ", ".join(_named(one) for one in every[1:])
    return first if not others else first + " " + words("S-PART-OR", others=others)


def _explained(one: Explanation) -> str:
    figures = {"factor": f"{one.factor + 1.0:+.2f}", "u": f"{one.u:.2f}", "left": f"{one.left_um:.2f}"}
    return words(_SAID[one.how], error=one.error, **figures)


def _named(one: Explanation) -> str:
    return words(_NAMED[one.how], error=one.error)


def _figures(found: FlankAgreement) -> dict[str, Any]:
    sizes = {"found": found.part_um, "model": found.model_um, "missed": found.missed_um, "u": found.u_um}
    return {"part": found.part, **{key: f"{size:.2f}" for key, size in sizes.items()}, "ratio": f"{found.ratio:.1f}"}
