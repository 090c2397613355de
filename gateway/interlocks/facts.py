"""What is known when a write is considered, and one reason against it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

import numpy as np

from drivers.errors import words
from drivers.limits import ACCESS_LEVEL, Limits
from drivers.programs import SelfTested
from drivers.types import (
    Ambient,
    AxisState,
    CompensationTable,
    LiveSet,
    LiveTable,
    MachineIdentity,
    MachineState,
    Marker,
    SignProof,
    TableLimits,
)
from drivers.units import AxisUnit
from gateway.domain import Approval, Capture, TableChange
from gateway.interlocks.limits import MAX_JUMP

__all__ = ["MAX_JUMP", "ROUNDING", "PushFacts", "Refusal", "Rule", "no", "others_now", "rest_of", "value_at"]

# Values are judged with this much room, so that a table exactly at its limit passes.
ROUNDING = 1e-6


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
    ``reference`` is that of the table's input axis. ``agreeing_position`` is where old and new table agree (None:
    nowhere). ``unchanged`` says whether the live tables are those of the capture (None: not read yet); ``live``
    are the live tables themselves, cross tables as deviations. ``unfinished`` names journals left open, ``marker`` is
    what the controller remembers and ``marker_ours`` whether that number was given here.

    ``plan`` is `gateway.push.plan_hash` of the change; ``actor`` who pushes; ``approvals`` who else agreed;
    ``approvals_needed`` None: one person, two when there is any warning. ``audit_broken`` says why the audit
    chain cannot be trusted ("": it can). ``key_taken`` names another plan under the same transaction key.

    ``proposed`` whether the audit log holds this plan's proposal; ``used`` and ``unrecorded`` are approvals that it
    knows as used or does not know; ``run_id`` the run they must name, ``consent_utc`` when they must hold (None: now).
    ``behind`` says how the log falls short of the control's marker ("": it does not); ``mark_lost`` is a transaction
    that the marker should name and does not, ``stranger`` one it names that another gateway ended, 0 for none.
    ``missing`` are transactions begun here whose journals are gone.
    ``alarms`` are differences found between this axis' live tables and what was pushed.
    ``self_test`` is the last of the output axis (None: never), ``self_tests`` whether this control must have one.
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
    access_level_needed: int = ACCESS_LEVEL
    live: LiveSet | None = None
    marker: Marker | None = None
    marker_ours: bool = True
    marker_kept: bool = True
    plan: str = ""
    actor: str = ""
    approvals: tuple[Approval, ...] = ()
    approvals_needed: int | None = None
    audit_broken: str = ""
    key_taken: str = ""
    proposed: bool = True
    used: tuple[Approval, ...] = ()
    unrecorded: tuple[Approval, ...] = ()
    run_id: str = ""
    consent_utc: datetime | None = None
    behind: str = ""
    mark_lost: int = 0
    stranger: int = 0
    missing: tuple[int, ...] = ()
    alarms: tuple[str, ...] = ()
    self_test: SelfTested | None = None
    self_tests: bool = False

    @property
    def table(self) -> CompensationTable:
        """The table to be written."""
        return self.change.new

    @property
    def unit(self) -> AxisUnit:
        """Unit of the table's output axis."""
        return self.change.new.output_unit

    @property
    def bounds(self) -> Limits:
        """The limits for the table's output axis."""
        return Limits.of(self.unit)

    @property
    def is_cross(self) -> bool:
        """Whether the table belongs to the layer of cross tables."""
        return self.change.new.kind == "cross"

    @property
    def axes(self) -> tuple[str, ...]:
        """Machine axes concerned: the output, and the input where it is another."""
        return tuple(dict.fromkeys((self.change.axis, self.table.input_axis)))

    @property
    def axis_state(self) -> AxisState | None:
        """The output axis as the controller reports it."""
        return self.state.axes.get(self.change.axis)

    @property
    def input_state(self) -> AxisState | None:
        """The input axis as the controller reports it."""
        return self.state.axes.get(self.table.input_axis)


Rule = Callable[[PushFacts], Iterator[Refusal]]


def no(code: str, **fields: object) -> Iterator[Refusal]:
    """One reason, for a rule to yield from."""
    yield Refusal(code, fields)


def value_at(table: CompensationTable, position: float) -> float:
    """Deviation of a table at a position in its input axis' unit; a table never loaded (step 0) is zero."""
    if table.step <= 0 or not any(table.deviations):
        return 0.0
    return float(table.at(np.array([position]))[0])


def rest_of(live: LiveSet, table: CompensationTable) -> tuple[LiveTable, ...]:
    """The cross tables of the set's axis but for ``table``."""
    return tuple(one for one in live.cross if table.kind == "axis" or one.table.index != table.index)


def others_now(facts: PushFacts) -> float:
    """What the other cross tables of the output axis add where their input axes stand; 0 for an axis table.

    A cross table's push switches all tables of its output axis off and on again, so this moves the axis too. Before
    anything is sent its own input axis counts as standing where it will be brought to.
    """
    if facts.live is None or not facts.is_cross:
        return 0.0
    places = {name: axis.position for name, axis in facts.state.axes.items()}
    if facts.moment == "start" and facts.agreeing_position is not None:
        places[facts.table.input_axis] = facts.agreeing_position
    enabled = [one.table for one in rest_of(facts.live, facts.table) if one.enabled]
    return sum(value_at(table, places.get(table.input_axis, table.minimum)) for table in enabled)
