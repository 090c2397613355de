"""Tables of readings: one row for each target, direction and repetition, with a header that names the columns."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.columns import ColumnMap, read_columns
from drivers.files.numbers import decimal, whole
from drivers.files.text import decode, read_bytes
from drivers.types import FloatArray, MeasuredSet
from drivers.units import AxisUnit, deg_to_arcsec, mm_to_um, rad_to_arcsec

Convert = Callable[[FloatArray], FloatArray]
COLUMNS = ("target", "direction", "repetition", "deviation")
UNITS: dict[str, tuple[AxisUnit, Convert]] = {
    "um": ("mm", lambda value: value),
    "mm": ("mm", mm_to_um),
    "arcsec": ("deg", lambda value: value),
    "deg": ("deg", deg_to_arcsec),
    "mrad": ("deg", lambda value: rad_to_arcsec(value / 1e3)),
    "urad": ("deg", lambda value: rad_to_arcsec(value / 1e6)),
}
DIRECTIONS = {"+": 0, "+1": 0, "1": 0, "up": 0, "-": 1, "-1": 1, "down": 1}
_BREAK = re.compile(r"\r\n|\n|\r")
SEPARATORS = (";", "\t", ",")
MOST_REPETITIONS = 10_000


@dataclass(frozen=True, slots=True)
class _Layout:
    separator: str
    width: int
    columns: tuple[int, ...]
    unit: str
    comma: bool


class CsvFormat:
    """File driver "csv": header target, direction, repetition, deviation in any order.

    Deviations are um over mm unless `unit`, or the column's own name (deviation_arcsec), says otherwise.
    """

    def __init__(self, unit: str = "", codepage: str = "cp1252", columns: Mapping[str, Any] | None = None) -> None:
        if unit and unit not in UNITS:
            raise ConfigError("E-FILE-UNIT", "csv", unit=unit, known=", ".join(UNITS))
        self._unit = unit
        self._codepage = codepage
        self._columns = ColumnMap.read(columns, "csv") if columns is not None else None

    def read(self, path: Path) -> MeasuredSet:
        """Read a file, by the declared columns if there are any. Raises FileFormatError with line and reason."""
        where = str(path)
        text = decode(read_bytes(path), self._codepage, where)
        return parse_csv(text, self._unit, where) if self._columns is None else read_columns(text, self._columns, where)


def parse_csv(text: str, unit: str, where: str) -> MeasuredSet:
    """A whole table, pure. Every (target, direction, repetition) may occur once; missing ones are NaN."""
    lines = [
        (at, line)
        for at, line in enumerate(_BREAK.split(text), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise FileFormatError("E-FILE-CSV-HEADER", where, found="nothing", columns=", ".join(COLUMNS))
    layout = _layout(lines[0], lines[1:], unit, where)
    readings = _readings(lines[1:], layout, where)
    targets, deviations = _arranged(readings)
    axis_unit, convert = UNITS[layout.unit]
    warnings = _warnings(deviations, layout)
    return MeasuredSet(targets, convert(deviations), axis_unit, header={"Unit": layout.unit}, warnings=warnings)


def _wrong(where: str, line: int, why: str) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)


def _cells(line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=separator), [])]
    except csv.Error:
        return []


def _layout(header: tuple[int, str], body: list[tuple[int, str]], unit: str, where: str) -> _Layout:
    at, line = header
    separator = next((mark for mark in SEPARATORS if mark in line), ",")
    names = [name.lower() for name in _cells(line, separator)]
    stems = [name.split("_")[0] for name in names]
    if sorted(stems.count(column) for column in COLUMNS) != [1, 1, 1, 1]:
        raise FileFormatError("E-FILE-CSV-HEADER", where, found=line[:80], columns=", ".join(COLUMNS))
    columns = tuple(stems.index(column) for column in COLUMNS)
    stated = names[columns[3]].partition("_")[2]
    if (stated and stated not in UNITS) or (stated and unit and stated != unit):
        raise _wrong(where, at, f"deviations in {stated!r}, expected one of {unit or ', '.join(UNITS)}")
    text = " ".join(line for _at, line in body)
    comma = separator != "," and "," in text and "." not in text
    return _Layout(separator, len(names), columns, unit or stated or "um", comma)


def _readings(lines: list[tuple[int, str]], layout: _Layout, where: str) -> dict[tuple[float, int, int], float]:
    readings: dict[tuple[float, int, int], float] = {}
    for at, line in lines:
        key, value = _reading(line, layout, at, where)
        if key in readings:
            raise _wrong(where, at, f"target {key[0]:g}, repetition {key[2]} in this direction occurs twice")
        readings[key] = value
    if not readings:
        raise FileFormatError("E-FILE-ROWS", where)
    return readings


def _reading(line: str, layout: _Layout, at: int, where: str) -> tuple[tuple[float, int, int], float]:
    cells = _cells(line, layout.separator)
    if len(cells) != layout.width:
        raise _wrong(where, at, f"{len(cells)} columns, but the header names {layout.width}")
    target_text, way_text, repetition_text, value_text = (cells[column] for column in layout.columns)
    target, value = decimal(target_text, comma=layout.comma), decimal(value_text, comma=layout.comma)
    way, repetition = DIRECTIONS.get(way_text.lower()), whole(repetition_text)
    for good, text, wanted in (
        (target is not None, target_text, "a target"),
        (way is not None, way_text, "a direction (+ - up down 1 -1)"),
        (repetition is not None and repetition < MOST_REPETITIONS, repetition_text, "a repetition"),
        (value is not None, value_text, "a deviation"),
    ):
        if not good:
            raise _wrong(where, at, f"{text!r} is not {wanted}")
    return (float(target or 0.0), way or 0, repetition or 0), float(value or 0.0)


def _arranged(readings: dict[tuple[float, int, int], float]) -> tuple[FloatArray, FloatArray]:
    """Targets (m,) rising, deviations (m, n, 2)."""
    targets = sorted({target for target, _way, _repetition in readings})
    repetitions = sorted({repetition for _target, _way, repetition in readings})
    row = {target: at for at, target in enumerate(targets)}
    column = {repetition: at for at, repetition in enumerate(repetitions)}
    deviations = np.full((len(targets), len(repetitions), 2), np.nan)
    for (target, way, repetition), value in readings.items():
        deviations[row[target], column[repetition], way] = value
    return np.array(targets, np.float64), deviations


def _warnings(deviations: FloatArray, layout: _Layout) -> tuple[str, ...]:
    found = ["numbers are written with a decimal comma"] if layout.comma else []
    ways = [way for way in (0, 1) if not np.isnan(deviations[:, :, way]).all()]
    if len(ways) == 1:
        found.append("measured in one direction only")
    missing = int(np.isnan(deviations[:, :, ways]).sum())
    if missing:
        found.append(f"{missing} readings are missing")
    return tuple(found)
