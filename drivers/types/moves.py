"""What moves before a press: safe places and feeds of a site, where a program sends an axis, where all axes stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf

from drivers.types.machine import MachineState
from drivers.units import AxisUnit

FEED_MM, FEED_DEG = 500.0, 360.0
NEAR = 0.001
"""How far from a place an axis still counts as standing right there, mm or deg."""


@dataclass(frozen=True, slots=True)
class SafePlaces:
    """Where each machine axis may stand while programs of the compensation run, and how fast these move axes.

    ``ranges``: (low, high) in machine coordinates, mm or deg, by the axis' name; infinite ends where its place does not
    matter. ``feed_mm`` in mm/min, ``feed_deg`` in deg/min.
    """

    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    feed_mm: float = FEED_MM
    feed_deg: float = FEED_DEG

    def feed(self, unit: AxisUnit) -> float:
        """Feed of such moves for an axis of this unit, mm/min or deg/min."""
        return self.feed_mm if unit == "mm" else self.feed_deg

    def holds(self, axis: str, position: float) -> bool:
        """Whether an axis stands in its safe place; one without any does not."""
        low, high = self.ranges.get(axis, (inf, -inf))
        return low - NEAR <= position <= high + NEAR


@dataclass(frozen=True, slots=True)
class Going:
    """What one program does with one axis, read from its own blocks; machine coordinates in ``unit``.

    ``first`` and ``last`` place it is sent to, ``low`` and ``high`` the outermost, ``feeds`` the slowest and the
    fastest in unit/min. ``turns``: it also turns by steps, up to a whole turn.
    ``goes_if_elsewhere``: the program leaves the move out where the axis stands there already. ``further``: more places
    between the same ends may follow without another press, where readings ask for it.
    """

    axis: str
    unit: AxisUnit
    first: float
    last: float
    low: float
    high: float
    feeds: tuple[float, float]
    turns: bool = False
    goes_if_elsewhere: bool = False
    further: bool = False


@dataclass(frozen=True, slots=True)
class AxisStands:
    """Where an axis stands now; ``place`` is its safe range, None where the site file names none."""

    axis: str
    unit: AxisUnit
    position: float
    place: tuple[float, float] | None

    @property
    def safe(self) -> bool:
        """Whether it stands in its safe place."""
        return self.place is not None and self.place[0] - NEAR <= self.position <= self.place[1] + NEAR


@dataclass(frozen=True, slots=True)
class Movement:
    """What the selected program will move, and where every axis of the control stands at this moment."""

    goes: tuple[Going, ...]
    stands: tuple[AxisStands, ...]


def movement_of(goes: tuple[Going, ...], state: MachineState, places: SafePlaces) -> Movement:
    """Both, from a state that was read just now."""
    stands = [
        AxisStands(name, axis.unit, axis.position, places.ranges.get(name)) for name, axis in sorted(state.axes.items())
    ]
    return Movement(goes, tuple(stands))
