"""A proposal into the controller: approved, signs proved, tables pushed layer by layer, measured again and judged.

1. Nothing is written before every objection against every table was asked for; then the approvals are consumed.
2. Missing signs are proved in as few transactions as possible; a table whose sign stays unknown is left out.
3. Axis tables and reversals are pushed in as few transactions as the control allows, the axes measured again once and
   judged. Cross tables follow, so an axis is judged without what the tooth asks of it.
4. The first table that is not committed ends the push, after its record is stored; what was committed stays or goes as
   the partial-commit policy says.

A push by carried files stops while a person is at the machine and is begun again from here: what was recorded is
replayed from the journal, and the audit log gets no second entry.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from types import MappingProxyType
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError
from drivers.message import Message, fixed
from drivers.offline_exchange import OfflineExchange
from drivers.ports.controller import ReadsTogether
from drivers.programs import ForeseesPlans, reading_plan
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.stops import StopPlan
from drivers.types.tables import CompensationTable, LiveSet
from gateway import audit
from gateway.approve import Approvals, give_consent
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.domain.outcomes import PushRecord, Verdict
from gateway.domain.proposals import Approval, Proposal, TableChange, torn
from gateway.errors import NotSignedIn, StoreError, WriteRefused
from gateway.interlocks import Refusal
from gateway.push import (
    PartialCommitPolicy,
    PreflightResult,
    PushContext,
    group_transactions,
    has_ended,
    is_resumed,
    outcome_error,
    push_tables,
    read_live_of_axes,
    run_preflight,
    table_questions,
)
from gateway.say import Say
from gateway.store import RunFolder, encode, sha256
from gateway.users import KeyRing, Signer, UserAccounts
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.axes.short_capture import combined_effect_plans, verify_combined_effect
from gateway.workflow.axes.verdict import PUSHED, judge_pushed_axes, judge_run, verification_plans
from gateway.workflow.control.signs import can_prove_sign, prove_missing_signs
from gateway.workflow.results.endings import finish, once, preview_proposal, select_tables
from gateway.workflow.run import push_context, stages
from gateway.workflow.run.audit_trail import (
    ConsumedApproval,
    consume_approvals,
    record_end,
    record_look,
    record_refusal,
    record_start,
    report_log_problem,
    require_current_version,
    with_consent,
)
from gateway.workflow.run.context import RunContext, check_name, open_context, run_or_look, set_aside_carried_files
from gateway.workflow.run.folder import site_of, store_of
from gateway.workflow.run.live_tables import alarms_for_push, standing_alarms
from gateway.workflow.run.outcome import Outcome, with_alarms
from gateway.workflow.run.push_context import record_failed_push, table_context
from gateway.workflow.tooth.ablation import predict_without, residual_after_partial_push
from gateway.workflow.tooth.verdict import require_agreement

Done = TypeVar("Done")


async def apply_proposal(at: RunContext, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> Verdict:
    """Push every change of a proposal, measure the pushed axes again and judge.

    Each axis' own tables and its reversal come first and are judged together, by measuring the axis once, before
    any cross table is pushed: its own deviation is judged without what the tooth asks of it. Raises WriteRefused,
    VerifyError (rolled back) or RollbackFailed (held) at the first layer with a table that was not committed, after
    everything about it is stored; with any reason against any table at the start, nothing at all is written.
    """
    require_current_version(at.folder)
    require_agreement(at.folder)
    done = await _start(at, proposal, measured)
    try:
        verdict = await _push_layers(at, proposal, measured, done)
    except TrueflankError:
        push_context.end_offline_push(at, done.going)
        raise
    push_context.end_offline_push(at, done.going)
    return verdict


async def _start(at: RunContext, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> _PushProgress:
    """Nothing speaks against it, and its approvals are used up; what waits for carried files was asked before."""
    going = push_context.unfinished_offline_push(at)
    if going is not None:
        return _PushProgress(going.taken, going=going)
    await _require_no_objection(at, proposal, measured)
    approvals = consume_approvals(at, proposal)
    return _PushProgress(approvals, going=push_context.begin_offline_push(at, approvals))


async def _push_layers(
    at: RunContext, proposal: Proposal, measured: Mapping[str, MeasuredAxis], done: _PushProgress
) -> Verdict:
    changes = await prove_missing_signs(at, proposal.changes, measured)
    own = [change for change in changes if change.layer == "axis"]
    cross = [change for change in changes if change.layer == "cross"]
    reads = reads_of(at, cross, measured)
    await _push(at, own, measured, done, (*verification_plans(at, own), *reads))
    at.folder.set_state("pushed")
    verdicts = await judge_pushed_axes(at, own, measured, done.records, reads=reads)
    await _push(at, cross, measured, done, combined_effect_plans(at, cross), await read_before(at, cross, measured))
    verdict = judge_run(verdicts, tuple(done.records.values()), tuple(done.proofs))
    at.folder.put(stages.VERDICT, verdict, tuple(at.folder.digest(stages.push(name)) for name in done.records))
    predict_without(at, proposal)
    await verify_combined_effect(at)
    return verdict


@dataclass(slots=True)
class _PushProgress:
    """What a run has pushed so far: records by the change's name, tables now live, proofs used.

    ``approvals`` by the change's name were used up at the start and hold to the end.
    """

    approvals: Mapping[str, ConsumedApproval]
    records: dict[str, PushRecord] = field(default_factory=dict)
    tables: list[CompensationTable] = field(default_factory=list)
    proofs: list[SignProof] = field(default_factory=list)
    going: push_context.CarriedPush | None = None


async def _push(
    at: RunContext,
    changes: Sequence[TableChange],
    measured: Mapping[str, MeasuredAxis],
    done: _PushProgress,
    follows: tuple[StopPlan, ...],
    read: Mapping[str, LiveSet] = MappingProxyType({}),
) -> None:
    """One layer, in as few transactions as the control allows; ``follows`` are the stops that come after it.

    ``read`` is what was read a moment before, by output axis: it holds for the first transaction.
    Raises for the first table that was not committed.
    """
    known = {name: item.capture for name, item in measured.items()}
    wishes = [(change, table_context(at, change.new, known.get(change.axis))) for change in changes]
    for wish in wishes:
        if wish[0].skipped:
            await _push_group(at, (wish,), done)
    groups = group_transactions([wish for wish in wishes if not wish[0].skipped])
    for number, group in enumerate(groups, start=1):
        last, first = follows if number == len(groups) else (), read if number == 1 else {}
        ready = [(change, replace(one, follows=last, read=first.get(change.axis))) for change, one in group]
        await _push_group(at, ready, done)


async def _push_group(at: RunContext, group: Sequence[tuple[TableChange, PushContext]], done: _PushProgress) -> None:
    wishes = [(change, await _ready_context(at, change, context, done)) for change, context in group]
    changes = [change for change, _ in wishes]
    wishes = [(change, push_context.with_transaction_key(context, done.going, changes)) for change, context in wishes]
    known = all(has_ended(context) for _, context in wishes)
    records = await record_failed_push(at, changes, _record_start_of_all(at, wishes))
    if not known and not all(change.skipped for change in changes):
        set_aside_carried_files(at.supervisor.controller)
    for (change, context), record in zip(wishes, records, strict=True):
        if not change.skipped and not known:
            report_log_problem(at, record_end(at, change, record))
        done.records[change.name] = record
        if record.outcome in PUSHED:
            proved, controller = context.sense, at.supervisor.controller
            done.tables.append(controller.table_by(change.new, proved, None))
    failures = [outcome_error(record) for record in records]
    failure = next((one for one in failures if one is not None), None)
    try:
        for change, record in zip(changes, records, strict=True):
            at.folder.put(stages.push(change.name), record, (at.folder.digest(stages.PROPOSAL),))
    except StoreError as error:
        if failure is not None:  # how the push ended is told before all else
            raise failure from error
        raise
    if failure is not None:
        raise failure


async def _record_start_of_all(
    at: RunContext, wishes: Sequence[tuple[TableChange, PushContext]]
) -> tuple[PushRecord, ...]:
    for change, context in wishes:
        if not change.skipped and not is_resumed(context):
            record_start(at, change, context)
    return await push_tables(wishes, _partial_commit_policy(at))


async def _ready_context(at: RunContext, change: TableChange, context: PushContext, done: _PushProgress) -> PushContext:
    """The context with today's consent; a skipped table needs none of it."""
    context = replace(context, pushed=tuple(done.tables))
    if change.skipped:
        return context
    if context.proof is not None:
        done.proofs.append(context.proof)
    context = replace(context, ambient_now=await _ambient(at, change))
    context = with_consent(at, change, context, done.approvals[change.name])
    return replace(context, on_live=await alarms_for_push(at, change.axis))


