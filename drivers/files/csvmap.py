"""Tables of readings in text or a workbook: heading and declared columns to readings, and those to a measured set."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from math import isnan, nan
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError, FileFormatError
from drivers.files.assembly import assembled
from drivers.files.columns import ColumnMap
from drivers.files.csvtext import table_text
from drivers.files.numbers import decimal, like_number, missing, whole
from drivers.files.readings import Reading, Readings, Rows
from drivers.files.signature import signature_of
from drivers.files.tables.heading import table_heading
from drivers.files.tables.headwords import DIRECTIONS, head_cell
from drivers.files.tables.indexed import indexed, is_indexed
from drivers.files.tables.layout import NONE, Layout, layout, no_heading, understood_as
from drivers.files.tables.order import by_order, by_steps, counted
from drivers.files.tables.plain import MOST_REPETITIONS, plain_table
from drivers.files.tables.sheet import COMMA, Row, Sheet, declared_sheet, heading_of, lines_before, sheets_of
from drivers.files.tables.statements import Concern, lines_above, lines_around, remarks
from drivers.files.text import end_doubts, other_texts, plain_minus, read_bytes
from drivers.files.workbook import is_workbook, workbook_text
from drivers.local.textfile import decode_text
from drivers.message import Message
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet, TableHeading
from drivers.units import (
    READING_UNITS,
    TARGET_UNITS,
    deg_to_arcsec,
    deviation_scale,
    deviation_unit,
    typed_unit,
    unit_named,
)

ONE_WAY = ("runs", "up", "down")
AGREE_UM, NEARLY = 1.0, 0.01
"""Positions and deviations of one row may differ by so much, um or arcsec, and by a hundredth: rounding."""
OF_ONE_TEST = ("Machine", "Serial No", "Axis", "Date")
"""What the two parts of one test state alike; of the date the year."""
_YEAR = re.compile(r"(?<!\d)(?:19|20)\d\d(?!\d)")
OTHER_WAY = {"up": "down", "down": "up"}
WAY = {"up": 0, "down": 1}


class CsvFormat:
    """File driver "csv": one row a reading, or a column for each pass, in text (.csv, .txt, .dat, .tsv) or a workbook.

    Every unit comes from the heading, from ``unit`` (of the readings) or from ``columns`` (see `ColumnMap`): there is
    no unit that nobody named. Where ``columns`` names targets and readings, no heading is needed for them; else it says
    what they leave open. ``mixed`` lets angles stand over mm (pitch) and um over deg (run-out).
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
        if unit and unit not in READING_UNITS:
            raise ConfigError("E-FILE-UNIT", "csv", unit=unit, known=", ".join(READING_UNITS))
        said = ColumnMap.read(columns or {}, "csv", mixed=mixed)
        self._said = replace(said, reading_unit=said.reading_unit or unit)
        self._codepage = codepage
        self._mixed = mixed

    def read(self, path: Path) -> MeasuredSet:
        """Read a file, by the declared columns if there are any. Raises FileFormatError with line and reason."""
        if not self._said.beside:
            found, text = self._readings(path, self._said)
            return measured_of(found, text, self._said, str(path))
        other = path.parent / self._said.beside
        ways = OTHER_WAY.get(self._said.ways, "")
        turned = replace(
            self._said,
            passes=ways if self._said.passes else "",
            direction="" if self._said.passes else ways or self._said.direction,
        )
        one, text = self._readings(path, self._said)
        two, _text = self._readings(other, turned)
        both = _together(one, two, str(path), str(other))
        digest = hashlib.sha256(read_bytes(other)).hexdigest()
        return measured_of(both, text, self._said, str(path), beside={"Beside": f"{other.name} {digest}"})

    def _readings(
        self, path: Path, said: ColumnMap
    ) -> tuple[tuple[Readings, Mapping[str, str], tuple[Message, ...]], str]:
        where = str(path)
        texts = self._texts(path)
        first = next(texts)
        try:
            return readings_of(first, said, where, mixed=self._mixed), first
        except FileFormatError as error:
            if error.code != "E-FILE-CSV-HEADER":
                raise
            # A heading that nobody understands may be in another country's code page.
            for other in texts:
                if sheets_of(other, lambda heads: understood_as(heads, said), where):
                    return readings_of(other, said, where, mixed=self._mixed), other
            raise

    def _texts(self, path: Path) -> Iterator[str]:
        data = read_bytes(path)
        if is_workbook(path, data):
            yield workbook_text(data, self._said, str(path))
            return
        yield from self._likely(data, str(path))

    def _likely(self, data: bytes, where: str) -> Iterator[str]:
        """The text by each code page that it may have, one in which its heading is understood before the others."""
        first = plain_minus(decode_text(data, self._codepage, where))
        others = tuple(map(plain_minus, other_texts(data)))
        del data  # a large file is not held twice
        every = (first, *others)
        best = next((text for text in every if self._named(text)), first) if others else first
        yield best
        yield from (text for text in every if text is not best)

    def _named(self, text: str) -> bool:
        """Whether a heading names the targets, or the units of the declared columns."""
        if table_heading(text) is not None:
            return True
        heads = _declared(text, self._said).heads if self._said.whole else ()
        wanted = (self._said.target - 1, self._said.reading - 1)
        return bool(heads) and max(wanted) < len(heads) and all(unit_named(head_cell(heads[at]).unit) for at in wanted)

    def signature(self, path: Path) -> str:
        """What tables of the same layout have in common, "" for one without a heading. Raises FileFormatError."""
        data = read_bytes(path)
        if is_workbook(path, data):
            return signature_of(workbook_text(data, self._said, str(path), any_sheet=True))
        return signature_of(decode_text(data, self._codepage, str(path)))

    def heading(self, path: Path) -> TableHeading | None:
        """Every column of the first table by its heading, None where no heading names targets."""
        data = read_bytes(path)
        if is_workbook(path, data):
            return table_heading(workbook_text(data, self._said, str(path), any_sheet=True))
        return table_heading(next(self._likely(data, str(path))))

    def text(self, measured: MeasuredSet) -> str:
        """A measured set as a table that `read` understands and a spreadsheet does not take for formulas."""
        return table_text(measured)


