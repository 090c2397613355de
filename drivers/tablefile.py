"""What crosses the table-file port: the content of a file, what is known of its machine, what is wrong in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Literal

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.types.tables import CompensationTable
from drivers.units import AxisUnit

Severity = Literal["wrong", "doubtful", "note"]


@dataclass(frozen=True, slots=True)
class TableFile:
    """Tables in order of appearance, and settings (backlash, temperature, switches) by the control's own names.

    Setting values are as the control has them, exact; ``lengths`` gives the unit of those that are lengths or
    angles. ``notes`` say what was left out when a back-up was read. ``names`` (AXn -> machine axis name) and ``units``
    are what machine data of the file say; ``unknown`` are numbered axes of which nobody says whether they are linear or
    rotary: their tables stand here as if they were linear. None of these is part of the content.
    """

    tables: tuple[CompensationTable, ...]
    settings: Mapping[str, Decimal] = field(default_factory=dict)
    lengths: Mapping[str, AxisUnit] = field(default_factory=dict, compare=False)
    notes: tuple[Message, ...] = field(default=(), compare=False)
    names: Mapping[str, str] = field(default_factory=dict, compare=False)
    units: Mapping[str, AxisUnit] = field(default_factory=dict, compare=False)
    unknown: frozenset[str] = field(default=frozenset(), compare=False)


@dataclass(frozen=True, slots=True)
class ArchiveMember:
    """One file of an NC archive: its name in the control, as shown, its folder, size in bytes, time (UNIX seconds)."""

    name: str
    shown: str
    folder: str
    size: int
    changed: int


@dataclass(frozen=True, slots=True)
class TableMachine:
    """What is known of the machine a file is meant for; everything may be left out.

    ``control`` "840D", "828D", "808D" or "802D"; ``own_points`` MD38000, ``cross_points`` MD18342; ``velocity`` of
    the input axis in mm/min or deg/min; ``references`` where each input axis' tables must be zero ("" for all);
    ``units`` of the axes. ``acting`` are the encoder indices that MD32700 switches on, by axis; ``reserved`` MD38000 by
    encoder index and axis, ``cross`` MD18342 by table; ``unknown`` axes of which nobody knows the unit.
    """

    control: str = ""
    own_points: int | None = None
    cross_points: int | None = None
    velocity: float | None = None
    references: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, AxisUnit] = field(default_factory=dict)
    acting: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    reserved: Mapping[tuple[int, str], int] = field(default_factory=dict)
    cross: Mapping[int, int] = field(default_factory=dict)
    unknown: frozenset[str] = frozenset()

    def reference(self, axis: str) -> float | None:
        """Where tables over this axis must be zero, if it is known."""
        return self.references.get(axis, self.references.get(""))


@dataclass(frozen=True, slots=True)
class TableFinding:
    """One thing about a file: wrong (must not be loaded), doubtful (look at it) or a note (good to know)."""

    severity: Severity
    error: TrueflankError

    @property
    def code(self) -> str:
        """The stable code, E- for wrong and W- for the others."""
        return self.error.code
