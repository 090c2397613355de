"""What is wrong or doubtful in a compensation table before any machine sees it.

The control neither limits nor monitors values (SINUMERIK 808D FM 01/2017, p. 106), so these limits are ours:
|value| 0.200 mm / 0.050 deg; slope 1.0 um/mm (doubtful above 0.2) / 10 arcsec per deg; every table zero at
the reference position of its input axis; modulo tables 0..360 deg with equal ends.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from drivers.errors import Gap, TableError, TooManyPoints, ValueOutOfRange
from drivers.types import CompensationTable, TableLimits
from drivers.units import deviation_scale

MAX_VALUE = {"mm": 0.200, "deg": 0.050}
MAX_SLOPE = {"mm": 1.0, "deg": 10.0}
DOUBTFUL_SLOPE = {"mm": 0.2, "deg": 10.0}
ZERO_AT_REFERENCE = 0.1  # um or arcsec
MOST_POINTS = {"EEC": 5000, "CEC": 2000}


def of_table(
    table: CompensationTable,
    where: str,
    limits: TableLimits | None = None,
    reference: float | None = None,
) -> list[TableError]:
    """All findings of one table; ``limits`` of the machine and ``reference`` of the input axis if known."""
    values = np.asarray(table.deviations, dtype=np.float64)
    if not np.all(np.isfinite(values)):
        first = int(np.flatnonzero(~np.isfinite(values))[0])
        return [ValueOutOfRange("E-TABLE-FINITE", where, point=first, value=values[first])]
    return [
        *_size(table, where, limits),
        *_grid(table, where),
        *_values(table, where, limits),
        *_slope(table, where),
        *_closure(table, where),
        *_reference(table, where, reference),
    ]


def of_set(tables: Sequence[CompensationTable], where: str) -> list[TableError]:
    """Findings between tables: one deviation in both layers."""
    own = {table.output_axis for table in tables if table.function == "EEC" and any(table.deviations)}
    return [
        TableError("E-TABLE-BOTH", where, table=table.name)
        for table in tables
        if table.function == "CEC"
        and table.direction == 0
        and table.input_axis == table.output_axis
        and table.output_axis in own
    ]


def _size(table: CompensationTable, where: str, limits: TableLimits | None) -> Iterable[TableError]:
    reserved = limits.reserved_points if limits else MOST_POINTS[table.function]
    if len(table.deviations) > reserved:
        yield TooManyPoints("E-TABLE-POINTS", where, table=table.name, points=len(table.deviations), reserved=reserved)
    if table.function == "EEC" and table.index == 1:
        yield TableError("E-TABLE-ENCODER", where, table=table.name)


def _grid(table: CompensationTable, where: str) -> Iterable[TableError]:
    if table.step <= 0 or table.maximum <= table.minimum:
        yield Gap("E-TABLE-GRID", where, table=table.name, step=table.step, low=table.minimum, high=table.maximum)
        return
    intervals = (table.maximum - table.minimum) / table.step
    if abs(intervals - round(intervals)) > 1e-9 * max(intervals, 1.0):
        yield Gap("E-TABLE-STEP", where, table=table.name, step=table.step, low=table.minimum, high=table.maximum)
    elif round(intervals) + 1 != len(table.deviations):
        yield Gap("E-TABLE-COUNT", where, table=table.name, points=len(table.deviations), need=round(intervals) + 1)


def _values(table: CompensationTable, where: str, limits: TableLimits | None) -> Iterable[TableError]:
    limit = limits.max_value if limits else MAX_VALUE[table.output_unit]
    stored = np.abs(np.asarray(table.deviations)) / deviation_scale(table.output_unit)
    worst = int(np.argmax(stored))
    if stored[worst] > limit * (1 + 1e-9):
        yield ValueOutOfRange(
            "E-TABLE-VALUE",
            where,
            table=table.name,
            point=worst,
            value=round(float(stored[worst]), 6),
            limit=limit,
            unit=table.output_unit,
        )


def _slope(table: CompensationTable, where: str) -> Iterable[TableError]:
    if table.input_unit != table.output_unit or table.step <= 0:
        return
    steps = [abs(after - before) / table.step for before, after in pairwise(table.deviations)]
    if not steps:
        return
    worst = max(range(len(steps)), key=steps.__getitem__)
    for code, limit in (
        ("E-TABLE-SLOPE", MAX_SLOPE[table.input_unit]),
        ("E-TABLE-STEEP", DOUBTFUL_SLOPE[table.input_unit]),
    ):
        if steps[worst] > limit * (1 + 1e-9):
            yield ValueOutOfRange(
                code,
                where,
                table=table.name,
                point=worst,
                slope=round(steps[worst], 4),
                limit=limit,
                unit=f"{table.deviation_unit}/{table.input_unit}",
            )
            return


def _closure(table: CompensationTable, where: str) -> Iterable[TableError]:
    if not table.modulo:
        return
    if table.input_unit == "deg" and (table.minimum, table.maximum) != (0.0, 360.0):
        yield Gap("E-TABLE-MODULO", where, table=table.name, low=table.minimum, high=table.maximum)
    if table.deviations[0] != table.deviations[-1]:
        yield Gap("E-TABLE-CLOSURE", where, table=table.name, first=table.deviations[0], last=table.deviations[-1])


def _reference(table: CompensationTable, where: str, reference: float | None) -> Iterable[TableError]:
    if reference is None:
        return
    value = float(table.at(np.array([reference]))[0])
    if abs(value) > ZERO_AT_REFERENCE:
        yield ValueOutOfRange(
            "E-TABLE-REFERENCE",
            where,
            table=table.name,
            reference=reference,
            value=round(value, 4),
            unit=table.deviation_unit,
        )
