"""Between a plan and its push: whose approvals count, used up before anything is written, and the audit of it all."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta

from drivers.errors import TrueflankError
from gateway import audit
from gateway.approve import Approvals
from gateway.domain import Approval, Proposal, PushRecord, TableChange
from gateway.push import PushContext, plan_hash
from gateway.push.compare import table_facts
from gateway.store.records import canonical, sha256
from gateway.workflow.bench import Bench

# A push that has begun may wait for people and machine for hours; what it was allowed at its start stays allowed.
IN_USE = timedelta(hours=24)
UNSURE = frozenset({"E-PUSH-JOURNAL", "E-PUSH-HELD", "E-PUSH-UNEXPECTED"})


def consented(
    at: Bench, change: TableChange, context: PushContext, taken: tuple[Approval, ...] | None = None
) -> PushContext:
    """The context with who pushes, the approvals of this plan, and the state of the audit.

    ``taken`` are approvals this push has taken up already; None: those nobody has used yet. Raises CorruptRecord
    (E-STORE-HASH) when one was altered.
    """
    health = audit.check(at.store.root)
    broken = health.problem.words if health.problem is not None else ""
    approvals = _unused(at, change) if taken is None else taken
    return replace(context, actor=audit.os_user(), approvals=approvals, audit_broken=broken)


def _unused(at: Bench, change: TableChange) -> tuple[Approval, ...]:
    return Approvals(at.folder.path).unused(plan_hash(change, at.machine))


def take_up(at: Bench, proposal: Proposal) -> dict[str, tuple[Approval, ...]]:
    """Use up the approvals of every proposed table, by its name, durably and before anything is written.

    Call it once nothing speaks against the push. What is returned holds for this push, however long people and
    machine take; an approval that has expired before stays expired. Raises WriteRefused (E-APPROVE-USED), StoreError.
    """
    now = at.clock.utc()
    held: dict[str, tuple[Approval, ...]] = {}
    for change in proposal.changes:
        approvals = () if change.skipped else _unused(at, change)
        Approvals(at.folder.path).use(approvals, f"push of {change.name} by {audit.os_user()} at {now.isoformat()}")
        held[change.name] = tuple(_held(approval, now) for approval in approvals)
    return held


def _held(approval: Approval, now: datetime) -> Approval:
    if now >= datetime.fromisoformat(approval.expires_utc):
        return approval
    return replace(approval, expires_utc=(now + IN_USE).isoformat(timespec="seconds"))


def begin(at: Bench, change: TableChange, context: PushContext) -> None:
    """Keep that a push begins, durable: the last act before anything is sent.

    Raises CorruptRecord (E-AUDIT-BROKEN), BusyError (E-AUDIT-BUSY), StoreError: then nothing may be sent.
    """
    people = ", ".join(sorted({approval.actor for approval in context.approvals}))
    _keep(at, change, "push-start", {"approved_by": people} if people else {})


def proving(at: Bench, change: TableChange) -> None:
    """Keep that a sign proof begins: its small table is written to the machine too. Raises as `begin`."""
    _keep(at, change, "sign-proof-start", {})


def refused(at: Bench, reasons: tuple[str, ...]) -> str:
    """Keep that a push was refused before it began; returns the log's problem in words ("": none)."""
    told = {"run": at.folder.run_id, "count": len(reasons), "reasons": "; ".join(reasons)}
    return audit.note(at.store.root, "push-refused", clock=at.clock, serial=at.machine.serial, details=told)


def failed(at: Bench, change: TableChange, error: BaseException) -> str:
    """Keep that a push ended without a record; the log's problem in words ("": none).

    "push-failed": with an error and nothing written; "push-unknown": stopped from outside, or its journal refused an
    entry, so that only `recover` can say what stands in the control.
    """
    told = {"table": change.name, "run": at.folder.run_id, "why": why_of(error)}
    action = f"push-{word_of(error)}"
    return audit.note(at.store.root, action, clock=at.clock, serial=at.machine.serial, details=told)


def word_of(error: BaseException) -> str:
    """ "failed" where an error says that nothing was written, "unknown" where it cannot."""
    sure = isinstance(error, TrueflankError) and error.code not in UNSURE
    return "failed" if sure else "unknown"


def why_of(error: BaseException) -> str:
    """An error's words, those of a stop from outside as well."""
    return str(error) if isinstance(error, TrueflankError) else "stopped from outside"


def ended(at: Bench, change: TableChange, record: PushRecord) -> str:
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


def proposed(at: Bench, proposal: Proposal) -> str:
    """Keep that a run proposed tables; returns the log's problem in words ("": none)."""
    tables = ", ".join(change.name for change in proposal.changes if not change.skipped)
    told = {"run": at.folder.run_id, "tables": tables}
    return audit.note(at.store.root, "propose", clock=at.clock, serial=at.machine.serial, details=told)


def tell(at: Bench, problem: str) -> None:
    """Tell people that the audit log could not take a record of what has been done; nothing to tell for ""."""
    if problem:
        at.say("P-AUDIT", problem=problem)


def recovered(at: Bench, action: str, record: PushRecord) -> str:
    """Keep what a recovery did; returns the log's problem in words ("": none)."""
    told = {"axis": record.axis, "run": at.folder.run_id, "finding": action}
    number, serial = record.transaction, at.machine.serial
    action = f"recover-{record.outcome}"
    return audit.note(at.store.root, action, clock=at.clock, serial=serial, transaction=number, details=told)


def not_recovered(at: Bench, action: str, number: int, error: BaseException) -> str:
    """Keep that a recovery ended without a record; returns the log's problem in words ("": none)."""
    told = {"run": at.folder.run_id, "finding": action, "why": why_of(error)}
    serial, word = at.machine.serial, f"recover-{word_of(error)}"
    return audit.note(at.store.root, word, clock=at.clock, serial=serial, transaction=number, details=told)


def table_hash(change: TableChange) -> str:
    """sha256 of the new table's canonical form."""
    return sha256(canonical(table_facts(change.new)))


def _keep(at: Bench, change: TableChange, action: str, told: dict[str, object]) -> None:
    audit.record(
        at.store.root,
        action,
        clock=at.clock,
        serial=at.machine.serial,
        plan_hash=plan_hash(change, at.machine),
        base_hash=change.base_digest,
        new_hash=table_hash(change),
        details={"table": change.name, "run": at.folder.run_id, **told},
    )
