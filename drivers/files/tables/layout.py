"""Which column of a table means what, in which unit: by what a person said, else by its heading.

What both leave open is decided by the readings where they leave no doubt (positions lie on their targets,
deviations about zero), else it is asked. There is no unit that nobody named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

from drivers.errors import FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.numbers import decimal
from drivers.files.readings import Quantity
from drivers.files.tables.headwords import (
    INCH_OR_ARCSEC,
    PLACES,
    HeadCell,
    HeadPass,
    Meaning,
    head_cell,
    is_index,
    is_statistic,
    pass_of,
    run_of,
)
from drivers.files.tables.order import PASSES, pass_in
from drivers.files.tables.sheet import Row, Sheet
from drivers.message import Message
from drivers.units import READING_UNITS, TARGET_UNITS, typed_unit, unit_named

COLUMNS = ("target", "direction", "repetition", "deviation")
MOST_ALONE = 2  # a single column beside the targets is no table of passes
ALONE_UNITS = {"um", "nm", "uin", "arcsec", "urad", "mrad"}
NEAR = 0.01
"""Of the targets' span: readings all within it of their targets are positions, within it of zero deviations."""
NONE = -1
ROW_WORDS: tuple[Meaning, Meaning] = ("direction", "repetition")
OPEN = ""


@dataclass(frozen=True, slots=True)
class Layout:
    """A table understood: ``columns`` are those of target, direction, repetition and reading, from 0; -1: none.

    A table with a column for each pass has ``passes``: (column, way, number) each; of ``columns`` the target's counts
    then. ``beside`` is a column of positions beside deviations, -1: none. Units are those of `TARGET_UNITS`. ``width``
    is how many cells a row has, 0: at least as many as are needed. ``aside`` are headings of columns not read.
    """

    columns: tuple[int, int, int, int]
    quantity: Quantity
    target_unit: str
    unit: str
    ways: str = ""
    passes: tuple[tuple[int, int, int], ...] = ()
    beside: int = NONE
    width: int = 0
    aside: tuple[str, ...] = ()

    @property
    def read(self) -> tuple[int, ...]:
        """The columns that hold numbers of the result."""
        own = [column for column, _way, _number in self.passes] or [self.columns[3]]
        return (self.columns[0], *own, *((self.beside,) if self.beside != NONE else ()))


def understood(heads: Row) -> int | None:
    """The column of the targets where a heading names what it must, or leaves nothing open but a way or a unit."""
    return understood_as(heads, ColumnMap())


def understood_as(heads: Row, said: ColumnMap) -> int | None:
    """The same where a person said some of it."""
    cells = [head_cell(cell) for cell in heads]
    if len(cells) < said.needed:
        return None
    if not said.reading and (_passes(cells) or _runs(cells)):
        return _target(cells)
    found = _places(cells, said)
    if len(found.get("target", ())) != 1 or any(len(found.get(one, ())) > 1 for one in ("direction", "repetition")):
        return None
    named = found.get("deviation") or found.get("position") or said.reading
    return found["target"][0] if named or _unnamed(cells, found) else None


def layout(sheet: Sheet, said: ColumnMap, where: str, *, mixed: bool = False) -> tuple[Layout, Sheet]:
    """The table's layout, and the sheet with the numbers of its columns written plainly.

    ``mixed`` lets angles stand over lengths and lengths over angles. Raises FileFormatError: E-FILE-CSV-WAYS where
    passes do not say their way, E-FILE-CSV-UNIT where targets or readings have no unit, or no value that tells
    positions from deviations, E-FILE-CSV-SEVERAL where several columns may be the readings, E-FILE-CSV-CONTRADICTS
    where the heading names another unit than was declared, E-FILE-CSV-MARKS, E-FILE-LINE.
    """
    heads = [head_cell(cell) for cell in sheet.heads]
    heads += [HeadCell("", "", "")] * (said.needed - len(heads))
    chosen = _by_passes(heads, sheet, said, where) if said.reading and not (said.whole or said.passes) else None
    if chosen is not None and said.reading - 1 in chosen.read:
        found = replace(chosen, quantity=cast(Quantity, said.quantity))
    elif said.whole or said.reading:
        found = _declared(heads, sheet, said, where)
    else:
        found = _by_passes(heads, sheet, said, where) or _by_row(heads, sheet, said, where)
    if said.run and not found.passes:
        found = replace(found, columns=(*found.columns[:2], said.run - 1, found.columns[3]))
    if said.direction_column and not found.passes:
        found = replace(found, columns=(found.columns[0], said.direction_column - 1, *found.columns[2:]))
    plain = sheet.spelled(found.read, where, comma=said.decimal_comma)
    found = _with_units(found, (heads, plain, said), where)
    apart = READING_UNITS[found.unit][0] != TARGET_UNITS[found.target_unit][0]
    if apart and not (mixed and found.quantity == "deviation"):
        raise _wrong(
            where,
            sheet.at,
            Message.of("W-FILE-UNITS-APART", target_unit=found.target_unit, quantity=found.quantity, unit=found.unit),
        )
    return found, plain


