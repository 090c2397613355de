"""What is proposed for the control, and people's consent to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from drivers.message import Message
from drivers.terms import spoken
from drivers.types.identity import MachineIdentity
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.uptime import Uptime
from gateway.domain.values import FloatArray

MOST_HARM = 0.05  # a table that makes the axis worse more often than this is not proposed


@dataclass(frozen=True, slots=True)
class Chance:
    """The gain expected of a table, RMS before less RMS after (about the mean), its standard uncertainty, and how
    likely RMS or range of the axis get worse; in the deviation unit, and 0 to 1.
    """

    gain: float
    u: float
    worse: float

    @property
    def worth(self) -> bool:
        """Whether the gain is more than its standard uncertainty and harm unlikely."""
        return self.gain > self.u and self.worse < MOST_HARM


class FindingWeight(StrEnum):
    """What a finding means for the push of its table."""

    REFUSES = "refuses"
    ASKS = "asks"
    JUDGED = "judged"  # an interlock judges the same by a limit of its own


@dataclass(frozen=True, slots=True)
class TableFinding:
    """What is odd about a proposed table, and whether that refuses its push or asks for a second person."""

    message: Message
    weight: FindingWeight = FindingWeight.ASKS

    @classmethod
    def older(cls, text: str) -> TableFinding:
        """The finding of a record of an older version, which stored a sentence behind its code."""
        weight = FindingWeight.ASKS if text[:2] == "W-" else FindingWeight.REFUSES
        judged = text.partition(" ")[0].rstrip(":") in _JUDGED_THEN
        return cls(Message.stored(text), FindingWeight.JUDGED if judged else weight)


_JUDGED_THEN = ("W-COMP-STEEP", "W-COMP-FLAT")


@dataclass(frozen=True, slots=True)
class TableChange:
    """One proposed table: the old one as live, the new one merged, and what the axis will then show.

    ``predicted`` (m,) mean deviation expected at ``targets`` after the push, with expanded uncertainty
    ``predicted_U`` (k = 2); of a reversal they are B. ``skipped`` says why nothing is proposed (None:
    something is).

    ``axis`` is the output axis. A cross table's change names its table by ``new``: kind, index, input and output axis,
    direction, multiplication; its deviations are d of the output axis, whatever the machine's sign. ``targets``
    are then positions of the input axis. ``base`` is the live set the change was made on, where it is not that
    of a capture of this axis. ``chance`` stands where the table leaves much of the axis, or where something stays
    unseen: what it gains by all axes that explain the readings.
    """

    axis: str
    old: CompensationTable
    new: CompensationTable
    old_enabled: bool
    base_digest: str
    targets: FloatArray
    predicted: FloatArray
    predicted_U: FloatArray
    findings: tuple[TableFinding, ...] = ()
    skipped: Message | None = None
    base: LiveSet | None = None
    chance: Chance | None = None

    @property
    def layer(self) -> Literal["axis", "cross"]:
        """Which layer of correction it belongs to; a pair for two directions over its own axis is its reversal."""
        own_pair = self.new.input_axis == self.new.output_axis and self.new.direction != 0
        return "axis" if self.new.kind != "cross" or own_pair else "cross"

    @property
    def name(self) -> str:
        """The table among all of a proposal, as people name it: "X1", and for a cross table its number too."""
        return spoken().name(self.new.kind, self.axis, self.new.index)


def torn(chosen: Sequence[TableChange], among: Sequence[TableChange]) -> tuple[str, ...]:
    """Names of ``among`` that are missing from ``chosen``: a pair for two directions and its constant go together.

    Half of a pair moves the mean of both directions, and the constant beside a pair is B at one place.
    """
    paired = {one.axis for one in among if one.new.direction and one.layer == "axis" and not one.skipped}
    together = [one for one in among if one.axis in paired and one.layer == "axis" and one.new.kind != "axis"]
    touched = {one.axis for one in chosen if one.name in {other.name for other in together}}
    here = {one.name for one in chosen}
    return tuple(one.name for one in together if one.axis in touched and not one.skipped and one.name not in here)


@dataclass(frozen=True, slots=True)
class Approval:
    """One person's consent to one plan: ``plan_hash`` from `gateway.push.plan_hash`, bound to base and machine.

    ``actor`` is who gave it; ``serial`` the machine; it holds from ``given_utc`` until ``expires_utc`` (ISO 8601
    with offset). ``run_id`` is the run whose proposal was approved. ``kept_by`` are those who made the
    approver's account or gave it a secret within seven days before: their pushes it does not approve. ``signature``
    is that of all else by the approver's ``key`` (ed25519, hex; "" where nobody at the store has one). ``given_at``
    is when, by the count of the computer where it was given: until that is restarted the calendar does not matter.
    """

    actor: str
    plan_hash: str
    base_digest: str
    serial: str
    given_utc: str
    expires_utc: str
    run_id: str = ""
    kept_by: tuple[str, ...] = ()
    key: str = ""
    signature: str = ""
    given_at: Uptime = field(default_factory=Uptime)

    def age_s(self, now: Uptime) -> float | None:
        """Seconds since it was given, by the count of one computer; None at another one, or after a restart."""
        return now.since(self.given_at)


@dataclass(frozen=True, slots=True)
class Proposal:
    """All table changes of a run, for one machine, made from captures named by their hashes."""

    machine: MachineIdentity
    changes: tuple[TableChange, ...]
    parents: tuple[str, ...]
    created_utc: str
    warnings: tuple[Message, ...] = ()
