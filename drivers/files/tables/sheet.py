"""Where a table stands in a text: its heading, the rows under it, what stands above and below; no meaning of a row.

Spreadsheets and capture programs put titles above a table, units or directions in a second line of its heading,
statistics below it, and some turn it over. What is not read is named, never lost.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from drivers.errors import FileFormatError
from drivers.files.numbers import decimal_mark, like_number, spelled
from drivers.files.tables.headwords import (
    DIRECTIONS,
    head_cell,
    is_statistic,
    is_way_or_unit,
    names_run,
    pass_of_text,
    way_in,
)
from drivers.message import Message
from drivers.units import READING_UNITS

MARKS = (";", "\t", "|", ",")
MOST_LINES, MOST_WORDS, LONGEST_WORD = 100, 40, 200
MOST_PREAMBLE = 1000
MOST_TABLES, MOST_TITLES, MOST_HEADS = 2, 2, 3
FEWEST_TURNED = 2  # targets in a heading, before a table counts as turned over
_BREAK = re.compile(r"\r\n|\n|\r")
_RULE = re.compile(r"[\s|:+\-=_*]*\Z")
_SEPARATED = re.compile(r"\s*sep=.\s*\Z", re.IGNORECASE)
_WORDS = re.compile(r"\s*([^:=;,\t]{2,40}?)\s*[:=;,\t]\s*(\S.*)")

# What others write above a table, by the names that result files of capture programs have.
CALLED: dict[str, str] = {
    word: name
    for name, words in {
        "Machine": ["machine", "machine name", "maschine", "机床", "machine tool"],
        "Serial No": [
            "serial no",
            "serial number",
            "machine serial number",
            "seriennummer",
            "maschinennummer",
            "序列号",
        ],
        "By": ["by", "operator", "measured by", "bediener", "prüfer", "操作员", "测量人"],
        "Date": ["date", "datum", "measured on", "test date", "messdatum", "日期"],
        "Axis": ["axis", "axis name", "achse", "轴", "axe", "asse", "eje"],
        "Location": ["location", "place", "ort", "地点"],
        "Title": ["title", "titel", "标题"],
    }.items()
    for word in words
}

Row = tuple[str, ...]
COMMA = Message.of("S-FILE-COMMA")
Understands = Callable[[Row], int | None]
"""The column of the targets where a heading is understood, else None."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """``heads`` stand in line ``at``; ``rows`` are (line, cells); ``said`` are the pairs of words above the table.

    ``way`` is "up" or "down" where the words above the table name one.
    """

    at: int
    separator: str
    heads: Row
    rows: tuple[tuple[int, Row], ...]
    said: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[Message, ...] = ()
    way: str = ""

    def spelled(self, columns: Sequence[int], where: str, *, comma: bool = False) -> Sheet:
        """The same with the numbers of these columns written plainly: a decimal point, nothing between thousands.

        ``comma`` says that the decimal mark is one. Raises FileFormatError (E-FILE-CSV-MARKS).
        """
        chosen = [[(at, row[one]) for at, row in self.rows if one < len(row)] for one in dict.fromkeys(columns)]
        mark = "," if comma else decimal_mark(chosen, where, quoted=self.separator == ",")
        kept = set(columns)
        rows: list[tuple[int, Row]] = []
        for at, row in self.rows:
            own = [spelled(cell, mark) if place in kept else cell for place, cell in enumerate(row)]
            for cell, plain in zip(row, own, strict=True):
                if plain is None:
                    raise FileFormatError(
                        "E-FILE-LINE", where, line=at, why=Message.of("W-FILE-DECIMAL-MARK", cell=cell, mark=mark)
                    )
            rows.append((at, tuple(cell or "" for cell in own)))
        comma = mark == "," and any("," in cell for column in chosen for _at, cell in column)
        notes = (COMMA,) if comma else ()
        return replace(self, rows=tuple(rows), notes=(*notes, *self.notes))


def cells(line: str, separator: str) -> list[str]:
    """The cells of a line without the blanks about them, "" separates by blanks; none where its quotes are wrong."""
    if not separator:
        return line.split()
    if separator == "|":
        return [cell.strip() for cell in line.strip().strip("|").split("|")]
    try:
        return [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=separator, strict=True), [])]
    except csv.Error:
        return []


def sheets_of(text: str, understands: Understands, where: str) -> tuple[Sheet, ...]:
    """The tables whose headings are understood: one, or several in one text, each with the way named above it.

    Raises FileFormatError (E-FILE-CSV-SECOND) where a further table follows without words that tell the two apart.
    """
    every = list(enumerate(_BREAK.split(text), start=1))
    found: list[Sheet] = []
    rest = every
    while (one := _first_sheet(rest, understands)) is not None:
        sheet, end = one
        found.append(replace(sheet, way=_way_above(every, sheet.at)))
        rest = [line for line in rest if line[0] >= end] if end else []
    for at, sheet in enumerate(found[1:], start=1):
        before = found[at - 1].rows[-1][0] if found[at - 1].rows else found[at - 1].at
        above = [line for line in every if before < line[0] < sheet.at]
        found[at] = replace(sheet, said={**_said(above), **sheet.said})
        if len(found) > MOST_TABLES or {one.way for one in found} != {"up", "down"}:
            raise FileFormatError("E-FILE-CSV-SECOND", where, line=sheet.at)
    return tuple(found)


def lines_before(text: str, separator: str, needed: int, *, target: int, reading: int) -> int:
    """How many lines stand above the first row: the first with ``needed`` cells and a number as its target.

    ``target`` and ``reading`` are columns from 1. A line directly above it with a number as its reading is a row whose
    target cannot be read, no heading: it counts, so that whoever reads it refuses it. 1 where no line is such a row.
    """
    before: tuple[int, list[str]] = (0, [])
    for at, line in enumerate(_BREAK.split(text, MOST_PREAMBLE)[:MOST_PREAMBLE], start=1):
        if not line.strip() or _passed_over(line):
            continue
        mark = separator or next((one for one in MARKS if one in line), "")
        row = cells(line, mark)
        if not separator and mark == "," and len(row) < needed:
            row = line.split()
        if len(row) < needed:
            continue
        if like_number(row[target - 1]):
            near = before[0] == at - 1 and before[1]
            return before[0] - 1 if near and like_number(before[1][reading - 1]) else at - 1
        before = (at, row)
    return 1


def declared_sheet(text: str, skip: int, separator: str, needed: int) -> Sheet:
    """A table by what a person said of it: ``skip`` lines above its rows, the last of them its heading."""
    every = list(enumerate(_BREAK.split(text), start=1))
    lines = [(at, line) for at, line in every[skip:] if line.strip() and not _passed_over(line)]
    if not separator and lines:
        found = next((mark for mark in MARKS if all(mark in line for _at, line in lines)), "")
        few = any(len(line.split()) < needed for _at, line in lines)
        separator = found if found != "," or few else ""
    rows = tuple((at, tuple(cells(line, separator))) for at, line in lines)
    heads: list[str] = []
    for _at, line in every[max(skip - MOST_HEADS, 0) : skip]:
        own = cells(line.lstrip("# \t") if line.lstrip().startswith("#") else line, separator)
        if len(own) > 1 or needed < 2:
            width = max(len(own), len(heads))
            both = zip(own + [""] * (width - len(own)), heads + [""] * (width - len(heads)), strict=True)
            heads = [f"{old} {new}".strip() if is_way_or_unit(new) else new or old for new, old in both]
    return Sheet(skip, separator=separator, heads=tuple(heads), rows=rows, said=words_above(text, skip))


def _first_sheet(every: Sequence[tuple[int, str]], understands: Understands) -> tuple[Sheet, int] | None:
    """The first table, and the line where a further heading stands (0: nowhere)."""
    lines = [(at, line) for at, line in every if not _passed_over(line)]
    remarks = [(at, line.lstrip("# \t")) for at, line in every[:MOST_LINES] if line.lstrip().startswith("#")]
    for index in range(min(len(lines), MOST_LINES)):
        found = _headed(lines, index, understands)
        if found is not None:
            above = [(at, line) for at, line in remarks if at < found[0].at]
            return replace(found[0], said={**_said(above), **found[0].said}), found[1]
    for at, line in remarks:
        found = _headed([(at, line), *(one for one in lines if one[0] > at)], 0, understands)
        if found is not None:
            return found
    return None


def _way_above(every: Sequence[tuple[int, str]], at: int) -> str:
    """The way that the nearest words above a heading name, "" where they name none."""
    above = [line for number, line in every if number < at and line.strip() and not _RULE.match(line.strip())]
    for line in reversed(above[-MOST_TITLES:]):
        if sum(like_number(cell) for cell in re.split(r"[;\t|,\s]+", line) if cell) > 1:
            return ""
        if way := way_in(line):
            return way
    return ""


def heading_of(text: str) -> tuple[int, str]:
    """Line number and text of what is most likely a table's heading: the last words above the first numbers."""
    best = (1, "")
    for at, line in list(enumerate(_BREAK.split(text), start=1))[:MOST_LINES]:
        if _passed_over(line) or not line.strip():
            continue
        numbers = sum(like_number(cell) for cell in re.split(r"[;\t|,\s]+", line) if cell)
        if best[1] and numbers > 1:
            break
        best = (at, line.strip())
    return best


