"""Rules on cross tables: their memory, their neighbours on the same output axis, and who owns what."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drivers.types.tables import CompensationTable
from drivers.units import deviation_scale
from gateway.interlocks.facts import ROUNDING, PushFacts, Refusal, Rule, no, others_now, rest_of, value_at

ALIKE = 0.9
ALIKE_SIZES = (0.5, 2.0)


def _type(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    if facts.is_cross and table.table_type != 0:
        yield from no("E-INT-TYPE", table=table.called, index=table.index, found=table.table_type)
    if facts.is_cross and table.direction not in (-1, 0, 1):
        yield from no("E-INT-DIRECTION", table=table.called, found=table.direction)


def _self(facts: PushFacts) -> Iterator[Refusal]:
    """Input = output is for tooth terms of a rotary axis and for pairs of directions only."""
    table = facts.table
    own = facts.is_cross and table.input_axis == table.output_axis and table.direction == 0
    if own and table.output_unit == "mm":
        yield from no("E-INT-SELF", table=table.called, axis=table.output_axis)
    elif own and facts.live is not None and facts.live.own.enabled and _alike(table, facts.live.own.table):
        yield from no("E-INT-BOTH-LAYERS", table=table.called, axis=table.output_axis)


def _alike(one: CompensationTable, two: CompensationTable) -> bool:
    """Whether two tables say the same deviation: nearly one shape, nearly one size."""
    if one.step <= 0 or two.step <= 0:
        return False
    here = np.asarray(one.deviations, dtype=np.float64)
    there = np.array([value_at(two, place) for place in one.positions])
    here, there = here - here.mean(), there - there.mean()
    sizes = float(np.sqrt(np.sum(here**2))), float(np.sqrt(np.sum(there**2)))
    if not min(sizes) > ROUNDING:
        return False
    ratio = sizes[0] / sizes[1]
    return ALIKE_SIZES[0] <= ratio <= ALIKE_SIZES[1] and float(here @ there) >= ALIKE * sizes[0] * sizes[1]


def _index(facts: PushFacts) -> Iterator[Refusal]:
    """A table that holds something for other axes, or another direction, belongs to somebody."""
    if facts.live is None or not facts.is_cross:
        return
    table = facts.table
    for one in (*facts.live.cross, *facts.live.others):
        found = one.table
        mine = (found.input_axis, found.output_axis, found.direction) == (
            table.input_axis,
            table.output_axis,
            table.direction,
        )
        if found.index == table.index and not mine and (one.enabled or any(found.deviations)):
            way = {1: " +", -1: " -"}.get(found.direction, "")
            yield from no("E-INT-INDEX", table=table.called, index=table.index, found=found.name + way)


def _factor(facts: PushFacts) -> Iterator[Refusal]:
    if facts.live is None or not facts.is_cross or facts.table.multiply_by == 0:
        return
    wanted = facts.table.multiply_by - 1
    known = {one.table.index for one in (*facts.live.cross, *facts.live.others)} | {facts.table.index}
    if wanted not in known:
        yield from no("E-INT-FACTOR", table=facts.table.called, index=facts.table.index, factor=wanted)


def _sum(facts: PushFacts) -> Iterator[Refusal]:
    """Largest possible sum of all tables of the output axis, each at its own worst place."""
    if not facts.is_cross:
        return
    rest = [one.table for one in rest_of(facts.live, facts.table) if one.enabled] if facts.live is not None else []
    values = [np.asarray(table.deviations, dtype=np.float64) for table in (facts.table, *rest)]
    total = sum(float(np.max(np.abs(each[np.isfinite(each)]), initial=0.0)) for each in values)
    limit = facts.bounds.value
    if facts.limits.max_sum is not None:
        limit = min(limit, facts.limits.max_sum * deviation_scale(facts.unit))
    if (total > limit + ROUNDING and len(values) > 1) or (total > limit + ROUNDING and limit < facts.bounds.value):
        fields = {"count": len(values), "total": round(total, 3), "limit": round(limit, 3)}
        yield from no("E-INT-SUM", axis=facts.change.axis, unit=facts.table.deviation_unit, **fields)


def _others(facts: PushFacts) -> Iterator[Refusal]:
    step = others_now(facts)
    if abs(step) > facts.bounds.jump + ROUNDING:
        live = facts.live
        names = [one.table for one in rest_of(live, facts.table) if one.enabled] if live is not None else []
        inputs = ", ".join(sorted({table.input_axis for table in names}))
        fields = {"jump": round(step, 3), "limit": facts.bounds.jump, "unit": facts.table.deviation_unit}
        yield from no("E-INT-OTHERS", axis=facts.change.axis, inputs=inputs, **fields)


CROSS: tuple[Rule, ...] = (_type, _self, _index, _factor, _sum, _others)
CROSS_RELEASE: tuple[Rule, ...] = (_others,)
