"""The sign of a table that only a restart switches: the same stops before and after it, a peak against a zero.

The step is the change of the distance between both places, so a datum that the restart took away is no matter. What
acted before and what acts after are both known; by their difference the step is judged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivers.types.stops import Stop, StopReached
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.interlocks import value_at
from gateway.push import conversation
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.work import Reading, Work

TIMES = 4
Readings = tuple[tuple[float, float], ...]
"""Peak less zero of each round, and its u; um or arcsec."""


def _zero(context: PushContext) -> float:
    return float(np.clip(context.moved.reference, *context.moved.room))


def _rise(context: PushContext, table: CompensationTable, peak: float) -> float:
    """Value of a table at the peak less that at the zero, each as it is come to."""
    at, zero = conversation.approach_to(context.moved, peak), _zero(context)
    return value_at(table, peak, at) - value_at(table, zero, conversation.approach_to(context.moved, zero))


def _acting_rise(context: PushContext, old: LiveTable, peak: float) -> float:
    return _rise(context, old.table, peak) if old.enabled else 0.0


def against(table: CompensationTable, live: LiveSet, context: PushContext, peak: float) -> CompensationTable:
    """The triangle, upside down where that is further from what acts now: the step is never smaller than its peak."""
    if _acting_rise(context, table_in(live, table), peak) <= 0.0:
        return table
    return replace(table, deviations=tuple(-value + 0.0 for value in table.deviations))


def change(work: Work, peak: float) -> float:
    """By how much the deviation at the peak, less that at the zero, changes from the old table to the triangle."""
    context = work.context
    return _rise(context, work.change.new, peak) - _acting_rise(context, work.restore_to, peak)


async def differences(work: Work, peak: float, reading: Reading, setup: str) -> Readings:
    """Measure at the zero and at the peak in turn. Raises what `conversation.visit` and the reading raise."""
    context, zero, found = work.context, _zero(work.context), []
    places = (zero, peak)
    stops = tuple(
        Stop(places[number % 2], conversation.approach_to(context.moved, places[number % 2]), number // 2, number)
        for number in range(2 * TIMES)
    )

    told = {"axis": context.axis.name, "count": TIMES, "zero": zero, "position": peak}
    plan = conversation.plan_along(conversation.along_of(context), "TFSIGN", stops, setup=setup)
    async with reading() as read_stop:

        async def read(stop: Stop, _reached: StopReached) -> None:
            found.append(await read_stop(stop))

        await conversation.visit(context, plan, read, ask=("P-PUSH-SIGN-STOPS", told))
    pairs = zip(found[0::2], found[1::2], strict=True)
    return tuple((high[0] - low[0], float(np.hypot(high[1], low[1]))) for low, high in pairs)


def step(before: Readings, after: Readings, moved: float, peak: float) -> tuple[float, float, tuple[float, ...]]:
    """What a table of ``peak`` would have done: its step, u of it (the larger of stated and scatter), each round.

    ``moved`` is the change of the tables between both runs, of at least the size of ``peak``.
    """
    was, now = np.asarray(before), np.asarray(after)
    scale = peak / moved
    each = (now[:, 0] - was[:, 0]) * scale
    stated = np.sqrt(np.sum(now[:, 1] ** 2 + was[:, 1] ** 2)) / each.size
    scatter = np.hypot(np.std(now[:, 0], ddof=1), np.std(was[:, 0], ddof=1)) / np.sqrt(each.size)
    u = float(max(stated, scatter)) * abs(scale)
    return float(np.mean(each)), u, tuple(float(value) for value in each)
