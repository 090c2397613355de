"""A proposal into the controller: signs proved, tables pushed axis by axis, measured again and judged."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.types.orders import SignProof
from drivers.types.sensing import Ambient
from drivers.types.stops import StopPlan
from drivers.types.tables import CompensationTable, LiveSet
from gateway.config import AxisSection
from gateway.domain.outcomes import PushRecord, Verdict
from gateway.domain.proposals import Proposal, TableChange, torn
from gateway.errors import StoreError, WriteRefused
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
    run_preflight,
)
from gateway.say import Say
from gateway.store import RunFolder
from gateway.workflow import carrying, stages
from gateway.workflow.aftercare import in_push, standing_alarms
from gateway.workflow.axes.acting import acting_plans, check_acting
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.axes.verdict import PUSHED, judge
from gateway.workflow.bench import Bench, bench, check_name, conclude, run_or_look
from gateway.workflow.consents import (
    Taken,
    begin,
    consented,
    demand_todays,
    ended,
    looked,
    refused,
    take_up,
    tell,
)
from gateway.workflow.control.contexts import kept, table_context
from gateway.workflow.control.judging import judged, plans_again
from gateway.workflow.control.proving import provable
from gateway.workflow.control.reading import read_before, reads_of
from gateway.workflow.control.signing import signed
from gateway.workflow.control.stored import stored_axes
from gateway.workflow.outcome import Outcome, alarmed
from gateway.workflow.results.ending import finish
from gateway.workflow.runsite import site_of
from gateway.workflow.showing import narrowed, once, shown
from gateway.workflow.tooth.agreement import demand_agreement
from gateway.workflow.tooth.remaining import remaining
from gateway.workflow.tooth.without import predict_without

Done = TypeVar("Done")


async def apply_proposal(at: Bench, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> Verdict:
    """Push every change of a proposal, measure the pushed axes again and judge.

    Each axis' own tables and its reversal come first and are judged together, by measuring the axis once, before
    any cross table is pushed: its own deviation is judged without what the tooth asks of it. Raises WriteRefused,
    VerifyError (rolled back) or RollbackFailed (held) at the first layer with a table that was not committed, after
    everything about it is stored; with any reason against any table at the start, nothing at all is written.
    """
    demand_todays(at.folder)
    demand_agreement(at.folder)
    done = await _starting(at, proposal, measured)
    try:
        verdict = await _applied(at, proposal, measured, done)
    except TrueflankError:
        carrying.ended(at, done.going)
        raise
    carrying.ended(at, done.going)
    return verdict


async def _starting(at: Bench, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> _Done:
    """Nothing speaks against it, and its approvals are used up; what waits for carried files was asked before."""
    going = carrying.going_on(at)
    if going is not None:
        return _Done(going.taken, going=going)
    await _nothing_against(at, proposal, measured)
    approvals = take_up(at, proposal)
    return _Done(approvals, going=carrying.begun(at, approvals))


async def _applied(at: Bench, proposal: Proposal, measured: Mapping[str, MeasuredAxis], done: _Done) -> Verdict:
    changes = await signed(at, proposal.changes, measured)
    own = [change for change in changes if change.layer == "axis"]
    cross = [change for change in changes if change.layer == "cross"]
    reads = reads_of(at, cross, measured)
    await _push(at, own, measured, done, (*plans_again(at, own), *reads))
    at.folder.set_state("pushed")
    verdicts = await judged(at, own, measured, done.records, reads=reads)
    await _push(at, cross, measured, done, acting_plans(at, cross), await read_before(at, cross, measured))
    verdict = judge(verdicts, tuple(done.records.values()), tuple(done.proofs))
    at.folder.put(stages.VERDICT, verdict, tuple(at.folder.digest(stages.push(name)) for name in done.records))
    predict_without(at, proposal)
    await check_acting(at)
    return verdict


@dataclass(slots=True)
class _Done:
    """What a run has pushed so far: records by the change's name, tables now live, proofs used.

    ``approvals`` by the change's name were used up at the start and hold to the end.
    """

    approvals: Mapping[str, Taken]
    records: dict[str, PushRecord] = field(default_factory=dict)
    tables: list[CompensationTable] = field(default_factory=list)
    proofs: list[SignProof] = field(default_factory=list)
    going: carrying.CarriedPush | None = None


async def _push(
    at: Bench,
    changes: Sequence[TableChange],
    measured: Mapping[str, MeasuredAxis],
    done: _Done,
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
            await _handed_over(at, (wish,), done)
    groups = group_transactions([wish for wish in wishes if not wish[0].skipped])
    for number, group in enumerate(groups, start=1):
        last, first = follows if number == len(groups) else (), read if number == 1 else {}
        ready = [(change, replace(one, follows=last, read=first.get(change.axis))) for change, one in group]
        await _handed_over(at, ready, done)


async def _handed_over(at: Bench, group: Sequence[tuple[TableChange, PushContext]], done: _Done) -> None:
    wishes = [(change, await _ready(at, change, context, done)) for change, context in group]
    changes = [change for change, _ in wishes]
    wishes = [(change, carrying.keyed(context, done.going, changes)) for change, context in wishes]
    known = all(has_ended(context) for _, context in wishes)
    records = await kept(at, changes, _begun(at, wishes))
    if not known and not all(change.skipped for change in changes):
        conclude(at.supervisor.controller)
    for (change, context), record in zip(wishes, records, strict=True):
        if not change.skipped and not known:
            tell(at, ended(at, change, record))
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


async def _begun(at: Bench, wishes: Sequence[tuple[TableChange, PushContext]]) -> tuple[PushRecord, ...]:
    for change, context in wishes:
        if not change.skipped and not is_resumed(context):
            begin(at, change, context)
    return await push_tables(wishes, _may_stay(at))


async def _ready(at: Bench, change: TableChange, context: PushContext, done: _Done) -> PushContext:
    """The context with today's consent; a skipped table needs none of it."""
    context = replace(context, pushed=tuple(done.tables))
    if change.skipped:
        return context
    if context.proof is not None:
        done.proofs.append(context.proof)
    context = replace(context, ambient_now=await _ambient(at, change))
    context = consented(at, change, context, done.approvals[change.name])
    return replace(context, on_live=await in_push(at, change.axis))


