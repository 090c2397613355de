"""Tables of readings: one row for each target, direction and repetition, with a header that names the columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isnan, nan
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.columns import TARGET_UNITS, ColumnMap, read_columns
from drivers.files.csvtext import table_text
from drivers.files.numbers import beyond, decimal, missing, no_readings, untaken, whole
from drivers.files.signature import signature_of
from drivers.files.tables.heading import table_heading
from drivers.files.tables.headwords import DIRECTIONS
from drivers.files.tables.indexed import indexed, is_indexed
from drivers.files.tables.layout import COLUMNS, NONE, UNITS, Layout, layout, understood
from drivers.files.tables.order import by_order, counted
from drivers.files.tables.sheet import Row, Sheet, heading_of, sheet_of, words_above
from drivers.files.text import end_doubts, other_texts, plain_minus, read_bytes
from drivers.local.letters import decode
from drivers.types.results import MeasuredSet, TableHeading
from drivers.types.values import FloatArray
from drivers.units import deviation_scale, deviation_unit, typed_unit

MOST_REPETITIONS = 10_000
Key = tuple[float, int, int]
# Beyond these a column is doubted: its unit, or whether it holds what its name says.
MOST_SHARE = 0.02  # of the targets' range: an axis that goes so wrong is none, columns changed about are
LARGEST = {"mm": 5000.0, "deg": 1000.0}
OPEN = {"reading_unit", "passes", "direction"}
ROWS = ("runs", "up", "down")
AGREE_UM, NEARLY = 1.0, 0.01
"""Positions and deviations of one row may differ by so much, um or arcsec, and by a hundredth: rounding."""


class CsvFormat:
    """File driver "csv": header target, direction, repetition, deviation (or position) in any order.

    Deviations are um over mm unless `unit`, or the column's own name (deviation_arcsec), says otherwise; positions are
    in the targets' unit. ``mixed`` lets angles stand over mm (pitch) and um over deg (run-out). A table in another
    layout is read by declared `columns`; where only `OPEN` keys are declared, its heading says the rest.
    """

    def __init__(
        self,
        unit: str = "",
        codepage: str = "cp1252",
        columns: Mapping[str, Any] | None = None,
        *,
        mixed: bool = False,
    ) -> None:
        beside = {key: str(value) for key, value in (columns or {}).items()} if set(columns or ()) <= OPEN else {}
        unit = typed_unit(beside.get("reading_unit", unit))
        if unit and unit not in UNITS:
            raise ConfigError("E-FILE-UNIT", "csv", unit=unit, known=", ".join(UNITS))
        self._unit = unit
        self._ways = beside.get("passes", "") or beside.get("direction", "")
        self._codepage = codepage
        self._mixed = mixed
        declared = columns is not None and not beside
        self._columns = ColumnMap.read(columns or {}, "csv", mixed=mixed) if declared else None
        if beside:
            ColumnMap.read({"deviation": 2, "run": 3, **(columns or {})}, "csv", mixed=True)  # judges the words

    def read(self, path: Path) -> MeasuredSet:
        """Read a file, by the declared columns if there are any. Raises FileFormatError with line and reason."""
        where = str(path)
        data = read_bytes(path)
        text = plain_minus(decode(data, self._codepage, where))
        if self._columns is not None:
            measured = read_columns(text, self._columns, where)
            return replace(measured, header={**words_above(text, self._columns.skip), **measured.header})
        try:
            return parse_csv(text, self._unit, where, mixed=self._mixed, ways=self._ways)
        except FileFormatError as error:
            if error.code != "E-FILE-CSV-HEADER":
                raise
            # A heading that nobody understands may be in another country's code page.
            other = next((one for one in map(plain_minus, other_texts(data)) if sheet_of(one, understood, where)), None)
            if other is None:
                raise
        return parse_csv(other, self._unit, where, mixed=self._mixed, ways=self._ways)

    def signature(self, path: Path) -> str:
        """What tables of the same layout have in common, "" for one without a heading. Raises FileFormatError."""
        return signature_of(decode(read_bytes(path), self._codepage, str(path)))

    def heading(self, path: Path) -> TableHeading | None:
        """Every column of the first table by its heading, None where no heading names targets."""
        return table_heading(plain_minus(decode(read_bytes(path), self._codepage, str(path))))

    def text(self, measured: MeasuredSet) -> str:
        """A measured set as a table that `read` understands and a spreadsheet does not take for formulas."""
        return table_text(measured)


def parse_csv(text: str, unit: str, where: str, *, mixed: bool = False, ways: str = "") -> MeasuredSet:
    """A whole table, pure. Every (target, direction, repetition) may occur once; missing ones are NaN.

    ``mixed``: pitch over mm or run-out over deg; the record's unit is then that of the deviations. ``ways`` of `PASSES`
    or `ROWS` says what no column does.
    """
    if is_indexed(text):
        return _by_indices(text, where)
    sheet = sheet_of(text, understood, where)
    if sheet is None:
        found = heading_of(text)[1][:80] or "nothing"
        raise FileFormatError("E-FILE-CSV-HEADER", where, found=found, columns=", ".join(COLUMNS))
    found_layout = layout(sheet, unit, where, mixed=mixed, ways=ways)
    rows, notes = _rows(sheet, found_layout, ways, where)
    left = untaken([at for at, _row in sheet.rows], [at for at, _key, _value in rows])
    return _set_of(rows, found_layout, where, text, said=sheet.said, notes=(*notes, *left, *sheet.notes))


def _by_indices(text: str, where: str) -> MeasuredSet:
    unit, rows = indexed(text, where)
    found = Layout(columns=(0, 0, 0, 0), reading="position", target_unit=unit, unit=unit, comma=False)
    return _set_of(rows, found, where, text)


def _set_of(
    rows: list[tuple[int, Key, float]],
    found: Layout,
    where: str,
    text: str,
    *,
    said: Mapping[str, str] | None = None,
    notes: tuple[str, ...] = (),
) -> MeasuredSet:
    """Line, (target, way, repetition) and value of every reading, as one record; ``said`` stood above the table."""
    targets, values = _arranged(_readings(rows, where), where)
    targets, deviations = _converted(targets, values, found)
    if beyond(float(np.max(np.abs(targets))), float(np.nanmax(np.abs(deviations)))):
        raise _impossible(rows, found, where)
    header = {**(said or {}), "Unit": found.unit} | ({"Reading": "position"} if found.reading == "position" else {})
    warnings = (*_warnings(targets, deviations, found), *notes, *end_doubts(text))
    return MeasuredSet(targets, deviations, found.axis_unit, header=header, warnings=warnings)


def _wrong(where: str, line: int, why: str) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)


def _impossible(rows: list[tuple[int, Key, float]], found: Layout, where: str) -> FileFormatError:
    """The first line whose numbers no measurement can hold."""
    for at, (target, _way, _repetition), value in rows:
        one, other = _converted(np.array([target]), np.array([[[value]]]), found)
        if beyond(one.item(), other.item()):
            return _wrong(where, at, f"target {target:g} with {found.reading} {value:g} is no measurement")
    return FileFormatError("E-FILE-ROWS", where)


def _readings(rows: list[tuple[int, Key, float]], where: str) -> dict[Key, float]:
    readings: dict[Key, float] = {}
    for at, key, value in rows:
        if key in readings:
            raise _wrong(where, at, f"target {key[0]:g}, repetition {key[2]} in this direction occurs twice")
        readings[key] = value
    if not readings:
        raise FileFormatError("E-FILE-ROWS", where)
    return readings


def _rows(sheet: Sheet, found: Layout, ways: str, where: str) -> tuple[list[tuple[int, Key, float]], tuple[str, ...]]:
    """Line, (target, way, repetition) and value of every reading, and a note of what the order alone told."""
    for at, row in sheet.rows:
        if len(row) != found.width:
            raise _wrong(where, at, f"{len(row)} columns, but the header names {found.width}")
    if found.passes:
        return [(at, *one) for at, row in sheet.rows for one in _of_passes(row, found, at, where)], ()
    read = [_of_row(row, found, at, where) for at, row in sheet.rows]
    targets = [target for target, _way, _repetition, _value in read]
    notes: tuple[str, ...] = ()
    if found.columns[1] == NONE and ways in (ROWS if found.columns[2] != NONE else ROWS[1:]):
        read = [(target, _way_of(run, ways), run, value) for target, _way, run, value in read]
    elif found.columns[1] == NONE:
        told = by_order(targets)
        if told is None:
            raise FileFormatError("E-FILE-CSV-RUNS", where, found=", ".join(sheet.heads)[:80])
        read = [(target, way, number, value) for (target, _w, _r, value), (way, number) in zip(read, told, strict=True)]
        notes = ("the order of the rows tells the directions: no column does",)
    if found.columns[2] == NONE and not notes:
        numbers = counted([(target, way) for target, way, _r, _value in read])
        read = [(target, way, number, value) for (target, way, _r, value), number in zip(read, numbers, strict=True)]
    rows = [((target, way, number), value) for target, way, number, value in read]
    return [(at, *one) for (at, _row), one in zip(sheet.rows, rows, strict=True) if not isnan(one[1])], notes


def _way_of(run: int, ways: str) -> int:
    return (run + 1) % 2 if ways == "runs" else int(ways == "down")


def _of_passes(row: Row, found: Layout, at: int, where: str) -> list[tuple[Key, float]]:
    """An empty cell is a reading that was not taken."""
    cell = row[found.columns[0]]
    target = decimal(cell, comma=found.comma)
    if target is None:
        raise _wrong(where, at, f"{cell!r} is not a target")
    readings = []
    for column, way, number in found.passes:
        value = decimal(row[column], comma=found.comma)
        if value is None and not missing(row[column]):
            raise _wrong(where, at, f"{row[column]!r} is not a {found.reading}")
        if value is not None:
            readings.append(((float(target), way, number), float(value)))
    return readings


def _of_row(row: Row, found: Layout, at: int, where: str) -> tuple[float, int, int, float]:
    """Target, way, repetition (0 where no column tells one) and reading, NaN where the cell says that there is none."""
    target_text, way_text, repetition_text, value_text = (
        row[column] if column != NONE else "" for column in found.columns
    )
    target, value = decimal(target_text, comma=found.comma), decimal(value_text, comma=found.comma)
    if value is None and value_text.strip("-") and missing(value_text):
        value = nan  # an empty cell and a lone mark may be where a file was cut
    way = DIRECTIONS.get(way_text.lower()) if found.columns[1] != NONE else 0
    repetition = whole(repetition_text) if found.columns[2] != NONE else 0
    for good, text, wanted in (
        (target is not None, target_text, "a target"),
        (way is not None, way_text, "a direction (+ - up down forward backward 1 -1)"),
        (repetition is not None and repetition < MOST_REPETITIONS, repetition_text, "a repetition"),
        (value is not None, value_text, f"a {found.reading}"),
    ):
        if not good:
            raise _wrong(where, at, f"{text!r} is not {wanted}")
    if found.beside != NONE and not isnan(value or 0.0):
        _agree(row, found, (float(target or 0.0), float(value or 0.0)), at, where)
    return float(target or 0.0), way or 0, repetition or 0, float(value or 0.0)


def _agree(row: Row, found: Layout, read: tuple[float, float], at: int, where: str) -> None:
    """Where a row has position and deviation, they say the same; else the table counts the other way round.

    Raises FileFormatError (E-FILE-LINE).
    """
    position = decimal(row[found.beside], comma=found.comma)
    kind, scale = TARGET_UNITS[found.target_unit]
    if position is None or UNITS[found.unit][0] != kind:
        return
    said = read[1] * UNITS[found.unit][1]
    difference = (float(position) - read[0]) * scale * deviation_scale(kind)
    if abs(said - difference) > AGREE_UM + NEARLY * abs(difference):
        unit = deviation_unit(kind)
        why = f"the deviation is {said:g} {unit}, but position - target is {difference:g} {unit}"
        raise _wrong(where, at, why)


def _arranged(readings: dict[tuple[float, int, int], float], where: str) -> tuple[FloatArray, FloatArray]:
    """Targets (m,) rising, readings (m, n, 2), as written."""
    targets = sorted({target for target, _way, _repetition in readings})
    row = {target: at for at, target in enumerate(targets)}
    column = _repetitions(readings)
    values = no_readings(len(targets), 1 + max(column.values()), where)
    for (target, way, repetition), value in readings.items():
        values[row[target], column[way, repetition], way] = value
    return np.array(targets, np.float64), values


def _repetitions(readings: dict[tuple[float, int, int], float]) -> dict[tuple[int, int], int]:
    """(way, number) -> repetition from 0. Numbers that no way shares count one-way passes, as vendors do."""
    numbers = [sorted({number for _target, at, number in readings if at == way}) for way in (0, 1)]
    if not set(numbers[0]) & set(numbers[1]):
        return {(way, number): at for way in (0, 1) for at, number in enumerate(numbers[way])}
    every = sorted({*numbers[0], *numbers[1]})
    return {(way, number): at for way in (0, 1) for at, number in enumerate(every)}


def _converted(targets: FloatArray, values: FloatArray, found: Layout) -> tuple[FloatArray, FloatArray]:
    """Targets in mm or deg, deviations in um or arcsec."""
    axis_unit, target_scale = TARGET_UNITS[found.target_unit]
    targets = targets * target_scale
    if found.reading == "deviation":
        return targets, values * UNITS[found.unit][1]
    return targets, (values * TARGET_UNITS[found.unit][1] - targets[:, None, None]) * deviation_scale(axis_unit)


def _warnings(targets: FloatArray, deviations: FloatArray, found: Layout) -> tuple[str, ...]:
    said = ["numbers are written with a decimal comma"] if found.comma else []
    ways = [way for way in (0, 1) if not np.isnan(deviations[:, :, way]).all()]
    if len(ways) == 1:
        said.append("measured in one direction only")
    missing = int(np.isnan(deviations[:, :, ways]).sum())
    if missing:
        said.append(f"readings missing: {missing}")
    largest = float(np.nanmax(np.abs(deviations)))
    span = float(np.ptp(targets)) * deviation_scale(found.axis_unit)
    apart = found.axis_unit != TARGET_UNITS[found.target_unit][0]
    if largest > LARGEST[found.axis_unit] or (not apart and 0.0 < span * MOST_SHARE < largest):
        unit = deviation_unit(found.axis_unit)
        said.append(f"the largest deviation is {largest:.4g} {unit}: does the column hold what its name says?")
    return tuple(said)
