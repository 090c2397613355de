"""How long stops take by the site's own figures: travel at the feed, overruns, dwell, settling, averaging; pure."""

from __future__ import annotations

from itertools import pairwise

from drivers.types.stops import Stop, StopPlan
from gateway.config import MeasureSection

HANDSHAKE_S = 1.0  # from a reading to the next move, and until the stream has caught up


def reading_s(measure: MeasureSection) -> float:
    """Seconds that an axis stands at a stop after the dwell, until its reading is taken."""
    return measure.settle_s + measure.average_s + HANDSHAKE_S


def way_of(plan: StopPlan) -> float:
    """How far the axis goes from the first stop to the last, mm or deg, with its overruns."""
    return sum(_leg(before, here, plan.overrun) for before, here in pairwise(plan.stops))


def plan_s(plan: StopPlan, standing_s: float) -> float:
    """Seconds from the first stop to the end; ``standing_s`` is what each takes beyond the program's dwell."""
    return len(plan.stops) * (plan.dwell_s + standing_s) + way_of(plan) / plan.feed * 60.0


def _leg(before: Stop, here: Stop, overrun: float) -> float:
    """Past the target and back where it is not approached in the direction in which the axis comes."""
    along = here.target - before.target
    if here.switch is not None and not along:
        return 0.0
    return abs(along) + (0.0 if along * here.approach > 0.0 else 2.0 * overrun)