def _may_stay(at: Bench) -> PartialCommitPolicy:
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
        found = remaining(at, changes)
        if found is None:
            return False
        figures = {"with_them": f"{found.with_them_um:.2f}", "without": f"{found.without_um:.2f}"}
        at.say("P-PUSH-REST-FLANK", names=", ".join(one.name for one in changes), **figures)
        return found.harmless

    return stays


async def _nothing_against(at: Bench, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> None:
    """Ask about every table before the first is touched. Raises WriteRefused (E-PUSH-REFUSED) with every reason."""
    told: dict[str, list[Message]] = {}
    for change in proposal.changes:
        refusals = () if change.skipped else (await _asked(at, change, measured)).refusals
        for refusal in refusals:
            if refusal.code != "E-INT-NOTHING" and not _proved_first(at, refusal, at.axis(change.axis)):
                at.say("P-PUSH-REFUSED", axis=change.name, reason=refusal.message)
                told.setdefault(change.name, []).append(refusal.message)
    if told:
        reasons = tuple(f"{names}: {reason}" for names, reason in once(told.items()))
        tell(at, refused(at, reasons))
        name = at.site.site.name
        raise WriteRefused("E-PUSH-REFUSED", name, count=len(reasons), reasons="; ".join(reasons))


async def _asked(at: Bench, change: TableChange, measured: Mapping[str, MeasuredAxis]) -> PreflightResult:
    known = measured.get(change.axis)
    context = table_context(at, change.new, known.capture if known is not None else None)
    return await run_preflight(
        change, consented(at, change, replace(context, ambient_now=await _ambient(at, change))), "table"
    )


async def _ambient(at: Bench, change: TableChange) -> Ambient | None:
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
    proposal = narrowed(folder.get(stages.PROPOSAL, Proposal), tables)
    demand_todays(folder)
    measured = stored_axes(folder, proposal)
    with carrying.carried_for(folder, site.controller.driver, apply=apply):
        if not apply:
            with run_or_look(site, path, "looking", look=True) as beside:
                async with bench(site, path, folder=beside, clock=clock, say=say) as at:
                    return await _show(replace(at, folder=folder), proposal, measured)
        try:
            async with bench(site, path, folder=folder, clock=clock, say=say) as at:
                verdict = await apply_proposal(at, proposal, measured)
                return alarmed(finish(folder, measured, proposal, verdict), standing_alarms(at))
        except TrueflankError as error:
            folder.set_state("failed", error=error.as_record())
            raise


def _proved_first(at: Bench, refusal: Refusal, axis: AxisSection) -> bool:
    """A missing sign proof is no reason where the push can make one with the axis' instrument."""
    return refusal.code == "E-INT-NO-PROOF" and provable(at, axis)


async def _show(at: Bench, proposal: Proposal, measured: Mapping[str, MeasuredAxis]) -> Outcome:
    refusals: dict[str, list[Message]] = {}
    against: set[str] = set()
    for change in proposal.changes:
        axis = at.axis(change.axis)
        if change.skipped:
            refusals[change.name] = [change.skipped]
            continue
        asked = await _asked(at, change, measured)
        first = Message.of("W-RUN-PROOF-FIRST", axis=axis.name)
        against |= {refusal.code for refusal in asked.refusals if not _proved_first(at, refusal, axis)}
        told = [first if _proved_first(at, refusal, axis) else refusal.message for refusal in asked.refusals]
        refusals[change.name] = [*told, *(warning.message for warning in asked.warnings)]
    looked(at, "push", run=at.folder.run_id, refused=bool(against))
    return shown(at.folder, proposal, refusals, refused_by=against)
