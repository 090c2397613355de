"""Approvals and audit of a run: which approvals count, consumed before anything is written, and a record of every step.

A record of a start is durable before anything is sent; a log that cannot take it stops the push. After a write a log
that fails is only reported, for a write is not undone by that. `AuditAdapter` answers what a push asks of the log, and
reads it again as it grows.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.message import Message, words
from drivers.terms import spoken
from drivers.types.uptime import Uptime
from gateway import audit
from gateway.approve import Approvals
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import Approval, Proposal, TableChange
from gateway.errors import CorruptRecord, StoreError, WriteRefused
from gateway.interlocks import APPROVED_AHEAD
from gateway.push import JOURNALS, PushContext, machine_folder, plan_hash, read_journals, table_facts
from gateway.store import RunFolder, canonical, disk_errors, sha256
from gateway.users import KeyRing
from gateway.workflow.run import stages
from gateway.workflow.run.context import RunContext

UNSURE = frozenset({"E-PUSH-JOURNAL", "E-PUSH-HELD", "E-PUSH-HELD-ON", "E-PUSH-UNEXPECTED"})


def with_consent(
    at: RunContext, change: TableChange, context: PushContext, taken: ConsumedApproval | None = None
) -> PushContext:
    """The context with who pushes, the approvals of this plan, and what the audit log knows of plan and table.

    ``taken`` are approvals this push has taken up already; None: those nobody has used yet. Raises CorruptRecord
    (E-STORE-HASH) when one was altered, StoreError.
    """
    log, ring = AuditAdapter(at), KeyRing(at.store.root)
    known = log.standing
    approvals = _unused_approvals(at, change) if taken is None else taken.approvals
    digests = {approval: Approvals.digest(approval) for approval in approvals}
    return replace(
        context,
        actor=ring.person_named(audit.acting_person()),
        approvals=approvals,
        audit_broken=audit_problem(at),
        log=log,
        is_proposed=_is_proposed(at, change, known, context),
        used_approvals=tuple(one for one, digest in digests.items() if taken is None and digest in known.used),
        unrecorded_approvals=tuple(one for one, digest in digests.items() if digest not in known.approved),
        unsigned_approvals=tuple(one for one in approvals if not is_signed(ring, one)),
        alarms=alarms_of(known, change.axis),
        run_id=at.folder.run_id,
        overtaken_approvals=overtaken(known, digests, at.clock.utc()) if taken is None else taken.overtaken,
        consent_utc=None if taken is None else taken.at_utc,
        consent_uptime=None if taken is None else taken.at_uptime,
    )


def is_signed(ring: KeyRing, approval: Approval) -> bool:
    """Whether a person whose key is known signed an approval; where nobody at the store has a key none is signed."""
    if not approval.signature:
        return not ring.signs
    form = Approvals.signed_form(approval)
    return ring.is_persons(approval.actor, approval.key, form, approval.signature)


def require_current_version(folder: RunFolder) -> None:
    """Raises WriteRefused (E-PROPOSAL-OLDER) for a proposal of an older version, which hashed its plans otherwise."""
    version = folder.older(stages.PROPOSAL)
    if version:
        raise WriteRefused("E-PROPOSAL-OLDER", folder.run_id, run=folder.run_id, version=version)


def audit_problem(at: RunContext) -> str:
    """Why the log cannot be trusted, in words ("": it can): its own lines, and what this store's files say of it."""
    root = at.store.root
    try:
        heads = anchors(root, at.machine.serial, at.folder.anchor)
        problem = audit.check_log(root, heads).problem
    except CorruptRecord as error:
        return str(error)
    return problem.words if problem is not None else ""


def alarms_of(known: audit.LogState, axis: str) -> tuple[Message, ...]:
    """What stands against the tables of an axis."""
    return tuple(told for table, told in known.alarms.items() if spoken().axis_of(table) == axis)


def _is_proposed(at: RunContext, change: TableChange, known: audit.LogState, context: PushContext) -> bool:
    """Whether the log holds this plan's proposal as it is stored, made of the very capture it is judged by.

    A gateway that is trusted here must have signed the line: who can write the log alone cannot.
    """
    folder, ring = at.folder, KeyRing(at.store.root)
    if not folder.has(stages.PROPOSAL):
        return False
    plan, proposal = plan_hash(change, at.machine), folder.digest(stages.PROPOSAL)
    form = _proposal_form(at, plan, proposal)
    if not any(ring.is_gateways(key, form, sign) for key, sign in known.plans.get((plan, proposal), ())):
        return False
    if context.capture is None:
        return True
    capture = folder.digest(stages.capture(change.axis, "before"))
    return capture in folder.get(stages.PROPOSAL, Proposal).parents


