"""Tables that a program wrote without a break: a heading, then rows of one form to the end, read column by column.

A million readings cell by cell take twenty seconds. What is read here is what the way for people's tables would read,
for whatever leaves that way a choice is left to it: a cell in quotes, a blank, a remark, a second mark in a number, a
line of another width, a column without a unit. `csvmap`, the only caller, goes it wherever this one answers None.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

import numpy as np

from drivers.errors import FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.numbers import decimal, like_number, mark_of, missing, whole
from drivers.files.readings import Rows, Whole
from drivers.files.tables.headwords import DIRECTIONS
from drivers.files.tables.layout import Layout, layout, told_by_heading, understood_as
from drivers.files.tables.sheet import MOST_LINES, Sheet, sheets_of
from drivers.types.values import FloatArray

MOST_REPETITIONS = 10_000
CHUNK = 1 << 18  # letters that are cut into cells at a time
LONGEST = 18  # of a number whose digits need not be counted
_PLAIN = {mark: f"0123456789+-{mark}\n".encode() for mark in ".,"}
SEPARATORS = (",", ";", "\t")


def plain_table(text: str, said: ColumnMap, where: str, *, mixed: bool) -> tuple[Layout, Sheet, Rows] | None:
    """The layout, the sheet with its first rows alone, and every reading; None where the table is not that plain."""
    kept = {name: getattr(said, name) for name in ("datum", "sense", "factor", "confirmed", "sheet")}
    if said != ColumnMap(**kept):
        return None
    end = _end_of_line(text, 2 * MOST_LINES)
    if end < 0:
        return None
    found = _begun(text[:end], said, where, mixed=mixed)
    if found is None:
        return None
    chosen, sheet, mark = found
    first = sheet.rows[0][0]
    rows = _rows(text, _end_of_line(text, first - 1), chosen, sheet, mark=mark)
    return None if rows is None else (chosen, sheet, rows)


def _end_of_line(text: str, count: int) -> int:
    """Where the line behind so many lines begins; -1 where there are fewer."""
    at = 0
    for _ in range(count):
        at = text.find("\n", at) + 1
        if not at:
            return -1
    return at


def _begun(head: str, said: ColumnMap, where: str, *, mixed: bool) -> tuple[Layout, Sheet, str] | None:
    """Layout, first rows and decimal mark, where the heading tells all of it and the first rows prove the mark."""
    try:
        sheets = sheets_of(head.rstrip("\r\n"), lambda heads: understood_as(heads, said), where)
        if len(sheets) != 1 or not sheets[0].rows or sheets[0].separator not in SEPARATORS or sheets[0].notes:
            return None
        sheet = sheets[0]
        found, plain = layout(sheet, said, where, mixed=mixed)
    except FileFormatError:
        return None
    lines = [at for at, _row in sheet.rows]
    even = all(len(row) == len(sheet.heads) for _at, row in sheet.rows)
    if not (even and told_by_heading(sheet, found, said) and lines == list(range(lines[0], head.count("\n") + 1))):
        return None
    cells = [row[column] for _at, row in sheet.rows for column in found.read]
    marks = {mark_of(cell) for cell in cells if like_number(cell)} & {".", ","}
    if len(marks) != 1 or (sheet.separator == "," and marks == {","}):
        return None
    return found, plain, marks.pop()


def _rows(text: str, start: int, found: Layout, sheet: Sheet, *, mark: str) -> Rows | None:
    """Every reading from here to the end; None at the first line that is not of the one form."""
    end = len(text)
    while text[end - 1] in "\r\n":
        end -= 1
    count = text.count("\n", start, end) + 1
    target, value = np.empty(count), np.empty(count)
    approach, run = np.empty(count, np.int32), np.empty(count, np.int32)
    at = 0
    for chunk in _chunks(text, start, end):
        columns = _columns(chunk, sheet.separator, len(sheet.heads))
        part = _part([columns[one] for one in found.columns], mark) if columns else None
        if part is None:
            return None
        own = slice(at, at := at + len(part[0]))
        target[own], approach[own], run[own], value[own] = part
    if end == len(text) and np.isnan(value[-1]):
        return None  # it may be where the file was cut
    first = sheet.rows[0][0]
    return Rows(np.arange(first, first + count, dtype=np.int32), target, approach, run, value=value)


def _chunks(text: str, start: int, end: int) -> Iterator[str]:
    """Whole lines without the end of the last one, with plain ends between them."""
    while start < end:
        at = text.find("\n", min(start + CHUNK, end), end)
        at = end if at < 0 else at
        yield text[start:at].replace("\r\n", "\n").removesuffix("\r")
        start = at + 1


def _columns(lines: str, separator: str, width: int) -> list[list[str]]:
    """The cells of each column; none where a line has another width, or a cell that only a reader of CSV can cut."""
    if '"' in lines or "\r" in lines:
        return []
    cells = [*lines.replace("\n", f"{separator}\n{separator}").split(separator), "\n"]
    ends = cells[width :: width + 1]
    if len(cells) % (width + 1) or len(ends) != lines.count("\n") + 1 or ends.count("\n") != len(ends):
        return []
    return [cells[at :: width + 1] for at in range(width)]


def _part(columns: list[list[str]], mark: str) -> tuple[FloatArray, Whole, Whole, FloatArray] | None:
    """Target, way, run and reading (k,) of the cells of these columns; None where one of them is no such thing."""
    target, value = (_numbers(columns[at], mark) for at in (0, 3))
    ways = {cell: DIRECTIONS.get(cell.strip().lower()) for cell in set(columns[1])}
    runs = {cell: whole(cell.strip()) for cell in set(columns[2])}
    known = all(way is not None for way in ways.values())
    known = known and all(run is not None and run < MOST_REPETITIONS for run in runs.values())
    if target is None or value is None or np.isnan(target).any() or not known:
        return None
    way, run = (
        np.fromiter(map(told.__getitem__, cells), np.int32, len(cells))
        for told, cells in ((ways, columns[1]), (runs, columns[2]))
    )
    return target, way, run, value


def _numbers(cells: list[str], mark: str) -> FloatArray | None:
    """Numbers, NaN where a cell says that there is none; None where one has another mark than the table's."""
    joined = "\n".join(cells)
    if mark == ",":
        if "." in joined:
            return None
        cells = joined.replace(",", ".").split("\n")
    if joined.isascii() and not joined.encode().translate(None, _PLAIN[mark]) and max(map(len, cells)) <= LONGEST:
        try:
            return np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            pass  # a cell is empty, or no number
    found = []
    for cell in cells:
        value = decimal(cell)
        if value is None and (like_number(cell) or not missing(cell)):
            return None
        found.append(nan if value is None else value)
    return np.array(found)
