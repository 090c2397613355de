"""Why an axis is after a push as it is: before and after against what the pushed table takes away; pure."""

from __future__ import annotations

import numpy as np

from drivers.types import FloatArray, LiveTable
from gateway.domain import TableChange
from gateway.evaluate.hypotheses import Finding, why
from gateway.table.comparison import acting, effective


def explain(change: TableChange, before: FloatArray, after: FloatArray, U: float = np.inf) -> Finding:
    """The hypothesis that the means ``before`` and ``after`` (m,) at the change's targets support, if any.

    The table's effect comes from the tables themselves, so it carries no noise of the measurement. The uncertainty
    of after - before is ``U`` (k = 2), or the prediction's where that is smaller: the prediction's also holds what
    a fit may miss between the targets. Arrays of another length than the targets decide nothing.
    """
    unit = change.new.deviation_unit
    if not (len(before) == len(after) == len(change.targets)):
        nothing = np.zeros(0)
        return why(nothing, nothing, nothing, nothing, unit)
    old = effective(LiveTable(change.old, change.old_enabled))
    effect = acting(change.new, change.targets) - acting(old, change.targets)
    return why(before, after, effect, np.minimum(change.predicted_U, U), unit)
