"""Two tables side by side: are they the same, what differs in form, what acts now, what will, and the change."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.message import Message
from drivers.types.tables import CompensationTable, LiveTable, factors_of
from drivers.types.values import Approach
from gateway.domain.values import FloatArray

GRID_TOLERANCE = 1e-6  # mm or deg: how far a control may round a grid
FORM = ("minimum", "maximum", "step", "modulo", "direction", "multiply_by", "table_type")
AXES, UNITS = ("input_axis", "output_axis"), ("input_unit", "output_unit")
PARTS = ("kind", "index", *AXES, *FORM)
"""All that says which table it is and where its points lie."""
PART_NAMES = {
    "kind": "S-PART-KIND",
    "index": "S-PART-INDEX",
    "input_axis": "S-PART-INPUT",
    "output_axis": "S-PART-OUTPUT",
    "minimum": "S-PART-MINIMUM",
    "maximum": "S-PART-MAXIMUM",
    "step": "S-PART-STEP",
    "modulo": "S-PART-MODULO",
    "direction": "S-PART-DIRECTION",
    "multiply_by": "S-PART-MULTIPLY",
    "table_type": "S-PART-TYPE",
    "input_unit": "S-PART-INPUT-UNIT",
    "output_unit": "S-PART-OUTPUT-UNIT",
}
POINTS = ("S-DIFF-POINT", "S-DIFF-POINTS")
PLACES = ("S-DIFF-PLACE", "S-DIFF-PLACES")
REVERSES = ("S-DIFF-REVERSE", "S-DIFF-REVERSES")


@dataclass(frozen=True, slots=True)
class TableDifference:
    """At the new table's points (k+1,): what acts now, what will, and the change; deviation unit."""

    positions: FloatArray
    old: FloatArray
    new: FloatArray

    @property
    def change(self) -> FloatArray:
        """New less old, shape (k+1,)."""
        return self.new - self.old

    @property
    def largest(self) -> tuple[float, float]:
        """(position, change) of the largest change."""
        place = int(np.argmax(np.abs(self.change)))
        return float(self.positions[place]), float(self.change[place])


def effective(live: LiveTable) -> CompensationTable:
    """The table that acts: all zero while it is switched off."""
    if live.enabled:
        return live.table
    return replace(live.table, deviations=(0.0,) * len(live.table.deviations), reverse=())


def differing_parts(
    wanted: CompensationTable, found: CompensationTable, names: Sequence[str] = FORM, within: float = GRID_TOLERANCE
) -> Iterator[tuple[str, object, object]]:
    """Parts beside the values that differ: name, wanted, found; numbers by more than ``within``, NaN always."""
    for name in names:
        one, two = getattr(wanted, name), getattr(found, name)
        if not (abs(one - two) <= within if isinstance(one, float) else one == two):
            yield name, one, two


def curves_apart(wanted: CompensationTable, found: CompensationTable, allowed: float) -> Iterator[Message]:
    """What differs in free places and in the curve of the negative direction, as messages."""
    yield from _points(PLACES, wanted.places, found.places, GRID_TOLERANCE)
    yield from _points(REVERSES, wanted.reverse, found.reverse, allowed)


def differences(wanted: CompensationTable, found: CompensationTable, allowed: float) -> tuple[Message, ...]:
    """What differs, part by part; values by more than ``allowed`` (um or arcsec), NaN always. Empty: the same table.

    A table never loaded is one with nothing in it: not every road can take a grid back once it was written.
    """
    if wanted.step <= 0 and not wanted.places and not any((*wanted.deviations, *found.deviations)):
        return ()
    parts = (
        Message.of("S-DIFF-PART", name=part_name(name), one=one, two=two)
        for name, one, two in differing_parts(wanted, found, PARTS)
    )
    points = _points(POINTS, wanted.deviations, found.deviations, allowed)
    return (*parts, *points, *curves_apart(wanted, found, allowed))


def part_name(name: str) -> Message:
    """A part of a table as people read it."""
    return Message.of(PART_NAMES[name])


def _points(
    codes: tuple[str, str], wanted: tuple[float, ...], found: tuple[float, ...], allowed: float
) -> Iterator[Message]:
    if len(wanted) != len(found):
        yield Message.of(codes[1], one=len(wanted), two=len(found))
        return
    for number, (value, other) in enumerate(zip(wanted, found, strict=True)):
        if not abs(value - other) <= allowed:
            yield Message.of(codes[0], number=number, one=value, two=other)


def taken_by_cross(tables: Iterable[CompensationTable], axis: str, at: FloatArray) -> FloatArray:
    """What cross tables of an axis take off the mean of both directions at its own positions (m,), others standing.

    Only those over the axis itself, half of one that acts in one direction only; one that is a factor counts nothing.
    """
    every = list(tables)
    factors = factors_of(every)
    own = [one for one in every if one.input_axis == axis and one.index not in factors]
    return np.sum([acting_mean(one, at) * (0.5 if one.direction else 1.0) for one in own], axis=0) + np.zeros_like(at)


def deviations_toward(table: CompensationTable, positions: FloatArray, approach: Approach) -> FloatArray:
    """Deviations a table cancels at positions (m,) come to in one direction; one that was never loaded cancels nothing.

    A reversal has one value, which holds everywhere.
    """
    if table.kind == "reversal":
        return np.full(positions.shape, table.deviations[0])
    if len(table.deviations) < 2 or table.maximum <= table.minimum:
        return np.zeros_like(positions)
    return np.asarray(table.at(positions, approach))


def acting_mean(table: CompensationTable, positions: FloatArray) -> FloatArray:
    """The mean of `toward` in both directions of travel, shape (m,)."""
    return (deviations_toward(table, positions, 1) + deviations_toward(table, positions, -1)) / 2.0


def directional_difference(table: CompensationTable, positions: FloatArray) -> FloatArray:
    """What a table cancels more of at positions in the positive than in the negative direction: its part of B."""
    return deviations_toward(table, positions, 1) - deviations_toward(table, positions, -1)
