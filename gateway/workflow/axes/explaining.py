"""Why an axis is after a push as it is, at the targets and between them, against what the table takes away; pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.message import Message, digits
from drivers.types.tables import LiveTable
from drivers.types.values import FloatArray
from drivers.units import DeviationUnit
from gateway.domain.captures import Capture
from gateway.domain.proposals import TableChange
from gateway.domain.values import COVERAGE
from gateway.evaluate.behaviour.fine_structure import means_between
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.evaluate.behaviour.table_effect import TableEffect, why
from gateway.table.comparison import acting_mean, effective
from gateway.table.proposal import may_harm

# Many places are judged at once, so the band is widened from k = 2 to k = 3.
WIDEN = 1.5


def explain(change: TableChange, before: FloatArray, after: FloatArray, U: float = np.inf) -> TableEffect:
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
class Checked:
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


def check_between(change: TableChange, after: Capture) -> Checked | None:
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
    return Checked(int(good.sum()), *sizes, after.unit)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))