def _passed_over(line: str) -> bool:
    """Remarks, rules between heading and rows, and a spreadsheet's word about its separator."""
    text = line.strip()
    return text.startswith("#") or bool(_SEPARATED.match(text)) or (len(text) > 1 and bool(_RULE.match(text)))


def _headed(lines: Sequence[tuple[int, str]], index: int, understands: Understands) -> tuple[Sheet, int] | None:
    at, line = lines[index]
    separator = next((mark for mark in MARKS if mark in line), "")
    heads = _trimmed(cells(line, separator))
    if len(heads) < FEWEST_TURNED or (not separator and _is_remark(heads)):
        return None
    under = cells(lines[index + 1][1], separator) if index + 1 < len(lines) else []
    both = _merged(heads, under)
    for head, body in ((both, index + 2), (heads, index + 1)):
        column = understands(head) if head else None
        if column is not None:
            rows, notes, end = _rows(lines[body:], separator, (head, column), understands)
            said = _said(lines[:index])
            return Sheet(at, separator=separator, heads=head, rows=rows, said=said, notes=notes), end
    after = [cells(text, separator) for _at, text in lines[index + 1 :]]
    turned = _annex(heads, after, _unit_above(lines[:index])) or _turned(heads, list(enumerate(after)))
    if turned and understands(turned[0]) is not None:
        rows = tuple((at, row) for row in turned[1:])
        return Sheet(at, separator=separator, heads=turned[0], rows=rows, said=_said(lines[:index])), 0
    return None