def told_by_heading(sheet: Sheet, found: Layout, said: ColumnMap) -> bool:
    """Whether columns for target, way, run and reading, and their units, are told by the heading alone, not by rows."""
    heads = [head_cell(cell) for cell in sheet.heads]
    if found.passes or found.beside != NONE or found.ways or NONE in found.columns:
        return False
    units = all(unit_named(heads[column].unit) for column in (found.columns[0], found.columns[3]))
    named = heads[found.columns[3]].meaning in ("deviation", "position")
    return units and named and not _unnamed(heads, _places(heads, said))


# ------------------------------------------------------------------------------------------------ which column is what


def _places(heads: list[HeadCell], said: ColumnMap) -> dict[Meaning, list[int]]:
    """The columns of each meaning, what a person said before what the heading says."""
    places: dict[Meaning, list[int]] = {}
    for index, head in enumerate(heads):
        places.setdefault(head.meaning, []).append(index)
    alone = places.get("position", [])
    other = "deviation" in places or (said.reading and alone != [said.reading - 1]) or _instruments(heads)
    if "target" not in places and len(alone) == 1 and heads[alone[0]].words in PLACES and other:
        places["target"] = places.pop("position")
    for meaning, column in (("target", said.target), ("direction", said.direction_column), ("repetition", said.run)):
        if column:
            places[cast(Meaning, meaning)] = [column - 1]
    return places


def _instruments(heads: list[HeadCell]) -> bool:
    """Whether a column with a unit of a length or angle has a name that is none of the known words."""
    return any(not head.meaning and unit_named(head.unit) and not is_statistic(head.words) for head in heads)


def _unnamed(heads: list[HeadCell], places: dict[Meaning, list[int]]) -> list[int]:
    """Columns that no known word names and that have a unit of a length or angle: instruments by their own names."""
    if any(pass_of(head) is not None or run_of(head) for head in heads):
        return []
    free = [one for one in places.get("", []) if one not in places.get("target", ())]
    return [one for one in free if unit_named(heads[one].unit) and not is_statistic(heads[one].words)]


def _declared(heads: list[HeadCell], sheet: Sheet, said: ColumnMap, where: str) -> Layout:
    """The layout where a person named the column of the readings; the heading may name the others."""
    places = _places(heads, said)
    if len(places.get("target", ())) != 1:
        raise _no_heading(sheet, where)
    target, reading = places["target"][0], said.reading - 1
    named: list[Meaning] = [] if said.whole else ["direction", "repetition"]
    direction, repetition = (
        places[one][0] if one in named and len(places.get(one, ())) == 1 else NONE for one in ROW_WORDS
    )
    columns = (target, direction, repetition, reading)
    quantity = cast(Quantity, said.quantity)
    ways = said.ways or sheet.way
    if said.passes:
        width = max((len(row) for _at, row in sheet.rows), default=0)
        chosen = tuple(range(reading, said.last or width))
        passes = tuple((column, *_way_of(chosen.index(column), chosen, said.passes, sheet, where)) for column in chosen)
        return Layout(columns, quantity, OPEN, OPEN, ways=ways, passes=passes, width=0 if said.last else width)
    return Layout(columns, quantity, OPEN, OPEN, ways=ways, aside=_aside_of(heads, columns))


