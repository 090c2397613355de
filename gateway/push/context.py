"""What a push works with: the machine's port, the axis, the consent, the clock and where to keep things."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Protocol

from drivers.clock import Clock
from drivers.limits import ACCESS_LEVEL
from drivers.message import Message
from drivers.ports.controller import Controller
from drivers.programs import SelfTested
from drivers.types.identity import MachineIdentity
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.stops import StopPlan
from drivers.types.tables import CompensationTable, LiveSet
from drivers.types.uptime import Uptime
from drivers.types.values import Sense
from gateway.axes import AxisRecord
from gateway.domain.captures import Capture
from gateway.domain.proposals import Approval, TableChange
from gateway.push.compare import table_facts
from gateway.say import Say, silence


class TextArchive(Protocol):
    """Where texts are kept for good: a run folder. Returns the path once the text is durable."""

    @property
    def path(self) -> Path:
        """The folder."""
        ...

    def write_text(self, name: str, text: str) -> Path:
        """Keep a text exactly as given."""
        ...


class AuditLog(Protocol):
    """What a push asks of the log of who did what: it is told before anything is sent, and it can be asked."""

    def begin(self, transaction: int, change: TableChange) -> str:
        """Keep, durable, that a transaction begins; the log's head. Raises CorruptRecord, BusyError, StoreError."""
        ...

    def end(self, transaction: int, state: str) -> None:
        """Keep how the control's marker is about to say that it ended; a log that takes nothing stops nothing."""
        ...

    def marker_lost(self, transaction: int, table: str, state: str, why: str) -> None:
        """Keep that the control's marker could not be brought to ``state``; stops nothing either."""
        ...

    def head(self) -> int:
        """The first 64 bits of the log's head; 0 for none."""
        ...

    def begun(self, transaction: int) -> bool:
        """Whether the log knows that this transaction of the machine began."""
        ...

    def announced(self) -> frozenset[int]:
        """Every transaction of the machine that `begin` has kept: each has a journal."""
        ...

    def holds(self, head: int) -> bool:
        """Whether a line of the log has a hash that begins so."""
        ...

    def last_mark(self) -> int:
        """The transaction that the machine's marker should still name; 0 where it need name none."""
        ...


@dataclass(frozen=True, slots=True)
class PushContext:
    """Everything a push may use.

    ``axis`` is the table's output axis, ``input`` its input axis where that is another (a cross table). ``proof`` must
    be that of the table's kind and output axis. ``pushed`` are tables this run has committed before, as
    stored: they are expected in the live set although the capture did not see them.

    ``actor`` is who pushes, ``approvals`` who else agreed, ``approvals_needed`` how many people the site asks
    for (None: one, two when anything warns). ``audit_broken`` says why the audit cannot be trusted. ``key`` is
    the caller's transaction key: the same key with the same plan gives the same answer.

    ``log`` is the audit log (None: nobody keeps one, as in a trial). ``is_proposed`` says whether it contains the
    signed proposal of this plan, ``used_approvals`` and ``unrecorded_approvals`` are those that it knows as used, or
    does not know at all, ``unsigned_approvals`` those without a signature of their person's known key, ``alarms`` what
    it found at the axis' live tables. ``overtaken_approvals`` are those since which it has a later time than the
    computer showed. ``run_id`` is the run that approvals must name; ``consent_utc`` and ``consent_uptime`` when this
    push began, which is when they must hold (None: now). ``on_live`` is told the live tables as read before anything is
    disabled, cross tables as deviations, and answers with the alarms that stand then.

    ``self_test`` is the last one of the output axis (None: this store knows none). ``risk_taken``: who pushes has typed
    the risk of a connection that is not protected. ``resumes``: what was begun under ``key`` and has not ended goes on.
    ``follows`` are the stops that come next once the effect is proved: one program and one press hold both. ``read`` is
    what was read of the output axis a moment before (None: it is read now).

    ``journals`` is the folder of all machines' journals; ``machine`` the fingerprint the run was made on;
    ``typed_name`` what the operator gave as the machine's name, ``site_name`` what it must be. Timeouts in s of
    the clock: for a person to start or do a reference run, and for one move to end.
    """

    controller: Controller
    clock: Clock
    folder: TextArchive
    journals: Path
    axis: AxisRecord
    machine: MachineIdentity
    typed_name: str
    site_name: str
    proof: SignProof | None = None
    capture: Capture | None = None
    ambient_now: Ambient | None = None
    start_timeout_s: float = 600.0
    stop_timeout_s: float = 120.0
    modes: tuple[str, ...] = ("AUTO",)
    harmless_alarms: tuple[int, ...] = ()
    access_level_needed: int = ACCESS_LEVEL
    say: Say = field(default=silence)
    input: AxisRecord | None = None
    pushed: tuple[CompensationTable, ...] = ()
    actor: str = ""
    approvals: tuple[Approval, ...] = ()
    approvals_needed: int | None = None
    audit_broken: str = ""
    key: str = ""
    log: AuditLog | None = None
    is_proposed: bool = True
    used_approvals: tuple[Approval, ...] = ()
    unrecorded_approvals: tuple[Approval, ...] = ()
    unsigned_approvals: tuple[Approval, ...] = ()
    alarms: tuple[Message, ...] = ()
    run_id: str = ""
    on_live: Callable[[LiveSet], tuple[Message, ...]] | None = None
    consent_utc: datetime | None = None
    consent_uptime: Uptime | None = None
    overtaken_approvals: tuple[Approval, ...] = ()
    self_test: SelfTested | None = None
    risk_taken: bool = False
    resumes: bool = False
    follows: tuple[StopPlan, ...] = ()
    read: LiveSet | None = None

    @property
    def input_axis(self) -> AxisRecord:
        """The axis that must stand where old and new table agree: the input axis."""
        return self.input or self.axis

    @property
    def sense(self) -> Sense:
        """In which sense cross tables are kept in this push's journal: that of its proof, as stored without one."""
        return self.proof.sense if self.proof is not None else 1

    def meant(self, table: CompensationTable, sense: Sense) -> CompensationTable:
        """A table that a journal kept in ``sense``, as a deviation by this push's proof."""
        return self.controller.table_by(table, sense, self.proof)


# People approve exactly this hash of table, base and machine, and nothing else.

PLAN = 2
"""The form of what is hashed: another form is another plan, whatever stands in it."""


def plan_hash(change: TableChange, machine: MachineIdentity) -> str:
    """sha256 (hex) of the canonical form of a change on a machine; pure.

    Canonical: JSON with sorted keys and no blanks; floats by `repr` (the shortest text of the same double).
    Enters: the form of the plan itself, every field of the new table, the digest of the live tables it was made on,
    the machine's fingerprint. What was predicted and found does not: it is not written.
    """
    plan = {
        "plan": PLAN,
        "table": table_facts(change.new),
        "base_digest": change.base_digest,
        "machine": [machine.serial, machine.version, list(machine.axis_names), machine.unit_system],
    }
    text = json.dumps(plan, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()
