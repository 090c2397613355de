"""Faults and doubts in compensation tables: in one table, in its unit, and between the tables of a file.

Values and slopes by `drivers.read_limits`; every table zero at the reference position of its input axis; modulo tables
0..360 deg with equal ends. EEC carries an axis' own deviation (the mean of both directions); CEC with input = output is
for tooth terms and for +/- pairs of reversal. The same amount in two of them, or in a pair and in the backlash, is
corrected twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from itertools import combinations
from typing import Any

import numpy as np

from drivers.errors import Gap, TableError, TooManyPoints, ValueOutOfRange
from drivers.limits import Limits, largest_value
from drivers.message import digits
from drivers.sinumerik.tablefile import axis_settings
from drivers.tablefile import Severity, TableFinding, TableMachine
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import ARCSEC_PER_DEG, MM_PER_INCH, UM_PER_MM, deviation_scale

# One table.

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


def make_finding(severity: Severity, error: TableError) -> TableFinding:
    """A finding of a table."""
    return TableFinding(severity, error)


def lint_table(table: CompensationTable, where: str, machine: TableMachine | None = None) -> list[TableFinding]:
    """All findings of one table, with what is known of the machine."""
    known = machine or TableMachine()
    values = np.asarray(table.deviations, dtype=np.float64)
    if not np.all(np.isfinite(values)):
        first = int(np.flatnonzero(~np.isfinite(values))[0])
        error = ValueOutOfRange("E-TABLE-FINITE", where, point=first, value=float(values[first]))
        return [make_finding("wrong", error)]
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
        yield make_finding("wrong", error)
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
        yield make_finding("note", TableError("W-TABLE-ENCODER", where, **fields))
    elif acting is not None and index not in acting:
        on = " and ".join(f"index {one}" for one in acting) or "none"
        yield make_finding(
            "doubtful", TableError("W-TABLE-OTHER-ENCODER", where, table=table.name, index=index, acting=on)
        )


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
            yield make_finding("note", TableError("W-TABLE-SIZE", where, **fields, points=points, memory=memory))
        return
    if table.index >= fixed[0]:
        error = TooManyPoints("E-TABLE-NUMBER-OF", where, **fields, index=table.index, count=fixed[0])
        yield make_finding("wrong", error)
    if points > fixed[1]:
        source = SOURCES[known.control]
        yield make_finding(
            "wrong", TooManyPoints("E-TABLE-CONTROL", where, **fields, points=points, limit=fixed[1], source=source)
        )


def _grid(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    fields: dict[str, Any] = {"table": table.name, "step": table.step, "low": table.minimum, "high": table.maximum}
    if table.step <= 0 or table.maximum <= table.minimum:
        yield make_finding("wrong", Gap("E-TABLE-GRID", where, **fields))
        return
    intervals = (table.maximum - table.minimum) / table.step
    last = int(intervals + 1e-9 * max(intervals, 1.0))
    if last < 1:
        yield make_finding("wrong", Gap("E-TABLE-STEP", where, **fields))
        return
    if abs(intervals - round(intervals)) > 1e-9 * max(intervals, 1.0):
        end = f"{table.minimum + last * table.step:g}"
        yield make_finding("doubtful", TableError("W-TABLE-STEP", where, **fields, last=last, end=end))
    if last + 1 != len(table.deviations):
        need = last + 1
        error = Gap("E-TABLE-COUNT", where, table=table.name, points=len(table.deviations), need=need)
        yield make_finding("wrong", error)
    yield from _closure(table, where)


def _closure(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    if not table.modulo:
        return
    if table.input_unit == "deg" and (table.minimum, table.maximum) != (0.0, 360.0):
        error = Gap("E-TABLE-MODULO", where, table=table.name, low=table.minimum, high=table.maximum)
        yield make_finding("wrong", error)
    first, last = table.deviations[0], table.deviations[-1]
    if first != last:
        error = Gap("E-TABLE-CLOSURE", where, table=table.name, first=_short(first), last=_short(last))
        yield make_finding("wrong", error)


def _values(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    limit = largest_value(table.output_unit)
    stored = np.abs(np.asarray(table.deviations)) / deviation_scale(table.output_unit)
    worst = int(np.argmax(stored))
    if stored[worst] > limit * (1 + 1e-9):
        value, unit = round(float(stored[worst]), 6), table.output_unit
        error = ValueOutOfRange(
            "E-TABLE-VALUE", where, table=table.name, point=worst, value=value, limit=limit, unit=unit
        )
        yield make_finding("wrong", error)


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
        yield make_finding("wrong", ValueOutOfRange("E-TABLE-SLOPE", where, **fields, limit=limits.slope))
    elif steep[worst] > limits.warn_slope * (1 + 1e-9):
        yield make_finding("doubtful", ValueOutOfRange("W-TABLE-STEEP", where, **fields, limit=limits.warn_slope))


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
        share=digits(100.0 * per_unit, 3),
    )
    yield make_finding("note", error)


def _reference(table: CompensationTable, where: str, known: TableMachine) -> Iterator[TableFinding]:
    reference = known.reference(table.input_axis)
    if reference is None:
        yield make_finding("note", TableError("W-TABLE-NO-REFERENCE", where, table=table.name, axis=table.input_axis))
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
        yield make_finding("wrong", error)


def _short(value: float) -> float:
    return round(value, 6)


# Is a table written in the unit it is read in? Inches, micrometres written as mm, arcsec written as deg.

SMALLEST_DOUBTED = {"mm": 1e-5, "deg": 1e-6}  # no interferometer sees less: 10 nm, 0.0036 arcsec
_WRITTEN = {"mm": ("um", UM_PER_MM), "deg": ("arcsec", ARCSEC_PER_DEG)}


def doubt_units(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    """Findings about units; all of them doubts, because a file does not say its unit."""
    yield from _doubt_values(table, where)
    if table.input_unit == "mm" and table.step > 0:
        yield from _doubt_grid(table, where)


def _doubt_values(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    stored = np.abs(np.asarray(table.deviations)) / deviation_scale(table.output_unit)
    largest = float(np.max(stored, initial=0.0))
    unit = table.output_unit
    small, factor = _WRITTEN[unit]
    most = largest_value(unit)
    if most < largest <= most * factor:
        error = TableError(
            "W-TABLE-LARGE-UNIT", where, table=table.name, value=digits(largest, 6), unit=unit, small=small
        )
        yield make_finding("doubtful", error)
    elif 0.0 < largest < SMALLEST_DOUBTED[unit]:
        yield make_finding(
            "doubtful", TableError("W-TABLE-TINY", where, table=table.name, value=digits(largest, 3), unit=unit)
        )


def _doubt_grid(table: CompensationTable, where: str) -> Iterator[TableFinding]:
    """A grid in whole inches read as mm, or a metric grid divided by 25.4."""
    grid = (table.step, table.minimum, table.maximum)
    fields: dict[str, Any] = {
        "table": table.name,
        "step": f"{table.step:g}",
        "low": table.minimum,
        "high": table.maximum,
    }
    if all(_is_whole(value / MM_PER_INCH, 1e-9) for value in grid):
        yield make_finding("doubtful", TableError("W-TABLE-INCH-GRID", where, **fields))
    elif not _is_whole(table.step * 100.0, 1e-9):  # three decimals, as 10 mm / 25.4 = 0.394 has them
        metric = table.step * MM_PER_INCH
        if metric > 0.5 and _is_whole(metric, min(0.01, 1e-3 * metric)):
            yield make_finding("doubtful", TableError("W-TABLE-INCH", where, **fields, metric=round(metric)))


def _is_whole(value: float, within: float) -> bool:
    return abs(value - round(value)) <= within


# What tables and settings of one file do to each other: one deviation corrected twice, pairs, factors, sums.
#
# EEC carries an axis' own deviation (the mean of both directions); CEC with input = output is for tooth terms and for
# +/- pairs of reversal. The same amount in two of them, or in a pair and in the backlash, is corrected twice.

LIKENESS = 0.9  # correlation from which two curves are one deviation
SIZES = (0.4, 2.5)  # and the ratio of their sizes
SMALLEST = 0.05  # um or arcsec: below this there is nothing to be doubled


def lint_set(
    tables: Sequence[CompensationTable], settings: Mapping[str, Decimal], where: str
) -> Iterator[TableFinding]:
    """Findings between tables and settings."""
    cross = [table for table in tables if table.kind == "cross"]
    own = {table.output_axis: table for table in tables if table.kind == "axis"}
    pairs = list(_pairs(cross))
    both = [one for one in cross if one.input_axis == one.output_axis and one.direction == 0]
    for table in (*both, *(_mean(plus, minus) for plus, minus in pairs)):
        if table.output_axis in own:
            yield from _corrected_twice(own[table.output_axis], table, where)
    for plus, minus in pairs:
        yield from _reversal(plus, minus, settings, where)
    yield from _halves(cross, pairs, where)
    yield from _factors(cross, where)
    yield from _sums(cross, where)
    for table in cross:
        yield make_finding("doubtful", TableError("W-TABLE-CEC-SIGN", where, table=table.name, index=table.index))


def _pairs(cross: Sequence[CompensationTable]) -> Iterator[tuple[CompensationTable, CompensationTable]]:
    for plus in cross:
        for minus in cross:
            same = (plus.input_axis, plus.output_axis) == (minus.input_axis, minus.output_axis)
            if same and plus.input_axis == plus.output_axis and (plus.direction, minus.direction) == (1, -1):
                yield plus, minus


def _mean(plus: CompensationTable, minus: CompensationTable) -> CompensationTable:
    mean = (np.asarray(plus.deviations) + minus.at(plus.positions)) / 2.0
    return replace(plus, deviations=tuple(float(value) for value in mean), direction=0)


def _corrected_twice(own: CompensationTable, cross: CompensationTable, where: str) -> Iterator[TableFinding]:
    at = np.unique(np.concatenate([own.positions, cross.positions]))
    at = at[(at >= max(own.minimum, cross.minimum)) & (at <= min(own.maximum, cross.maximum))]
    if at.size < 2 or not any(cross.deviations) or not any(own.deviations):
        return
    if _are_alike(own.at(at), cross.at(at)):
        yield make_finding("wrong", TableError("E-TABLE-BOTH", where, table=cross.name, index=cross.index))
    elif float(np.ptp(cross.at(at))) > SMALLEST:
        yield make_finding("doubtful", TableError("W-TABLE-LAYERS", where, table=cross.name, index=cross.index))


def _are_alike(one: FloatArray, two: FloatArray) -> bool:
    """The same shape and about the same size, whatever the sign (that of CEC is not known here)."""
    first, second = one - one.mean(), two - two.mean()
    sizes = float(np.linalg.norm(first)), float(np.linalg.norm(second))
    if min(sizes) < SMALLEST:
        return False
    likeness = abs(float(first @ second)) / (sizes[0] * sizes[1])
    return likeness >= LIKENESS and SIZES[0] <= sizes[1] / sizes[0] <= SIZES[1]


def _reversal(
    plus: CompensationTable, minus: CompensationTable, settings: Mapping[str, Decimal], where: str
) -> Iterator[TableFinding]:
    """The mean difference of a pair against MD32450 x MD32452 of the axis."""
    taken_up = axis_settings.backlash_of(settings, plus.output_axis)
    if taken_up is None or not taken_up.value:
        return
    amount = abs(float(taken_up.effective())) * deviation_scale(plus.output_unit)
    difference = np.asarray(plus.deviations) - minus.at(plus.positions)
    mean = abs(float(difference.mean()))
    if mean > SMALLEST and SIZES[0] <= mean / amount <= SIZES[1]:
        error = TableError(
            "E-TABLE-BACKLASH",
            where,
            table=plus.name,
            pair=f"{plus.index} and {minus.index}",
            mean=digits(mean, 3),
            amount=digits(amount, 3),
            unit=plus.deviation_unit,
        )
        yield make_finding("wrong", error)


def _halves(
    cross: Sequence[CompensationTable], pairs: Sequence[tuple[CompensationTable, CompensationTable]], where: str
) -> Iterator[TableFinding]:
    paired = {id(one) for pair in pairs for one in pair}
    for table in cross:
        if table.direction and table.input_axis == table.output_axis and id(table) not in paired:
            way = f"{table.direction:+d}"
            yield make_finding(
                "doubtful", TableError("W-TABLE-HALF", where, table=table.name, index=table.index, way=way)
            )


def _factors(cross: Sequence[CompensationTable], where: str) -> Iterator[TableFinding]:
    """MULT_BY_TABLE counts tables from 1."""
    here = {table.index + 1 for table in cross}
    for table in cross:
        if table.multiply_by and table.multiply_by not in here:
            yield make_finding(
                "doubtful",
                TableError("W-TABLE-FACTOR", where, table=table.name, index=table.index, factor=table.multiply_by - 1),
            )


def _sums(cross: Sequence[CompensationTable], where: str) -> Iterator[TableFinding]:
    plain = [table for table in cross if not table.multiply_by and any(table.deviations)]
    for one, two in combinations(plain, 2):
        same = (one.input_axis, one.output_axis) == (two.input_axis, two.output_axis)
        if same and one.direction * two.direction != -1:
            tables = f"{one.index} and {two.index}"
            yield make_finding("doubtful", TableError("W-TABLE-SUM", where, table=one.name, tables=tables))
