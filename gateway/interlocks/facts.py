"""What is known when a write is considered, one reason against it, and the limits of a push."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Literal, Protocol

import numpy as np

from drivers.errors import words
from drivers.limits import Limits
from drivers.message import Form, Message
from drivers.programs import SelfTested
from drivers.types.abilities import Capabilities, Marker, TableLimits
from drivers.types.identity import MachineIdentity
from drivers.types.machine import AxisState, MachineState
from drivers.types.moves import SafePlaces
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.uptime import Uptime
from drivers.types.values import Approach
from drivers.units import AxisUnit
from gateway.axes import AxisRecord
from gateway.domain.captures import Capture
from gateway.domain.proposals import Approval, TableChange

__all__ = [
    "MAX_JUMP",
    "ROUNDING",
    "MarkerCheck",
    "PushFacts",
    "PushRequest",
    "Refusal",
    "Rule",
    "other_cross_tables",
    "other_tables_now",
    "refuse",
    "value_at",
]

# Values are judged with this much room, so that a table exactly at its limit passes.
ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Refusal:
    """One reason not to write: a catalogue code with its fields."""

    code: str
    fields: Mapping[str, object]

    @property
    def message(self) -> Message:
        """The reason as a record contains it."""
        return Message(self.code, self.fields, Form.REASON)

    @property
    def words(self) -> str:
        """The reason as people read it, in English."""
        return f"{self.code}: {words(self.code, **self.fields)}"


class PushRequest(Protocol):
    """Who asks for what and with whose consent, as far as the rules care; a push's own context is one.

    ``typed_name`` is what the operator gave as the machine's name, ``site_name`` what it must be; ``machine`` the
    fingerprint the run was made on; ``input_axis`` the table's input axis. ``self_test`` is the last of
    the output axis (None: never). ``actor`` is who pushes, ``approvals`` who else
    agreed, ``approvals_needed`` None: one person, two when there is any warning. ``audit_broken`` says why the audit
    chain cannot be trusted ("": it can). ``is_proposed`` whether the audit log contains this plan's proposal;
    ``used_approvals`` and ``unrecorded_approvals`` are those that it knows as used or does not know;
    ``run_id`` the run they must name,
    ``overtaken_approvals`` those since which the log has a later time than the computer shows; ``consent_utc`` and
    ``consent_uptime`` when they must hold (None: now). ``alarms`` are differences found between this axis' live tables
    and what was pushed. ``risk_taken``: who pushes has typed the risk of a connection that is not protected.
    """

    @property
    def typed_name(self) -> str: ...
    @property
    def site_name(self) -> str: ...
    @property
    def machine(self) -> MachineIdentity: ...
    @property
    def input_axis(self) -> AxisRecord: ...
    @property
    def proof(self) -> SignProof | None: ...
    @property
    def capture(self) -> Capture | None: ...
    @property
    def self_test(self) -> SelfTested | None: ...
    @property
    def ambient_now(self) -> Ambient | None: ...
    @property
    def modes(self) -> tuple[str, ...]: ...
    @property
    def harmless_alarms(self) -> tuple[int, ...]: ...
    @property
    def access_level_needed(self) -> int: ...
    @property
    def actor(self) -> str: ...
    @property
    def approvals(self) -> tuple[Approval, ...]: ...
    @property
    def approvals_needed(self) -> int | None: ...
    @property
    def audit_broken(self) -> str: ...
    @property
    def is_proposed(self) -> bool: ...
    @property
    def used_approvals(self) -> tuple[Approval, ...]: ...
    @property
    def unrecorded_approvals(self) -> tuple[Approval, ...]: ...
    @property
    def unsigned_approvals(self) -> tuple[Approval, ...]: ...
    @property
    def run_id(self) -> str: ...
    @property
    def overtaken_approvals(self) -> tuple[Approval, ...]: ...
    @property
    def consent_utc(self) -> datetime | None: ...
    @property
    def consent_uptime(self) -> Uptime | None: ...
    @property
    def risk_taken(self) -> bool: ...
    @property
    def alarms(self) -> tuple[Message, ...]: ...


@dataclass(frozen=True, slots=True)
class MarkerCheck:
    """What the control's marker says of this store.

    ``ours`` whether its transaction was given here, or there is none. ``behind`` says why the audit log is older than
    the marker ("": it is not). ``lost`` is the transaction it should name where it names none, ``stranger`` the one it
    names that was not given here; 0 for none.
    """

    ours: bool = True
    behind: str = ""
    lost: int = 0
    stranger: int = 0


@dataclass(frozen=True, slots=True)
class PushFacts:
    """All that is known when the question is asked: what was asked for, and what was found.

    ``moment`` "start" is before anything is sent, "release" while the program waits between its halves. ``can`` is what
    the connection can do, ``found`` the machine that answered. ``agreeing_position`` is where old and new table agree
    (None: nowhere). ``unchanged`` says whether the live tables are those of the capture (None: not read yet); ``live``
    are the live tables themselves, cross tables as deviations. ``unfinished`` names journals left open, ``marker`` is
    what the controller remembers and ``mark`` what that says of this store. ``plan`` is `gateway.push.plan_hash` of the
    change, ``key_taken`` names another plan under the same transaction key, ``missing`` are transactions begun here
    whose journals are gone. ``places`` are the safe places that the control's programs are held to. ``brought`` is
    where other input axes of the same transaction will stand when it switches; ``uptime`` is now by this computer's own
    count.
    """

    change: TableChange
    purpose: Literal["table", "sign-proof", "restore"]
    moment: Literal["start", "release"]
    request: PushRequest
    can: Capabilities
    found: MachineIdentity
    state: MachineState
    limits: TableLimits
    agreeing_position: float | None
    now_utc: datetime
    unchanged: bool | None = None
    unfinished: tuple[str, ...] = ()
    live: LiveSet | None = None
    marker: Marker | None = None
    mark: MarkerCheck = field(default_factory=MarkerCheck)
    plan: str = ""
    key_taken: str = ""
    missing: tuple[int, ...] = ()
    places: SafePlaces = field(default_factory=SafePlaces)
    brought: Mapping[str, float] = field(default_factory=dict)
    uptime: Uptime = field(default_factory=Uptime)

    @property
    def modes(self) -> tuple[str, ...]:
        """Where no program loads the tables the control may be in JOG as well; any mode where a restart does it."""
        if not self.can.switches_now:
            return (*self.request.modes, "JOG", "MDI")
        return self.request.modes if self.can.stops else (*self.request.modes, "JOG")

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


def refuse(code: str, **fields: object) -> Iterator[Refusal]:
    """One reason, for a rule to yield from."""
    yield Refusal(code, fields)


def value_at(table: CompensationTable, position: float, approach: Approach = 1) -> float:
    """Deviation of a table at a position in its input axis' unit, reached by ``approach``; never loaded: zero."""
    loaded = table.step > 0 or bool(table.places)
    if not loaded or not any((*table.deviations, *table.reverse)):
        return 0.0
    return float(table.at(np.array([position]), approach)[0])


