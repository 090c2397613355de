"""Our own tables of numbers for spreadsheets and scripts: compensation tables and the 21 errors as CSV.

Units stand in columns of their own, the sign in the first lines, which begin with "#". A person's sheet is read too:
with semicolons and decimal commas, or with tabs; in capitals, with blanks, with rows that hold nothing.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, TypeVar

import numpy as np

from drivers.errors import FileFormatError
from drivers.exchange.lines import comment, number, only_motions, rising
from drivers.terms import TableKind
from drivers.types.exchange import ErrorCurve, ErrorSet, ReadAs
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit

MARK = "#"
WAYS: Mapping[str, Literal[-1, 0, 1]] = {"-1": -1, "0": 0, "1": 1}
KINDS: Mapping[str, TableKind] = {"axis": "axis", "cross": "cross"}
AXIS_UNITS: Mapping[str, AxisUnit] = {"mm": "mm", "deg": "deg"}
OUTPUTS: Mapping[str, AxisUnit] = {"um": "mm", "arcsec": "deg"}
MODULO: Mapping[str, bool] = {"0": False, "1": True}
LOCATION, MOTION = re.compile("[XYZABC]0[XYZABC]"), re.compile("E[XYZABC][XYZABC]")
Found = TypeVar("Found")
_MICRO = str.maketrans("\u00b5\u03bc", "uu")
TABLE_COLUMNS = (
    "kind", "output_axis", "input_axis", "input_unit", "deviation_unit", "modulo", "direction", "position", "deviation",
    "deviation_reverse",
)  # fmt: skip
ERROR_COLUMNS = ("name", "argument", "argument_unit", "position", "value", "value_unit")
TABLE_COMMENT = "a deviation is actual - nominal of the output axis; a table holds the deviation that it cancels"
ERROR_COMMENT = "error = actual - nominal, names of ISO 230-1; a location error has no position"


class TableCsv:
    """Compensation tables as CSV, one row a point (implements ports.TableExchange)."""

    suffix = ".csv"
    forms = ("",)

    def text(self, tables: Sequence[CompensationTable], _form: str, comments: Sequence[str]) -> str:
        """All tables below one another; ``deviation_reverse`` only where the negative direction has its own curve."""
        return _text((TABLE_COMMENT, *comments), TABLE_COLUMNS, (row for table in tables for row in _table_rows(table)))

    def read(self, text: str, where: str, _known: ReadAs) -> tuple[CompensationTable, ...]:
        """The file says axis and unit itself. Raises FileFormatError (E-EXCHANGE-...)."""
        found: dict[tuple[str, ...], list[tuple[int, Mapping[str, str]]]] = {}
        for line, row in _rows(text, TABLE_COLUMNS, where):
            found.setdefault(tuple(row[key] for key in TABLE_COLUMNS[:7]), []).append((line, row))
        return tuple(_table(rows, where) for rows in found.values())


class ErrorCsv:
    """The 21 errors as CSV, one row a position (implements ports.ErrorExchange)."""

    suffix = ".csv"

    def text(self, errors: ErrorSet, comments: Sequence[str]) -> str:
        """Location errors first, then each motion. Raises TableError (E-EXCHANGE-FIELD) for one over several axes."""
        only_motions(errors, "error-csv")
        return _text((ERROR_COMMENT, *comments), ERROR_COLUMNS, _error_rows(errors))

    def read(self, text: str, where: str) -> ErrorSet:
        """Raises FileFormatError (E-EXCHANGE-...)."""
        points: dict[tuple[str, AxisUnit], list[tuple[float, float]]] = {}
        locations: dict[str, float] = {}
        for line, row in _rows(text, ERROR_COLUMNS, where):
            name, value = row["name"], number(row["value"], where, line)
            if not (LOCATION if row["position"] == "" else MOTION).fullmatch(name):
                raise FileFormatError("E-EXCHANGE-KEY", where, line=line, found=name[:20])
            unit = ErrorSet.location_unit(name.removeprefix("E"))
            _word(row, "value_unit", {unit: unit}, where, line)
            if row["position"] == "":
                if name in locations:
                    raise FileFormatError("E-EXCHANGE-TWICE", where, line=line, key=name)
                locations[name] = value
            else:
                # Over the axis that its name says, and in that axis' unit: else it is another error.
                _word(row, "argument", {name[2].lower(): name[2]}, where, line)
                turns: AxisUnit = "deg" if name[2] in "ABC" else "mm"
                key = (name, _word(row, "argument_unit", {turns: turns}, where, line))
                points.setdefault(key, []).append((number(row["position"], where, line), value))
        return ErrorSet(tuple(_curve(key, rows, where) for key, rows in points.items()), locations)


def _text(said: Sequence[str], columns: Sequence[str], rows: Iterator[Sequence[str]]) -> str:
    buffer = io.StringIO()
    for line in said:
        buffer.write(f"{MARK} {comment(line)}\n")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return buffer.getvalue()


def _table_rows(table: CompensationTable) -> Iterator[Sequence[str]]:
    head: tuple[str, ...] = (table.kind, table.output_axis, table.input_axis, table.input_unit, table.deviation_unit)
    head = (*head, str(int(table.modulo)), str(table.direction))
    reverse = table.reverse or (None,) * len(table.deviations)
    for at, forward, back in zip(table.positions, table.deviations, reverse, strict=True):
        yield (*head, repr(float(at)), repr(forward), "" if back is None else repr(back))


def _error_rows(errors: ErrorSet) -> Iterator[Sequence[str]]:
    for name, value in errors.locations.items():
        yield (name, "", "", "", repr(float(value)), ErrorSet.location_unit(name))
    for curve in errors.curves:
        for at, value in zip(curve.positions, curve.values, strict=True):
            yield (curve.name, curve.argument, curve.axis_unit, repr(float(at)), repr(float(value)), curve.unit)


def _rows(text: str, columns: Sequence[str], where: str) -> Iterator[tuple[int, Mapping[str, str]]]:
    """Rows by column name with their lines. Raises FileFormatError (E-EXCHANGE-COLUMNS, E-EXCHANGE-WIDTH)."""
    lines = [(count, line) for count, line in enumerate(text.splitlines(), 1) if line and not line.startswith(MARK)]
    title = lines[0][1] if lines else ""
    between = next((one for one in "\t;" if one in title), ",")
    reader = csv.reader([line for _, line in lines], delimiter=between)
    header = [cell.strip().lower() for cell in next(reader, [])]
    if tuple(header) != tuple(columns):
        line, wanted = lines[0][0] if lines else 1, ",".join(columns)
        raise FileFormatError("E-EXCHANGE-COLUMNS", where, line=line, found=title[:120], wanted=wanted)
    for (line, _), row in zip(lines[1:], reader, strict=False):
        cells = [cell.strip() for cell in row]
        if between == ";":  # where a comma is the decimal sign
            cells = [cell.replace(",", ".") for cell in cells]
        if not any(cells):
            continue
        if len(cells) != len(columns):
            raise FileFormatError("E-EXCHANGE-WIDTH", where, line=line, found=len(row), width=len(columns))
        yield line, dict(zip(columns, cells, strict=True))


def _word(row: Mapping[str, str], column: str, known: Mapping[str, Found], where: str, line: int) -> Found:
    """What a cell means. Raises FileFormatError (E-EXCHANGE-WORD)."""
    word = row[column].lower().translate(_MICRO)
    if word not in known:
        found, listed = row[column][:20], ", ".join(known)
        raise FileFormatError("E-EXCHANGE-WORD", where, line=line, column=column, found=found, known=listed)
    return known[word]


def _curve(key: tuple[str, AxisUnit], rows: Sequence[tuple[float, float]], where: str) -> ErrorCurve:
    at, values = np.asarray(rows, dtype=np.float64).T
    rising(at, where)
    return ErrorCurve(key[0], key[1], at, values)


def _table(rows: Sequence[tuple[int, Mapping[str, str]]], where: str) -> CompensationTable:
    line, head = rows[0]
    at = np.asarray([number(row["position"], where, one) for one, row in rows])
    rising(at, where)
    back = [row["deviation_reverse"] for _, row in rows]
    kind = _word(head, "kind", KINDS, where, line)
    units = _word(head, "input_unit", AXIS_UNITS, where, line), _word(head, "deviation_unit", OUTPUTS, where, line)
    if kind == "axis" and (units[0] != units[1] or head["input_axis"] != head["output_axis"]):
        told: dict[str, Any] = {
            key: head[key][:20] for key in ("input_axis", "output_axis", "input_unit", "deviation_unit")
        }
        raise FileFormatError("E-EXCHANGE-OWN", where, line=line, **told)
    return CompensationTable(
        kind=kind,
        input_axis=head["input_axis"],
        output_axis=head["output_axis"],
        minimum=float(at[0]),
        maximum=float(at[-1]),
        step=0.0,
        deviations=tuple(number(row["deviation"], where, one) for one, row in rows),
        modulo=_word(head, "modulo", MODULO, where, line),
        input_unit=units[0],
        output_unit=units[1],
        direction=_word(head, "direction", WAYS, where, line),
        places=tuple(float(one) for one in at),
        reverse=tuple(number(word, where, one) for (one, _), word in zip(rows, back, strict=True)) if any(back) else (),
    )
