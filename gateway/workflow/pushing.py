"""A proposal into the controller: signs proved, tables pushed axis by axis, measured again and judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from drivers.clock import Clock
from drivers.errors import TrueflankError, words
from drivers.types import SignProof, Stop
from drivers.units import deviation_scale
from gateway.capture.live import combined
from gateway.capture.readings import Readings
from gateway.capture.sense import prove_sense
from gateway.config import AxisSection
from gateway.domain import AxisVerdict, Capture, Evaluation, Proposal, PushRecord, TableChange, Verdict
from gateway.errors import WriteRefused
from gateway.interlocks import Refusal
from gateway.push import AxisFacts, PushContext, ask, outcome_error, prove_sign, push_table
from gateway.say import Say
from gateway.store import RunFolder
from gateway.workflow import stages
from gateway.workflow.bench import Bench, bench, check_name, site_of
from gateway.workflow.measure import Measured, live_again, measure_axis
from gateway.workflow.outcome import Outcome, finish, shown
from gateway.workflow.verdict import PUSHED, judge, judge_axis, unmeasured

JOURNALS = "journal"
# Switching a table moves the axis by micrometres: no motion is seen, so the reading waits longer instead.
SWITCH_SETTLE_S = 8.0


async def apply_proposal(at: Bench, proposal: Proposal, measured: Mapping[str, Measured]) -> Verdict:
    """Push every change of a proposal, measure the pushed axes again and judge.

    Raises WriteRefused, VerifyError (rolled back) or RollbackFailed (held) at the first axis that was not
    committed, after everything about it is stored.
    """
    proofs: list[SignProof] = []
    pushes: dict[str, PushRecord] = {}
    for change in proposal.changes:
        pushes[change.axis] = await _push(at, change, measured[change.axis].capture, proofs)
    at.folder.set_state("pushed")
    verdicts = [await _verify(at, change, measured[change.axis], pushes[change.axis]) for change in proposal.changes]
    verdict = judge(tuple(verdicts), tuple(pushes.values()), tuple(proofs))
    at.folder.put(stages.VERDICT, verdict, tuple(at.folder.digest(stages.push(axis)) for axis in pushes))
    return verdict


async def _push(at: Bench, change: TableChange, capture: Capture, proofs: list[SignProof]) -> PushRecord:
    axis = at.axis(change.axis)
    context = push_context(at, axis, capture)
    if not change.skipped:
        proof = at.proofs.find(at.machine, "EEC", axis.name) or await _prove(at, axis, context)
        proofs.append(proof)
        context = replace(context, proof=proof)
    record = await push_table(change, context)
    at.folder.put(stages.push(axis.name), record, (at.folder.digest(stages.PROPOSAL),))
    failure = outcome_error(record)
    if failure is not None:
        raise failure
    return record


def push_context(at: Bench, axis: AxisSection, capture: Capture | None) -> PushContext:
    """What a push of this axis works with; the operator's consent was checked before the bench was opened."""
    measure, operator = axis.measure, at.site.operator
    facts = AxisFacts(
        axis.name,
        axis.letter,
        axis.unit,
        axis.kind == "rotary",
        axis.modulo,
        axis.travel,
        axis.reference,
        measure.feed,
        measure.overrun,
        measure.dwell_s,
        axis.encoder,
    )
    name = at.site.site.name
    return PushContext(
        controller=at.supervisor.controller,
        clock=at.clock,
        folder=at.folder,
        journals=at.store.root / JOURNALS,
        axis=facts,
        machine=at.machine,
        typed_name=name,
        site_name=name,
        capture=capture,
        start_timeout_s=operator.start_timeout_s,
        stop_timeout_s=operator.stop_timeout_s,
        say=at.say,
    )


async def _prove(at: Bench, axis: AxisSection, context: PushContext) -> SignProof:
    """Mount the axis' instrument again, prove its sense, then the sign of the axis' table."""
    if not axis.measure.instrument:
        raise WriteRefused("E-RUN-NO-PROOF", axis.name)
    at.say("P-SIGN", axis=axis.name)
    rig = at.rig(axis)
    sense = await prove_sense(rig)
    combine = combined(axis, rig.instrument, sense.sense)
    window = replace(rig.window, settle_s=SWITCH_SETTLE_S)
    scale = deviation_scale(axis.unit)
    async with Readings(rig.instrument, at.clock, combine) as readings:

        async def read_stop(_stop: Stop) -> tuple[float, float]:
            reading = await readings.settled(window)
            value = float(combine(reading.values[None, :])[0])
            return value * scale, float(reading.sigma.max()) * scale / reading.count**0.5

        grid = axis.table
        proof = await prove_sign(context, grid.minimum, grid.maximum, grid.step, read_stop)
    at.proofs.save(proof)
    at.say("P-SIGN-PROVED", axis=axis.name, slope=f"{proof.slope:+.3f}")
    return proof


async def _verify(at: Bench, change: TableChange, before: Measured, push: PushRecord) -> AxisVerdict:
    again = live_again(at.axis(change.axis), change.targets) if push.outcome in PUSHED else None
    if again is None:
        return unmeasured(change.axis, before.evaluation, change, push)
    after = (await measure_axis(at, again, "after")).evaluation
    return judge_axis(change.axis, before.evaluation, after, change)


async def push_run(folder: RunFolder, *, apply: bool, machine_name: str, clock: Clock, say: Say) -> Outcome:
    """A stored run's proposal against the live machine: difference and refusals; with `apply` the push itself.

    Without `apply` nothing is written. Raises what `run_site` raises.
    """
    site, path = site_of(folder)
    check_name(site, apply, machine_name)
    proposal = folder.get(stages.PROPOSAL, Proposal)
    measured = {change.axis: _stored(folder, change.axis) for change in proposal.changes}
    try:
        async with bench(site, path, folder, clock, say) as at:
            if not apply:
                return await _show(at, proposal, measured)
            return finish(folder, measured, proposal, await apply_proposal(at, proposal, measured))
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise


def _stored(folder: RunFolder, axis: str) -> Measured:
    capture = folder.get(stages.capture(axis, "before"), Capture)
    evaluation = folder.get(stages.evaluation(axis, "before"), Evaluation)
    return Measured(capture, evaluation, folder.digest(stages.capture(axis, "before")))


def _reason(refusal: Refusal, axis: AxisSection) -> str:
    """A missing sign proof is no reason where the push can make one with the axis' instrument."""
    if refusal.code == "E-INT-NO-PROOF" and axis.measure.instrument:
        return words("W-RUN-PROOF-FIRST", axis=axis.name)
    return refusal.words


async def _show(at: Bench, proposal: Proposal, measured: Mapping[str, Measured]) -> Outcome:
    refusals: dict[str, list[str]] = {}
    for change in proposal.changes:
        axis = at.axis(change.axis)
        context = push_context(at, axis, measured[change.axis].capture)
        context = replace(context, proof=at.proofs.find(at.machine, "EEC", axis.name))
        if change.skipped:
            refusals[axis.name] = [change.skipped]
        else:
            asked = await ask(change, context, "table")
            refusals[axis.name] = [_reason(refusal, axis) for refusal in asked.refusals]
    at.folder.set_state("proposed")
    return shown(at.folder, proposal, refusals)
