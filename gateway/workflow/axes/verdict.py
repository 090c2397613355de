"""The verdict on an axis: before against after in the words of ISO 230-2, against the prediction, and why it differs.

The change of M counts beyond its expanded uncertainty. Every target must lie within U of its predicted curve, and the
check stops between the targets too. If the prediction fails, the slope of the change over the table's shape
tells why: not active, wrong sign, doubled or in part, or something else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.message import Message, digits, fixed
from drivers.offline_exchange import OfflineExchange
from drivers.types.orders import SignProof
from drivers.types.stops import StopPlan
from drivers.types.tables import LiveTable
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit
from gateway.config import AxisSection, SiteFile
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.outcomes import AxisVerdict, PushRecord, Verdict
from gateway.domain.proposals import TableChange
from gateway.domain.values import COVERAGE
from gateway.evaluate.behaviour import repetitions
from gateway.evaluate.behaviour.fine_structure import means_between
from gateway.evaluate.behaviour.repeatability import SpreadChange, compare_spread
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.evaluate.behaviour.table_effect import Kind, TableEffect, why
from gateway.evaluate.standards.iso230_2 import scatter_alone
from gateway.table.comparison import acting_mean, effective
from gateway.table.proposal import may_harm
from gateway.workflow.axes.measure import MeasuredAxis, live_again, measure_axis, plans_of_axis
from gateway.workflow.run.context import RunContext

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
    checked: CheckStopVerdict | None = None,
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
        effect = explain_residual(change, mean_of_both(before), mean_of_both(after), _U_of_change(before, after))
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


def unmeasured_verdict(axis: str, before: Evaluation, change: TableChange, *, pushed: bool) -> AxisVerdict:
    """An axis that was not measured again: nothing was pushed, or there is no instrument to prove it with."""
    said = Message.of("W-VERDICT-UNPROVED") if pushed else change.skipped or Message.of("W-VERDICT-NOTHING")
    return AxisVerdict(axis, before.unit, before, before, improved=False, within_prediction=False, words=(said,))


def judge_run(axes: tuple[AxisVerdict, ...], pushes: tuple[PushRecord, ...], proofs: tuple[SignProof, ...]) -> Verdict:
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
    figures = {
        "figure": by,
        "before": fixed(was),
        "after": fixed(is_now),
        "U": fixed(_U_of_difference(before, after, by)),
    }
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
    doubt = _U_of_difference(before, after, name)
    change = was - is_now
    return 0 if abs(change) <= doubt else int(np.sign(change))


def _U_of_difference(before: Evaluation, after: Evaluation, name: Literal["M", "B"]) -> float:
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


# Why an axis is after a push as it is, at the targets and between them, against what the table takes away; pure.

# Many places are judged at once, so the band is widened from k = 2 to k = 3.
WIDEN = 1.5


def explain_residual(change: TableChange, before: FloatArray, after: FloatArray, U: float = np.inf) -> TableEffect:
    """The hypothesis that the means ``before`` and ``after`` (m,) at the change's targets support, if any.

    The table's effect comes from the tables themselves, so it carries no noise of the measurement. The uncertainty
    of after - before is ``U`` (k = 2), or the prediction's where that is smaller: the prediction's also holds what
    a fit may miss between the targets. Arrays of another length than the targets decide nothing.
    """
    unit = change.new.deviation_unit
    if not (len(before) == len(after) == len(change.targets)):
        nothing = np.zeros(0)
        return why(nothing, nothing, effect=nothing, U=nothing, unit=unit)
    return why(before, after, effect=_effect(change, change.targets), U=np.minimum(change.predicted_U, U), unit=unit)


def _effect(change: TableChange, at: FloatArray) -> FloatArray:
    """What the new table takes away beyond the old one."""
    old = effective(LiveTable(change.old, change.old_enabled))
    return np.asarray(acting_mean(change.new, at) - acting_mean(old, at))


@dataclass(frozen=True, slots=True)
class CheckStopVerdict:
    """What ``count`` places between the targets say of a push, RMS about the targets' mean, in ``unit``.

    ``before`` is ``after`` with what the table took away there put back, so both stand on the same readings; ``U`` is
    the expanded uncertainty (k = 2) of one place. ``seen`` is how far they lie off what was predicted, ``allowed`` what
    was stated, widened from k = 2 to k = 3; ``taken`` what the table takes away over all targets.
    """

    count: int
    before: float
    after: float
    U: float
    seen: float
    allowed: float
    taken: float
    unit: DeviationUnit

    @property
    def held(self) -> bool:
        """Whether the places lie where they were predicted."""
        return self.seen <= self.allowed

    @property
    def grown(self) -> bool:
        """Whether the places got worse themselves."""
        return not self.held and self.after > self.before + self.U

    @property
    def worse(self) -> bool:
        """Whether they did, or miss so much that the same table would not have been proposed (`reasons.may_harm`)."""
        return self.grown or (not self.held and may_harm(self.seen, self.taken))

    @property
    def words(self) -> tuple[Message, ...]:
        """The finding, sentence by sentence."""
        sizes = {"before": digits(self.before), "after": digits(self.after), "count": self.count, "unit": self.unit}
        if self.held:
            return (Message.of("W-VERDICT-BETWEEN-HELD", **sizes),)
        if self.grown:
            return (Message.of("W-VERDICT-BETWEEN-WORSE", **sizes),)
        off = {"seen": digits(self.seen), "allowed": digits(self.allowed)}
        told = Message.of("W-VERDICT-BETWEEN-MISSED", **sizes, **off)
        return (told, Message.of("W-VERDICT-BETWEEN-HARM", taken=digits(self.taken))) if self.worse else (told,)


def check_between(change: TableChange, after: Capture) -> CheckStopVerdict | None:
    """The check stops of a capture after the push against the prediction; None where there were none.

    Raises ModelError as `means_between`.
    """
    stops = after.between
    if stops is None or len(after.targets) != len(change.targets):
        return None
    means, u = means_between(after.targets, after.deviations, stops)
    good = np.isfinite(means) & np.isfinite(u)
    if not good.any():
        return None
    zero = float(np.nanmean(robust_means(after.targets, after.deviations).mean))
    left, effect = (means - zero)[good], _effect(change, change.targets)
    taken = _effect(change, stops.targets)[good] - np.mean(effect)
    wanted = np.interp(stops.targets[good], change.targets, change.predicted - np.nanmean(change.predicted))
    allowed = WIDEN * _rms(change.predicted_U)
    sizes = (
        _rms(left + taken),
        _rms(left),
        COVERAGE * _rms(u[good]),
        _rms(left - wanted),
        allowed,
        float(np.std(effect)),
    )
    return CheckStopVerdict(int(good.sum()), *sizes, after.unit)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


# Every pushed axis measured again, once, with everything of its own layer in, and judged.

Records = Mapping[str, PushRecord]
"""How each change ended, by its name."""
Holds = Callable[[AxisSection], bool]
"""Whether the optics of an axis stand already."""


def verification_plans(at: RunContext, own: Sequence[TableChange]) -> tuple[StopPlan, ...]:
    """What `judge_pushed_axes` will visit where each of these changes goes in."""
    return plans_of_verification(at.site, own, at.standing.holds) if _runs_visits(at) else ()


def plans_of_verification(
    site: SiteFile, own: Sequence[TableChange], holds: Holds = lambda _axis: False
) -> tuple[StopPlan, ...]:
    """As `verification_plans`, of a control that runs visits; ``holds`` says whose optics stand already. Pure."""
    axes = {axis.name: axis for axis in site.axes}
    mine = by_axis([one for one in own if not one.skipped])
    turn = sorted(mine, key=lambda name: not holds(axes[name]))
    return tuple(_plans_by_holds(holds, [_targets_again(axes[name], mine[name]) for name in turn]))


def _plans_by_holds(holds: Holds, again: Sequence[AxisSection | None]) -> list[StopPlan]:
    sections = [axis for axis in again if axis is not None]
    return [plan for axis in sections for plan in plans_of_axis(axis, "after", stands=holds(axis))]


def by_axis(own: Sequence[TableChange]) -> dict[str, list[TableChange]]:
    """The changes of each axis, in order."""
    return {name: [one for one in own if one.axis == name] for name in dict.fromkeys(one.axis for one in own)}


def mounted_axis_first(at: RunContext, mine: Mapping[str, list[TableChange]]) -> dict[str, list[TableChange]]:
    """The axis whose optics still stand from the sign proofs first."""
    return {name: mine[name] for name in sorted(mine, key=lambda name: not at.standing.holds(at.axis(name)))}


async def judge_pushed_axes(
    at: RunContext,
    own: Sequence[TableChange],
    before: Mapping[str, MeasuredAxis],
    records: Records,
    reads: Sequence[StopPlan] = (),
) -> tuple[AxisVerdict, ...]:
    """A verdict for each axis of the changes ``own``, in order. Raises as `measure_axis`.

    The program that measures waits at its end for the plans ``reads``, which save tables.
    """
    mine = mounted_axis_first(at, by_axis(own))
    again = {name: _measured_again_axis(at, changes, records) for name, changes in mine.items()}
    await at.foresee([*_plans_by_holds(at.standing.holds, list(again.values())), *reads])
    verdicts = {
        name: await _verdict_of_axis(at, changes, again[name], before[name], records) for name, changes in mine.items()
    }
    if not reads:
        await at.foresee(())
    return tuple(verdicts[name] for name in by_axis(own))


def _measured_again_axis(at: RunContext, changes: Sequence[TableChange], records: Records) -> AxisSection | None:
    """How an axis is measured after its tables were pushed; None where none was, or nothing can measure it."""
    pushed = any(records[one.name].outcome in PUSHED for one in changes)
    return _measured_again(at, changes) if pushed else None


def _measured_again(at: RunContext, changes: Sequence[TableChange]) -> AxisSection | None:
    return _targets_again(at.axis(changes[0].axis), changes) if _runs_visits(at) else None


def _runs_visits(at: RunContext) -> bool:
    """Whether the control runs programs that wait for readings."""
    controller = at.supervisor.controller
    return controller.capabilities.stops and not isinstance(controller, OfflineExchange)


def _targets_again(axis: AxisSection, changes: Sequence[TableChange]) -> AxisSection | None:
    return live_again(axis, _deciding_change(changes).targets)


def _predicted_reversal(changes: Sequence[TableChange]) -> TableChange | None:
    """What is predicted of B: it stands at the change of the constant, with what a pair of tables takes."""
    return next((one for one in changes if one.new.kind == "reversal"), None)


def _deciding_change(changes: Sequence[TableChange]) -> TableChange:
    return next((one for one in changes if one.new.kind == "axis"), changes[0])


async def _verdict_of_axis(
    at: RunContext, changes: Sequence[TableChange], again: AxisSection | None, before: MeasuredAxis, records: Records
) -> AxisVerdict:
    pushed = [one for one in changes if records[one.name].outcome in PUSHED]
    change = _deciding_change(changes)
    turned = _predicted_reversal(changes) if any(one.new.kind != "axis" for one in pushed) else None
    if again is None:
        return unmeasured_verdict(change.axis, before.evaluation, change, pushed=bool(pushed))
    after = await measure_axis(at, again, "after")
    return judge_measured(change, before, after, turned=turned)
