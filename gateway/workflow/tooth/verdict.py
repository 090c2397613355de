"""Parts judged: the part before against the model of the errors, and the flank before against after and its prediction.

The part before any push tells whether the error model is right: a difference beyond its uncertainty is explained by an
error that is reversed, absent or of another size, or the tables are not written. After the push the complete
flank decides where its change exceeds what the clampings may make; else the flank without any eccentricity does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from drivers.message import Message, fixed
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty
from gateway.correct.outlook.part_agreement import compare_part
from gateway.correct.plan.plan import Plan
from gateway.domain.values import COVERAGE
from gateway.errors import CaptureError, WriteRefused
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right, with_corrected_setup
from gateway.model.error_model import ErrorModel
from gateway.store import RunFolder
from gateway.tooth import (
    Explanation,
    FlankAgreement,
    FlankMap,
    FlankPrediction,
    FloatArray,
    GroundPart,
    InspectedFlank,
    ToothVerdict,
)
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.errors21.setups import plan_setups
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext

_SAID: dict[Outcome, str] = {
    "better": "W-TOOTH-BETTER",
    "unchanged": "W-TOOTH-UNCHANGED",
    "worse": "W-TOOTH-WORSE",
}


def judge_tooth(
    before: InspectedFlank,
    after: InspectedFlank,
    prediction: FlankPrediction,
    gear: CycloidGear,
    trial: InspectedFlank | None = None,
) -> ToothVerdict:
    """Better or worse than before with its set-up values put right, beyond the uncertainty of the change (k = 2).

    Set-up values alone are no merit of the tables, so the flank before is judged as it would be ground anew with them
    right (`reground`). ``trial`` is the part between, which explains where the last part is no better than it.
    """
    fair = set_right(before.fitted, gear).rms_um
    anew = with_corrected_setup(before.fitted, gear, before.turned_arcsec)
    first, last = FlankSize.of(anew, before, gear), FlankSize.of(after.fitted, after, gear)
    change = FlankChange.of(first, last)
    missed = float(np.sqrt(np.mean((after.fitted.deviation_um - prediction.after.deviation_um) ** 2)))
    held = missed <= COVERAGE * float(np.hypot(prediction.u_um, after.rms_u_um))
    figures = {
        "before": fixed(before.fitted.rms_um),
        "fair": fixed(fair),
        "after": fixed(after.fitted.rms_um),
        "predicted": fixed(prediction.rms_um),
        "u": fixed(prediction.u_um),
    }
    off, rest = eccentric_share(after.fitted, gear)
    tried = FlankSize.of(trial.fitted, trial, gear) if trial is not None else None
    said = (
        Message.of(_SAID[change.outcome], **figures),
        Message.of("W-TOOTH-HELD" if held else "W-TOOTH-MISSED"),
        *_curvature_remark(fair, first),
        _change_words(first, last, change),
        Message.of("W-TOOTH-ECCENTRIC", off=fixed(off), rest=fixed(rest)),
        *(_trial_remark(tried, last) if tried is not None else ()),
    )
    return ToothVerdict(
        before_um=before.fitted.rms_um,
        before_set_right_um=fair,
        after_um=after.fitted.rms_um,
        predicted_um=prediction.rms_um,
        u_um=prediction.u_um,
        within_prediction=held,
        outcome=change.outcome,
        words=said,
        before_anew_um=first.rms,
        change_um=change.whole,
        change_U_um=change.whole_U,
        before_clear_um=first.clear,
        after_clear_um=last.clear,
        clear_U_um=change.clear_U,
        trial_um=tried.rms if tried is not None else None,
        trial_clear_um=tried.clear if tried is not None else None,
    )


def _curvature_remark(fair: float, first: FlankSize) -> tuple[Message, ...]:
    """Where the part before stood so far off its zero that the profile's curvature shows."""
    if fair - first.rms <= LEAST_UM:
        return ()
    return (Message.of("W-TOOTH-CURVED", fair=fixed(fair), anew=fixed(first.rms)),)


def _change_words(first: FlankSize, last: FlankSize, change: FlankChange) -> Message:
    whole = {"change": fixed(change.whole, signed=True), "U": fixed(change.whole_U)}
    clear = {"first": fixed(first.clear), "last": fixed(last.clear), "clear_U": fixed(change.clear_U)}
    return Message.of("W-TOOTH-CHANGE", **whole, **clear)


def _trial_remark(trial: FlankSize, last: FlankSize) -> tuple[Message, ...]:
    """Why the last part is not as good as the trial part before it; nothing where it is."""
    if last.rms <= trial.rms:
        return ()
    change = FlankChange.of(trial, last)
    code = "W-TOOTH-TRIAL-SAME" if change.outcome == "unchanged" else "W-TOOTH-TRIAL-WORSE"
    if change.outcome == "worse" and change.clear <= change.clear_U:
        code = "W-TOOTH-TRIAL-CLAMPED"
    sizes = {"trial": fixed(trial.rms), "after": fixed(last.rms), "U": fixed(change.whole_U)}
    return (Message.of(code, **sizes, first=fixed(trial.clear), last=fixed(last.clear)),)


