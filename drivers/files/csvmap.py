"""Tables of readings: one row for each target, direction and repetition, with a header that names the columns."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.columns import TARGET_UNITS, ColumnMap, read_columns
from drivers.files.csvlayout import COLUMNS, UNITS, Layout, cells, layout
from drivers.files.csvtext import table_text
from drivers.files.headwords import DIRECTIONS
from drivers.files.indexed import indexed, is_indexed
from drivers.files.numbers import beyond, decimal, no_readings, whole
from drivers.files.signature import heading, signature_of
from drivers.files.text import decode, end_doubts, read_bytes
from drivers.types.results import MeasuredSet
from drivers.types.values import FloatArray
from drivers.units import deviation_scale, deviation_unit, typed_unit

_BREAK = re.compile(r"\r\n|\n|\r")
MOST_REPETITIONS = 10_000
Key = tuple[float, int, int]
# Beyond these a column is doubted: its unit, or whether it holds what its name says.
LARGEST = {"mm": 5000.0, "deg": 1000.0}


class CsvFormat:
    """File driver "csv": header target, direction, repetition, deviation (or position) in any order.

    Deviations are um over mm unless `unit`, or the column's own name (deviation_arcsec), says otherwise; positions are
    in the targets' unit. ``mixed`` lets angles stand over mm (pitch) and um over deg (run-out). A table in another
    layout is read by declared `columns`.
    """

    def __init__(
        self,
        unit: str = "",
        codepage: str = "cp1252",
        columns: Mapping[str, Any] | None = None,
        *,
        mixed: bool = False,
    ) -> None:
        unit = typed_unit(unit)
        if unit and unit not in UNITS:
            raise ConfigError("E-FILE-UNIT", "csv", unit=unit, known=", ".join(UNITS))
        self._unit = unit
        self._codepage = codepage
        self._mixed = mixed
        self._columns = ColumnMap.read(columns, "csv", mixed=mixed) if columns is not None else None

    def read(self, path: Path) -> MeasuredSet:
        """Read a file, by the declared columns if there are any. Raises FileFormatError with line and reason."""
        where = str(path)
        text = decode(read_bytes(path), self._codepage, where)
        if self._columns is not None:
            return read_columns(text, self._columns, where)
        try:
            return parse_csv(text, self._unit, where, mixed=self._mixed)
        except FileFormatError as error:
            other = _chinese(path) if error.code == "E-FILE-CSV-HEADER" else ""
            if not other:
                raise
            return parse_csv(other, self._unit, where, mixed=self._mixed)

    def signature(self, path: Path) -> str:
        """What tables of the same layout have in common, "" for one without a heading. Raises FileFormatError."""
        return signature_of(decode(read_bytes(path), self._codepage, str(path)))

    def heading(self, path: Path) -> str:
        """The line that names the columns, "" where there is none."""
        return (heading(decode(read_bytes(path), self._codepage, str(path))) or ("",))[-1]

    def text(self, measured: MeasuredSet) -> str:
        """A measured set as a table that `read` understands and a spreadsheet does not take for formulas."""
        return table_text(measured)


def _chinese(path: Path) -> str:
    """The text of a PC in China, "" where it can be none: a heading that nobody understands may be in its code page."""
    data = read_bytes(path)
    try:
        return "" if data.isascii() else data.decode("gb18030")
    except UnicodeDecodeError:
        return ""


def parse_csv(text: str, unit: str, where: str, *, mixed: bool = False) -> MeasuredSet:
    """A whole table, pure. Every (target, direction, repetition) may occur once; missing ones are NaN.

    ``mixed``: pitch over mm or run-out over deg; the record's unit is then that of the deviations.
    """
    if is_indexed(text):
        return _by_indices(text, where)
    lines = [
        (at, line)
        for at, line in enumerate(_BREAK.split(text), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise FileFormatError("E-FILE-CSV-HEADER", where, found="nothing", columns=", ".join(COLUMNS))
    found = layout(lines[0], lines[1:], unit, where, mixed=mixed)
    rows = [(at, key, value) for at, line in lines[1:] for key, value in _reading(line, found, at, where)]
    return _set_of(rows, found, where, text)


def _by_indices(text: str, where: str) -> MeasuredSet:
    unit, rows = indexed(text, where)
    found = Layout(
        separator="", width=0, columns=(0, 0, 0, 0), reading="position", target_unit=unit, unit=unit, comma=False
    )
    return _set_of(rows, found, where, text)


def _set_of(rows: list[tuple[int, Key, float]], found: Layout, where: str, text: str) -> MeasuredSet:
    """Line, (target, way, repetition) and value of every reading, as one record."""
    targets, values = _arranged(_readings(rows, where), where)
    targets, deviations = _converted(targets, values, found)
    if beyond(float(np.max(np.abs(targets))), float(np.nanmax(np.abs(deviations)))):
        raise _impossible(rows, found, where)
    header = {"Unit": found.unit} if found.reading == "deviation" else {"Unit": found.unit, "Reading": "position"}
    warnings = (*_warnings(deviations, found), *end_doubts(text))
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


def _reading(line: str, found: Layout, at: int, where: str) -> list[tuple[Key, float]]:
    """(target, way, repetition) and value: one of a row, or one of each pass."""
    row = cells(line, found.separator)
    if len(row) != found.width:
        raise _wrong(where, at, f"{len(row)} columns, but the header names {found.width}")
    return _of_passes(row, found, at, where) if found.passes else [_of_row(row, found, at, where)]


def _of_passes(row: list[str], found: Layout, at: int, where: str) -> list[tuple[Key, float]]:
    """An empty cell is a reading that was not taken."""
    target = decimal(row[0], comma=found.comma)
    if target is None:
        raise _wrong(where, at, f"{row[0]!r} is not a target")
    readings = []
    for column, way, number in found.passes:
        value = decimal(row[column], comma=found.comma)
        if value is None and row[column]:
            raise _wrong(where, at, f"{row[column]!r} is not a {found.reading}")
        if value is not None:
            readings.append(((float(target), way, number), float(value)))
    return readings


def _of_row(row: list[str], found: Layout, at: int, where: str) -> tuple[Key, float]:
    target_text, way_text, repetition_text, value_text = (row[column] for column in found.columns)
    target, value = decimal(target_text, comma=found.comma), decimal(value_text, comma=found.comma)
    way, repetition = DIRECTIONS.get(way_text.lower()), whole(repetition_text)
    for good, text, wanted in (
        (target is not None, target_text, "a target"),
        (way is not None, way_text, "a direction (+ - up down forward backward 1 -1)"),
        (repetition is not None and repetition < MOST_REPETITIONS, repetition_text, "a repetition"),
        (value is not None, value_text, f"a {found.reading}"),
    ):
        if not good:
            raise _wrong(where, at, f"{text!r} is not {wanted}")
    return (float(target or 0.0), way or 0, repetition or 0), float(value or 0.0)


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


def _warnings(deviations: FloatArray, found: Layout) -> tuple[str, ...]:
    said = ["numbers are written with a decimal comma"] if found.comma else []
    ways = [way for way in (0, 1) if not np.isnan(deviations[:, :, way]).all()]
    if len(ways) == 1:
        said.append("measured in one direction only")
    missing = int(np.isnan(deviations[:, :, ways]).sum())
    if missing:
        said.append(f"{missing} readings are missing")
    largest = float(np.nanmax(np.abs(deviations)))
    if largest > LARGEST[found.axis_unit]:
        unit = deviation_unit(found.axis_unit)
        said.append(f"the largest deviation is {largest:.4g} {unit}: does the column hold what its name says?")
    return tuple(said)
