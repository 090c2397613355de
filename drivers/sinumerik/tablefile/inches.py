"""Lines that stand under INCH -> the same in mm: positions by their input axis, values by their output axis.

The unit line (METRIC, INCH) is the control's word for all lengths after it. Angles stay. An axis of which nobody says
whether it is linear or rotary cannot be converted and is refused by name.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal

from drivers.errors import FileFormatError
from drivers.sinumerik.tablefile.archive import Listing
from drivers.sinumerik.tablefile.grammar import Assignment
from drivers.sinumerik.tablefile.variables import VARIABLES
from drivers.units import MM_PER_INCH, AxisUnit

Known = Callable[[str], AxisUnit | None]
_INCH = Decimal(repr(MM_PER_INCH))
_GRID = ("_STEP", "_MIN", "_MAX")


def in_metric(found: Listing, known: Known, where: str) -> Listing:
    """The listing with every length in mm. Raises FileFormatError (E-TABLE-INCH-AXIS)."""
    if not any(word == "INCH" for _line, word in found.units):
        return found
    lines = [line for line, _word in found.units]
    cross = {(item.name, item.numbers[0]): str(item.value) for item in found.assignments if "_AXIS" in item.name}
    converted = []
    for item in found.assignments:
        at = bisect_right(lines, item.line)
        inch = at > 0 and found.units[at - 1][1] == "INCH"
        converted.append(_converted(item, _axis_of(item, cross), known, where) if inch else item)
    return replace(found, assignments=tuple(converted))


def _axis_of(item: Assignment, cross: dict[tuple[str, int], str]) -> str:
    """The axis whose unit the value has; "" if it is no length at all."""
    if item.name == "$AN_CEC":
        return cross.get(("$AN_CEC_OUTPUT_AXIS", item.numbers[0]), "?")
    if item.name.startswith("$AN_CEC") and item.name.endswith(_GRID):
        return cross.get(("$AN_CEC_INPUT_AXIS", item.numbers[0]), "?")
    own = item.name == "$AA_ENC_COMP" or (item.name.startswith("$AA_") and item.name.endswith(_GRID))
    return item.axis if own or VARIABLES[item.name].length else ""


def _converted(item: Assignment, axis: str, known: Known, where: str) -> Assignment:
    if not axis or not isinstance(item.value, Decimal) or not item.value:
        return item
    unit = known(axis)
    if unit is None:
        raise FileFormatError("E-TABLE-INCH-AXIS", f"{where}, line {item.line}", line=item.line, axis=axis)
    return replace(item, value=item.value * _INCH) if unit == "mm" else item