def _by_passes(heads: list[HeadCell], sheet: Sheet, said: ColumnMap, where: str) -> Layout | None:
    """A table with a column for each pass; None where it is none."""
    passes = _passes(heads)
    runs = () if passes else _runs(heads)
    if runs:
        ways = said.ways or sheet.way
        if ways not in PASSES[1:]:
            raise _open("E-FILE-CSV-WAYS", where, sheet, runs)
        passes = tuple((column, *_way_of(runs.index(column), runs, ways, sheet, where)) for column in runs)
    if not passes:
        return None
    columns = [heads[column] for column, _way, _number in passes]
    if len({one.unit for one in columns}) != 1:
        raise _no_heading(sheet, where)
    words = {given.meaning for one in columns if (given := pass_of(one)) is not None and given.meaning}
    words |= {one.meaning for one in columns if run_of(one) and one.meaning in ("deviation", "position")}
    if len(words) > 1:
        raise _no_heading(sheet, where)
    quantity = cast(Quantity, words.pop() if words else OPEN)
    target = _target(heads) or 0
    return Layout((target, NONE, NONE, passes[0][0]), quantity, OPEN, OPEN, passes=passes, width=len(heads))


def _by_row(heads: list[HeadCell], sheet: Sheet, said: ColumnMap, where: str) -> Layout:
    """A table with one reading a row."""
    places = _places(heads, said)
    if any(len(places.get(one, ())) > 1 for one in ("target", "direction", "repetition")) or "target" not in places:
        raise _no_heading(sheet, where)
    target, direction, repetition = (places.get(one, [NONE])[0] for one in ("target", *ROW_WORDS))
    deviations, positions = places.get("deviation", []), places.get("position", [])
    unnamed = [one for one in _unnamed(heads, places) if _may_hold(sheet, heads, (target, one))]
    if len(deviations) > 1 or len(positions) > 1 or len(unnamed) > 1 or (unnamed and positions):
        raise _several(sheet, (*deviations, *positions, *unnamed), where)
    if not (deviations or positions or unnamed):
        raise _no_heading(sheet, where)
    reading = (deviations or positions or unnamed)[0]
    quantity: Quantity | str = "deviation" if deviations else "position" if positions else OPEN
    columns = (target, direction, repetition, reading)
    beside = (positions or unnamed)[0] if deviations and (positions or unnamed) else NONE
    return Layout(
        columns,
        cast(Quantity, quantity),
        OPEN,
        OPEN,
        ways=said.ways or sheet.way,
        beside=beside,
        width=len(sheet.heads),
        aside=_aside_of(heads, (*columns, beside)),
    )


def _aside_of(heads: list[HeadCell], read: Sequence[int]) -> tuple[str, ...]:
    """Names of columns with a unit of a length or angle that are not read."""
    return tuple(
        head.words or f"column {at + 1}" for at, head in enumerate(heads) if at not in read and unit_named(head.unit)
    )


def _may_hold(sheet: Sheet, heads: list[HeadCell], two: tuple[int, int]) -> bool:
    """Whether a column's numbers are like positions or deviations of the targets."""
    target, column = two
    units = (unit_named(heads[target].unit) or unit_named(heads[column].unit), unit_named(heads[column].unit))
    try:
        plain = sheet.spelled((target, column), "")
    except FileFormatError:
        return True
    return bool(_by_values(plain, target, (column,), units))


def _way_of(place: int, runs: Sequence[int], ways: str, sheet: Sheet, where: str) -> tuple[int, int]:
    """Way and number of the pass in this place. Raises FileFormatError (E-FILE-LINE) where half a pass is left."""
    if ways in ("alternate", "halves") and len(runs) % 2:
        raise _wrong(where, sheet.at, Message.of("W-FILE-PASSES", count=len(runs)))
    number, way = pass_in(place, len(runs), ways)
    return way, number


def _target(heads: list[HeadCell]) -> int | None:
    """The column of targets before all passes; columns that only count the rows may stand before it."""
    for column, head in enumerate(heads):
        if head.meaning in ("target", "position") and pass_of(head) is None:
            return column
        if not is_index(head):
            return None
    return None