def _is_remark(words: Row) -> bool:
    """Whether words between blanks are a sentence: "deviation = measured - target", "Sign: target minus actual"."""
    return "=" in words or sum(word.endswith(":") for word in words) == 1


def _trimmed(row: list[str]) -> Row:
    """Without the empty cells at the end that spreadsheets write."""
    while row and not row[-1]:
        row.pop()
    return tuple(row)


def _merged(upper: Row, lower: Sequence[str]) -> Row:
    """A heading of two lines as one: units or directions stand under (or over) the names, over several columns once."""
    lower = _trimmed(list(lower))
    width = max(len(upper), len(lower))
    top, low = [*upper, *[""] * (width - len(upper))], [*lower, *[""] * (width - len(lower))]
    words = [cell for cell in low if cell]
    if not words or like_number(low[0]):
        return ()
    above, below = ([is_way_or_unit(cell) or names_run(cell) for cell in row if cell] for row in (top[1:], low[1:]))
    if not all(below) and not all(above):
        return ()
    for column in range(2, width):
        top[column] = top[column] or (top[column - 1] if low[column] and pass_of_text(top[column - 1]) else "")
    return tuple(f"{one} {other}".strip() for one, other in zip(top, low, strict=True))


def _rows(
    lines: Sequence[tuple[int, str]], separator: str, heading: tuple[Row, int], understands: Understands
) -> tuple[tuple[tuple[int, Row], ...], tuple[Message, ...], int]:
    """Rows of readings, a note of what stands below them, and the line of a further heading (0: there is none)."""
    heads, column = heading
    rows: list[tuple[int, Row]] = []
    aside: list[int] = []
    below, end = False, 0
    for at, line in lines:
        row = cells(line, separator)
        while len(row) > len(heads) and not row[-1]:
            row.pop()
        if not any(row) and line.strip(f"{separator} \t") == "":
            below = bool(rows)
            continue
        known = like_number(row[column]) if column < len(row) else False
        first = next((cell for cell in row if cell), "")
        if rows and not known and (below or is_statistic(first)):
            if understands(_trimmed(list(row))) is not None or tuple(row) == heads:
                end = at
                break
            aside.append(at)
            continue
        rows.append((at, tuple(row)))
    notes = (Message.of("S-FILE-BELOW", count=len(aside), line=aside[0]),) if aside else ()
    return tuple(rows), notes, end


