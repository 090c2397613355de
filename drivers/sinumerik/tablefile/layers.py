"""What tables and settings of one file do to each other: one deviation corrected twice, pairs, factors, sums.

EEC carries an axis' own deviation (the mean of both directions); CEC with input = output is for tooth terms and for
+/- pairs of reversal. The same amount in two of them, or in a pair and in the backlash, is corrected twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from itertools import combinations

import numpy as np

from drivers.errors import TableError
from drivers.sinumerik.tablefile import backlash
from drivers.sinumerik.tablefile.lint import finding
from drivers.tablefile import TableFinding
from drivers.types.tables import CompensationTable
from drivers.types.values import FloatArray
from drivers.units import deviation_scale

LIKENESS = 0.9  # correlation from which two curves are one deviation
SIZES = (0.4, 2.5)  # and the ratio of their sizes
SMALLEST = 0.05  # um or arcsec: below this there is nothing to be doubled


def of_set(tables: Sequence[CompensationTable], settings: Mapping[str, Decimal], where: str) -> Iterator[TableFinding]:
    """Findings between tables and settings."""
    cross = [table for table in tables if table.kind == "cross"]
    own = {table.output_axis: table for table in tables if table.kind == "axis"}
    pairs = list(_pairs(cross))
    both = [one for one in cross if one.input_axis == one.output_axis and one.direction == 0]
    for table in (*both, *(_mean(plus, minus) for plus, minus in pairs)):
        if table.output_axis in own:
            yield from _twice(own[table.output_axis], table, where)
    for plus, minus in pairs:
        yield from _reversal(plus, minus, settings, where)
    yield from _halves(cross, pairs, where)
    yield from _factors(cross, where)
    yield from _sums(cross, where)
    for table in cross:
        yield finding("doubtful", TableError("W-TABLE-CEC-SIGN", where, table=table.name, index=table.index))


def _pairs(cross: Sequence[CompensationTable]) -> Iterator[tuple[CompensationTable, CompensationTable]]:
    for plus in cross:
        for minus in cross:
            same = (plus.input_axis, plus.output_axis) == (minus.input_axis, minus.output_axis)
            if same and plus.input_axis == plus.output_axis and (plus.direction, minus.direction) == (1, -1):
                yield plus, minus


def _mean(plus: CompensationTable, minus: CompensationTable) -> CompensationTable:
    mean = (np.asarray(plus.deviations) + minus.at(plus.positions)) / 2.0
    return replace(plus, deviations=tuple(float(value) for value in mean), direction=0)


def _twice(own: CompensationTable, cross: CompensationTable, where: str) -> Iterator[TableFinding]:
    at = np.unique(np.concatenate([own.positions, cross.positions]))
    at = at[(at >= max(own.minimum, cross.minimum)) & (at <= min(own.maximum, cross.maximum))]
    if at.size < 2 or not any(cross.deviations) or not any(own.deviations):
        return
    if _alike(own.at(at), cross.at(at)):
        yield finding("wrong", TableError("E-TABLE-BOTH", where, table=cross.name, index=cross.index))
    elif float(np.ptp(cross.at(at))) > SMALLEST:
        yield finding("doubtful", TableError("W-TABLE-LAYERS", where, table=cross.name, index=cross.index))


def _alike(one: FloatArray, two: FloatArray) -> bool:
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
    taken_up = backlash.of_axis(settings, plus.output_axis)
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
            mean=f"{mean:.3g}",
            amount=f"{amount:.3g}",
            unit=plus.deviation_unit,
        )
        yield finding("wrong", error)


def _halves(
    cross: Sequence[CompensationTable], pairs: Sequence[tuple[CompensationTable, CompensationTable]], where: str
) -> Iterator[TableFinding]:
    paired = {id(one) for pair in pairs for one in pair}
    for table in cross:
        if table.direction and table.input_axis == table.output_axis and id(table) not in paired:
            way = f"{table.direction:+d}"
            yield finding("doubtful", TableError("W-TABLE-HALF", where, table=table.name, index=table.index, way=way))


def _factors(cross: Sequence[CompensationTable], where: str) -> Iterator[TableFinding]:
    """MULT_BY_TABLE counts tables from 1."""
    here = {table.index + 1 for table in cross}
    for table in cross:
        if table.multiply_by and table.multiply_by not in here:
            yield finding(
                "doubtful",
                TableError("W-TABLE-FACTOR", where, table=table.name, index=table.index, factor=table.multiply_by - 1),
            )


def _sums(cross: Sequence[CompensationTable], where: str) -> Iterator[TableFinding]:
    plain = [table for table in cross if not table.multiply_by and any(table.deviations)]
    for one, two in combinations(plain, 2):
        same = (one.input_axis, one.output_axis) == (two.input_axis, two.output_axis)
        if same and one.direction * two.direction != -1:
            tables = f"{one.index} and {two.index}"
            yield finding("doubtful", TableError("W-TABLE-SUM", where, table=one.name, tables=tables))
