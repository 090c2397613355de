"""Our own tables of numbers for spreadsheets and scripts: compensation tables and the 21 errors as CSV.

Units stand in the column names, the sign in the first lines, which begin with "#".
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, cast

import numpy as np

from drivers.errors import FileFormatError
from drivers.exchange.lines import comment, number, rising
from drivers.terms import TableKind
from drivers.types.exchange import ErrorCurve, ErrorSet, ReadAs
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit

MARK = "#"
WAYS: Mapping[str, Literal[-1, 0, 1]] = {"-1": -1, "0": 0, "1": 1}
TABLE_COLUMNS = (
    "kind", "output_axis", "input_axis", "input_unit", "deviation_unit", "modulo", "direction", "position", "deviation",
    "deviation_reverse",
)  # fmt: skip
ERROR_COLUMNS = ("name", "argument", "argument_unit", "position", "value", "value_unit")
TABLE_SIGN = "a deviation is actual - nominal of the output axis; a table holds the deviation that it cancels"
ERROR_SIGN = "error = actual - nominal, names of ISO 230-1; a location error has no position"


class TableCsv:
    """Compensation tables as CSV, one row a point (implements ports.TableExchange)."""

    suffix = ".csv"
    forms = ("",)

    def text(self, tables: Sequence[CompensationTable], _form: str, comments: Sequence[str]) -> str:
        """All tables below one another; ``deviation_reverse`` only where the negative direction has its own curve."""
        return _text((TABLE_SIGN, *comments), TABLE_COLUMNS, (row for table in tables for row in _table_rows(table)))

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
        """Location errors first, then each motion."""
        return _text((ERROR_SIGN, *comments), ERROR_COLUMNS, _error_rows(errors))

    def read(self, text: str, where: str) -> ErrorSet:
        """Raises FileFormatError (E-EXCHANGE-...)."""
        points: dict[tuple[str, AxisUnit], list[tuple[float, float]]] = {}
        locations: dict[str, float] = {}
        for line, row in _rows(text, ERROR_COLUMNS, where):
            name, value = row["name"], number(row["value"], where, line)
            if row["position"] == "":
                locations[name] = value
            else:
                key = (name, _axis_unit(row["argument_unit"], where, line))
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
    """Rows by column name with their lines. Raises FileFormatError (E-EXCHANGE-HEADER, E-EXCHANGE-WIDTH)."""
    lines = [(count, line) for count, line in enumerate(text.splitlines(), 1) if line and not line.startswith(MARK)]
    reader = csv.reader([line for _, line in lines])
    header = next(reader, [])
    if tuple(header) != tuple(columns):
        raise FileFormatError("E-EXCHANGE-HEADER", where, line=lines[0][0] if lines else 1, found=",".join(header)[:80])
    for (line, _), row in zip(lines[1:], reader, strict=False):
        if len(row) != len(columns):
            raise FileFormatError("E-EXCHANGE-WIDTH", where, line=line, found=len(row), width=len(columns))
        yield line, dict(zip(columns, row, strict=True))


def _axis_unit(word: str, where: str, line: int) -> AxisUnit:
    if word not in ("mm", "deg"):
        raise FileFormatError("E-EXCHANGE-UNIT", where, line=line, found=word[:20])
    return cast(AxisUnit, word)


def _curve(key: tuple[str, AxisUnit], rows: Sequence[tuple[float, float]], where: str) -> ErrorCurve:
    at, values = np.asarray(rows, dtype=np.float64).T
    rising(at, where)
    return ErrorCurve(key[0], key[1], at, values)


def _table(rows: Sequence[tuple[int, Mapping[str, str]]], where: str) -> CompensationTable:
    line, head = rows[0]
    if head["kind"] not in ("axis", "cross") or head["direction"] not in WAYS:
        raise FileFormatError("E-EXCHANGE-HEADER", where, line=line, found=f"{head['kind']},{head['direction']}")
    at = np.asarray([number(row["position"], where, one) for one, row in rows])
    rising(at, where)
    back = [row["deviation_reverse"] for _, row in rows]
    output: AxisUnit = "mm" if head["deviation_unit"] == "um" else "deg"
    return CompensationTable(
        kind=cast(TableKind, head["kind"]),
        input_axis=head["input_axis"],
        output_axis=head["output_axis"],
        minimum=float(at[0]),
        maximum=float(at[-1]),
        step=0.0,
        deviations=tuple(number(row["deviation"], where, one) for one, row in rows),
        modulo=head["modulo"] == "1",
        input_unit=_axis_unit(head["input_unit"], where, line),
        output_unit=output,
        direction=WAYS[head["direction"]],
        places=tuple(float(one) for one in at),
        reverse=tuple(number(word, where, one) for (one, _), word in zip(rows, back, strict=True)) if any(back) else (),
    )