def _passes(heads: list[HeadCell]) -> tuple[tuple[int, int, int], ...]:
    """(column, way, number) where every column after the targets names a pass; without numbers they count as they
    stand. Means and spreads beside them are none."""
    target = _target(heads)
    if target is None:
        return ()
    named = [(column, pass_of(head)) for column, head in enumerate(heads) if column > target and not _aside(head)]
    found: list[tuple[int, HeadPass]] = [(column, one) for column, one in named if one is not None]
    if len(found) < MOST_ALONE or len(found) != len(named):
        return ()
    if any(one.number for _column, one in found):
        # Beside numbered passes a lone "B" is a reversal, not a pass that goes back.
        found = [(column, one) for column, one in found if one.number or not is_statistic(heads[column].words)]
    counted = [one.number > 0 for _column, one in found]
    if any(counted) and not all(counted):
        return ()
    seen = [0, 0]
    passes = []
    for column, one in found:
        seen[one.way] += 1
        passes.append((column, one.way, one.number or seen[one.way]))
    return tuple(passes) if len({(way, number) for _column, way, number in passes}) == len(passes) else ()


def _aside(head: HeadCell) -> bool:
    """Whether a column beside passes holds no readings: worked out of them, or empty."""
    return not head.words or (is_statistic(head.words) and pass_of(head) is None)


def _runs(heads: list[HeadCell]) -> tuple[int, ...]:
    """The columns of passes none of which says its way: "Run 1" to "Run 10"."""
    target = _target(heads)
    if target is None:
        return ()
    numbers = [(column, run_of(head)) for column, head in enumerate(heads) if column > target and not _aside(head)]
    if len(numbers) < MOST_ALONE or [number for _column, number in numbers] != list(range(1, len(numbers) + 1)):
        return ()
    return tuple(column for column, _number in numbers)


# ------------------------------------------------------------------------------------------------------------- units


def _with_units(found: Layout, told: tuple[list[HeadCell], Sheet, ColumnMap], where: str) -> Layout:
    """Units of heading and person as one; what is read by the readings where no word says it."""
    heads, sheet, said = told
    target, own = found.columns[0], found.read[1 : len(found.passes) + 1] or (found.columns[3],)
    stated = {heads[column].unit if column < len(heads) else "" for column in own}
    if len(stated) > 1:
        raise _wrong(where, sheet.at, Message.of("W-FILE-SEVERAL-UNITS", stated=", ".join(sorted(stated))))
    mark = heads[target].unit in INCH_OR_ARCSEC
    target_unit = _unit("" if mark else heads[target].unit, said.target_unit, "target", sheet, where)
    read = next(iter(stated), "")
    if read in INCH_OR_ARCSEC and target_unit in ("", "inch"):  # beside an angle it is arcsec, else it may be inches
        mark, read = True, ""
    unit = _unit(read, said.reading_unit, "reading", sheet, where)
    quantity: Quantity | str = found.quantity
    if not quantity and unit in ALONE_UNITS and target_unit not in ("", unit):
        quantity = "deviation"
    if quantity != "deviation" and bool(target_unit) != bool(unit):
        known = target_unit or unit
        if _by_values(sheet, target, own, (known, known)) == "position":
            target_unit = unit = known
    usual = "inch" if mark else "deg" if unit and READING_UNITS[unit][0] == "deg" else "mm"
    missing = [f"target_unit={usual}"] if not target_unit else []
    missing += [f"reading_unit={'inch' if mark else _example(target_unit, quantity)}"] if not unit else []
    if missing:
        raise _open("E-FILE-CSV-UNIT", where, sheet, (target, *own), " ".join(missing))
    if not quantity:
        quantity = _by_values(sheet, target, own, (target_unit, unit))
    if quantity == "deviation" and not (found.quantity or found.passes):
        quantity = OPEN  # "correction", "target - actual", "|dev|", "sigma": a word nobody knows says no sign either
    if not quantity:
        column = own[0] + 1
        raise _open("E-FILE-CSV-UNIT", where, sheet, own, Message.of("W-FILE-EITHER-COLUMN", column=column))
    return replace(found, quantity=cast(Quantity, quantity), target_unit=target_unit, unit=unit)


def _example(target_unit: str, quantity: str) -> str:
    if quantity in ("position", "increment", "length"):
        return target_unit or "mm"
    return "arcsec" if target_unit and TARGET_UNITS[target_unit][0] == "deg" else "um"


