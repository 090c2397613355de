"""Before against after, axis by axis, in the words of ISO 230-2 and against what was predicted; pure."""

from __future__ import annotations

from typing import Literal

import numpy as np

from drivers.message import Message, digits, fixed
from drivers.types.orders import SignProof
from drivers.types.values import FloatArray
from gateway.domain.figures import Evaluation
from gateway.domain.outcomes import AxisVerdict, PushRecord, Verdict
from gateway.domain.proposals import TableChange
from gateway.evaluate.behaviour import repetitions
from gateway.evaluate.behaviour.repeatability import SpreadChange, compare_spread
from gateway.evaluate.behaviour.table_effect import Kind
from gateway.evaluate.standards.iso230_2 import scatter_alone
from gateway.workflow.axes.explaining import WIDEN, Checked, check_between, explain
from gateway.workflow.axes.measure import MeasuredAxis

PUSHED = ("committed", "already-applied")
_SIZES = {1: "W-VERDICT-BETTER", 0: "W-VERDICT-SAME", -1: "W-VERDICT-WORSE"}
_NO_REASON: dict[int, tuple[Kind, ...]] = {1: ("cannot-tell", "not-active", "wrong-sign"), 0: (), -1: ("cannot-tell",)}
"""What the shape of the change may suggest and is no reason for the verdict: M, B and the check stops decide it.

They compare ranges with their own U; the shape needs four times that to name a cause, so it stays silent more often.
"""


def judge_axis(
    axis: str,
    before: Evaluation,
    after: Evaluation,
    change: TableChange,
    *,
    checked: Checked | None = None,
    spread: SpreadChange | None = None,
    turned: TableChange | None = None,
) -> AxisVerdict:
    """A pushed axis measured again: is M smaller by more than its uncertainty, and did the prediction hold?

    ``checked`` is what places say that no table was fitted to: an axis that looks better at the targets is worse where
    these are worse, or miss the prediction by more than a table may leave unseen. ``spread`` explains a larger R.
    ``turned`` is the change of its reversal where that was pushed: then B is judged as M is, against its own
    prediction, and the axis is worse where either is.
    """
    tabled = change.new.kind == "axis" and not change.skipped
    held = (change.new.kind != "axis" or _prediction_holds(after, change)) and _reversal_holds(after, turned)
    size = _smaller(before, after, "M") if tabled else 0
    if checked is not None:
        held, size = held and checked.held, -1 if checked.worse else size
    B = _smaller(before, after, "B") if turned is not None else 0
    by: Literal["M", "B"] = "B" if turned is not None and (not tabled or B < 0 or (B > 0 and size <= 0)) else "M"
    size = -1 if min(size, B) < 0 else max(size, B)
    said = [*_verdict(size, by, before, after=after), Message.of("W-VERDICT-HELD" if held else "W-VERDICT-MISSED")]
    if tabled:
        effect = explain(change, mean_of_both(before), mean_of_both(after), _U_of_change(before, after))
        said += effect.words if effect.kind not in _NO_REASON[size] else ()
    said += checked.words if checked is not None else ()
    said += [_reversal(before, after, worse=B < 0)] if turned is not None else []
    said += _over_travel(after)
    said += spread.words if spread is not None else ()
    said += [Message.of("W-VERDICT-RESTORE", axis=axis)] if size < 0 else []
    return AxisVerdict(
        axis=axis,
        unit=before.unit,
        before=before,
        after=after,
        improved=size > 0,
        within_prediction=held,
        words=tuple(said),
        worse=size < 0,
    )


def judge_measured(
    change: TableChange, before: MeasuredAxis, after: MeasuredAxis, *, turned: TableChange | None = None
) -> AxisVerdict:
    """`judge_axis` of two measurements, with what their check stops and their scatter say."""
    old, new = before.evaluation, after.evaluation
    tabled = change.new.kind == "axis" and not change.skipped
    return judge_axis(
        change.axis,
        old,
        after=new,
        change=change,
        checked=check_between(change, after.capture) if tabled else None,
        spread=compare_spread(before.capture, after.capture, (old.R, new.R)),
        turned=turned,
    )


