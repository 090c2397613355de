"""Which column of a table means what, by its heading: our own names and those the field uses beside them.

What a heading leaves open is decided by the readings where they leave no doubt (positions lie on their targets,
deviations about zero), else it is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.errors import FileFormatError
from drivers.files.columns import READING_UNITS, TARGET_UNITS
from drivers.files.numbers import decimal
from drivers.files.tables.doubts import NEAR, both_marks, decimal_comma, too_small, whole_turn
from drivers.files.tables.headwords import (
    PLACE,
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
from drivers.units import AxisUnit

COLUMNS = ("target", "direction", "repetition", "deviation")
DEFAULT_READING: dict[AxisUnit, str] = {"mm": "um", "deg": "arcsec"}
UNITS = READING_UNITS
Reading = Literal["deviation", "position"]
READINGS: tuple[Reading, ...] = ("deviation", "position")
MOST_ALONE = 2  # a single column beside the targets is no table of passes
ALONE_UNITS = {"um", "nm", "uin", "arcsec", "urad", "mrad"}
NONE = -1


@dataclass(frozen=True, slots=True)
class Layout:
    """A table's heading understood: ``columns`` are those of target, direction, repetition and reading, -1: none.

    A table with a column for each pass has ``passes``: (column, way, number) each; of ``columns`` the target's counts
    then. ``beside`` is a column of positions beside deviations, -1: none. ``target_unit`` of `TARGET_UNITS`; ``unit``
    of `UNITS` for deviations, of `TARGET_UNITS` for positions.
    """

    columns: tuple[int, int, int, int]
    reading: Reading
    target_unit: str
    unit: str
    comma: bool
    passes: tuple[tuple[int, int, int], ...] = ()
    beside: int = NONE
    width: int = 0

    @property
    def axis_unit(self) -> AxisUnit:
        """mm where deviations are lengths, deg where they are angles; positions are what the targets are."""
        return UNITS[self.unit][0] if self.reading == "deviation" else TARGET_UNITS[self.target_unit][0]


def understood(heads: Row) -> int | None:
    """The column of the targets where a heading names what it must, or leaves nothing open but a way or a unit."""
    cells = [head_cell(cell) for cell in heads]
    passes = _passes(cells) or _runs(cells)
    if passes:
        return _target(cells)
    found = _by_row(cells)
    return found[0][0] if found is not None else None


def layout(sheet: Sheet, unit: str, where: str, *, mixed: bool = False, ways: str = "") -> Layout:
    """``mixed`` lets angles stand over lengths and lengths over angles; ``ways`` of `PASSES` says how passes went.

    Raises FileFormatError: E-FILE-CSV-WAYS where passes do not say their way, E-FILE-CSV-UNIT where readings have
    neither unit nor a value that tells positions from deviations, E-FILE-CSV-TURN without a unit and with targets
    round a whole turn, E-FILE-LINE.
    """
    heads = [head_cell(cell) for cell in sheet.heads]
    comma = decimal_comma(sheet)
    passes = _passes(heads)
    runs = () if passes else _runs(heads)
    if runs:
        if ways not in PASSES[1:]:
            raise _open("E-FILE-CSV-WAYS", where, sheet, runs)
        passes = tuple((column, *_way_of(runs.index(column), runs, ways, sheet, where)) for column in runs)
    found = _by_pass(heads, passes, (sheet, comma, unit, where)) if passes else _by_row(heads)
    if found is None:
        raise FileFormatError("E-FILE-CSV-HEADER", where, found=" ".join(sheet.heads)[:80], columns=", ".join(COLUMNS))
    columns, reading, beside = found
    read = [column for column, _way, _number in passes] or [columns[3]]
    marks = both_marks(sheet, (columns[0], *read))
    if marks is not None:
        raise FileFormatError("E-FILE-CSV-MARKS", where, line=marks[0], one=marks[1], other=marks[2])
    stated = (heads[columns[0]].unit, heads[columns[3]].unit)
    if reading == "deviation" and not (stated[1] or unit) and too_small(sheet, columns, passes, comma=comma):
        raise _open("E-FILE-CSV-UNIT", where, sheet, [column for column, _way, _number in passes] or [columns[3]])
    if not any((*stated, unit)) and whole_turn(sheet, columns[0], comma=comma):
        raise _open("E-FILE-CSV-TURN", where, sheet, (columns[0], columns[3]))
    target_unit, reading_unit = _units(stated, reading, unit, sheet.at, where)
    apart = reading == "deviation" and UNITS[reading_unit][0] != TARGET_UNITS[target_unit][0]
    if apart and not mixed:
        raise _wrong(
            where,
            sheet.at,
            f"targets in {target_unit}, but {reading}s in {reading_unit}: one is a length, one an angle",
        )
    return Layout(
        columns=columns,
        reading=reading,
        target_unit=target_unit,
        unit=reading_unit,
        comma=comma,
        passes=passes,
        beside=beside,
        width=len(heads),
    )


def _way_of(place: int, runs: Sequence[int], ways: str, sheet: Sheet, where: str) -> tuple[int, int]:
    """Way and number of the pass in this place. Raises FileFormatError (E-FILE-LINE) where half a pass is left."""
    if ways in ("alternate", "halves") and len(runs) % 2:
        raise _wrong(where, sheet.at, f"{len(runs)} passes, but as many forward as reverse are needed")
    number, way = pass_in(place, len(runs), ways)
    return way, number


Columns = tuple[tuple[int, int, int, int], Reading, int]


def _by_row(heads: list[HeadCell]) -> Columns | None:
    """The columns of a table with one reading a row; None where one is missing or stands twice."""
    places: dict[Meaning, list[int]] = {}
    for index, head in enumerate(heads):
        places.setdefault(head.meaning, []).append(index)
    if "target" not in places and "deviation" in places and heads[places.get("position", [0])[0]].words == PLACE:
        places["target"] = places.pop("position", [])
    readings: list[Reading] = [one for one in READINGS if places.get(one)]
    wanted: tuple[Meaning, ...] = ("target", *readings)
    if not readings or any(len(places.get(one, ())) != 1 for one in wanted):
        return None
    if any(len(places.get(one, ())) > 1 for one in ("direction", "repetition")):
        return None
    target, direction, repetition, reading = (
        places.get(one, [NONE])[0] for one in ("target", "direction", "repetition", readings[0])
    )
    beside = places["position"][0] if len(readings) > 1 else NONE
    return (target, direction, repetition, reading), readings[0], beside


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


def _by_pass(
    heads: list[HeadCell], passes: tuple[tuple[int, int, int], ...], told: tuple[Sheet, bool, str, str]
) -> Columns | None:
    """What the columns of passes read: by their words, by a unit of deviations alone, or by the readings themselves."""
    sheet, comma, unit, where = told
    columns = [heads[column] for column, _way, _number in passes]
    units = {one.unit for one in columns}
    said: set[Meaning] = {given.meaning for one in columns if (given := pass_of(one)) is not None and given.meaning}
    target = _target(heads) or 0
    if len(units) != 1 or len(said) > 1:
        return None
    (stated,) = units
    if not said and (stated or unit) in ALONE_UNITS:
        said = {"deviation"}
    if not said:
        said = {_by_values(sheet, (target, passes, heads[target].unit, stated or unit), comma=comma)}
    if said == {""} or (said == {"deviation"} and not (stated or unit) and not _words_say(columns)):
        raise _open("E-FILE-CSV-UNIT", where, sheet, [column for column, _way, _number in passes])
    return (target, 0, 0, passes[0][0]), "position" if "position" in said else "deviation", NONE


def _words_say(columns: Sequence[HeadCell]) -> bool:
    return any(given.meaning for one in columns if (given := pass_of(one)) is not None)


def _by_values(sheet: Sheet, told: tuple[int, Sequence[tuple[int, int, int]], str, str], *, comma: bool) -> Meaning:
    """Positions or deviations, where every reading lies on its target or about zero; "" where neither, or both, do."""
    target, passes, target_unit, unit = told
    kind, scale = TARGET_UNITS.get(target_unit or "mm", TARGET_UNITS["mm"])
    own = TARGET_UNITS.get(unit or target_unit or "mm", (kind, scale))
    if own[0] != kind:
        return ""
    places, values = [], []
    for _at, row in sheet.rows:
        for column, _way, _number in passes:
            place, value = (decimal(row[one], comma=comma) if one < len(row) else None for one in (target, column))
            if place is not None and value is not None:
                places.append(place * scale)
                values.append(value * own[1])
    if not places:
        return ""
    near = NEAR * (max(places) - min(places))
    on_target = all(abs(value - place) <= near for place, value in zip(places, values, strict=True))
    about_zero = all(abs(value) <= near for value in values)
    if on_target == about_zero:
        return ""
    return "position" if on_target else "deviation"


def _units(said: tuple[str, str], reading: Reading, unit: str, at: int, where: str) -> tuple[str, str]:
    """Units of targets and readings; what the headings leave open follows from the other, mm and um at last."""
    target, stated = said
    known = UNITS if reading == "deviation" else TARGET_UNITS
    if target and target not in TARGET_UNITS:
        raise _wrong(where, at, f"targets in {target!r}, expected one of {', '.join(TARGET_UNITS)}")
    if (stated and stated not in known) or (stated and unit and stated != unit):
        raise _wrong(where, at, f"{reading}s in {stated!r}, expected one of {unit or ', '.join(known)}")
    chosen = stated or unit
    if chosen and chosen not in known:
        raise _wrong(where, at, f"{reading}s in {chosen!r}, expected one of {', '.join(known)}")
    if not target:
        target = (chosen if reading == "position" else known[chosen][0]) if chosen else "mm"
    if not chosen:
        chosen = DEFAULT_READING[TARGET_UNITS[target][0]] if reading == "deviation" else target
    if reading == "position" and known[chosen][0] != TARGET_UNITS[target][0]:
        raise _wrong(where, at, f"targets in {target}, but {reading}s in {chosen}: one is a length, one an angle")
    return target, chosen


def _open(code: str, where: str, sheet: Sheet, columns: Sequence[int]) -> FileFormatError:
    first, last = (sheet.heads[column] for column in (columns[0], columns[-1]))
    return FileFormatError(code, where, found=f"{first} ... {last}"[:80])


def _wrong(where: str, line: int, why: str) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)
