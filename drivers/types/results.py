"""A result file as a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.message import Message
from drivers.types.doubts import Doubt
from drivers.types.sensing import Ambient
from drivers.types.values import CompensatedFor, FloatArray
from drivers.units import AxisUnit


@dataclass(frozen=True, slots=True)
class MeasuredSet:
    """A result file as a record: deviations (m, n, 2) with NaN where missing; last axis is + then -.

    ``targets`` shape (m,) in the axis unit, relative to the file's own zero (a vendor file has no machine
    datum); ``deviations`` in um or arcsec.
    """

    targets: FloatArray
    deviations: FloatArray
    axis_unit: AxisUnit
    ambient_start: Ambient = field(default_factory=Ambient)
    ambient_end: Ambient = field(default_factory=Ambient)
    compensated_for: CompensatedFor = "air+material"
    expansion_ppm_per_k: float | None = None
    header: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()
    doubts: tuple[Doubt, ...] = ()


@dataclass(frozen=True, slots=True)
class TableColumn:
    """One column of a table: ``number`` from 1, its heading whole, the heading's ``words`` without its unit.

    ``role``: "target", "direction", "repetition"; "reading" where the heading names one or the way of a pass;
    "numbers" for any other column of numbers; "" for text, counters and statistics. ``unit`` is "" where the heading
    names none.
    """

    number: int
    heading: str
    words: str
    unit: str
    role: str


@dataclass(frozen=True, slots=True)
class TableHeading:
    """The heading of a table: its columns, the lines before the first row, and what separates cells ("": blanks).

    ``said`` is what the file states about itself above it, by the names of a set's header.
    """

    columns: tuple[TableColumn, ...]
    skip: int
    separator: str
    said: Mapping[str, str] = field(default_factory=dict)

    def column(self, role: str) -> int:
        """Number of the first column of a role, 0 where there is none."""
        return next((one.number for one in self.columns if one.role == role), 0)
