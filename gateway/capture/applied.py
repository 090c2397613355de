"""Does the control apply the table that was read, as it was read? Asked where no public text says how it is taken."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from drivers.types.tables import CompensationTable, LiveSet
from gateway.errors import CaptureError
from gateway.table.comparison import acting_mean, effective

WHOLE = 1e-6
POSITION_SLACK = 0.01  # mm or deg: the exact stop window
SHOWN_SLACK = 0.02  # um or arcsec: the last places of the table and of what the control shows


def is_uneven(table: CompensationTable) -> bool:
    """Whether the step leaves a rest of the range: points end at k = floor((maximum - minimum) / step), as assumed."""
    if table.places or table.step <= 0.0 or table.maximum <= table.minimum:
        return False
    intervals = (table.maximum - table.minimum) / table.step
    return abs(intervals - round(intervals)) > WHOLE


def check_applied(live: LiveSet, shown: Iterable[tuple[float, float]]) -> None:
    """Compare what the control said it applied at stops, (position, um or arcsec), with an uneven table that acts.

    Raises CaptureError (E-CAP-APPLIED): then it takes the step in another way, and nothing may be built on that table.
    """
    table = effective(live.own)
    seen = np.asarray(sorted(shown), dtype=np.float64).reshape(-1, 2)
    if not is_uneven(table) or not live.own.enabled or not len(seen):
        return
    expected = acting_mean(table, seen[:, 0])
    steepest = float(np.max(np.abs(np.diff(table.deviations)), initial=0.0)) / table.step
    off = np.abs(seen[:, 1] - expected)
    worst = int(np.argmax(off))
    if off[worst] > SHOWN_SLACK + POSITION_SLACK * steepest:
        told: dict[str, Any] = {
            "position": round(float(seen[worst, 0]), 4),
            "expected": round(float(expected[worst]), 3),
        }
        told |= {"found": round(float(seen[worst, 1]), 3), "step": table.step}
        raise CaptureError("E-CAP-APPLIED", live.axis, table=table.name, unit=table.deviation_unit, **told)