def other_cross_tables(live: LiveSet, table: CompensationTable) -> tuple[LiveTable, ...]:
    """The cross tables of the set's axis but for ``table``."""
    return tuple(one for one in live.cross if table.kind != "cross" or one.table.index != table.index)


def other_tables_now(facts: PushFacts) -> float:
    """What the other cross tables of the output axis add where their input axes stand; 0 for an axis table.

    A cross table's push switches all tables of its output axis off and on again, so this moves the axis too. Before
    anything is sent its own input axis counts as standing where it will be brought to.
    """
    if facts.live is None or not facts.is_cross:
        return 0.0
    places = {name: axis.position for name, axis in facts.state.axes.items()}
    if facts.moment == "start" and facts.agreeing_position is not None:
        places |= facts.brought
        places[facts.table.input_axis] = facts.agreeing_position
    enabled = [one.table for one in other_cross_tables(facts.live, facts.table) if one.enabled]
    return sum(value_at(table, places.get(table.input_axis, table.minimum)) for table in enabled)


# Limits of a push beside those of the table itself (`drivers.limits`): age, warmth, repetitions, proofs.

MAX_AGE = timedelta(hours=24)
WARN_AGE = timedelta(hours=4)
MAX_AHEAD = timedelta(minutes=2)
APPROVED_FOR = timedelta(minutes=10)
APPROVED_AHEAD = timedelta(seconds=10)
# A table may be pushed at another temperature than it was measured at, as long as that spoils little of what it
# corrects: never less than normal conditions change in a shift, never more than a machine in use should.
LEAST_DRIFT_K, MOST_DRIFT_K = 2.0, 8.0
SPOILT_SHARE = 0.25
# Of straightness and squareness, which a uniform change of a shift in an ordinary hall leaves as they are.
CROSS_DRIFT_K = 4.0
# 1e-6/K: by so much may the expansion of an axis differ from the one its readings were corrected with (steel, glass).
EXPANSION_DOUBT = 3.5
MIN_REPETITIONS = 3
MAX_SUSPECT_SHARE = 0.1
MAX_REMAINING = 0.5
MAX_REPEATABILITY = 1.0 / 3.0
COARSEST_UM = 1.0
PROOF_WITHIN = 0.2
PROOF_COVERAGE = 2.0
PROOF_TIMES_U = 4.0
# Midway between one and half or twice.
PROOF_SIZES = (0.75, 1.5)

MAX_JUMP = Limits.of("mm").jump
# um or arcsec: by so little temperature compensation may have changed since the measurement.
TEMPERATURE_MOVED = 0.1
