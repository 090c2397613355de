"""Two tables side by side: are they the same, what differs in form, what acts now, what will, and the change."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.types import CompensationTable, LiveTable
from gateway.domain import FloatArray

GRID_TOLERANCE = 1e-6  # mm or deg: how far a control may round a grid
FORM = ("minimum", "maximum", "step", "modulo", "direction", "multiply_by", "table_type")
AXES, UNITS = ("input_axis", "output_axis"), ("input_unit", "output_unit")


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
    return replace(live.table, deviations=(0.0,) * len(live.table.deviations))


def unlike(
    wanted: CompensationTable, found: CompensationTable, names: Sequence[str] = FORM, within: float = GRID_TOLERANCE
) -> Iterator[tuple[str, object, object]]:
    """Parts beside the values that differ: name, wanted, found; numbers by more than ``within``, NaN always."""
    for name in names:
        one, two = getattr(wanted, name), getattr(found, name)
        if not (abs(one - two) <= within if isinstance(one, float) else one == two):
            yield name, one, two


def equal_tables(one: CompensationTable, two: CompensationTable, allowed: float) -> bool:
    """Whether two tables have one form and values ``allowed`` apart at most (um or arcsec)."""
    if any(unlike(one, two)) or len(one.deviations) != len(two.deviations):
        return False
    return all(abs(first - second) <= allowed for first, second in zip(one.deviations, two.deviations, strict=True))


def diff(old: CompensationTable, new: CompensationTable) -> TableDifference:
    """Old and new at the new table's points; `old` is what acts now (see `effective`)."""
    at = new.positions
    return TableDifference(at, acting(old, at), np.asarray(new.deviations, dtype=np.float64))


def acting(table: CompensationTable, positions: FloatArray) -> FloatArray:
    """Deviations a table cancels at positions; one that was never loaded has no range and cancels nothing."""
    if len(table.deviations) < 2 or table.maximum <= table.minimum:
        return np.zeros_like(positions)
    return np.asarray(table.at(positions))