# How much a flank changed from part to part, with and without what a clamping makes, each with its own U; pure.
#
# What an inspection may be off is nearly all its clamping: an eccentricity of any direction, another at each
# clamping. It reaches the RMS by its share of the flank's own shape, so it hides a change only where the flank itself
# is eccentric. What no eccentricity can make is known to the scatter of the points: of N points fitted by p values an
# RMS is uncertain by u / sqrt(N), and too large by u^2 p / (2 N RMS) (GUM 5.1, H.3).

LEAST_UM = 0.05  # a smaller change of the RMS is nobody's business, whatever the uncertainty
PLACE = 3  # values fitted at each place: A, B, G
Outcome = Literal["better", "unchanged", "worse"]


@dataclass(frozen=True, slots=True)
class FlankSize:
    """One flank's RMS and what of it no eccentricity can make, with standard uncertainties; um."""

    rms: float
    u: float
    clear: float
    clear_u: float

    @classmethod
    def of(cls, flank: FlankMap, inspected: InspectedFlank, gear: CycloidGear) -> FlankSize:
        """Of a flank made from an inspected part, set right or as it is."""
        _, clear = eccentric_share(flank, gear)
        return cls(flank.rms_um, _by_clamping(flank, inspected, gear), clear, _by_scatter(clear, inspected))


@dataclass(frozen=True, slots=True)
class FlankChange:
    """From one flank to the next, um: RMS, and RMS without what an eccentric clamping can make; U with k = 2."""

    whole: float
    whole_U: float
    clear: float
    clear_U: float

    @classmethod
    def of(cls, before: FlankSize, after: FlankSize) -> FlankChange:
        """Both figures' change; none is known better than nobody cares for."""
        return cls(
            after.rms - before.rms,
            max(LEAST_UM, COVERAGE * float(np.hypot(before.u, after.u))),
            after.clear - before.clear,
            max(LEAST_UM, COVERAGE * float(np.hypot(before.clear_u, after.clear_u))),
        )

    @property
    def outcome(self) -> Outcome:
        """The whole flank decides; where a clamping may have made its change, what no clamping can make does."""
        if abs(self.whole) > self.whole_U:
            return "worse" if self.whole > 0.0 else "better"
        if abs(self.clear) > self.clear_U:
            return "worse" if self.clear > 0.0 else "better"
        return "unchanged"


def clamping_maps(flank: FlankMap, gear: CycloidGear) -> FloatArray:
    """What one um of eccentricity along x and along y of the gear does to its flanks, (2, K, T, 1)."""
    section, phi = gear.section(flank.theta_rad), gear.space_angle(np.arange(gear.zc))[:, None, None]
    nx, ny = section.nx[None, :, None], section.ny[None, :, None]
    return np.stack([nx * np.cos(phi) - ny * np.sin(phi), nx * np.sin(phi) + ny * np.cos(phi)])


def beside(gear: CycloidGear, flank: FlankMap, other: FlankMap) -> FloatArray:
    """One flank less another (K, T, Z), um, without set-up values, rotation and eccentric clamping of either."""
    both = [set_right(one, gear).deviation_um for one in (flank, other)]
    left = both[0] - both[1]
    ways = np.stack([np.broadcast_to(one, left.shape).ravel() for one in clamping_maps(flank, gear)], axis=1)
    taken = ways @ np.linalg.lstsq(ways, left.ravel(), rcond=None)[0]
    return np.asarray(left - taken.reshape(left.shape))


def rms_beside(gear: CycloidGear, flank: FlankMap, other: FlankMap) -> float:
    """RMS of `beside`, um."""
    return float(np.sqrt(np.mean(beside(gear, flank, other) ** 2)))


def eccentric_share(flank: FlankMap, gear: CycloidGear) -> tuple[float, float]:
    """RMS of what an eccentricity of part or clamping takes of a flank by least squares, and of what it leaves, um."""
    ways = np.stack(
        [np.broadcast_to(one, flank.deviation_um.shape).ravel() for one in clamping_maps(flank, gear)],
        axis=1,
    )
    seen = flank.deviation_um.ravel()
    taken = ways @ np.linalg.lstsq(ways, seen, rcond=None)[0]
    return float(np.sqrt(np.mean(taken**2))), float(np.sqrt(np.mean((seen - taken) ** 2)))


def _by_clamping(flank: FlankMap, inspected: InspectedFlank, gear: CycloidGear) -> float:
    """Standard uncertainty of a flank's RMS: how far an eccentric clamping lies along that very flank, um."""
    ways = clamping_maps(flank, gear)
    size = inspected.rms_u_um / float(np.sqrt(np.mean(np.sum(ways**2, axis=0))))
    shape = flank.deviation_um / max(flank.rms_um, np.finfo(float).tiny)
    return size * float(np.hypot(*(np.mean(one * shape) for one in ways)))