def _proposal_form(at: RunContext, plan: str, proposal: str) -> bytes:
    """What of a proposal is signed: its plan, the stored record by its hash, the run and the machine."""
    told = {"plan": plan, "proposal": proposal, "run": at.folder.run_id, "serial": at.machine.serial}
    return b"trueflank proposal 1\n" + canonical(told)


def _unused_approvals(at: RunContext, change: TableChange) -> tuple[Approval, ...]:
    return Approvals(at.folder.path).read_unused(plan_hash(change, at.machine))


@dataclass(frozen=True, slots=True)
class ConsumedApproval:
    """Approvals of one table that this push has used up, and when it began: they must have held then.

    ``overtaken`` are those since which the log had a later time than the computer then showed.
    """

    approvals: tuple[Approval, ...]
    at_utc: datetime
    at_uptime: Uptime = field(default_factory=Uptime)
    overtaken: tuple[Approval, ...] = ()


def overtaken(known: audit.LogState, digests: Mapping[Approval, str], now_utc: datetime) -> tuple[Approval, ...]:
    """Approvals since which the log has a later time than the computer shows: its calendar was set back."""
    latest = (now_utc + APPROVED_AHEAD).isoformat(timespec="milliseconds")
    return tuple(one for one, digest in digests.items() if known.latest_since(digest) > latest)


def consume_approvals(at: RunContext, proposal: Proposal) -> dict[str, ConsumedApproval]:
    """Use up the approvals of every proposed table, by its name, durably and before anything is written.

    Call it once nothing speaks against the push. What is returned holds for this push, however long people and
    machine take; an approval that has expired before stays expired, and those the audit log knows as used stay used.
    Raises WriteRefused (E-APPROVE-USED), StoreError, BusyError (E-AUDIT-BUSY).
    """
    now, uptime, known = at.clock.utc(), at.clock.uptime(), AuditAdapter(at).standing
    held: dict[str, ConsumedApproval] = {}
    for change in proposal.changes:
        fresh = () if change.skipped else _unused_approvals(at, change)
        approvals = tuple(one for one in fresh if Approvals.digest(one) not in known.used)
        late = overtaken(known, {one: Approvals.digest(one) for one in approvals}, now)
        Approvals(at.folder.path).use(
            approvals,
            words("W-AUDIT-PUSH-BY", name=change.name, acting_person=audit.acting_person(), isoformat=now.isoformat()),
        )
        for approval in approvals:
            _record_use(at, change, approval)
        held[change.name] = ConsumedApproval(approvals, now, uptime, late)
    return held


def _record_use(at: RunContext, change: TableChange, approval: Approval) -> None:
    """The log's line is what makes an approval used for good; the mark beside it only keeps two pushes apart."""
    told = {"approval": Approvals.digest(approval), "run": at.folder.run_id, "table": change.name}
    told["approved_by"] = approval.actor
    audit.record(
        at.store.root,
        audit.USED,
        clock=at.clock,
        serial=at.machine.serial,
        plan_hash=approval.plan_hash,
        base_hash=approval.base_digest,
        details=told,
    )


def record_start(at: RunContext, change: TableChange, context: PushContext) -> None:
    """Keep that a push begins, durable: the last act before anything is sent.

    Raises CorruptRecord (E-AUDIT-BROKEN), BusyError (E-AUDIT-BUSY), StoreError: then nothing may be sent.
    """
    people = ", ".join(sorted({approval.actor for approval in context.approvals}))
    told: dict[str, object] = {"approved_by": people} if people else {}
    typed = context.risk_taken and bool(_unprotected_connection(at))
    _append_record(at, change, "push-start", told | ({"risk": "typed"} if typed else {}))


def record_sign_proof(at: RunContext, change: TableChange) -> None:
    """Keep that a sign proof begins: its small table is written to the machine too. Raises as `record_start`."""
    _append_record(at, change, "sign-proof-start", {})


def record_repeated_proof(at: RunContext, change: TableChange, mean: float, u: float, count: int) -> None:
    """Keep that its table is switched as often again, and what the first ``count`` steps gave.

    Raises as `record_start`.
    """
    _append_record(at, change, "sign-proof-again", {"mean": round(mean, 3), "u": round(u, 3), "steps": count})


def record_left_out(at: RunContext, change: TableChange, why: str) -> None:
    """Keep that a run goes on without a table whose sign is not proved, or that is worth nothing without it."""
    _append_record(at, change, "push-left-out", {"why": why})


def record_refusal(at: RunContext, reasons: tuple[str, ...]) -> str:
    """Keep that a push was refused before it began; returns the log's problem in words ("": none)."""
    told = {"run": at.folder.run_id, "count": len(reasons), "reasons": "; ".join(reasons)}
    return audit.note(at.store.root, "push-refused", clock=at.clock, serial=at.machine.serial, details=told)


