"""Rules on the table itself and its neighbours: the control neither limits nor monitors its values, so we do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drivers.terms import spoken
from drivers.types.tables import CompensationTable
from drivers.types.values import Approach
from drivers.units import deviation_scale
from gateway.domain.proposals import FindingWeight, TableChange
from gateway.interlocks.facts import (
    COARSEST_UM,
    ROUNDING,
    PushFacts,
    Refusal,
    Rule,
    other_cross_tables,
    other_tables_now,
    refuse,
    value_at,
)

TURN_DEG = 360.0


def _output(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    own_input = table.kind == "cross" or table.input_axis == table.output_axis
    if table.output_axis != facts.change.axis or not own_input:
        yield from refuse("E-INT-OTHER-AXIS", table=table.called, axis=facts.change.axis)


def _kind_supported(facts: PushFacts) -> Iterator[Refusal]:
    """A road that does not take the constant reversal must not be asked for it."""
    kind = facts.table.kind
    if kind == "reversal" and facts.can.table(kind) is None:
        yield from refuse("E-INT-KIND", kind=spoken().kind(kind), axis=facts.table.output_axis)


def _points(facts: PushFacts) -> Iterator[Refusal]:
    needed, reserved = len(facts.table.deviations), facts.limits.reserved_points
    if needed > reserved:
        axis, index = facts.table.output_axis, facts.table.index
        code = "E-INT-CROSS-POINTS" if facts.is_cross else "E-INT-POINTS"
        yield from refuse(code, axis=axis, index=index, needed=needed, reserved=reserved)


def _resolution(facts: PushFacts) -> Iterator[Refusal]:
    step = facts.limits.resolution * deviation_scale(facts.unit)
    if not 0.0 < step <= COARSEST_UM:
        yield from refuse("E-INT-RESOLUTION", axis=facts.change.axis, found=step, unit=facts.table.deviation_unit)


def _grid(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    if table.kind == "reversal":
        return
    grid = (table.minimum, table.maximum, table.step)
    intervals = len(table.deviations) - 1
    whole = bool(np.all(np.isfinite(grid))) and table.step > 0 and intervals >= 1
    if not whole or abs((table.maximum - table.minimum) / table.step - intervals) > 1e-6:
        minimum, maximum, step = grid
        count = len(table.deviations)
        yield from refuse("E-INT-GRID", table=table.called, minimum=minimum, maximum=maximum, step=step, count=count)


def _findings(facts: PushFacts) -> Iterator[Refusal]:
    """Warnings are for the reader of the proposal; what else was found is a reason."""
    for finding in facts.change.findings:
        if finding.weight is FindingWeight.REFUSES:
            yield from refuse("E-INT-FINDING", table=facts.table.called, finding=finding.message)


def _values(facts: PushFacts) -> Iterator[Refusal]:
    table, unit = facts.table, facts.table.deviation_unit
    values = np.asarray((*table.deviations, *table.reverse), dtype=np.float64)
    if not table.deviations or not np.all(np.isfinite(values)):
        yield from refuse("E-INT-FINITE", table=table.called)
        return
    largest, bounds = float(np.max(np.abs(values))), facts.bounds
    limit = bounds.reversal if table.kind == "reversal" else bounds.value
    if largest > limit + ROUNDING:
        yield from refuse("E-INT-VALUE", table=table.called, value=largest, limit=limit, unit=unit)
    slope = steepest(table)
    if slope > bounds.slope + ROUNDING:
        limit, per = bounds.slope, table.input_unit
        yield from refuse("E-INT-SLOPE", table=table.called, slope=round(slope, 4), limit=limit, unit=unit, per=per)
    for curve in (table.deviations, table.reverse):
        if table.modulo and curve and abs(curve[0] - curve[-1]) > bounds.reference:
            yield from refuse("E-INT-MODULO", table=table.called, first=curve[0], last=curve[-1], unit=unit)


def steepest(table: CompensationTable) -> float:
    """Largest slope between points, deviation unit per input axis unit; 0 where there is none."""
    if not table.step > 0 or len(table.deviations) < 2:
        return 0.0
    curves = [np.asarray(one, dtype=np.float64) for one in (table.deviations, table.reverse) if one]
    return max(float(np.max(np.abs(np.diff(one)))) for one in curves) / table.step


def _turn(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    wrong = abs(table.maximum - table.minimum - TURN_DEG) > ROUNDING or table.input_unit != "deg"
    if table.modulo and wrong:
        yield from refuse("E-INT-TURN", table=table.called, minimum=table.minimum, maximum=table.maximum)


def _reference(facts: PushFacts) -> Iterator[Refusal]:
    place = facts.request.input_axis.reference
    value = (value_at(facts.table, place, 1) + value_at(facts.table, place, -1)) / 2.0
    if not abs(value) <= facts.bounds.reference + ROUNDING:
        fields = {"reference": facts.request.input_axis.reference, "value": value, "limit": facts.bounds.reference}
        yield from refuse("E-INT-REF-VALUE", table=facts.table.called, unit=facts.table.deviation_unit, **fields)


def largest_change(change: TableChange) -> float:
    """Largest difference to what acts now, at the new table's points."""
    old = change.old if change.old_enabled else None
    if change.new.kind == "reversal":
        return abs(change.new.deviations[0] - (old.deviations[0] if old is not None else 0.0))
    return max(_largest_one_way(old, change.new, 1), _largest_one_way(old, change.new, -1))


