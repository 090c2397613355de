"""Which column of a table means what, by its heading: our own names and those the field uses beside them."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Literal

from drivers.errors import FileFormatError
from drivers.files.columns import READING_UNITS, TARGET_UNITS
from drivers.files.headwords import PLACE, HeadCell, HeadPass, Meaning, head_cell, pass_of
from drivers.units import AxisUnit

COLUMNS = ("target", "direction", "repetition", "deviation")
SEPARATORS = (";", "\t", ",")
DEFAULT_READING: dict[AxisUnit, str] = {"mm": "um", "deg": "arcsec"}
UNITS = {unit: READING_UNITS[unit] for unit in ("um", "mm", "arcsec", "deg", "mrad", "urad")}

Reading = Literal["deviation", "position"]
READINGS: tuple[Reading, ...] = ("deviation", "position")
MOST_ALONE = 2  # a single column beside the targets is no table of passes


@dataclass(frozen=True, slots=True)
class Layout:
    """A table's heading understood: ``columns`` are those of target, direction, repetition and reading.

    A table with a column for each pass has ``passes``: (column, way, number) each; of ``columns`` the target's counts
    then. ``target_unit`` of `TARGET_UNITS`; ``unit`` of `UNITS` for deviations, of `TARGET_UNITS` for positions.
    """

    separator: str
    width: int
    columns: tuple[int, int, int, int]
    reading: Reading
    target_unit: str
    unit: str
    comma: bool
    passes: tuple[tuple[int, int, int], ...] = ()

    @property
    def axis_unit(self) -> AxisUnit:
        """mm where deviations are lengths, deg where they are angles; positions are what the targets are."""
        return UNITS[self.unit][0] if self.reading == "deviation" else TARGET_UNITS[self.target_unit][0]


def cells(line: str, separator: str) -> list[str]:
    """The cells of a line without the blanks about them; none where the line's quotes are wrong."""
    try:
        return [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=separator, strict=True), [])]
    except csv.Error:
        return []


def layout(
    header: tuple[int, str], body: list[tuple[int, str]], unit: str, where: str, *, mixed: bool = False
) -> Layout:
    """From the heading (line number, text); ``mixed`` lets angles stand over lengths and lengths over angles.

    Raises FileFormatError (E-FILE-CSV-HEADER, E-FILE-LINE).
    """
    at, line = header
    separator = next((mark for mark in SEPARATORS if mark in line), ",")
    heads = [head_cell(cell) for cell in cells(line, separator)]
    passes = _passes(heads)
    found = _by_pass(heads, passes) if passes else _by_row(heads)
    if found is None:
        raise FileFormatError("E-FILE-CSV-HEADER", where, found=line[:80], columns=", ".join(COLUMNS))
    columns, reading = found
    target_unit, reading_unit = _units((heads[columns[0]].unit, heads[columns[3]].unit), reading, unit, at, where)
    apart = reading == "deviation" and UNITS[reading_unit][0] != TARGET_UNITS[target_unit][0]
    if apart and not mixed:
        raise _wrong(
            where, at, f"targets in {target_unit}, but {reading}s in {reading_unit}: one is a length, one an angle"
        )
    text = " ".join(line for _at, line in body)
    comma = separator != "," and "," in text and "." not in text
    return Layout(
        separator=separator,
        width=len(heads),
        columns=columns,
        reading=reading,
        target_unit=target_unit,
        unit=reading_unit,
        comma=comma,
        passes=passes,
    )


def _by_row(heads: list[HeadCell]) -> tuple[tuple[int, int, int, int], Reading] | None:
    """The columns of a table with one reading a row; None where one is missing or stands twice."""
    places: dict[Meaning, list[int]] = {}
    for index, head in enumerate(heads):
        places.setdefault(head.meaning, []).append(index)
    if "target" not in places and "deviation" in places and heads[places.get("position", [0])[0]].words == PLACE:
        places["target"] = places.pop("position", [])
    readings: list[Reading] = [one for one in READINGS if places.get(one)]
    wanted: tuple[Meaning, ...] = ("target", "direction", "repetition", *readings)
    if len(readings) != 1 or any(len(places.get(one, ())) != 1 for one in wanted):
        return None
    target, direction, repetition, reading = (places[one][0] for one in wanted)
    return (target, direction, repetition, reading), readings[0]


def _passes(heads: list[HeadCell]) -> tuple[tuple[int, int, int], ...]:
    """(column, way, number) where every column but the first names a pass; without numbers they count as they stand."""
    named = [pass_of(head) for head in heads[1:]]
    found: list[HeadPass] = [one for one in named if one is not None]
    if len(found) < MOST_ALONE or len(found) != len(named) or heads[0].meaning not in ("target", "position"):
        return ()
    counted = [one.number > 0 for one in found]
    if any(counted) and not all(counted):
        return ()
    seen = [0, 0]
    passes = []
    for column, one in enumerate(found, start=1):
        seen[one.way] += 1
        passes.append((column, one.way, one.number or seen[one.way]))
    return tuple(passes) if len({(way, number) for _column, way, number in passes}) == len(passes) else ()


def _by_pass(
    heads: list[HeadCell], passes: tuple[tuple[int, int, int], ...]
) -> tuple[tuple[int, int, int, int], Reading] | None:
    """What the columns of passes read: by their words, else deviations where their unit is one of deviations alone."""
    columns = [heads[column] for column, _way, _number in passes]
    units = {one.unit for one in columns}
    said = {told.meaning for one in columns if (told := pass_of(one)) is not None and told.meaning}
    if len(units) != 1 or len(said) > 1:
        return None
    if not said and units <= {"um", "arcsec", "urad", "mrad"}:
        said = {"deviation"}
    return ((0, 0, 0, 1), "position" if "position" in said else "deviation") if said else None


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
        target = known[chosen][0] if chosen else "mm"
    if not chosen:
        chosen = DEFAULT_READING[TARGET_UNITS[target][0]] if reading == "deviation" else target
    if reading == "position" and known[chosen][0] != TARGET_UNITS[target][0]:
        raise _wrong(where, at, f"targets in {target}, but {reading}s in {chosen}: one is a length, one an angle")
    return target, chosen


def _wrong(where: str, line: int, why: str) -> FileFormatError:
    return FileFormatError("E-FILE-LINE", where, line=line, why=why)