Found = tuple[Readings, Mapping[str, str], tuple[Message, ...]]
"""Readings, what their file says of itself, and notes."""


def parse_csv(text: str, said: ColumnMap, where: str, *, mixed: bool = False) -> MeasuredSet:
    """A whole text, pure. Every (target, direction, repetition) may occur once; missing ones are NaN."""
    return measured_of(readings_of(text, said, where, mixed=mixed), text, said, where)


def measured_of(
    found: Found, text: str, said: ColumnMap, where: str, *, beside: Mapping[str, str] | None = None
) -> MeasuredSet:
    """Readings as a record, with the notes of their text."""
    readings, words, notes = found
    header = {**words, **(beside or {}), "Unit": readings.unit}
    header |= {"Stated unit": words["Unit"]} if words.get("Unit", "").strip() else {}
    header |= {"Reading": readings.quantity} if readings.quantity != "deviation" else {}
    header |= {"Columns": said.told()} if said.told() else {}
    comma = tuple(one for one in notes if one == COMMA)
    rest = tuple(one for one in notes if one not in comma)
    measured = assembled(readings, where, header=header, warnings=(*rest, *end_doubts(text)), confirmed=said.confirmed)
    return replace(measured, warnings=(*comma, *measured.warnings))


def readings_of(text: str, said: ColumnMap, where: str, *, mixed: bool = False) -> Found:
    """The readings of every table of a text as one set. Raises FileFormatError as `layout`, E-FILE-CSV-HEADER."""
    if is_indexed(text) and not said.whole:
        unit, indexed_rows = indexed(text, where)
        unit = unit or said.reading_unit or said.target_unit
        if not unit:
            raise FileFormatError("E-FILE-CSV-UNIT", where, found="TGT_DATA", columns="target_unit=mm reading_unit=mm")
        rows = tuple(Reading(at, key[0], key[1], run=key[2], value=value) for at, key, value in indexed_rows)
        own = Readings("position", unit, unit, Rows.of(rows), datum=said.datum, scale=said.scale)
        return _with_remarks((own, {}, ()), lines_around(text, {row.line for row in rows}), said, where)
    plain = plain_table(text, said, where, mixed=mixed)
    if plain is not None:
        chosen, sheet, columns = plain
        return _with_remarks(
            _found(chosen, sheet, said, where, columns, mixed=mixed), lines_above(text, sheet.at), said, where
        )
    if said.whole:
        sheets: tuple[Sheet, ...] = (_declared(text, said),)
    else:
        sheets = sheets_of(text, lambda heads: understood_as(heads, said), where)
    if not sheets:
        at, found = heading_of(text)
        bare = all(like_number(cell) for cell in found.replace(",", " ").split())
        raise no_heading(declared_sheet(text, 0 if bare else at, "", 2), found, where)
    if not any(sheet.rows for sheet in sheets):
        raise FileFormatError("E-FILE-ROWS", where)
    parts = [_of_sheet(sheet, said, where, text, mixed=mixed) for sheet in sheets]
    if len(parts) == 1:
        return parts[0]
    return _joined(parts[0], parts[1], where)