def _largest_one_way(old: CompensationTable | None, new: CompensationTable, approach: Approach) -> float:
    places = np.asarray(new.positions)
    curve = new.reverse if approach < 0 and new.reverse else new.deviations
    before = np.array([value_at(old, place, approach) for place in places]) if old else np.zeros(places.shape)
    changes = np.abs(np.asarray(curve, dtype=np.float64) - before)
    return float(np.max(changes[np.isfinite(changes)], initial=0.0))


def _change(facts: PushFacts) -> Iterator[Refusal]:
    largest = largest_change(facts.change)
    if largest > facts.bounds.change + ROUNDING:
        fields = {"change": round(largest, 3), "limit": facts.bounds.change}
        yield from refuse("E-INT-CHANGE", table=facts.table.called, unit=facts.table.deviation_unit, **fields)


def _agreement(facts: PushFacts) -> Iterator[Refusal]:
    if facts.agreeing_position is None:
        limit, unit = facts.bounds.jump, facts.table.deviation_unit
        yield from refuse("E-INT-NOWHERE", axis=facts.table.input_axis, limit=limit, unit=unit)


TABLE: tuple[Rule, ...] = (
    _output,
    _kind_supported,
    _points,
    _resolution,
    _grid,
    _turn,
    _findings,
    _values,
    _reference,
    _change,
    _agreement,
)
FITS: tuple[Rule, ...] = (_points,)


# Cross tables share memory and an output axis with others, so these rules look at the neighbours too.

SAME_CORRELATION = 0.9
SAME_SIZES = (0.5, 2.0)


def _type(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    if facts.is_cross and table.table_type != 0:
        yield from refuse("E-INT-TYPE", table=table.called, index=table.index, found=table.table_type)
    if facts.is_cross and table.direction not in (-1, 0, 1):
        yield from refuse("E-INT-DIRECTION", table=table.called, found=table.direction)


def _self(facts: PushFacts) -> Iterator[Refusal]:
    """Input = output is for tooth terms of a rotary axis and for pairs of directions only."""
    table = facts.table
    own = facts.is_cross and table.input_axis == table.output_axis and table.direction == 0
    if own and table.output_unit == "mm":
        yield from refuse("E-INT-SELF", table=table.called, axis=table.output_axis)
    elif own and facts.live is not None and facts.live.own.enabled and _is_same_deviation(table, facts.live.own.table):
        yield from refuse("E-INT-BOTH-LAYERS", table=table.called, axis=table.output_axis)


def _is_same_deviation(one: CompensationTable, two: CompensationTable) -> bool:
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
    return SAME_SIZES[0] <= ratio <= SAME_SIZES[1] and float(here @ there) >= SAME_CORRELATION * sizes[0] * sizes[1]


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
            yield from refuse("E-INT-INDEX", table=table.called, index=table.index, found=found.name + way)


def _factor(facts: PushFacts) -> Iterator[Refusal]:
    if facts.live is None or not facts.is_cross or facts.table.multiply_by == 0:
        return
    wanted = facts.table.multiply_by - 1
    known = {one.table.index for one in (*facts.live.cross, *facts.live.others)} | {facts.table.index}
    if wanted not in known:
        yield from refuse("E-INT-FACTOR", table=facts.table.called, index=facts.table.index, factor=wanted)


def _sum(facts: PushFacts) -> Iterator[Refusal]:
    """Largest possible sum of all tables of the output axis, each at its own worst place."""
    if not facts.is_cross:
        return
    rest = (
        [one.table for one in other_cross_tables(facts.live, facts.table) if one.enabled]
        if facts.live is not None
        else []
    )
    values = [np.asarray(table.deviations, dtype=np.float64) for table in (facts.table, *rest)]
    total = sum(float(np.max(np.abs(each[np.isfinite(each)]), initial=0.0)) for each in values)
    limit = facts.bounds.value
    if facts.limits.max_sum is not None:
        limit = min(limit, facts.limits.max_sum * deviation_scale(facts.unit))
    if (total > limit + ROUNDING and len(values) > 1) or (total > limit + ROUNDING and limit < facts.bounds.value):
        fields = {"count": len(values), "total": round(total, 3), "limit": round(limit, 3)}
        yield from refuse("E-INT-SUM", axis=facts.change.axis, unit=facts.table.deviation_unit, **fields)


def _other_tables(facts: PushFacts) -> Iterator[Refusal]:
    step = other_tables_now(facts)
    if abs(step) > facts.bounds.jump + ROUNDING:
        live = facts.live
        names = [one.table for one in other_cross_tables(live, facts.table) if one.enabled] if live is not None else []
        inputs = ", ".join(sorted({table.input_axis for table in names}))
        fields = {"jump": round(step, 3), "limit": facts.bounds.jump, "unit": facts.table.deviation_unit}
        yield from refuse("E-INT-OTHERS", axis=facts.change.axis, inputs=inputs, **fields)


CROSS: tuple[Rule, ...] = (_type, _self, _index, _factor, _sum, _other_tables)
CROSS_RELEASE: tuple[Rule, ...] = (_other_tables,)
