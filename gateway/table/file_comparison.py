"""Two table files against each other: points and parameters of every table, settings, what stands in one only."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np

from drivers.message import words
from drivers.tablefile import TableFile
from drivers.terms import spoken
from drivers.types.tables import CompensationTable
from drivers.units import deviation_scale, deviation_unit
from gateway.domain.values import FloatArray
from gateway.table.comparison import AXES, FORM, UNITS, TableDifference, acting_mean, differing_parts

ROUNDING = 1e-6  # um or arcsec: what interpolation between two grids leaves
AS_STORED = words("W-TABLE-MM-DEG")


@dataclass(frozen=True, slots=True)
class PairDifference:
    """One table of both files: ``parameters`` as (name, first, second), and the points that differ.

    ``points`` has the positions at which the values differ, with both; on the union of both grids if they differ.
    ``unit`` is that of the values, ``input_unit`` that of the positions.
    """

    label: str
    unit: str
    input_unit: str
    count: int
    parameters: tuple[tuple[str, object, object], ...]
    points: TableDifference

    @property
    def same(self) -> bool:
        """Nothing differs."""
        return not self.parameters and not self.points.positions.size


@dataclass(frozen=True, slots=True)
class SettingDifference:
    """One setting: its values (None: not set), and the change in um or arcsec where it is a length or an angle."""

    name: str
    first: Decimal | None
    second: Decimal | None
    change: float | None = None
    unit: str = ""


@dataclass(frozen=True, slots=True)
class FileDifference:
    """What differs between two files; ``only_first`` and ``only_second`` name tables without counterpart."""

    tables: tuple[PairDifference, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    settings: tuple[SettingDifference, ...]

    @property
    def same(self) -> bool:
        """Both files mean the same."""
        return not (self.tables or self.only_first or self.only_second or self.settings)

    @property
    def largest(self) -> tuple[str, float, float, str] | None:
        """(table, position, change, unit) of the largest change of a point, None if no point differs."""
        found = [(pair, *pair.points.largest) for pair in self.tables if pair.points.positions.size]
        if not found:
            return None
        pair, position, change = max(found, key=lambda item: abs(item[2]))
        return pair.label, position, change, pair.unit


def compare_files(first: TableFile, second: TableFile) -> FileDifference:
    """Tables are matched by encoder and axis (axis tables) or by table number (cross tables).

    Where machine data of one file name the axes, AX1 of the other is that axis. A table of axes of which
    nobody knows the unit is compared as it is stored (mm or deg).
    """
    names = _agreed_names(first.names, second.names)
    ours, theirs = _by_place(first, names), _by_place(second, names)
    raw = {names.get(axis, axis) for axis in first.unknown | second.unknown}
    pairs = [_pair(place, ours[place], theirs[place], raw) for place in ours if place in theirs]
    return FileDifference(
        tuple(pair for pair in pairs if not pair.same),
        tuple(place for place in ours if place not in theirs),
        tuple(place for place in theirs if place not in ours),
        tuple(_settings(first, second)),
    )


def _agreed_names(first: Mapping[str, str], second: Mapping[str, str]) -> dict[str, str]:
    """Names of numbered axes that one file gives and the other does not contradict."""
    both = {**first, **second}
    return {axis: name for axis, name in both.items() if first.get(axis, name) == second.get(axis, name)}


def _by_place(file: TableFile, names: Mapping[str, str]) -> Mapping[str, CompensationTable]:
    named = [
        replace(
            table,
            input_axis=names.get(table.input_axis, table.input_axis),
            output_axis=names.get(table.output_axis, table.output_axis),
        )
        for table in file.tables
    ]
    return {_place(table): table for table in named}


def _place(table: CompensationTable) -> str:
    if table.kind == "axis":
        return f"{spoken().own} {table.output_axis} encoder {table.index}"
    return f"{spoken().cross} table {table.index}"


def _pair(place: str, first: CompensationTable, second: CompensationTable, raw: Collection[str]) -> PairDifference:
    stored = bool({second.input_axis, second.output_axis} & set(raw))
    if stored:
        first, second = _as_stored(first), _as_stored(second)
    one, two, at = _values_of_both(first, second)
    differs = np.abs(two - one) > (0.0 if _same_grid(first, second) else ROUNDING)
    return PairDifference(
        label=f"{place} {second.name}",
        unit=AS_STORED if stored else second.deviation_unit,
        input_unit=AS_STORED if stored else second.input_unit,
        count=int(at.size),
        parameters=tuple(differing_parts(first, second, (*AXES, *FORM, *UNITS), within=0.0)),
        points=TableDifference(at[differs], one[differs], two[differs]),
    )


def _as_stored(table: CompensationTable) -> CompensationTable:
    """The values as the control has them, in its own unit."""
    return replace(table, deviations=tuple(value / deviation_scale(table.output_unit) for value in table.deviations))


def _values_of_both(first: CompensationTable, second: CompensationTable) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Values of both at the same positions; none where they belong to other axes and cannot be compared."""
    if first.name != second.name or (first.input_unit, first.output_unit) != (second.input_unit, second.output_unit):
        return np.empty(0), np.empty(0), np.empty(0)
    at = first.positions if _same_grid(first, second) else np.union1d(first.positions, second.positions)
    return _values(first, at), _values(second, at), at


def _same_grid(first: CompensationTable, second: CompensationTable) -> bool:
    grids = [(table.minimum, table.maximum, table.step, len(table.deviations)) for table in (first, second)]
    return grids[0] == grids[1]


def _values(table: CompensationTable, at: FloatArray) -> FloatArray:
    if at.size == len(table.deviations) and np.array_equal(at, table.positions):
        return np.asarray(table.deviations, dtype=np.float64)
    return acting_mean(table, at)


def _settings(first: TableFile, second: TableFile) -> Iterator[SettingDifference]:
    for name in dict.fromkeys((*first.settings, *second.settings)):
        one, two = first.settings.get(name), second.settings.get(name)
        if one == two:
            continue
        unit = second.lengths.get(name) or first.lengths.get(name)
        if unit is None or one is None or two is None:
            yield SettingDifference(name, one, two)
        else:
            change = float(two - one) * deviation_scale(unit)
            yield SettingDifference(name=name, first=one, second=two, change=change, unit=deviation_unit(unit))
