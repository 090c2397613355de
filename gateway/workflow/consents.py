"""Between a plan and its push: whose approvals count, used up before anything is written, and the audit of it all."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.terms import spoken
from gateway import audit
from gateway.approve import Approvals
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import Approval, Proposal, TableChange
from gateway.errors import CorruptRecord, StoreError, WriteRefused
from gateway.push import PushContext, plan_hash, table_facts
from gateway.store import RunFolder
from gateway.store.records import canonical, sha256
from gateway.users import KeyRing
from gateway.workflow import stages
from gateway.workflow.bench import Bench
from gateway.workflow.witness import Witness, anchors

UNSURE = frozenset({"E-PUSH-JOURNAL", "E-PUSH-HELD", "E-PUSH-HELD-ON", "E-PUSH-UNEXPECTED"})


def consented(at: Bench, change: TableChange, context: PushContext, taken: Taken | None = None) -> PushContext:
    """The context with who pushes, the approvals of this plan, and what the audit log knows of plan and table.

    ``taken`` are approvals this push has taken up already; None: those nobody has used yet. Raises CorruptRecord
    (E-STORE-HASH) when one was altered, StoreError.
    """
    log, ring = Witness(at), KeyRing(at.store.root)
    known = log.standing
    approvals = _unused(at, change) if taken is None else taken.approvals
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
        consent_utc=None if taken is None else taken.at_utc,
    )


def is_signed(ring: KeyRing, approval: Approval) -> bool:
    """Whether a person whose key is known signed an approval; where nobody at the store has a key none is signed."""
    if not approval.signature:
        return not ring.signs
    form = Approvals.signed_form(approval)
    return ring.is_persons(approval.actor, approval.key, form, approval.signature)


def demand_todays(folder: RunFolder) -> None:
    """Raises WriteRefused (E-PROPOSAL-OLDER) for a proposal of an older version, which hashed its plans otherwise."""
    version = folder.older(stages.PROPOSAL)
    if version:
        raise WriteRefused("E-PROPOSAL-OLDER", folder.run_id, run=folder.run_id, version=version)


def audit_problem(at: Bench) -> str:
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


def _is_proposed(at: Bench, change: TableChange, known: audit.LogState, context: PushContext) -> bool:
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


def _proposal_form(at: Bench, plan: str, proposal: str) -> bytes:
    """What of a proposal is signed: its plan, the stored record by its hash, the run and the machine."""
    told = {"plan": plan, "proposal": proposal, "run": at.folder.run_id, "serial": at.machine.serial}
    return b"trueflank proposal 1\n" + canonical(told)


def _unused(at: Bench, change: TableChange) -> tuple[Approval, ...]:
    return Approvals(at.folder.path).read_unused(plan_hash(change, at.machine))


@dataclass(frozen=True, slots=True)
class Taken:
    """Approvals of one table that this push has used up, and when it began: they must have held then."""

    approvals: tuple[Approval, ...]
    at_utc: datetime


def take_up(at: Bench, proposal: Proposal) -> dict[str, Taken]:
    """Use up the approvals of every proposed table, by its name, durably and before anything is written.

    Call it once nothing speaks against the push. What is returned holds for this push, however long people and
    machine take; an approval that has expired before stays expired, and those the audit log knows as used stay used.
    Raises WriteRefused (E-APPROVE-USED), StoreError, BusyError (E-AUDIT-BUSY).
    """
    now, known = at.clock.utc(), Witness(at).standing
    held: dict[str, Taken] = {}
    for change in proposal.changes:
        fresh = () if change.skipped else _unused(at, change)
        approvals = tuple(one for one in fresh if Approvals.digest(one) not in known.used)
        Approvals(at.folder.path).use(
            approvals, f"push of {change.name} by {audit.acting_person()} at {now.isoformat()}"
        )
        for approval in approvals:
            _used(at, change, approval)
        held[change.name] = Taken(approvals, now)
    return held


def _used(at: Bench, change: TableChange, approval: Approval) -> None:
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


def begin(at: Bench, change: TableChange, context: PushContext) -> None:
    """Keep that a push begins, durable: the last act before anything is sent.

    Raises CorruptRecord (E-AUDIT-BROKEN), BusyError (E-AUDIT-BUSY), StoreError: then nothing may be sent.
    """
    people = ", ".join(sorted({approval.actor for approval in context.approvals}))
    told: dict[str, object] = {"approved_by": people} if people else {}
    typed = context.risk_taken and bool(_open_road(at))
    _keep(at, change, "push-start", told | ({"risk": "typed"} if typed else {}))


def proving(at: Bench, change: TableChange) -> None:
    """Keep that a sign proof begins: its small table is written to the machine too. Raises as `begin`."""
    _keep(at, change, "sign-proof-start", {})


def proving_again(at: Bench, change: TableChange, mean: float, u: float, count: int) -> None:
    """Keep that its table is switched as often again, and what the first ``count`` steps gave. Raises as `begin`."""
    _keep(at, change, "sign-proof-again", {"mean": round(mean, 3), "u": round(u, 3), "steps": count})


def left_out(at: Bench, change: TableChange, why: str) -> None:
    """Keep that a run goes on without a table whose sign is not proved, or that is worth nothing without it."""
    _keep(at, change, "push-left-out", {"why": why})


def refused(at: Bench, reasons: tuple[str, ...]) -> str:
    """Keep that a push was refused before it began; returns the log's problem in words ("": none)."""
    told = {"run": at.folder.run_id, "count": len(reasons), "reasons": "; ".join(reasons)}
    return audit.note(at.store.root, "push-refused", clock=at.clock, serial=at.machine.serial, details=told)


def failed(at: Bench, change: TableChange, error: BaseException) -> str:
    """Keep that a push ended without a record; the log's problem in words ("": none).

    "push-failed": with an error and nothing written; "push-unknown": stopped on request, or its journal refused an
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
    return str(error) if isinstance(error, TrueflankError) else "stopped on request"


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
    """Keep what a run has proposed and stored, a line for each table; the log's problem in words ("": none).

    The run folder then names the log's head, so that a log which is gone or cut is missed.
    """
    told: dict[str, object] = {"run": at.folder.run_id, "proposal": at.folder.digest(stages.PROPOSAL)}
    problems = [_proposed(at, change, told) for change in proposal.changes if not change.skipped]
    if not problems:
        problems = [
            audit.note(at.store.root, "propose-nothing", clock=at.clock, serial=at.machine.serial, details=told)
        ]
    if not any(problems):
        at.folder.set_anchor(audit.current_head(at.store.root))
    return next((one for one in problems if one), "")


def _proposed(at: Bench, change: TableChange, told: dict[str, object]) -> str:
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
        details={**told, **_open_road(at), "table": change.name},
    )


def looked(at: Bench, action: str, **told: object) -> None:
    """Keep that somebody looked and nothing was changed: the line is all that stays of it."""
    tell(at, audit.note(at.store.root, f"{action}-looked", clock=at.clock, serial=at.machine.serial, details=told))


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
        details={"table": change.name, "run": at.folder.run_id, **_open_road(at), **told},
    )


def _open_road(at: Bench) -> dict[str, object]:
    """What a record says of the connection: nothing but where it is not protected."""
    return {"unprotected": str(at.open_road)} if at.open_road else {}
