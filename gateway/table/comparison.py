"""Two tables side by side: what changes, and where both act alike so that the axis may stand there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import TableError
from drivers.types import CompensationTable, LiveTable
from gateway.domain import FloatArray

AGREE_WITHIN = 1.0


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


def diff(old: CompensationTable, new: CompensationTable) -> TableDifference:
    """Old and new at the new table's points; `old` is what acts now (see `effective`)."""
    at = new.positions
    return TableDifference(at, acting(old, at), np.asarray(new.deviations, dtype=np.float64))


def agreeing_position(
    old: CompensationTable, new: CompensationTable, travel: tuple[float, float], reference: float
) -> float:
    """Position inside the travel where both agree within 1 um or 1 arcsec, as near the reference as possible.

    Raises TableError (E-COMP-AGREE) when there is none.
    """
    low, high = travel
    nodes = np.concatenate((_unrolled(old, travel), _unrolled(new, travel), [low, high, reference]))
    at = np.unique(nodes[(nodes >= low) & (nodes <= high)])
    gap = acting(new, at) - acting(old, at)
    places = np.concatenate((at[np.abs(gap) <= AGREE_WITHIN], _crossings(at, gap)))
    if not places.size:
        closest = int(np.argmin(np.abs(gap)))
        raise TableError("E-COMP-AGREE", new.name, gap=f"{abs(gap[closest]):.3g}", at=f"{at[closest]:g}")
    return float(places[np.argmin(np.abs(places - reference))])


def _crossings(at: FloatArray, gap: FloatArray) -> FloatArray:
    changes = np.flatnonzero(gap[:-1] * gap[1:] < 0.0)
    share = gap[changes] / (gap[changes] - gap[changes + 1])
    return np.asarray(at[changes] + share * (at[changes + 1] - at[changes]))


def _unrolled(table: CompensationTable, travel: tuple[float, float]) -> FloatArray:
    if not table.modulo or len(table.deviations) < 2:
        return table.positions
    period = table.maximum - table.minimum
    first, last = (int(np.floor((edge - table.minimum) / period)) for edge in travel)
    return np.concatenate([table.positions + turn * period for turn in range(first, min(last, first + 20) + 1)])


def acting(table: CompensationTable, positions: FloatArray) -> FloatArray:
    """Deviations a table cancels at positions; one that was never loaded has no range and cancels nothing."""
    if len(table.deviations) < 2 or table.maximum <= table.minimum:
        return np.zeros_like(positions)
    return np.asarray(table.at(positions))