def record_failure(at: RunContext, change: TableChange, error: BaseException) -> str:
    """Keep that a push ended without a record; the log's problem in words ("": none).

    "push-failed": with an error and nothing written; "push-unknown": stopped on request, or its journal refused an
    entry, so that only `recover` can say what stands in the control.
    """
    told = {"table": change.name, "run": at.folder.run_id, "why": error_words(error)}
    action = f"push-{outcome_word(error)}"
    return audit.note(at.store.root, action, clock=at.clock, serial=at.machine.serial, details=told)


def outcome_word(error: BaseException) -> str:
    """ "failed" where an error says that nothing was written, "unknown" where it cannot."""
    sure = isinstance(error, TrueflankError) and error.code not in UNSURE
    return "failed" if sure else "unknown"


def error_words(error: BaseException) -> str:
    """An error's words, those of a stop from outside as well."""
    return str(error) if isinstance(error, TrueflankError) else words("W-SHORT-STOPPED")


def record_end(at: RunContext, change: TableChange, record: PushRecord) -> str:
    """Keep how it ended; returns the log's problem in words ("": none), for a write is not undone by that."""
    told = {"table": change.name, "run": at.folder.run_id, "backup": record.backup_path}
    return audit.note(
        at.store.root,
        f"push-{record.outcome}",
        clock=at.clock,
        serial=at.machine.serial,
        transaction=record.transaction,
        plan_hash=plan_hash(change, at.machine),
        base_hash=change.base_digest,
        new_hash=table_hash(change),
        details=told,
    )


def record_proposal(at: RunContext, proposal: Proposal) -> str:
    """Keep what a run has proposed and stored, a line for each table; the log's problem in words ("": none).

    The run folder then names the log's head, so that a log which is gone or cut is missed.
    """
    told: dict[str, object] = {"run": at.folder.run_id, "proposal": at.folder.digest(stages.PROPOSAL)}
    problems = [_record_proposed(at, change, told) for change in proposal.changes if not change.skipped]
    if not problems:
        problems = [
            audit.note(at.store.root, "propose-nothing", clock=at.clock, serial=at.machine.serial, details=told)
        ]
    if not any(problems):
        at.folder.set_anchor(audit.current_head(at.store.root))
    return next((one for one in problems if one), "")


def _record_proposed(at: RunContext, change: TableChange, told: dict[str, object]) -> str:
    plan = plan_hash(change, at.machine)
    try:
        signer = KeyRing(at.store.root).gateway()
    except StoreError as error:
        return str(error)
    told = told | {
        "key": signer.public,
        "signature": signer.signature_of(_proposal_form(at, plan, str(told["proposal"]))),
    }
    return audit.note(
        at.store.root,
        audit.PROPOSED,
        clock=at.clock,
        serial=at.machine.serial,
        plan_hash=plan,
        base_hash=change.base_digest,
        new_hash=table_hash(change),
        details={**told, **_unprotected_connection(at), "table": change.name},
    )


def record_look(at: RunContext, action: str, **told: object) -> None:
    """Keep that somebody looked and nothing was changed: the line is all that stays of it."""
    report_log_problem(
        at, audit.note(at.store.root, f"{action}-looked", clock=at.clock, serial=at.machine.serial, details=told)
    )


def report_log_problem(at: RunContext, problem: str) -> None:
    """Tell people that the audit log could not take a record of what has been done; nothing to tell for ""."""
    if problem:
        at.say("P-AUDIT", problem=problem)


def record_recovery(at: RunContext, action: str, record: PushRecord) -> str:
    """Keep what a recovery did; returns the log's problem in words ("": none)."""
    told = {"axis": record.axis, "run": at.folder.run_id, "finding": action}
    number, serial = record.transaction, at.machine.serial
    action = f"recover-{record.outcome}"
    return audit.note(at.store.root, action, clock=at.clock, serial=serial, transaction=number, details=told)


def record_failed_recovery(at: RunContext, action: str, number: int, error: BaseException) -> str:
    """Keep that a recovery ended without a record; returns the log's problem in words ("": none)."""
    told = {"run": at.folder.run_id, "finding": action, "why": error_words(error)}
    serial, word = at.machine.serial, f"recover-{outcome_word(error)}"
    return audit.note(at.store.root, word, clock=at.clock, serial=serial, transaction=number, details=told)


def table_hash(change: TableChange) -> str:
    """sha256 of the new table's canonical form."""
    return sha256(canonical(table_facts(change.new)))