def _by_scatter(clear: float, inspected: InspectedFlank) -> float:
    """Of the RMS without an eccentricity; a record without points is no better than its whole uncertainty."""
    points = inspected.k.size
    if not points:
        return inspected.rms_u_um
    fitted = inspected.u_um**2 * PLACE * inspected.place_k.size / points
    return float(np.hypot(inspected.u_um / points**0.5, min(fitted / (2.0 * max(clear, 1e-9)), fitted**0.5)))


# The part that a run ground before it proposes anything, asked whether the model of the errors is right.

BEFORE = "before"
_AGREEMENT_CODES = {"reversed": "S-PART-REVERSED", "absent": "S-PART-ABSENT", "factor": "S-PART-FACTOR"}
_NAMED = {"reversed": "S-PART-REVERSED-SHORT", "absent": "S-PART-ABSENT-SHORT", "factor": "S-PART-FACTOR-SHORT"}


def compare_part_with_model(
    at: RunContext,
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
    if not folder.has(stages.inspected(BEFORE)) or not _same_tables(at, measured):
        return {}
    part = folder.get(stages.inspected(BEFORE), InspectedFlank)
    found = compare_part(grinding, grid, plan, model=model, shop=shop, part=part)
    parents = folder.digest(stages.ERRORS), folder.digest(stages.inspected(BEFORE))
    folder.put(stages.AGREEMENT, found, parents)
    if found.outcome == "apart":
        raise _difference_facts(at, found)
    figures = _figures(found)
    if found.outcome == "agrees":
        at.say("P-PART-AGREES", **figures)
        return {}
    told = {**figures, "why": why_of(found), "again": _again(at, found)}
    at.say("P-PART-LOOK", **told)
    return told


def require_agreement(folder: RunFolder) -> None:
    """Refuse to write the tables of a run whose part contradicts its model. Raises WriteRefused (E-PART-WRITES)."""
    if folder.has(stages.AGREEMENT):
        found = folder.get(stages.AGREEMENT, FlankAgreement)
        if found.outcome == "apart":
            raise WriteRefused("E-PART-WRITES", folder.run_id, **_figures(found), run=folder.run_id, why=why_of(found))


def contradicts_model(folder: RunFolder) -> bool:
    """Whether the run's part, as inspected, contradicts the model and no error explains it: it is inspected again."""
    seen = stages.inspected(BEFORE)
    if not folder.has(stages.AGREEMENT) or folder.digest(seen) not in folder.parents(stages.AGREEMENT):
        return False
    found = folder.get(stages.AGREEMENT, FlankAgreement)
    return found.outcome == "apart" and not found.explanations


def _same_tables(at: RunContext, measured: Mapping[str, MeasuredAxis]) -> bool:
    """Whether the part was ground while the tables acted with which the errors were measured."""
    if not at.folder.has(stages.ground(BEFORE)):
        return False
    acted = at.folder.get(stages.ground(BEFORE), GroundPart).live
    seen = {name: one.capture.live.digest for name, one in measured.items() if one.capture.live is not None}
    other = [name for name, digest in seen.items() if acted.get(name, digest) != digest]
    if other:
        at.say("P-PART-OTHER-TABLES", part=BEFORE, axes=", ".join(other))
    return not other


def _difference_facts(at: RunContext, found: FlankAgreement) -> CaptureError:
    told = {**_figures(found), "why": why_of(found), "again": _again(at, found), "run": at.folder.run_id}
    return CaptureError("E-PART-APART", at.folder.run_id, **told)


def _again(at: RunContext, found: FlankAgreement) -> Message:
    """What to measure again: the set-ups of the errors that explain it, or the part."""
    setups = ", ".join(setups_of(at, found))
    return Message.of("S-PART-AGAIN", setups=setups) if setups else Message.of("S-PART-AGAIN-PART", part=found.part)


def setups_of(at: RunContext, found: FlankAgreement) -> tuple[str, ...]:
    """Keys of the set-ups that measured the errors by which a difference is explained."""
    names = {one.error for one in found.explanations}
    return tuple(one.key for one in plan_setups(at.site) if one.measured and one.setup.name in names)


def why_of(found: FlankAgreement) -> tuple[Message, ...]:
    """Which error explains a difference; that several do where they cannot be told apart, or none."""
    every = found.explanations
    if not every:
        return () if found.outcome == "agrees" else (Message.of("S-PART-UNEXPLAINED"),)
    first = _explanation(every[0])
    others = tuple(map(_error_name, every[1:]))
    return (first, Message.of("S-PART-OR", others=others)) if others else (first,)


def _explanation(one: Explanation) -> Message:
    figures = {"factor": fixed(one.factor + 1.0, signed=True), "u": fixed(one.u), "left": fixed(one.left_um)}
    return Message(_AGREEMENT_CODES[one.how], {"error": one.error, **figures})


def _error_name(one: Explanation) -> Message:
    return Message(_NAMED[one.how], {"error": one.error})


def _figures(found: FlankAgreement) -> dict[str, Any]:
    sizes = {"found": found.part_um, "model": found.model_um, "missed": found.missed_um, "u": found.u_um}
    return {"part": found.part, **{key: fixed(size) for key, size in sizes.items()}, "ratio": fixed(found.ratio, 1)}
