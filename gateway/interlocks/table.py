"""Rules on the table itself: the control neither limits nor monitors its values, so we do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gateway.interlocks.facts import MAX_JUMP, ROUNDING, PushFacts, Refusal, Rule, no, value_at

MAX_VALUE = {"mm": 200.0, "deg": 180.0}
MAX_SLOPE = {"mm": 1.0, "deg": 10.0}
MAX_CHANGE = {"mm": 120.0, "deg": 54.0}
MAX_AT_REFERENCE = 0.1


def _cross(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    if table.function != "EEC":
        yield from no("E-INT-CROSS", table=table.name, function=table.function)
    if table.output_axis != facts.change.axis:
        yield from no("E-INT-OTHER-AXIS", table=table.name, axis=facts.change.axis)


def _points(facts: PushFacts) -> Iterator[Refusal]:
    needed, reserved = len(facts.table.deviations), facts.limits.reserved_points
    if needed > reserved:
        axis, index = facts.table.output_axis, facts.table.index
        yield from no("E-INT-POINTS", axis=axis, index=index, needed=needed, reserved=reserved)


def _grid(facts: PushFacts) -> Iterator[Refusal]:
    table = facts.table
    grid = (table.minimum, table.maximum, table.step)
    intervals = len(table.deviations) - 1
    whole = bool(np.all(np.isfinite(grid))) and table.step > 0 and intervals >= 1
    if not whole or abs((table.maximum - table.minimum) / table.step - intervals) > 1e-6:
        minimum, maximum, step = grid
        count = len(table.deviations)
        yield from no("E-INT-GRID", table=table.name, minimum=minimum, maximum=maximum, step=step, count=count)


def _findings(facts: PushFacts) -> Iterator[Refusal]:
    """Warnings (W-...) are for the reader of the proposal; what else was found is a reason."""
    for finding in facts.change.findings:
        if not finding.startswith("W-"):
            yield from no("E-INT-FINDING", table=facts.table.name, finding=finding)


def _values(facts: PushFacts) -> Iterator[Refusal]:
    table, unit = facts.table, facts.table.deviation_unit
    values = np.asarray(table.deviations, dtype=np.float64)
    if values.size == 0 or not np.all(np.isfinite(values)):
        yield from no("E-INT-FINITE", table=table.name)
        return
    largest = float(np.max(np.abs(values)))
    if largest > MAX_VALUE[facts.unit] + ROUNDING:
        yield from no("E-INT-VALUE", table=table.name, value=largest, limit=MAX_VALUE[facts.unit], unit=unit)
    slope = float(np.max(np.abs(np.diff(values)), initial=0.0)) / table.step if table.step > 0 else 0.0
    if slope > MAX_SLOPE[facts.unit] + ROUNDING:
        limit, per = MAX_SLOPE[facts.unit], table.input_unit
        yield from no("E-INT-SLOPE", table=table.name, slope=round(slope, 4), limit=limit, unit=unit, per=per)
    if table.modulo and abs(values[0] - values[-1]) > MAX_AT_REFERENCE:
        yield from no("E-INT-MODULO", table=table.name, first=values[0], last=values[-1], unit=unit)


def _reference(facts: PushFacts) -> Iterator[Refusal]:
    value = value_at(facts.table, facts.reference)
    if not abs(value) <= MAX_AT_REFERENCE + ROUNDING:
        fields = {"reference": facts.reference, "value": value, "limit": MAX_AT_REFERENCE}
        yield from no("E-INT-REF-VALUE", table=facts.table.name, unit=facts.table.deviation_unit, **fields)


def _change(facts: PushFacts) -> Iterator[Refusal]:
    old = facts.change.old if facts.change.old_enabled else None
    places = np.asarray(facts.table.positions)
    before = np.array([value_at(old, place) for place in places]) if old is not None else np.zeros(places.shape)
    changes = np.abs(np.asarray(facts.table.deviations, dtype=np.float64) - before)
    largest = float(np.max(changes[np.isfinite(changes)], initial=0.0))
    if largest > MAX_CHANGE[facts.unit] + ROUNDING:
        fields = {"change": round(largest, 3), "limit": MAX_CHANGE[facts.unit]}
        yield from no("E-INT-CHANGE", table=facts.table.name, unit=facts.table.deviation_unit, **fields)


def _agreement(facts: PushFacts) -> Iterator[Refusal]:
    if facts.agreeing_position is None:
        yield from no("E-INT-NOWHERE", axis=facts.change.axis, limit=MAX_JUMP, unit=facts.table.deviation_unit)


TABLE: tuple[Rule, ...] = (
    _cross,
    _points,
    _grid,
    _findings,
    _values,
    _reference,
    _change,
    _agreement,
)
FITS: tuple[Rule, ...] = (_points,)
