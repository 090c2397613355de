"""What is wrong or doubtful in one compensation table before any machine sees it.

Values and slopes by `drivers.limits`; every table zero at the reference position of its input axis; modulo tables
0..360 deg with equal ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from drivers.errors import Gap, TableError, TooManyPoints, ValueOutOfRange
from drivers.limits import Limits, largest_value
from drivers.tablefile import Severity, TableFinding, TableMachine
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import deviation_scale

MEMORY = {
    "axis": "MD38000 $MA_MM_ENC_COMP_MAX_POINTS",
    "cross": "MD18342 $MN_MM_CEC_MAX_POINTS",
}
# Fixed sizes that a manual states: tables x points of CEC (828D: K3 03/2013, p. 264; 802D sl: FM 11/2012, p. 222).
CEC_SIZES = {"828D": (8, 200), "802D": (2, 350)}
# Points of one axis table, N = 0 to 199: SINUMERIK 808D function manual 01/2017, p. 106.
AXIS_SIZES = {"808D": 200}
SOURCES = {
    "828D": "K3 03/2013, p. 264",
    "802D": "802D sl FM 11/2012, p. 222",
    "808D": "808D FM 01/2017, p. 106",
}
CONTROLS = ("840D", "828D", "808D", "802D")


def finding(severity: Severity, error: TableError) -> TableFinding:
    """A finding of a table."""
    return TableFinding(severity, error)


def of_table(table: CompensationTable, where: str, machine: TableMachine | None = None) -> list[TableFinding]:
    """All findings of one table, with what is known of the machine."""
    known = machine or TableMachine()
    values = np.asarray(table.deviations, dtype=np.float64)
    if not np.all(np.isfinite(values)):
        first = int(np.flatnonzero(~np.isfinite(values))[0])
        error = ValueOutOfRange("E-TABLE-FINITE", where, point=first, value=float(values[first]))
        return [finding("wrong", error)]
    grid = list(_grid(table, where))
    found = [*_size(table, where, known), *grid, *_values(table, where)]
    if any(one.severity == "wrong" for one in grid):
        return found
    slope = [] if _unknown(table, known) else _slope(table, where)
    return [*found, *slope, *_velocity(table, where, known), *_reference(table, where, known)]


def _unknown(table: CompensationTable, known: TableMachine) -> bool:
    return bool(known.unknown & {table.input_axis, table.output_axis})


def _size(table: CompensationTable, where: str, known: TableMachine) -> Iterator[TableFinding]:
    points = len(table.deviations)
    memory, reserved = MEMORY[table.kind], _reserved(table, known)
    if reserved is not None and points > reserved:
        error = TooManyPoints(
            "E-TABLE-RESERVED", where, table=table.name, points=points, reserved=reserved, memory=memory
        )
        yield finding("wrong", error)
    yield from _encoder(table, where, known)
    yield from _control(table, where, known, reserved)


def _reserved(table: CompensationTable, known: TableMachine) -> int | None:
    """MD38000 or MD18342: as typed, else as machine data of the file say."""
    if table.kind == "axis":
        own = known.reserved.get((table.index, table.output_axis))
        return own if known.own_points is None else known.own_points
    return known.cross.get(table.index) if known.cross_points is None else known.cross_points


def _encoder(table: CompensationTable, where: str, known: TableMachine) -> Iterator[TableFinding]:
    """Measuring system 2 is as usual as 1: which of them acts, MD32700 says."""
    if table.kind != "axis":
        return
    acting, index = known.acting.get(table.output_axis), table.index
    if acting is None and index == 1:
        fields: dict[str, Any] = {"table": table.name, "index": index, "system": index + 1}
        yield finding("note", TableError("W-TABLE-ENCODER", where, **fields))
    elif acting is not None and index not in acting:
        on = " and ".join(f"index {one}" for one in acting) or "none"
        yield finding("doubtful", TableError("W-TABLE-OTHER-ENCODER", where, table=table.name, index=index, acting=on))


def _control(table: CompensationTable, where: str, known: TableMachine, reserved: int | None) -> Iterator[TableFinding]:
    if not known.control:
        return
    points = len(table.deviations)
    fields: dict[str, Any] = {"table": table.name, "control": known.control}
    fixed = CEC_SIZES.get(known.control) if table.kind == "cross" else None
    if table.kind == "axis" and known.control in AXIS_SIZES:
        fixed = (table.index + 1, AXIS_SIZES[known.control])
    if fixed is None:
        if reserved is None:
            memory = MEMORY[table.kind]
            yield finding("note", TableError("W-TABLE-SIZE", where, **fields, points=points, memory=memory))
        return
    if table.index >= fixed[0]:
        error = TooManyPoints("E-TABLE-NUMBER-OF", where, **fields, index=table.index, count=fixed[0])
        yield finding("wrong", error)
    if points > fixed[1]:
        source = SOURCES[known.control]
        yield finding(
            "wrong", TooManyPoints("E-TABLE-CONTROL", where, **fields, points=points, limit=fixed[1], source=source)
        )


def _grid(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    fields: dict[str, Any] = {"table": table.name, "step": table.step, "low": table.minimum, "high": table.maximum}
    if table.step <= 0 or table.maximum <= table.minimum:
        yield finding("wrong", Gap("E-TABLE-GRID", where, **fields))
        return
    intervals = (table.maximum - table.minimum) / table.step
    last = int(intervals + 1e-9 * max(intervals, 1.0))
    if last < 1:
        yield finding("wrong", Gap("E-TABLE-STEP", where, **fields))
        return
    if abs(intervals - round(intervals)) > 1e-9 * max(intervals, 1.0):
        end = f"{table.minimum + last * table.step:g}"
        yield finding("doubtful", TableError("W-TABLE-STEP", where, **fields, last=last, end=end))
    if last + 1 != len(table.deviations):
        need = last + 1
        error = Gap("E-TABLE-COUNT", where, table=table.name, points=len(table.deviations), need=need)
        yield finding("wrong", error)
    yield from _closure(table, where)


def _closure(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    if not table.modulo:
        return
    if table.input_unit == "deg" and (table.minimum, table.maximum) != (0.0, 360.0):
        error = Gap("E-TABLE-MODULO", where, table=table.name, low=table.minimum, high=table.maximum)
        yield finding("wrong", error)
    first, last = table.deviations[0], table.deviations[-1]
    if first != last:
        error = Gap("E-TABLE-CLOSURE", where, table=table.name, first=_short(first), last=_short(last))
        yield finding("wrong", error)


def _values(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    limit = largest_value(table.output_unit)
    stored = np.abs(np.asarray(table.deviations)) / deviation_scale(table.output_unit)
    worst = int(np.argmax(stored))
    if stored[worst] > limit * (1 + 1e-9):
        value, unit = round(float(stored[worst]), 6), table.output_unit
        error = ValueOutOfRange(
            "E-TABLE-VALUE", where, table=table.name, point=worst, value=value, limit=limit, unit=unit
        )
        yield finding("wrong", error)


def slopes(table: CompensationTable) -> FloatArray:
    """Deviation unit per input unit between neighbouring points, shape (k,)."""
    return np.diff(np.asarray(table.deviations, dtype=np.float64)) / table.step


def _slope(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    if table.input_unit != table.output_unit:
        return
    steep = np.abs(slopes(table))
    worst = int(np.argmax(steep))
    unit = f"{table.deviation_unit}/{table.input_unit}"
    fields: dict[str, Any] = {"table": table.name, "point": worst, "slope": round(float(steep[worst]), 4), "unit": unit}
    limits = Limits.of(table.output_unit)
    if steep[worst] > limits.slope * (1 + 1e-9):
        yield finding("wrong", ValueOutOfRange("E-TABLE-SLOPE", where, **fields, limit=limits.slope))
    elif steep[worst] > limits.warn_slope * (1 + 1e-9):
        yield finding("doubtful", ValueOutOfRange("W-TABLE-STEEP", where, **fields, limit=limits.warn_slope))


def _velocity(table: CompensationTable, where: str, known: TableMachine) -> Iterator[TableFinding]:
    """The compensation moves the output axis while the input axis travels: slope times velocity."""
    if known.velocity is None:
        return
    per_unit = float(np.max(np.abs(slopes(table)))) / deviation_scale(table.output_unit)
    error = TableError(
        "W-TABLE-VELOCITY",
        where,
        table=table.name,
        velocity=f"{known.velocity:g} {table.input_unit}/min",
        added=f"{per_unit * known.velocity:.4g} {table.output_unit}/min",
        share=f"{100.0 * per_unit:.3g}",
    )
    yield finding("note", error)


def _reference(table: CompensationTable, where: str, known: TableMachine) -> Iterator[TableFinding]:
    reference = known.reference(table.input_axis)
    if reference is None:
        yield finding("note", TableError("W-TABLE-NO-REFERENCE", where, table=table.name, axis=table.input_axis))
        return
    value = float(table.at(np.array([reference]))[0])
    if abs(value) > Limits.of(table.output_unit).reference:
        error = ValueOutOfRange(
            "E-TABLE-REFERENCE",
            where,
            table=table.name,
            reference=reference,
            value=round(value, 4),
            unit=table.deviation_unit,
        )
        yield finding("wrong", error)


def _short(value: float) -> float:
    return round(value, 6)