def unmeasured(axis: str, before: Evaluation, change: TableChange, *, pushed: bool) -> AxisVerdict:
    """An axis that was not measured again: nothing was pushed, or there is no instrument to prove it with."""
    said = Message.of("W-VERDICT-UNPROVED") if pushed else change.skipped or Message.of("W-VERDICT-NOTHING")
    return AxisVerdict(axis, before.unit, before, before, improved=False, within_prediction=False, words=(said,))


def judge(axes: tuple[AxisVerdict, ...], pushes: tuple[PushRecord, ...], proofs: tuple[SignProof, ...]) -> Verdict:
    """The run's answer: worse if any axis is, better if any is and none is worse."""
    if not any(push.outcome in PUSHED for push in pushes):
        return Verdict(axes, "not-pushed", proofs)
    if any(axis.worse for axis in axes):
        return Verdict(axes, "worse", proofs)
    return Verdict(axes, "better" if any(axis.improved for axis in axes) else "unchanged", proofs)


def mean_of_both(evaluation: Evaluation) -> FloatArray:
    """Mean of both approaches at each target, shape (m,), as `repetitions.mean_of_both`."""
    return repetitions.mean_of_both(evaluation.mean_up, evaluation.mean_down)


def _verdict(size: int, by: Literal["M", "B"], before: Evaluation, after: Evaluation) -> tuple[Message, Message]:
    """The verdict in one sentence, then the figure that it rests on."""
    was, is_now = getattr(before, by), getattr(after, by)
    figures = {"figure": by, "before": fixed(was), "after": fixed(is_now), "U": fixed(_doubt(before, after, by))}
    return Message.of(_SIZES[size]), Message.of("W-VERDICT-FIGURES", **figures, unit=before.unit)


def _over_travel(after: Evaluation) -> tuple[Message, ...]:
    """What is to be expected between the targets too, where something tells."""
    if after.M_travel is None:
        return ()
    sizes = {"M": digits(after.M_travel), "U": digits(after.U["M_travel"]), "unit": after.unit}
    return (Message.of("W-VERDICT-TRAVEL", **sizes),)


def _reversal(before: Evaluation, after: Evaluation, *, worse: bool) -> Message:
    """B, R and A before and after, and what of A scatter alone leaves."""
    figures = {
        f"{name}_{when}": fixed(value)
        for when, one in (("before", before), ("after", after))
        for name, value in (("B", one.B), ("R", one.R), ("A", one.A))
    }
    U, left = after.U.get("B", float("nan")), scatter_alone(after)
    code = "W-VERDICT-REVERSAL-WORSE" if worse else "W-VERDICT-REVERSAL"
    return Message.of(code, **figures, B_U=fixed(U), scatter=fixed(left), unit=after.unit)


def _smaller(before: Evaluation, after: Evaluation, name: Literal["M", "B"]) -> int:
    was, is_now = getattr(before, name), getattr(after, name)
    if was is None or is_now is None:
        return 0
    doubt = _doubt(before, after, name)
    change = was - is_now
    return 0 if abs(change) <= doubt else int(np.sign(change))


def _doubt(before: Evaluation, after: Evaluation, name: Literal["M", "B"]) -> float:
    """Expanded uncertainty of the difference of a figure."""
    return float(np.hypot(before.U.get(name, 0.0), after.U.get(name, 0.0)))


def _U_of_change(before: Evaluation, after: Evaluation) -> float:
    """Expanded uncertainty of a mean after less the same before: the instrument's own share is counted twice."""
    return float(np.hypot(before.U.get("M", np.inf), after.U.get("M", np.inf)))


def _reversal_holds(after: Evaluation, turned: TableChange | None) -> bool:
    """Whether B is at every target what was predicted of it; a place with one approach alone tells nothing."""
    if turned is None:
        return True
    if not _same_targets(after, turned):
        return False
    off = np.abs(after.B_i - turned.predicted) - WIDEN * turned.predicted_U
    return not bool(np.any(off[np.isfinite(off)] > 0.0))


def _same_targets(after: Evaluation, change: TableChange) -> bool:
    return len(change.targets) == len(after.targets) and np.allclose(change.targets, after.targets, atol=1e-6)


def _prediction_holds(after: Evaluation, change: TableChange) -> bool:
    if not _same_targets(after, change):
        return False
    difference = mean_of_both(after) - change.predicted
    difference -= float(np.nanmedian(difference))
    return bool(np.all(np.abs(difference) <= WIDEN * change.predicted_U))