def _declared(text: str, said: ColumnMap) -> Sheet:
    """The table of declared columns, behind whatever a program wrote above it."""
    skip = said.skip
    if skip < 0:
        skip = lines_before(text, said.separator, said.needed, target=said.target, reading=said.reading)
    return declared_sheet(text, skip, said.separator, said.needed)


def _of_sheet(sheet: Sheet, said: ColumnMap, where: str, text: str, *, mixed: bool) -> Found:
    found, plain = layout(sheet, said, where, mixed=mixed)
    rows, notes = _rows(plain, found, where, cut=_cut_line(text))
    own = {sheet.at, *(at for at, _row in sheet.rows)}
    readings, words, more = _with_remarks(
        _found(found, plain, said, where, Rows.of(rows), mixed=mixed), lines_around(text, own), said, where
    )
    if not found.passes and found.columns[1] != NONE and _against_the_order(rows):
        doubt = Doubt("S-READ-DIRECTION", where, blocking=True, names={"line": str(rows[0].line)})
        readings = replace(readings, doubts=(*readings.doubts, doubt))
    return readings, words, (*notes, *more)


def _with_remarks(found: Found, lines: Iterable[tuple[int, str]], said: ColumnMap, where: str) -> Found:
    """The same with a doubt about each line around a table that a person did not settle."""
    readings, words, notes = found
    said_of: dict[Concern, bool] = {"factor": said.factor != 0.0, "sign": said.sense < 0, "zero": said.datum != 0.0}
    settled = [concern for concern, known in said_of.items() if known]
    units = (readings.target_unit, readings.unit)
    own = remarks(lines, where, settled=settled, units=units, confirmed=said.confirmed)
    return replace(readings, doubts=(*readings.doubts, *own)), words, notes


def _against_the_order(rows: Sequence[Reading]) -> bool:
    """Whether every pass goes the other way in the file than its direction says: up downwards, and down upwards.

    A table that is sorted tells no order, nor does one whose passes are mixed up; one direction alone may have been
    turned over by a spreadsheet.
    """
    ways: dict[tuple[int, int], list[float]] = {}
    for (way, run), own in groupby(rows, key=lambda row: (row.approach, row.run)):
        if (way, run) in ways:
            return False
        ways[way, run] = [row.target for row in own]
    steps = {
        way: [
            (b - a) * (1 if way == 0 else -1) for (side, _), at in ways.items() if side == way for a, b in pairwise(at)
        ]
        for way in (0, 1)
    }
    return all(steps[way] and all(step < 0.0 for step in steps[way]) for way in (0, 1))


def _found(found: Layout, plain: Sheet, said: ColumnMap, where: str, rows: Rows, *, mixed: bool) -> Found:
    readings = Readings(
        found.quantity,
        found.unit,
        found.target_unit,
        rows,
        axis=plain.said.get("Axis", ""),
        datum=said.datum,
        scale=said.scale,
        mixed=mixed,
        doubts=(Doubt("S-READ-COLUMNS", where, names={"columns": ", ".join(found.aside)}),) if found.aside else (),
    )
    return readings, plain.said, plain.notes