def _partial_commit_policy(at: RunContext) -> PartialCommitPolicy:
    """Whether part of a layer may stay when the rest failed.

    An axis' own table was predicted for that axis alone. Tables for a tooth were found together: where one cures what
    another brings, part of them may be worse than none. So the flank that they leave is worked out first; what cannot
    be worked out does not stay.
    """

    def stays(changes: Sequence[TableChange]) -> bool:
        if torn(changes, at.folder.get(stages.PROPOSAL, Proposal).changes):
            return False
        if not at.folder.has(stages.TOOTH):
            return True
        found = residual_after_partial_push(at, changes)
        if found is None:
            return False
        figures = {"with_them": fixed(found.with_them_um), "without": fixed(found.without_um)}
        at.say("P-PUSH-REST-FLANK", names=", ".join(one.name for one in changes), **figures)
        return found.harmless

    return stays


async def _require_no_objection(at: RunContext, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> None:
    """Ask about every table before the first is touched. Raises WriteRefused (E-PUSH-REFUSED) with every reason."""
    told: dict[str, list[Message]] = {}
    for change in proposal.changes:
        refusals = () if change.skipped else (await _preflight(at, change, measured)).refusals
        for refusal in refusals:
            if refusal.code != "E-INT-NOTHING" and not _is_provable(at, refusal, at.axis(change.axis)):
                at.say("P-PUSH-REFUSED", axis=change.name, reason=refusal.message)
                told.setdefault(change.name, []).append(refusal.message)
    if told:
        reasons = tuple(f"{names}: {reason}" for names, reason in once(told.items()))
        report_log_problem(at, record_refusal(at, reasons))
        name = at.site.site.name
        raise WriteRefused("E-PUSH-REFUSED", name, count=len(reasons), reasons="; ".join(reasons))


async def _preflight(at: RunContext, change: TableChange, measured: Mapping[str, MeasuredAxis]) -> PreflightResult:
    known = measured.get(change.axis)
    context = table_context(at, change.new, known.capture if known is not None else None)
    return await run_preflight(
        change, with_consent(at, change, replace(context, ambient_now=await _ambient(at, change))), "table"
    )


async def _ambient(at: RunContext, change: TableChange) -> Ambient | None:
    """What the axis' instrument reads of its environment now; None where the axis has none."""
    name = at.axis(change.axis).measure.instrument
    return await at.supervisor.instrument(name).ambient() if name else None


async def push_run(
    folder: RunFolder, *, apply: bool, machine_name: str, clock: Clock, say: Say, tables: Collection[str] = ()
) -> Outcome:
    """A stored run's proposal against the live machine: difference and refusals; with `apply` the push itself.

    ``tables`` by their names are the only ones; none named: all. Without `apply` nothing is written, and the run stays
    as it is however the look ends. Raises what `run_site` raises, ConfigError (E-RUN-AXIS).
    """
    site, path = site_of(folder)
    check_name(site, apply, machine_name)
    proposal = select_tables(folder.get(stages.PROPOSAL, Proposal), tables)
    require_current_version(folder)
    measured = stored_axes(folder, proposal)
    with push_context.offline_work_of(folder, site.controller.driver, apply=apply):
        if not apply:
            with run_or_look(site, path, "looking", look=True) as beside:
                async with open_context(site, path, folder=beside, clock=clock, say=say) as at:
                    return await _preview_push(replace(at, folder=folder), proposal, measured)
        try:
            async with open_context(site, path, folder=folder, clock=clock, say=say) as at:
                verdict = await apply_proposal(at, proposal, measured)
                return with_alarms(finish(folder, measured, proposal, verdict), standing_alarms(at))
        except TrueflankError as error:
            folder.set_state("failed", error=error.as_record())
            raise


def _is_provable(at: RunContext, refusal: Refusal, axis: AxisSection) -> bool:
    """A missing sign proof is no reason where the push can make one with the axis' instrument."""
    return refusal.code == "E-INT-NO-PROOF" and can_prove_sign(at, axis)


async def _preview_push(at: RunContext, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> Outcome:
    refusals: dict[str, list[Message]] = {}
    against: set[str] = set()
    for change in proposal.changes:
        axis = at.axis(change.axis)
        if change.skipped:
            refusals[change.name] = [change.skipped]
            continue
        asked = await _preflight(at, change, measured)
        first = Message.of("W-RUN-PROOF-FIRST", axis=axis.name)
        against |= {refusal.code for refusal in asked.refusals if not _is_provable(at, refusal, axis)}
        told = [first if _is_provable(at, refusal, axis) else refusal.message for refusal in asked.refusals]
        refusals[change.name] = [*told, *(warning.message for warning in asked.warnings)]
    record_look(at, "push", run=at.folder.run_id, refused=bool(against))
    return preview_proposal(at.folder, proposal, refusals, refused_by=against)


# What acts on the axes of the next layer, read in the program that has just measured: nobody starts one for it.

Measured = Mapping[str, MeasuredAxis]


def reads_of(at: RunContext, changes: Sequence[TableChange], measured: Measured) -> tuple[StopPlan, ...]:
    """The plans of `read_before`, to be foreseen behind what is visited before it."""
    contexts = _contexts(at, changes, measured)
    return tuple(reading_plan(one) for one in table_questions(contexts)) if contexts else ()


async def read_before(at: RunContext, changes: Sequence[TableChange], measured: Measured) -> dict[str, LiveSet]:
    """What acts on each output axis of these changes, by its name; nothing where the road makes no program of plans.

    Raises as `gateway.push.controller_access.read_live_of_axes`.
    """
    contexts = _contexts(at, changes, measured)
    if not contexts:
        return {}
    found = await read_live_of_axes(contexts)
    return {context.axis.name: live for context, live in zip(contexts, found, strict=True)}


def _contexts(at: RunContext, changes: Sequence[TableChange], measured: Measured) -> tuple[PushContext, ...]:
    controller = at.supervisor.controller
    together = isinstance(controller, ForeseesPlans) and isinstance(controller, ReadsTogether)
    if not together or isinstance(controller, OfflineExchange):
        return ()
    of: dict[str, PushContext] = {}
    for change in changes:
        if not change.skipped and change.axis not in of:
            known = measured.get(change.axis)
            of[change.axis] = table_context(at, change.new, known.capture if known is not None else None)
    return tuple(of.values())


# What a stored run measured of the axes that its proposal is about.


def stored_axes(folder: RunFolder, proposal: Proposal) -> dict[str, MeasuredAxis]:
    """Measurements by axis; the output axis of a cross table need not have been measured itself."""
    names = dict.fromkeys(change.axis for change in proposal.changes)
    own = {change.axis for change in proposal.changes if change.layer == "axis"}
    return {
        name: _stored_axis(folder, name) for name in names if name in own or folder.has(stages.capture(name, "before"))
    }


def _stored_axis(folder: RunFolder, axis: str) -> MeasuredAxis:
    capture = folder.get(stages.capture(axis, "before"), Capture)
    evaluation = folder.get(stages.evaluation(axis, "before"), Evaluation)
    return MeasuredAxis(capture, evaluation, folder.digest(stages.capture(axis, "before")))


# A person's approval of a stored plan: shown as a push would show it, bound to what was shown, kept and recorded.


async def show_plan(folder: RunFolder, *, table: str = "", clock: Clock, say: Say) -> Outcome:
    """The plan against the live machine, with every warning and refusal; writes nothing. Raises as `push_run`.

    ``table`` is the one to be approved ("": all). Raises as `approve_plan`, before a device is opened.
    """
    _changes_to_approve(folder.get(stages.PROPOSAL, Proposal), table, folder)
    return await push_run(folder, apply=False, machine_name="", clock=clock, say=say)


async def approve_plan(
    folder: RunFolder,
    *,
    table: str,
    typed_name: str,
    clock: Clock,
    actor: str = "",
    kept_by: tuple[str, ...] = (),
    signer: Signer | None = None,
) -> tuple[Approval, ...]:
    """Approve the proposed tables of a run, or the one named by its name, as ``actor`` (who acts).

    ``kept_by`` are those who may know that person's secret (`Approval.kept_by`), ``signer`` that person's key: where
    people of the store have keys nobody approves without one. Who has an account approves in its name, also at a
    keyboard.

    Each approval holds ten minutes, for this plan on this machine, for one push. Raises WriteRefused (E-APPROVE-...)
    with nothing approved, ConfigError (E-RUN-AXIS), CorruptRecord (E-AUDIT-BROKEN), StoreError.
    """
    site, path = site_of(folder)
    root = store_of(site, path).root
    ring = KeyRing(root)
    person = ring.person_named(actor or audit.acting_person())
    if signer is None and ring.signs:
        raise WriteRefused("E-APPROVE-KEY", person, actor=person)
    proposal = folder.get(stages.PROPOSAL, Proposal)
    require_current_version(folder)
    kept = Approvals(folder.path)
    audit.require_sound(root)
    made = [
        give_consent(
            change,
            proposal.machine,
            actor=person,
            typed_name=typed_name,
            site_name=site.site.name,
            now_utc=clock.utc(),
            run_id=folder.run_id,
            given=kept.read_unused(),
            kept_by=kept_by,
            uptime=clock.uptime(),
        )
        for change in _changes_to_approve(proposal, table, folder)
    ]
    for approval in (_sign_approval(one, signer) for one in made):
        # The record comes first: an approval nobody can look up later must not exist.
        audit.record(
            root,
            "approve",
            clock=clock,
            actor=person,
            role="approver",
            serial=approval.serial,
            plan_hash=approval.plan_hash,
            base_hash=approval.base_digest,
            details={"run": folder.run_id, "approval": sha256(encode(approval)), "until": approval.expires_utc},
        )
        kept.keep(approval)
    return tuple(made)


def _sign_approval(approval: Approval, signer: Signer | None) -> Approval:
    if signer is None:
        return approval
    named = replace(approval, key=signer.public)
    return replace(named, signature=signer.signature_of(Approvals.signed_form(named)))


def signer_at_keyboard(
    folder: RunFolder, utc: datetime, ask: Callable[[Message], str]
) -> tuple[Signer | None, tuple[str, ...]]:
    """The key of who approves at a keyboard, where the people of its store sign, and who may know that secret.

    It is that of the account of this computer's person. ``ask`` is given a question and answers
    with the secret, or with the second factor's code. None where nobody at this store has a key.
    Raises SignInRefused (E-USER-...), WriteRefused (E-APPROVE-KEY), StoreError.
    """
    site, path = site_of(folder)
    ring = KeyRing(store_of(site, path).root)
    if not ring.signs:
        return None, ()
    accounts, name = UserAccounts(ring.accounts_root), ring.person_named(audit.acting_person())
    account = accounts.find(name)
    if account is None or account.key is None:
        raise WriteRefused("E-APPROVE-KEY", name, actor=name)
    secret = ask(Message.of("P-APPROVE-SECRET", name=name))
    try:
        signer = accounts.by_secret(name, pin=secret).signer if account.pin else None
    except NotSignedIn:
        signer = None
    signer = signer or accounts.by_secret(name, password=secret).signer
    if account.factor:
        accounts.take_code(name, ask(Message.of("P-APPROVE-CODE", name=name)), utc)
    return signer, account.kept_by(utc)


def _changes_to_approve(proposal: Proposal, table: str, folder: RunFolder) -> list[TableChange]:
    known = [change.name for change in proposal.changes]
    if table and table not in known:
        raise ConfigError("E-RUN-AXIS", str(folder.path), axis=table, known=", ".join(known))
    named = [change for change in proposal.changes if change.name == table]
    found = named or [change for change in proposal.changes if not change.skipped]
    if not found:
        why = tuple(one.skipped for one in proposal.changes if one.skipped)
        raise WriteRefused("E-APPROVE-NOTHING", folder.run_id, why=why)
    return found
