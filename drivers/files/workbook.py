"""A workbook's sheet as the text of a table, so that it is read like any other; old and renamed workbooks by name."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Callable
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

from drivers.errors import FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.tables.indexed import is_indexed
from drivers.files.tables.layout import understood_as
from drivers.files.tables.sheet import sheets_of
from drivers.message import Message

ZIP, OLD = b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
ENDING = ".xlsx"
MOST_UNPACKED = 256 << 20
MOST_ROWS, MOST_COLUMNS = 100_000, 1_000


def is_workbook(path: Path, data: bytes) -> bool:
    """Whether a file is an .xlsx workbook.

    Raises FileFormatError: E-FILE-WORKBOOK-OLD for an .xls, E-FILE-WORKBOOK-NAME for one, or another packed file,
    under the name of a text, E-FILE-WORKBOOK for an .xlsx that is none.
    """
    named = path.suffix.lower() == ENDING
    if data.startswith(OLD):
        raise FileFormatError("E-FILE-WORKBOOK-OLD", str(path))
    if data.startswith(ZIP) and not named:
        raise FileFormatError("E-FILE-WORKBOOK-NAME", str(path), ending=path.suffix or "(none)")
    if named and not data.startswith(ZIP):
        raise FileFormatError("E-FILE-WORKBOOK", str(path), why=Message.of("W-FILE-BEGINS", data=data[:8]))
    return named


def workbook_text(data: bytes, said: ColumnMap, where: str, *, any_sheet: bool = False) -> str:
    """The one sheet that holds a table, or the one that was named, as text with tabs; line numbers are row numbers.

    Raises FileFormatError (E-FILE-WORKBOOK), E-FILE-SHEET where several sheets hold a table, or none has the name said.
    ``any_sheet`` takes the first of several.
    """
    texts = _sheets(data, where)
    if said.sheet:
        if said.sheet not in texts:
            raise FileFormatError("E-FILE-SHEET", where, found=", ".join(texts), columns=f"sheet={next(iter(texts))}")
        return texts[said.sheet]
    holding = {name: text for name, text in texts.items() if text.strip() and _holds(text, said, where)}
    if not holding:  # whoever reads it says what is missing
        holding = {name: text for name, text in texts.items() if text.strip()}
    if len(holding) > 1 and not any_sheet:
        first = next(iter(holding))
        raise FileFormatError("E-FILE-SHEET", where, found=", ".join(holding), columns=f"sheet={first}")
    return next(iter(holding.values()), "\n")


def _holds(text: str, said: ColumnMap, where: str) -> bool:
    if said.whole or is_indexed(text):
        return True
    understands: Callable[[tuple[str, ...]], int | None] = lambda heads: understood_as(heads, said)  # noqa: E731
    try:
        return bool(sheets_of(text, understands, where))
    except FileFormatError:
        return True


def _sheets(data: bytes, where: str) -> dict[str, str]:
    """Every sheet's text by its name."""
    import openpyxl  # it is slow to load, and only a workbook needs it

    _refuse_huge(data, where)
    try:
        values = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        formulas = openpyxl.load_workbook(io.BytesIO(data), read_only=True)
        return {
            name: _text(values[name], formulas[name], where)
            for name in values.sheetnames
            if hasattr(values[name], "iter_rows")
        }
    except FileFormatError:
        raise
    except Exception as error:  # the library raises whatever a damaged part leads to
        raise FileFormatError("E-FILE-WORKBOOK", where, why=f"{type(error).__name__}: {error}"[:120]) from error


def _refuse_huge(data: bytes, where: str) -> None:
    """Before anything is unpacked."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            unpacked = sum(one.file_size for one in packed.infolist())
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError) as error:
        raise FileFormatError("E-FILE-WORKBOOK", where, why=str(error)) from error
    if unpacked > MOST_UNPACKED:
        raise FileFormatError("E-FILE-WORKBOOK", where, why=Message.of("W-FILE-UNPACKS", most_unpacked=MOST_UNPACKED))


def _text(values: Any, formulas: Any, where: str) -> str:
    out = io.StringIO()
    writer = csv.writer(out, delimiter="\t", lineterminator="\n")
    rows = zip(values.iter_rows(values_only=True), formulas.iter_rows(values_only=True), strict=True)
    for at, (row, sources) in enumerate(rows, start=1):
        if at > MOST_ROWS or len(row) > MOST_COLUMNS:
            limit = Message.of("W-FILE-ROWS-COLUMNS", most_rows=MOST_ROWS, most_columns=MOST_COLUMNS)
            raise FileFormatError("E-FILE-WORKBOOK", where, why=Message.of("W-FILE-SHEET-MORE", limit=limit))
        cells = [_cell(value, source) for value, source in zip(row, sources, strict=True)]
        while cells and not cells[-1]:
            cells.pop()
        writer.writerow(cells or [""]) if any(cells) else out.write("\n")
    return out.getvalue()


def _cell(value: Any, source: Any) -> str:
    """A cell as text; a formula whose result the file does not hold stays the formula, which is no number."""
    if value is None:
        return str(source) if isinstance(source, str) and source.startswith("=") else ""
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, (int, float)):
        return repr(float(value)).removesuffix(".0") if abs(value) < 1e15 else repr(float(value))
    if isinstance(value, (datetime, date, time)):
        return value.isoformat()
    return " ".join(str(value).split()).replace(";", ",")