def _cut_line(text: str) -> int:
    """The number of a last line that has no end, 0 where it has: there a missing reading may be a file cut short."""
    if text.endswith(("\n", "\r")):
        return 0
    return text.replace("\r\n", "\n").replace("\r", "\n").count("\n") + 1


# -------------------------------------------------------------------------------------------------- two parts as one


def _joined(one: Found, other: Found, where: str) -> Found:
    """Two tables of opposite ways as one set. Raises FileFormatError (E-FILE-BESIDE) where they do not fit."""
    (first, words, notes), (second, more, others) = one, other
    units = [(part.quantity, part.unit, part.target_unit) for part in (first, second)]
    ways = [set(np.unique(part.rows.approach).tolist()) for part in (first, second)]
    places = [set(part.rows.target.tolist()) for part in (first, second)]
    if units[0] != units[1]:
        raise FileFormatError(
            "E-FILE-BESIDE", where, why=Message.of("W-FILE-HOLD-APART", units=_named(units[0]), units2=_named(units[1]))
        )
    if ways[0] & ways[1] or len(ways[0] | ways[1]) != len(WAY):
        raise FileFormatError("E-FILE-BESIDE", where, why=Message.of("W-FILE-NOT-OPPOSITE"))
    if places[0] != places[1]:
        apart = ", ".join(f"{place:g}" for place in sorted(places[0] ^ places[1])[:5])
        raise FileFormatError("E-FILE-BESIDE", where, why=Message.of("W-FILE-ONE-HAS-TARGETS", apart=apart))
    for key in OF_ONE_TEST:
        stated = [_plain(key, part[key]) for part in (words, more) if part.get(key)]
        if len(set(stated)) > 1:
            why = Message.of("W-FILE-STATE-APART", key=key, words=words[key], more=more[key])
            raise FileFormatError("E-FILE-BESIDE", where, why=why)
    doubts = tuple(dict.fromkeys(first.doubts)) if first.doubts == second.doubts else (*first.doubts, *second.doubts)
    both = replace(first, rows=first.rows.and_then(second.rows), doubts=doubts)
    return both, {**more, **words}, tuple(dict.fromkeys((*notes, *others)))


def _plain(key: str, text: str) -> str:
    """What must be the same of a statement: of a date the year, of anything else its words."""
    years = _YEAR.findall(text) if key == "Date" else []
    return " ".join(years or ([] if key == "Date" else text.casefold().split()))


def _named(units: tuple[str, str, str]) -> str:
    quantity, unit, target_unit = units
    return f"{quantity}s in {unit} over {target_unit}"


def _together(one: Found, other: Found, where: str, beside: str) -> Found:
    return _joined(one, other, f"{where} and {beside}")


# --------------------------------------------------------------------------------------------------------------- rows


def _wrong(where: str, line: int, why: str | Message) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)


def _rows(sheet: Sheet, found: Layout, where: str, *, cut: int) -> tuple[list[Reading], tuple[Message, ...]]:
    """Every reading, NaN where a cell says that there is none, and a note of what the order alone told."""
    needed = 1 + max(*found.columns, *found.read)
    for at, row in sheet.rows:
        if len(row) < needed:
            raise _wrong(where, at, Message.of("W-FILE-COLUMN-NEEDED", count=len(row), needed=needed))
        if found.width and len(row) != found.width:
            raise _wrong(where, at, Message.of("W-FILE-HEADER-WIDTH", count=len(row), width=found.width))
    if found.passes:
        return [one for at, row in sheet.rows for one in _of_passes(row, found, at, where)], ()
    rows = [_of_row(row, found, at, where, cut=cut) for at, row in sheet.rows]
    notes: tuple[Message, ...] = ()
    if found.columns[1] == NONE:
        rows, notes = _with_ways(rows, found, sheet, where)
    if found.columns[2] == NONE and not notes:
        numbers = counted([(row.target, row.approach) for row in rows])
        rows = [replace(row, run=number) for row, number in zip(rows, numbers, strict=True)]
    return rows, notes


