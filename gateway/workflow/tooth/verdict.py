"""The flank before against after, and against what was predicted of it; pure."""

from __future__ import annotations

import numpy as np

from drivers.message import Message, fixed
from gateway.domain.values import COVERAGE
from gateway.gear.cycloid import CycloidGear
from gateway.gear.process_drift import set_right, with_corrected_setup
from gateway.tooth import FlankPrediction, InspectedFlank, ToothVerdict
from gateway.workflow.tooth.change import LEAST_UM, FlankChange, FlankSize, Outcome, eccentric_share

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
        *_curved(fair, first),
        _changed(first, last, change),
        Message.of("W-TOOTH-ECCENTRIC", off=fixed(off), rest=fixed(rest)),
        *(_tried(tried, last) if tried is not None else ()),
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


def _curved(fair: float, first: FlankSize) -> tuple[Message, ...]:
    """Where the part before stood so far off its zero that the profile's curvature shows."""
    if fair - first.rms <= LEAST_UM:
        return ()
    return (Message.of("W-TOOTH-CURVED", fair=fixed(fair), anew=fixed(first.rms)),)


def _changed(first: FlankSize, last: FlankSize, change: FlankChange) -> Message:
    whole = {"change": fixed(change.whole, signed=True), "U": fixed(change.whole_U)}
    clear = {"first": fixed(first.clear), "last": fixed(last.clear), "clear_U": fixed(change.clear_U)}
    return Message.of("W-TOOTH-CHANGE", **whole, **clear)


def _tried(trial: FlankSize, last: FlankSize) -> tuple[Message, ...]:
    """Why the last part is not as good as the trial part before it; nothing where it is."""
    if last.rms <= trial.rms:
        return ()
    change = FlankChange.of(trial, last)
    code = "W-TOOTH-TRIAL-SAME" if change.outcome == "unchanged" else "W-TOOTH-TRIAL-WORSE"
    if change.outcome == "worse" and change.clear <= change.clear_U:
        code = "W-TOOTH-TRIAL-CLAMPED"
    sizes = {"trial": fixed(trial.rms), "after": fixed(last.rms), "U": fixed(change.whole_U)}
    return (Message.of(code, **sizes, first=fixed(trial.clear), last=fixed(last.clear)),)
