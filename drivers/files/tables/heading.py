"""Every column of a table by its heading, whether a reader takes it or not; pure."""

from __future__ import annotations

import re
from collections.abc import Sequence

from drivers.files.numbers import like_number, missing
from drivers.files.tables.headwords import head_cell, is_index, is_statistic, is_way_or_unit, pass_of, run_of
from drivers.files.tables.sheet import MARKS, MOST_LINES, Row, cells, words_above
from drivers.types.results import TableColumn, TableHeading

_BREAK = re.compile(r"\r\n|\n|\r")
ROWS_LOOKED_AT = 20
LINES_LOOKED_AT = 10 * MOST_LINES
ROLES = {"target": "target", "direction": "direction", "repetition": "repetition", "deviation": "reading"}


def table_heading(text: str) -> TableHeading | None:
    """The first heading with a column of targets and rows of numbers under it; None where there is none."""
    lines = _BREAK.split(text, LINES_LOOKED_AT)[:LINES_LOOKED_AT]
    for at, line in enumerate(lines[:MOST_LINES]):
        separator = next((mark for mark in MARKS if mark in line), "")
        heads = tuple(cells(line, separator))
        if len(heads) < len("tr") or not any(head_cell(one).meaning in ("target", "position") for one in heads):
            continue
        below = [
            (number, tuple(cells(one, separator))) for number, one in enumerate(lines) if number > at and one.strip()
        ]
        heads, body = _with_units(heads, below)
        if body and len(body[0][1]) == len(heads) and _numbers(body, len(heads)):
            return TableHeading(_columns(heads, body), body[0][0], separator, words_above(text, at))
    return None


def _with_units(heads: Row, below: Sequence[tuple[int, Row]]) -> tuple[Row, Sequence[tuple[int, Row]]]:
    """The heading with the units of a second line, and the rows behind both."""
    second = below[0][1] if below else ()
    named = [one for one in second if one]
    if len(second) != len(heads) or not named or not all(is_way_or_unit(one) for one in named):
        return heads, below
    return tuple(f"{one} {unit}".strip() for one, unit in zip(heads, second, strict=True)), below[1:]


def _numbers(body: Sequence[tuple[int, Row]], width: int) -> set[int]:
    """Columns in which the first rows hold numbers, and numbers alone where a cell is filled."""
    found = set()
    for column in range(width):
        read = [row[column] for _at, row in body[:ROWS_LOOKED_AT] if column < len(row) and row[column]]
        if any(like_number(one) for one in read) and all(like_number(one) or missing(one) for one in read):
            found.add(column)
    return found


def _columns(heads: Row, body: Sequence[tuple[int, Row]]) -> tuple[TableColumn, ...]:
    numbers = _numbers(body, len(heads))
    first = min((at for at, one in enumerate(heads) if head_cell(one).meaning in ("target", "position")), default=0)
    said = any(head_cell(one).meaning == "target" for one in heads)
    found = []
    for at, text in enumerate(heads):
        cell = head_cell(text)
        role = ROLES.get(cell.meaning, "")
        if cell.meaning == "position":
            role = "target" if at == first and not said else "reading"
        elif not role and (pass_of(cell) is not None or run_of(cell)):
            role = "reading"
        elif not role and at in numbers and not is_index(cell) and not is_statistic(text):
            role = "numbers"
        found.append(TableColumn(at + 1, text, cell.words, cell.unit, role=role))
    return tuple(found)