def _with_ways(
    rows: list[Reading], found: Layout, sheet: Sheet, where: str
) -> tuple[list[Reading], tuple[Message, ...]]:
    """Directions that no column tells: as a person said, or by the order of the rows."""
    if found.ways == "runs" and found.columns[2] != NONE:
        return [replace(row, approach=(row.run + 1) % 2) for row in rows], ()
    if found.ways in WAY:
        return [replace(row, approach=WAY[found.ways]) for row in rows], ()
    targets = [row.target for row in rows]
    if found.ways == "order":
        kind, scale = TARGET_UNITS[found.target_unit]
        ways = by_steps(targets, 360.0 / scale if kind == "deg" else 0.0)
        if isinstance(ways, int):
            why = Message.of("W-FILE-ORDER-UNSAID")
            raise _wrong(where, rows[ways].line, why)
        return [replace(row, approach=way) for row, way in zip(rows, ways, strict=True)], ()
    told = by_order(targets)
    if told is None:
        raise FileFormatError("E-FILE-CSV-RUNS", where, found=", ".join(sheet.heads)[:80])
    rows = [replace(row, approach=way, run=number) for row, (way, number) in zip(rows, told, strict=True)]
    return rows, (Message.of("S-FILE-ORDER"),)


def _of_passes(row: Row, found: Layout, at: int, where: str) -> list[Reading]:
    """One reading of each pass."""
    target = _target(row, found, at, where)
    return [
        Reading(at, target, way, run=number, value=_value(row[column], found, at, where, cut=0))
        for column, way, number in found.passes
    ]


def _target(row: Row, found: Layout, at: int, where: str) -> float:
    target = decimal(row[found.columns[0]])
    if target is None:
        raise _wrong(where, at, Message.of("W-FILE-NO-TARGET", row=row[found.columns[0]]))
    return float(target)


def _value(cell: str, found: Layout, at: int, where: str, *, cut: int) -> float:
    """A reading; NaN where the cell says that there is none, unless it may be where the file was cut."""
    value = decimal(cell)
    if value is None and (not missing(cell) or (at == cut and not cell.strip("-"))):
        raise _wrong(where, at, Message.of("W-FILE-NOT-A", cell=cell, quantity=found.quantity))
    return nan if value is None else float(value)


def _of_row(row: Row, found: Layout, at: int, where: str, *, cut: int) -> Reading:
    """The reading of a row; way and run are 0 where no column tells them."""
    target = _target(row, found, at, where)
    way_text, run_text = (row[column] if column != NONE else "" for column in found.columns[1:3])
    way = DIRECTIONS.get(way_text.lower()) if found.columns[1] != NONE else 0
    run = whole(run_text) if found.columns[2] != NONE else 0
    if way is None:
        raise _wrong(where, at, Message.of("W-FILE-NO-DIRECTION", way_text=way_text))
    if run is None or run >= MOST_REPETITIONS:
        raise _wrong(where, at, Message.of("W-FILE-NO-REPETITION", run_text=run_text))
    value = _value(row[found.columns[3]], found, at, where, cut=cut)
    if found.beside != NONE and not isnan(value):
        _agree(row, found, (target, value), at, where)
    return Reading(at, target, way, run=run, value=value)


def _agree(row: Row, found: Layout, read: tuple[float, float], at: int, where: str) -> None:
    """Where a row has position and deviation, they say the same; else the table counts the other way round.

    Raises FileFormatError (E-FILE-LINE).
    """
    position = decimal(row[found.beside])
    kind, scale = TARGET_UNITS[found.target_unit]
    if position is None or READING_UNITS[found.unit][0] != kind:
        return
    said = read[1] * READING_UNITS[found.unit][1]
    difference = (float(position) - read[0]) * scale * deviation_scale(kind)
    if kind == "deg":
        difference -= float(np.round(difference / deg_to_arcsec(360.0))) * deg_to_arcsec(360.0)
    if abs(said - difference) > AGREE_UM + NEARLY * abs(difference):
        unit = deviation_unit(kind)
        why = Message.of("W-FILE-DISAGREES", said=said, unit=unit, difference=difference)
        raise _wrong(where, at, why)
