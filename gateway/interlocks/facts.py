"""What is known when a write is considered, and one reason against it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

import numpy as np

from drivers.errors import words
from drivers.types import (
    Ambient,
    AxisState,
    CompensationTable,
    MachineIdentity,
    MachineState,
    SignProof,
    TableLimits,
)
from drivers.units import AxisUnit
from gateway.domain import Capture, TableChange

# Values are judged with this much room, so that a table exactly at its limit passes.
ROUNDING = 1e-6
MAX_JUMP = 1.0


@dataclass(frozen=True, slots=True)
class Refusal:
    """One reason not to write: a catalogue code with its fields."""

    code: str
    fields: Mapping[str, object]

    @property
    def words(self) -> str:
        """The reason as people read it."""
        return f"{self.code}: {words(self.code, **self.fields)}"


@dataclass(frozen=True, slots=True)
class PushFacts:
    """All that is known when the question is asked.

    ``moment`` "start" is before anything is sent, "release" while the program waits between its halves.
    ``agreeing_position`` is where old and new table agree (None: nowhere). ``unchanged`` says whether the live
    tables are those of the capture (None: not read yet). ``unfinished`` names journals left open.
    """

    change: TableChange
    purpose: Literal["table", "sign-proof", "restore"]
    moment: Literal["start", "release"]
    typed_name: str
    site_name: str
    expected: MachineIdentity
    found: MachineIdentity
    state: MachineState
    limits: TableLimits
    reference: float
    agreeing_position: float | None
    now_utc: datetime
    unchanged: bool | None = None
    proof: SignProof | None = None
    capture: Capture | None = None
    ambient_now: Ambient | None = None
    unfinished: tuple[str, ...] = ()
    modes: tuple[str, ...] = ("AUTO",)
    harmless_alarms: tuple[int, ...] = ()
    access_level_needed: int = 7

    @property
    def table(self) -> CompensationTable:
        """The table to be written."""
        return self.change.new

    @property
    def unit(self) -> AxisUnit:
        """Unit of the table's output axis."""
        return self.change.new.output_unit

    @property
    def axis_state(self) -> AxisState | None:
        """The axis as the controller reports it."""
        return self.state.axes.get(self.change.axis)


Rule = Callable[[PushFacts], Iterator[Refusal]]


def no(code: str, **fields: object) -> Iterator[Refusal]:
    """One reason, for a rule to yield from."""
    yield Refusal(code, fields)


def value_at(table: CompensationTable, position: float) -> float:
    """Deviation of a table at a position in its input axis' unit; a table never loaded (step 0) is zero."""
    if table.step <= 0 or not any(table.deviations):
        return 0.0
    return float(table.at(np.array([position]))[0])
