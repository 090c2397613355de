"""What a table's numbers leave in doubt: a decimal comma or a thousand, mm or um, mm or deg."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from drivers.files.numbers import decimal
from drivers.files.tables.sheet import Sheet

NEAR = 0.01
"""Of the targets' span: readings all within it of their targets are positions, within it of zero deviations."""
SMALLEST = 0.2  # um or arcsec: below it a whole table without a unit is asked for it
LEAST_OF_TURN, TURN = 4, 360.0
_NUMBER = re.compile(r"[+-]?[0-9]*[.,]?[0-9.,]*(?:[eE][+-]?[0-9]+)?\Z")
_DATE = re.compile(r"[0-3]?[0-9]\.[01]?[0-9]\.(?:[0-9]{2}){1,2}\Z")
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}(,[0-9]{3})+\Z")


def too_small(
    sheet: Sheet, columns: tuple[int, int, int, int], passes: Sequence[tuple[int, int, int]], *, comma: bool
) -> bool:
    """Whether deviations without a unit would be smaller than those of any machine axis: they may be mm, or deg."""
    own = [column for column, _way, _number in passes] or [columns[3]]
    read = (decimal(row[at], comma=comma) for _line, row in sheet.rows for at in own if at < len(row))
    return 0.0 < max((abs(value) for value in read if value is not None), default=0.0) < SMALLEST


def whole_turn(sheet: Sheet, column: int, *, comma: bool) -> bool:
    """Whether even steps from the first target to the last, or one more, make 360: mm then is no more than a guess."""
    found = {decimal(row[column], comma=comma) for _at, row in sheet.rows if column < len(row)}
    places = sorted(place for place in found if place is not None)
    if len(places) < LEAST_OF_TURN:
        return False
    steps = [after - before for before, after in pairwise(places)]
    span = places[-1] - places[0]
    even = max(steps) - min(steps) <= NEAR * max(steps)
    return even and any(abs(whole - TURN) <= NEAR for whole in (span, span + max(steps)))


def _is_number(cell: str) -> bool:
    return _NUMBER.match(cell) is not None and not _DATE.match(cell)


def both_marks(sheet: Sheet, columns: Sequence[int]) -> tuple[int, str, str] | None:
    """Line and two numbers, one with a comma and one with a point: one of the marks may separate thousands."""
    found = [(at, row[one]) for at, row in sheet.rows for one in columns if one < len(row) and _is_number(row[one])]
    pointed = next(((at, cell) for at, cell in found if "." in cell), None)
    with_comma = next(((at, cell) for at, cell in found if "," in cell), None)
    if pointed is None or with_comma is None:
        return None
    return max(pointed[0], with_comma[0]), pointed[1], with_comma[1]


def decimal_comma(sheet: Sheet) -> bool:
    """Whether numbers have a decimal comma: commas occur in the rows, and points do not."""
    numbers = [cell for _at, row in sheet.rows for cell in row if _is_number(cell)]
    text = " ".join(numbers)
    if "," not in text or "." in text:
        return False
    # Between commas a number with one stands in quotes, and "1,000" there may be a thousand.
    return sheet.separator != "," or any("," in cell and not _THOUSANDS.match(cell) for cell in numbers)