def _turned(heads: Row, rows: Sequence[tuple[int, list[str]]]) -> tuple[Row, ...]:
    """A table with the targets in its heading and a pass in each row, turned over; () where it is none."""
    numbers = [like_number(cell) for cell in heads]
    names = numbers.index(True) if True in numbers else 0
    if not names or sum(numbers) < FEWEST_TURNED or not all(numbers[names:]):
        return ()
    kept = []
    for _at, row in rows:
        if not any(row):
            break
        if len(_trimmed(list(row))) > len(heads) or len(row) < len(heads):
            return ()
        kept.append(row[: len(heads)])
    if not kept or not all(pass_of_text(" ".join(row[:names])) for row in kept):
        return ()
    title = heads[0] if names == 1 else "target"
    head = (title, *(" ".join(cell for cell in row[:names] if cell) for row in kept))
    return (head, *((heads[at], *(row[at] for row in kept)) for at in range(names, len(heads))))


def _annex(heads: Row, rows: Sequence[list[str]], unit: str) -> tuple[Row, ...]:
    """A table as the standard's annex has it, turned over: targets in the heading, under them ways, then a run a row.

    A target may stand once over both its ways. () where it is none, or where a way stands twice under a target.
    """
    ways = [_way_in(cell) for cell in _trimmed(list(rows[0]))[1:]] if rows else []
    if len(ways) < FEWEST_TURNED or None in ways or not heads[0]:
        return ()
    targets: list[str] = []
    for cell in (*heads[1:], *[""] * (len(ways) - len(heads) + 1)):
        targets.append(cell or (targets[-1] if targets else ""))
    if len(targets) != len(ways) or not all(like_number(cell) for cell in targets):
        return ()
    named_runs = [bool(row) and names_run(row[0]) for row in rows[1:]]
    count = named_runs.index(False) if False in named_runs else len(named_runs)
    if any(named_runs[count:]) or any(len(_trimmed(list(row))) > 1 + len(ways) for row in rows[1 : 1 + count]):
        return ()  # what stands apart, or beyond the ways, would be lost
    runs = [[*row, *[""] * (1 + len(ways) - len(row))] for row in rows[1 : 1 + count]]
    at = {key: place for place, key in enumerate(zip(targets, ways, strict=True), start=1)}
    if not runs or len(at) != len(ways):
        return ()
    both = sorted({way for way in ways if way is not None})
    named = [f"{number} {'-' if way else '+'} {unit}".strip() for number in range(1, len(runs) + 1) for way in both]
    body = [
        (target, *(run[at[target, way]] if (target, way) in at else "" for run in runs for way in both))
        for target in dict.fromkeys(targets)
    ]
    return ((heads[0], *named), *body)


def _way_in(cell: str) -> int | None:
    return DIRECTIONS.get(cell.lower())


def _unit_above(lines: Sequence[tuple[int, str]]) -> str:
    """The unit of readings that one title names in brackets: "Positional deviation (µm)"; "" where none, or two, do."""
    cut = [head_cell(line.strip(" ;,\t|")) for _at, line in lines[:MOST_WORDS]]
    units = {one.unit for one in cut if one.unit in READING_UNITS and "deviation" in one.words}
    return f"[{units.pop()}]" if len(units) == 1 else ""


def words_above(text: str, count: int) -> Mapping[str, str]:
    """What a file states about itself in its first ``count`` lines: "Machine: Mill 7"."""
    return _said([(at, line.lstrip("# \t")) for at, line in enumerate(_BREAK.split(text, count + 1)[:count], start=1)])


def _said(lines: Sequence[tuple[int, str]]) -> Mapping[str, str]:
    """What a file says of itself above its table: "Machine: Mill 7"."""
    found: dict[str, str] = {}
    for _at, line in lines[:MOST_WORDS]:
        pair = _WORDS.match(line)
        value = pair[2].strip(' ";,\t|')[:LONGEST_WORD] if pair else ""
        if pair and value:
            name = pair[1].strip(' "|')
            found.setdefault(CALLED.get(name.lower().rstrip("."), name), value)
    return found