def _unit(stated: str, declared: str, what: str, sheet: Sheet, where: str) -> str:
    """The unit that heading and person agree on, "" where neither names one.

    Raises FileFormatError (E-FILE-CSV-CONTRADICTS, or E-FILE-LINE for a unit nobody knows).
    """
    known, declared = unit_named(stated), typed_unit(declared)
    if known and declared and known != declared:
        raise FileFormatError(
            "E-FILE-CSV-CONTRADICTS", where, line=sheet.at, what=what, stated=known, declared=declared
        )
    if stated and not (known or declared):
        raise _wrong(
            where,
            sheet.at,
            Message.of("W-FILE-IN-UNIT", what=what, stated=stated, target_units=", ".join(TARGET_UNITS)),
        )
    return known or declared


def _by_values(sheet: Sheet, target: int, columns: Sequence[int], units: tuple[str, str]) -> Quantity | str:
    """Positions or deviations, where every reading lies on its target or about zero; "" where neither, or both, do."""
    if not all(units) or TARGET_UNITS[units[0]][0] != TARGET_UNITS[units[1]][0]:
        return ""
    scale, own = TARGET_UNITS[units[0]][1], TARGET_UNITS[units[1]][1]
    places, values = [], []
    for _at, row in sheet.rows:
        for column in columns:
            place, value = (decimal(row[one]) if one < len(row) else None for one in (target, column))
            if place is not None and value is not None:
                places.append(place * scale)
                values.append(value * own)
    if not places:
        return ""
    near = NEAR * (max(places) - min(places))
    on_target = all(abs(value - place) <= near for place, value in zip(places, values, strict=True))
    about_zero = all(abs(value) <= near for value in values)
    if on_target == about_zero:
        return ""
    return "position" if on_target else "deviation"


# ------------------------------------------------------------------------------------------------------------ refusals


def _no_heading(sheet: Sheet, where: str) -> FileFormatError:
    return no_heading(sheet, " ".join(sheet.heads), where)


def no_heading(sheet: Sheet, found: str, where: str) -> FileFormatError:
    """The error for a table whose heading does not tell its columns, with those that its numbers point at."""
    return FileFormatError(
        "E-FILE-CSV-HEADER",
        where,
        found=found[:80] or "nothing",
        columns=", ".join(COLUMNS),
        suggested=_suggested(sheet),
    )


def _suggested(sheet: Sheet) -> str:
    """The two columns that look like targets and readings; a column that only counts the rows is neither."""
    try:
        plain = sheet.spelled(range(max((len(row) for _at, row in sheet.rows), default=0)), "")
    except FileFormatError:
        plain = sheet
    columns: dict[int, list[float]] = {}
    for _at, row in plain.rows:
        for place, cell in enumerate(row):
            value = decimal(cell)
            if value is not None:
                columns.setdefault(place, []).append(value)
    most = max((len(values) for values in columns.values()), default=0)
    able = [
        place
        for place, values in sorted(columns.items())
        if 2 * len(values) > most and values != [values[0] + step for step in range(len(values))]
    ]
    skip = f" skip={sheet.at}" if sheet.at != 1 else ""
    if len(able) < MOST_ALONE:
        return f"target=1 measured=2{skip}"
    target, reading = able[:2]
    word = "deviation" if _by_values(plain, target, (reading,), ("mm", "mm")) == "deviation" else "measured"
    return f"target={target + 1} {word}={reading + 1}{skip}"


def _several(sheet: Sheet, columns: Sequence[int], where: str) -> FileFormatError:
    each = ", ".join(f"{sheet.heads[one]} (column {one + 1})" for one in sorted(columns))[:200]
    first = min(columns) + 1
    return FileFormatError(
        "E-FILE-CSV-SEVERAL", where, found=each, columns=Message.of("W-FILE-EITHER-COLUMN", column=first)
    )


def _open(code: str, where: str, sheet: Sheet, columns: Sequence[int], missing: str | Message = "") -> FileFormatError:
    names = [sheet.heads[one] if one < len(sheet.heads) else f"column {one + 1}" for one in (columns[0], columns[-1])]
    found = " ... ".join(dict.fromkeys(names))[:80]
    return FileFormatError(code, where, found=found, columns=missing)


def _wrong(where: str, line: int, why: str | Message) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)