def _append_record(at: RunContext, change: TableChange, action: str, told: dict[str, object]) -> None:
    audit.record(
        at.store.root,
        action,
        clock=at.clock,
        serial=at.machine.serial,
        plan_hash=plan_hash(change, at.machine),
        base_hash=change.base_digest,
        new_hash=table_hash(change),
        details={"table": change.name, "run": at.folder.run_id, **_unprotected_connection(at), **told},
    )


def _unprotected_connection(at: RunContext) -> dict[str, object]:
    """What a record says of the connection: nothing but where it is not protected."""
    return {"unprotected": str(at.open_road)} if at.open_road else {}


# The audit log as a push asks for it: told before anything is sent, asked what it knows, read again as it grows.


class AuditAdapter:
    """A store's log for one machine; keeps `gateway.push.context.AuditLog`."""

    def __init__(self, at: RunContext) -> None:
        self._root, self._clock, self._serial = at.store.root, at.clock, at.machine.serial
        self._run = at.folder.run_id
        self._known = audit.LogState()
        self._as_of = ""

    def begin(self, transaction: int, change: TableChange) -> str:
        """Keep that a transaction begins; the head is then on the disk. Raises as `audit.record`."""
        head = audit.record(
            self._root,
            audit.BEGUN,
            clock=self._clock,
            serial=self._serial,
            transaction=transaction,
            base_hash=change.base_digest,
            new_hash=sha256(canonical(table_facts(change.new))),
            details={"table": change.name, "run": self._run},
        )
        return str(head)

    def end(self, transaction: int, state: str) -> None:
        """Keep what the control's marker is about to say."""
        told = {"state": state, "run": self._run}
        audit.note(
            self._root, audit.ENDING, clock=self._clock, serial=self._serial, transaction=transaction, details=told
        )

    def marker_lost(self, transaction: int, table: str, state: str, why: str) -> None:
        """Keep that the control's marker does not say how a transaction ended."""
        told = {"table": table, "state": state, "why": why, "run": self._run}
        audit.note(
            self._root,
            audit.MARKER_LOST,
            clock=self._clock,
            serial=self._serial,
            transaction=transaction,
            details=told,
        )

    def head(self) -> int:
        """The first 64 bits of the head; 0 where the log has none to give."""
        try:
            number, _, digest = audit.current_head(self._root).partition(":")
        except TrueflankError:
            return 0
        return int(digest[:16], 16) if int(number) else 0

    def begun(self, transaction: int) -> bool:
        """Whether a line names this transaction."""
        return transaction in self.standing.begun

    def announced(self) -> frozenset[int]:
        """Transactions that were begun here, each with its journal."""
        return frozenset(self.standing.announced)

    def holds(self, head: int) -> bool:
        """Whether a line has a hash that begins so."""
        return head in self.standing.prefixes

    def last_mark(self) -> int:
        """The transaction that the marker should still name; 0 where it need name none."""
        return self.standing.last_mark

    @property
    def standing(self) -> audit.LogState:
        """What the log says now."""
        try:
            as_of = audit.current_head(self._root)
        except TrueflankError:
            as_of = ""  # a log that is not whole is told elsewhere; what it says is read afresh
        if not as_of or as_of != self._as_of:
            self._known, self._as_of = audit.read_log_state(self._root, self._serial), as_of
        return self._known


def anchors(root: Path, serial: str, *named: str) -> tuple[audit.ChainHead, ...]:
    """Heads that the journals of a machine, and ``named`` others, say the log has had. Raises CorruptRecord."""
    folder = machine_folder(root / JOURNALS, serial)
    every = (*read_journals(folder), *read_journals(folder / "done"))
    told = {str(found.latest("audit")) for found in every if found.latest("audit")}
    return tuple(audit.parse_head(text) for text in sorted({*told, *(one for one in named if one)}))


# A run's folder is taken away, unless something rests on it; the audit log keeps that it was.


def remove_run(folder: RunFolder, *, clock: Clock) -> None:
    """Remove a run whose folder nothing rests on.

    A run that pushed stays: rolling back and verifying start from it. Raises StoreError (E-STORE-RESTS,
    E-STORE-DISK), CorruptRecord (E-AUDIT-BROKEN).
    """
    pushed = [stage for stage in folder.stages if stage.startswith(stages.push(""))]
    if pushed:
        raise StoreError("E-STORE-RESTS", str(folder.path), run=folder.run_id, pushes=", ".join(pushed))
    root = folder.path.parent
    audit.require_sound(root)
    told = {"run": folder.run_id, "state": folder.state, "head": folder.anchor}
    audit.record(root, "remove-run", clock=clock, role="operator", details=told)
    with disk_errors(folder.path):
        shutil.rmtree(folder.path)
