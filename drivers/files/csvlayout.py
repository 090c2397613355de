"""Which column of a table means what, by its heading: our own names and those the field uses beside them."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Literal

from drivers.errors import FileFormatError
from drivers.files.columns import DOWN, READING_UNITS, TARGET_UNITS, UP
from drivers.units import AxisUnit

COLUMNS = ("target", "direction", "repetition", "deviation")
# What others call the same thing; a position is a reading of the place itself: deviation = position - target.
NAMES: dict[str, tuple[str, ...]] = {
    "target": ("target",),
    "direction": ("direction", "approach", "dir"),
    "repetition": ("repetition", "run", "cycle"),
    "deviation": ("deviation",),
    "position": ("position", "measured", "actual"),
}
SEPARATORS = (";", "\t", ",")
DEFAULT_READING: dict[AxisUnit, str] = {"mm": "um", "deg": "arcsec"}
DIRECTIONS = dict.fromkeys(UP, 0) | dict.fromkeys(DOWN, 1)
UNITS = {unit: READING_UNITS[unit] for unit in ("um", "mm", "arcsec", "deg", "mrad", "urad")}

Reading = Literal["deviation", "position"]


@dataclass(frozen=True, slots=True)
class Layout:
    """A table's heading understood: ``columns`` are those of target, direction, repetition and reading.

    ``target_unit`` of `TARGET_UNITS`; ``unit`` of `UNITS` for deviations, of `TARGET_UNITS` for positions.
    """

    separator: str
    width: int
    columns: tuple[int, int, int, int]
    reading: Reading
    target_unit: str
    unit: str
    comma: bool

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
    names = [name.lower() for name in cells(line, separator)]
    places = {meaning: _places(names, known) for meaning, known in NAMES.items()}
    readings = [meaning for meaning in ("deviation", "position") if places[meaning]]
    once = all(len(places[meaning]) == 1 for meaning in (*COLUMNS[:3], *readings))
    if len(readings) != 1 or not once:
        raise FileFormatError("E-FILE-CSV-HEADER", where, found=line[:80], columns=", ".join(COLUMNS))
    reading: Reading = "deviation" if readings == ["deviation"] else "position"
    columns = (places["target"][0], places["direction"][0], places["repetition"][0], places[reading][0])
    target_unit, reading_unit = _units((names[columns[0]], names[columns[3]]), reading, unit, at, where)
    apart = reading == "deviation" and UNITS[reading_unit][0] != TARGET_UNITS[target_unit][0]
    if apart and not mixed:
        raise _wrong(
            where, at, f"targets in {target_unit}, but {reading}s in {reading_unit}: one is a length, one an angle"
        )
    text = " ".join(line for _at, line in body)
    comma = separator != "," and "," in text and "." not in text
    return Layout(
        separator=separator,
        width=len(names),
        columns=columns,
        reading=reading,
        target_unit=target_unit,
        unit=reading_unit,
        comma=comma,
    )


def _places(names: list[str], known: tuple[str, ...]) -> list[int]:
    return [index for index, name in enumerate(names) if name.partition("_")[0] in known]


def _units(names: tuple[str, str], reading: Reading, unit: str, at: int, where: str) -> tuple[str, str]:
    """Units of targets and readings; what the headings leave open follows from the other, mm and um at last."""
    target, stated = (name.partition("_")[2] for name in names)
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
