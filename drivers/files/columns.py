"""A table of readings by columns the user declares: what each column means is said once, and remembered outside.

For tables whose layout is not ours and not public: spreadsheets, capture programs' text exports. Nothing is
guessed: target, reading, units, sense and direction are each declared, and a line that does not fit is refused.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, Literal, cast

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.declared import declared
from drivers.files.numbers import beyond, decimal, missing, no_readings, untaken, whole
from drivers.files.tables.order import PASSES, pass_in
from drivers.files.text import end_doubts
from drivers.types.results import MeasuredSet
from drivers.types.values import FloatArray
from drivers.units import (
    MM_PER_INCH,
    AxisUnit,
    arcsec_to_deg,
    deg_to_arcsec,
    mm_to_um,
    rad_to_arcsec,
    rad_to_deg,
    um_to_mm,
)

MARKS = (";", "\t", ",")
_BREAK = re.compile(r"\r\n|\n|\r")
TARGET_UNITS: dict[str, tuple[AxisUnit, float]] = {
    "mm": ("mm", 1.0),
    "um": ("mm", um_to_mm(1.0)),
    "m": ("mm", 1e3),
    "nm": ("mm", um_to_mm(1e-3)),
    "inch": ("mm", MM_PER_INCH),
    "deg": ("deg", 1.0),
    "rad": ("deg", rad_to_deg(1.0)),
    "mrad": ("deg", rad_to_deg(1e-3)),
    "arcsec": ("deg", arcsec_to_deg(1.0)),
}
READING_UNITS: dict[str, tuple[AxisUnit, float]] = {
    "um": ("mm", 1.0),
    "mm": ("mm", mm_to_um(1.0)),
    "m": ("mm", mm_to_um(1000.0)),
    "nm": ("mm", 1e-3),
    "inch": ("mm", mm_to_um(MM_PER_INCH)),
    "uin": ("mm", mm_to_um(MM_PER_INCH * 1e-6)),
    "arcsec": ("deg", 1.0),
    "deg": ("deg", deg_to_arcsec(1.0)),
    "rad": ("deg", rad_to_arcsec(1.0)),
    "mrad": ("deg", rad_to_arcsec(1e-3)),
    "urad": ("deg", rad_to_arcsec(1e-6)),
}
UP, DOWN = {"+", "+1", "1", "up", "forward", "f", "pos"}, {"-", "-1", "down", "backward", "reverse", "r", "b", "neg"}
MOST_RUNS = 10_000

Directions = Literal["column", "runs", "order", "up", "down"]


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """What each column means. Columns count from 1; 0: there is none.

    ``deviation`` or ``measured`` (then deviation = sense * measured - target) holds the reading. ``direction``:
    "column" (``direction_column``), "runs" (odd ``run`` forward, even reverse), "order" (the way the targets
    go in the file) or one way only. ``passes``: every column from the reading on, to ``last`` (0: the end), is a pass;
    "alternate" forward and reverse in turn, "halves" all forward ones first, or one way only. ``sense`` -1 turns the
    readings' sign. ``skip`` lines stand before the rows.
    """

    target: int = 1
    deviation: int = 0
    measured: int = 0
    run: int = 0
    direction_column: int = 0
    direction: str = "order"
    passes: str = ""
    last: int = 0
    target_unit: str = "mm"
    reading_unit: str = "um"
    sense: int = 1
    skip: int = 1
    separator: str = ""
    decimal_comma: bool = False

    @classmethod
    def read(cls, said: Mapping[str, Any], where: str, *, mixed: bool = False) -> ColumnMap:
        """From a user's words; ``mixed`` lets angles stand over lengths and lengths over angles.

        Raises ConfigError (E-FILE-MAP) naming the key and what is allowed.
        """
        found = declared(cls, said, where)
        if found.apart and (found.measured or not mixed):
            why = "targets and readings must both be lengths or both angles"
            raise ConfigError("E-FILE-MAP", where, key="reading_unit", why=why)
        return found

    @property
    def apart(self) -> bool:
        """Whether targets and readings are of different kinds: pitch over mm, run-out over deg."""
        return TARGET_UNITS[self.target_unit][0] != READING_UNITS[self.reading_unit][0]

    @property
    def needed(self) -> int:
        """How many columns a line has at least."""
        return max(self.target, self.deviation, self.measured, self.run, self.direction_column)

    def limits(self) -> tuple[tuple[str, bool, str], ...]:
        """See `drivers.files.declared.Declared`."""
        ways = ("column", "runs", "order", "up", "down")
        return (
            ("target", self.target >= 1, "must be a column from 1"),
            ("deviation", (self.deviation >= 1) != (self.measured >= 1), "give either deviation or measured"),
            ("direction", self.direction in ways, f"must be one of {', '.join(ways)}"),
            ("direction_column", self.direction != "column" or self.direction_column >= 1, "must be a column from 1"),
            ("run", self.direction != "runs" or self.run >= 1, "must be a column from 1"),
            ("passes", self.passes in PASSES, f"must be one of {', '.join(PASSES[1:])}"),
            (
                "last",
                self.last == 0 or self.last >= max(self.deviation, self.measured),
                "must be the last pass's column",
            ),
            ("target_unit", self.target_unit in TARGET_UNITS, f"must be one of {', '.join(TARGET_UNITS)}"),
            ("reading_unit", self.reading_unit in READING_UNITS, f"must be one of {', '.join(READING_UNITS)}"),
            ("sense", self.sense in (1, -1), "must be 1 or -1"),
            ("skip", self.skip >= 0, "must be 0 or more"),
            ("separator", len(self.separator) <= 1, "must be one character, or empty: as the lines show, else blanks"),
        )


@dataclass(frozen=True, slots=True)
class _Row:
    line: int
    target: float
    reading: float
    run: int
    way: int | None


def read_columns(text: str, columns: ColumnMap, where: str) -> MeasuredSet:
    """A whole table, pure: repetitions by the run column, else by how often a target has come from its side.

    Raises FileFormatError (E-FILE-LINE with the line and reason, E-FILE-ROWS).
    """
    lines = list(enumerate(_BREAK.split(text), start=1))[columns.skip :]
    columns = _as_written(columns, [line for _, line in lines if line.strip()])
    kept = [(at, line) for at, line in lines if line.strip()]
    if columns.passes:
        rows = [row for at, line in kept for row in _of_passes(line, columns, at, where)]
    else:
        rows = [_row(line, columns, at, where) for at, line in kept]
    if not rows:
        raise FileFormatError("E-FILE-ROWS", where)
    ways = [row.way or 0 for row in rows] if columns.passes else _ways(rows, columns, where)
    targets, deviations = _arranged(rows, ways, columns, where)
    unit, scale = READING_UNITS[columns.reading_unit]
    header = {"Columns": ", ".join(f"{item.name}={getattr(columns, item.name)}" for item in fields(columns))}
    missing = int(np.isnan(deviations).sum())
    left = untaken([at for at, _line in kept], [row.line for row in rows])
    warnings = (*((f"readings missing: {missing}",) if missing else ()), *left, *end_doubts(text))
    return MeasuredSet(targets, deviations * scale, unit, header=header, warnings=warnings)


def _as_written(columns: ColumnMap, lines: list[str]) -> ColumnMap:
    """The map with the marks that nobody declared but every line shows: what separates cells, a decimal comma."""
    if not columns.separator and lines:
        found = next((mark for mark in MARKS if all(mark in line for line in lines)), "")
        few = any(len(line.split()) < columns.needed for line in lines)
        columns = replace(columns, separator=found) if found != "," or few else columns
    body = "".join(lines)
    comma = columns.separator != "," and "," in body and "." not in body
    return replace(columns, decimal_comma=columns.decimal_comma or comma)


def _wrong(where: str, line: int, why: str) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)


def _cells(line: str, separator: str) -> list[str]:
    if not separator:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=separator), [])]
    except csv.Error:
        return []


def _row(line: str, columns: ColumnMap, at: int, where: str) -> _Row:
    cells = _cells(line, columns.separator)
    if len(cells) < columns.needed:
        raise _wrong(where, at, f"{len(cells)} columns, but column {columns.needed} is needed")
    target = _number(cells[columns.target - 1], columns, at, where)
    reading = _number(cells[(columns.deviation or columns.measured) - 1], columns, at, where)
    run = whole(cells[columns.run - 1]) if columns.run else 0
    if run is None or run > MOST_RUNS:
        raise _wrong(where, at, f"{cells[columns.run - 1]!r} is no run number")
    way = _way(cells[columns.direction_column - 1], at, where) if columns.direction == "column" else None
    return _Row(at, target, reading, run, way)


def _of_passes(line: str, columns: ColumnMap, at: int, where: str) -> list[_Row]:
    """One reading of each pass; an empty cell is one that was not taken."""
    cells = _cells(line, columns.separator)
    first = (columns.deviation or columns.measured) - 1
    values = cells[first : columns.last or len(cells)]
    if len(cells) < columns.needed or not values:
        raise _wrong(where, at, f"{len(cells)} columns, but column {columns.needed} is needed")
    if columns.passes in ("alternate", "halves") and len(values) % 2:
        raise _wrong(where, at, f"{len(values)} passes, but as many forward as reverse are needed")
    target = _number(cells[columns.target - 1], columns, at, where)
    found = []
    for place, cell in enumerate(values):
        run, way = pass_in(place, len(values), columns.passes)
        if not missing(cell):
            found.append(_Row(at, target, _number(cell, columns, at, where), run, way))
    return found


def _number(cell: str, columns: ColumnMap, at: int, where: str) -> float:
    value = decimal(cell, comma=columns.decimal_comma)
    if value is None:
        raise _wrong(where, at, f"{cell!r} is no number")
    return value


def _way(cell: str, at: int, where: str) -> int:
    word = cell.lower()
    if word not in UP and word not in DOWN:
        raise _wrong(where, at, f"{cell!r} is no direction (+ - up down forward reverse)")
    return 0 if word in UP else 1


def _ways(rows: list[_Row], columns: ColumnMap, where: str) -> list[int]:
    """0 up or 1 down for each row."""
    match cast(Directions, columns.direction):
        case "column":
            return [row.way or 0 for row in rows]
        case "runs":
            return [(row.run + 1) % 2 for row in rows]
        case "up" | "down":
            return [int(columns.direction == "down")] * len(rows)
        case "order":
            return _by_order(rows, where)


def _by_order(rows: list[_Row], where: str) -> list[int]:
    """The way from the row before; at a turn, where a target comes twice, the second is from the new side."""
    steps = [after.target - before.target for before, after in pairwise(rows)]
    ways: list[int] = []
    for index, row in enumerate(rows):
        step = steps[index - 1] if index else 0.0
        if step == 0.0:
            step = next((later for later in steps[index:] if later), 0.0)
        if step == 0.0:
            raise _wrong(where, row.line, "all targets are the same: declare how directions are told")
        ways.append(0 if step > 0 else 1)
    return ways


def _arranged(rows: list[_Row], ways: list[int], columns: ColumnMap, where: str) -> tuple[FloatArray, FloatArray]:
    """Targets (m,) rising in the axis unit, deviations (m, n, 2) in the reading's own unit, NaN where missing."""
    _unit, scale = TARGET_UNITS[columns.target_unit]
    _kind, reading_scale = READING_UNITS[columns.reading_unit]
    to_reading = (1000.0 if _unit == "mm" else 3600.0) / reading_scale
    found: dict[tuple[float, int, int], float] = {}
    seen: dict[tuple[float, int], int] = {}
    numbers: dict[int, dict[int, int]] = {0: {}, 1: {}}
    for row, way in zip(rows, ways, strict=True):
        target = row.target * scale
        if columns.run or columns.passes:
            repetition = numbers[way].setdefault(row.run, len(numbers[way]))
        else:
            repetition = seen.get((target, way), 0)
            seen[target, way] = repetition + 1
        if (target, repetition, way) in found:
            raise _wrong(where, row.line, f"target {row.target:g} occurs twice in run {row.run} in this direction")
        reading = columns.sense * row.reading
        value = reading - target * to_reading if columns.measured else reading
        if beyond(target, value * reading_scale):
            raise _wrong(where, row.line, f"target {row.target:g} with reading {row.reading:g} is no measurement")
        found[target, repetition, way] = value
    targets = sorted({target for target, _repetition, _way in found})
    place = {target: at for at, target in enumerate(targets)}
    repetitions = 1 + max(repetition for _t, repetition, _w in found)
    deviations = no_readings(len(targets), repetitions, where)
    for (target, repetition, way), value in found.items():
        deviations[place[target], repetition, way] = value
    return np.array(targets, np.float64), deviations
