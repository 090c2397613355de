"""The sign proof: in which direction this machine applies a table, measured on the machine itself.

Small tables (`gateway.push.sign_proof_tables`) of all axes and kinds are loaded by one transaction. Where programs of
ours switch them, they are left off by it: each is on only at the stops where its own axis is measured. A connection
without programs, or a control on which a restart alone switches, has one table at a time. The previous tables are
restored, by one program where that goes well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from drivers.errors import TrueflankError
from drivers.message import Message
from drivers.terms import TableKind
from drivers.types.abilities import Marker, TableLimits
from drivers.types.orders import SignProof
from drivers.types.stops import StopPlan
from drivers.types.tables import LiveSet
from gateway.errors import RollbackFailed, StillOn, VerifyError, WriteRefused
from gateway.events import TrialTablesLoaded
from gateway.push import controller_access, journal, sign_proof_tables
from gateway.push.context import PushContext
from gateway.push.journal import machine_lock
from gateway.push.load import TableLoad, keep_snapshot, load_tables, release_tables
from gateway.push.phases import PushEvent
from gateway.push.preflight import common_positions, group_transactions, run_preflight
from gateway.push.restore import roll_back_all, roll_back_batch
from gateway.push.sign_proof_tables import (
    InstrumentProvider,
    MountedInstrument,
    SignQuestion,
    Steps,
    TrialTable,
    judge_steps,
    make_trial,
    measure_switching,
    trial_plan,
    trials_stay_off,
)
from gateway.push.state import Outcome, Reading, TableTransactionState, wrap_unexpected
from gateway.push.transaction import AdmittedTable, abort, open_transaction
from gateway.table.trial import PEAK

Lives = Mapping[TrialTable, LiveSet]


async def prove_sign(
    context: PushContext,
    minimum: float,
    maximum: float,
    step: float,
    reading: Reading,
    kind: TableKind = "axis",
    index: int = 0,
) -> SignProof:
    """Prove one sign with an instrument that is mounted already; arguments as of `SignQuestion`.

    Raises as `prove_signs`, and the VerifyError that it may answer with.
    """
    question = SignQuestion(context, minimum, maximum=maximum, step=step, kind=kind, index=index)
    (found,) = await prove_signs((question,), MountedInstrument(reading))
    if isinstance(found, VerifyError):
        raise found
    return found


async def prove_signs(
    questions: Sequence[SignQuestion], eyes: InstrumentProvider
) -> tuple[SignProof | VerifyError, ...]:
    """Prove signs on one machine, in as few transactions as the places of the input axes allow; the caller keeps them.

    An answer for each question, in order: the proof, or why what was measured is none (E-PUSH-NO-PROOF, E-PUSH-SIGN).
    Raises WriteRefused (E-PUSH-REFUSED), RollbackFailed (E-PUSH-HELD), UnsupportedDevice (E-PUSH-NO-SWITCHING),
    BusyError, StoreError, and what port or reading raise; the old tables are then live again.
    """
    trials = [make_trial(question) for question in questions]
    first = trials[0].context
    with machine_lock(journal.machine_folder(first.journals, first.machine.serial)):
        for trial in trials:
            await _admit_trial(trial, None)
        lives = await _read_lives(trials)
        if not first.controller.capabilities.switches_now:
            lives = {_turned_against_live(trial, live): live for trial, live in lives.items()}
            trials = list(lives)
        found: dict[TrialTable, SignProof | VerifyError] = {}
        for group in _groups(trials, lives):
            found |= await _prove_group(group, lives, eyes)
    return tuple(found[trial] for trial in trials)


async def _read_lives(trials: Sequence[TrialTable]) -> Lives:
    """What is live on each output axis, as stored; each is read once."""
    axes = {trial.context.axis.name: trial.context for trial in trials}
    read = dict(zip(axes, await controller_access.read_live_of_axes(tuple(axes.values())), strict=True))
    return {trial: read[trial.context.axis.name] for trial in trials}


def _turned_against_live(trial: TrialTable, live: LiveSet) -> TrialTable:
    """Where a restart switches: the triangle that is further from what acts now."""
    return replace(trial, table=sign_proof_tables.turn_against_live(trial.table, live, trial.context, trial.peak))


def _groups(trials: Sequence[TrialTable], lives: Lives) -> list[list[TrialTable]]:
    """Those that go together; one by one where the connection does not leave them off by itself."""
    if not trials_stay_off(trials[0].context):
        return [[trial] for trial in trials]
    left = iter(trials)
    groups = group_transactions([(trial.change(lives[trial]), trial.context) for trial in trials])
    return [[next(left) for _ in group] for group in groups]


@dataclass(frozen=True, slots=True)
class _AdmittedTrial:
    limits: TableLimits
    place: float
    marker: Marker | None


async def _admit_trial(trial: TrialTable, live: LiveSet | None, place: float | None = None) -> _AdmittedTrial:
    change = trial.change(live)
    asked = await run_preflight(change, trial.context, "sign-proof", live, place=place)
    if asked.refusals or asked.agreeing_position is None:
        reasons = tuple(refusal.message for refusal in asked.refusals)
        raise WriteRefused("E-PUSH-REFUSED", change.axis, count=len(asked.refusals), reasons=reasons)
    return _AdmittedTrial(asked.limits, asked.agreeing_position, asked.marker)


async def _prove_group(
    group: Sequence[TrialTable], lives: Lives, eyes: InstrumentProvider
) -> dict[TrialTable, SignProof | VerifyError]:
    """One transaction: the trial tables in, each measured, all of them out again."""
    places = common_positions([(trial.change(lives[trial]), trial.context) for trial in group])
    tasks = []
    for trial in group:
        asked = await _admit_trial(trial, lives[trial], places[trial.context.input_axis.name])
        change = trial.change(lives[trial])
        tasks.append(
            AdmittedTable(change, trial.context, asked.limits, agreeing_position=asked.place, marker=asked.marker)
        )
    with open_transaction(tasks, "sign-proof") as works:
        of = dict(zip(works, group, strict=True))
        steps = await _load_measure_restore(of, lives, eyes)
    return {trial: _judge_trial(trial, steps[work]) for work, trial in of.items()}


def _judge_trial(trial: TrialTable, steps: Steps) -> SignProof | VerifyError:
    try:
        return judge_steps(trial.context, steps, trial.question.kind)
    except VerifyError as error:
        return error


async def _load_measure_restore(
    of: Mapping[TableTransactionState, TrialTable], lives: Lives, eyes: InstrumentProvider
) -> dict[TableTransactionState, Steps]:
    """Load the trial tables, measure, and put the old tables back whatever happened."""
    works = tuple(of)
    names = ", ".join(work.name for work in works)
    failure: TrueflankError | None = None
    steps: dict[TableTransactionState, Steps] = {}
    whole = False
    for work in works:
        keep_snapshot(work, lives[of[work]])
    try:
        with wrap_unexpected(names):
            before = await _measure_before_restart(of, eyes)
            await _load_trials(works, [lives[of[work]] for work in works])
            whole = True
            steps = await _measure_trials(of, eyes, before)
    except TrueflankError as error:
        failure = error
        if all(work.marked is None for work in works):
            abort(works, error.message)
            raise
    why = failure.message if failure is not None else Message.of("W-PUSH-MEASURED")
    ended = await (roll_back_batch(works, why) if whole else roll_back_all(works, why))
    _require_not_held(ended, failure)
    if failure is not None:
        raise failure
    return steps


def _require_not_held(ended: Mapping[TableTransactionState, Outcome], failure: TrueflankError | None) -> None:
    for work, outcome in ended.items():
        if outcome == "held-on":
            raise StillOn(
                "E-PUSH-HELD-ON", work.axis, axis=work.axis, backup=work.backup_path, why=failure
            ) from failure
        if outcome == "held":
            raise RollbackFailed(
                "E-PUSH-HELD", work.axis, axis=work.axis, backup=work.backup_path, why=failure
            ) from failure


async def _load_trials(works: Sequence[TableTransactionState], lives: Sequence[LiveSet]) -> None:
    """Load and compare all; where `trials_stay_off` they are off during the restart after which they can act."""
    enable = not trials_stay_off(works[0].context)
    loads = tuple(
        TableLoad(work, work.order(work.change.new, enable, "sign-proof", work.transaction.number), live)
        for work, live in zip(works, lives, strict=True)
    )
    faults = await load_tables(loads)
    if faults:
        raise next(iter(faults.values()))
    await release_tables(loads)
    if enable or all(one.order.table.kind == "reversal" for one in loads):
        return
    context = works[0].context
    TrialTablesLoaded(", ".join(work.name for work in works)).tell(context.say)
    await context.controller.restarted(tuple(one.order for one in loads), context.start_timeout_s)
    for work in works:
        work.note(PushEvent.RESTARTED)


async def _measure_before_restart(
    of: Mapping[TableTransactionState, TrialTable], eyes: InstrumentProvider
) -> dict[TableTransactionState, sign_proof_tables.RestartReadings]:
    """Where only a restart switches a table, what is measured before it; nothing elsewhere."""
    if next(iter(of)).context.controller.capabilities.switches_now:
        return {}
    return {
        work: await sign_proof_tables.measure_differences(work, of[work].peak, await eyes.on(work.axis), "")
        for work in of
    }


async def _steps_after_restart(
    work: TableTransactionState, peak: float, reading: Reading, before: sign_proof_tables.RestartReadings
) -> Steps:
    after = await sign_proof_tables.measure_differences(work, peak, reading, "")
    return Steps(*sign_proof_tables.restart_step(before, after, sign_proof_tables.restart_change(work, peak), PEAK))


async def _measure_trials(
    of: Mapping[TableTransactionState, TrialTable],
    eyes: InstrumentProvider,
    before: Mapping[TableTransactionState, sign_proof_tables.RestartReadings],
) -> dict[TableTransactionState, Steps]:
    """Axis by axis, each with its instrument mounted once for all tables that move it."""
    axes = dict.fromkeys(work.axis for work in of)
    works = [work for axis in axes for work in of if work.axis == axis]
    plans = _plans(of, works, eyes)
    context = works[0].context
    await controller_access.foresee(context, _following_plans(plans, works, 0))
    found: dict[TableTransactionState, Steps] = {}
    reading: Reading | None = None
    for place, work in enumerate(works):
        if reading is None or work.axis != works[place - 1].axis:
            reading = await eyes.on(work.axis)
        trial = of[work]
        if work in before:
            steps = await _steps_after_restart(work, trial.peak, reading, before[work])
        else:
            follows = _following_plans(plans, works, place + 1)
            steps = await measure_switching(work, trial.peak, reading, again=trial.question.again, follows=follows)
        work.note(PushEvent.MEASURED, mean=steps.mean, u=steps.u, each=list(steps.each))
        found[work] = steps
    await controller_access.foresee(context, ())
    return found


def _plans(
    of: Mapping[TableTransactionState, TrialTable], works: Sequence[TableTransactionState], eyes: InstrumentProvider
) -> dict[TableTransactionState, list[StopPlan]]:
    """What each visits, the first of an axis with what mounts its instrument."""
    plans = {work: [trial_plan(work, of[work].peak)] for work in works}
    for first in {work.axis: work for work in reversed(works)}.values():
        plans[first] = [*eyes.plans(first.axis), *plans[first]]
    return plans


def _following_plans(
    plans: Mapping[TableTransactionState, list[StopPlan]], works: Sequence[TableTransactionState], place: int
) -> list[StopPlan]:
    return [plan for work in works[place:] for plan in plans[work]]
