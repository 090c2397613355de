"""The sign proof: in which direction this machine applies a table, measured on the machine itself.

Small tables (`gateway.push.trials`) of all axes and kinds are loaded by one transaction. Where programs of ours switch
them, they are left off by it: each is on only at the stops where its own axis is measured (`proofs.switching`).
A road without programs, or where a restart alone switches (`proofs.restart`), has one table at a time. What was there
is restored, by one program where that goes well.
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
from gateway.push import conversation
from gateway.push.asking import ask
from gateway.push.beginning import Task, abort, begun
from gateway.push.context import PushContext
from gateway.push.loading import TableLoad, load, release
from gateway.push.places import common_places, together
from gateway.push.proofs import restart
from gateway.push.proofs.switching import PEAK, Steps, plan_of, quiet, switched
from gateway.push.records import journal
from gateway.push.records.lock import machine_lock
from gateway.push.records.phases import PushEvent
from gateway.push.snapshot import keep
from gateway.push.trials import AlreadyOn, Eyes, SignQuestion, TrialTable, judged, trial_of
from gateway.push.undo.restoring import all_back
from gateway.push.undo.together import taken_away
from gateway.push.unexpected import foreseen
from gateway.push.work import Outcome, Reading, Work

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
    """Prove one sign with an instrument that sees the axis already; arguments as of `SignQuestion` and `Eyes.on`.

    Raises as `prove_signs`, and the VerifyError that it may answer with.
    """
    question = SignQuestion(context, minimum, maximum=maximum, step=step, kind=kind, index=index)
    (found,) = await prove_signs((question,), AlreadyOn(reading))
    if isinstance(found, VerifyError):
        raise found
    return found


async def prove_signs(questions: Sequence[SignQuestion], eyes: Eyes) -> tuple[SignProof | VerifyError, ...]:
    """Prove signs on one machine, in as few transactions as the places of the input axes allow; the caller keeps them.

    An answer for each question, in order: the proof, or why what was measured is none (E-PUSH-NO-PROOF, E-PUSH-SIGN).
    Raises WriteRefused (E-PUSH-REFUSED), RollbackFailed (E-PUSH-HELD), UnsupportedDevice (E-PUSH-NO-SWITCHING),
    BusyError, StoreError, and what port or reading raise; the old tables are then live again.
    """
    trials = [trial_of(question) for question in questions]
    first = trials[0].context
    with machine_lock(journal.machine_folder(first.journals, first.machine.serial)):
        for trial in trials:
            await _allowed(trial, None)
        lives = await _lives(trials)
        if not first.controller.capabilities.switches_now:
            lives = {_against(trial, live): live for trial, live in lives.items()}
            trials = list(lives)
        found: dict[TrialTable, SignProof | VerifyError] = {}
        for group in _groups(trials, lives):
            found |= await _proved(group, lives, eyes)
    return tuple(found[trial] for trial in trials)


async def _lives(trials: Sequence[TrialTable]) -> Lives:
    """What is live on each output axis, as stored; each is read once."""
    axes = {trial.context.axis.name: trial.context for trial in trials}
    read = dict(zip(axes, await conversation.read_all(tuple(axes.values())), strict=True))
    return {trial: read[trial.context.axis.name] for trial in trials}


def _against(trial: TrialTable, live: LiveSet) -> TrialTable:
    """Where a restart switches: the triangle that is further from what acts now."""
    return replace(trial, table=restart.against(trial.table, live, trial.context, trial.peak))


def _groups(trials: Sequence[TrialTable], lives: Lives) -> list[list[TrialTable]]:
    """Those that go together; one by one where the road does not leave them off by itself."""
    if not quiet(trials[0].context):
        return [[trial] for trial in trials]
    left = iter(trials)
    groups = together([(trial.change(lives[trial]), trial.context) for trial in trials])
    return [[next(left) for _ in group] for group in groups]


@dataclass(frozen=True, slots=True)
class _Allowed:
    limits: TableLimits
    place: float
    marker: Marker | None


async def _allowed(trial: TrialTable, live: LiveSet | None, place: float | None = None) -> _Allowed:
    change = trial.change(live)
    asked = await ask(change, trial.context, "sign-proof", live, place=place)
    if asked.refusals or asked.agreeing_position is None:
        reasons = tuple(refusal.message for refusal in asked.refusals)
        raise WriteRefused("E-PUSH-REFUSED", change.axis, count=len(asked.refusals), reasons=reasons)
    return _Allowed(asked.limits, asked.agreeing_position, asked.marker)


async def _proved(group: Sequence[TrialTable], lives: Lives, eyes: Eyes) -> dict[TrialTable, SignProof | VerifyError]:
    """One transaction: the trial tables in, each measured, all of them out again."""
    places = common_places([(trial.change(lives[trial]), trial.context) for trial in group])
    tasks = []
    for trial in group:
        asked = await _allowed(trial, lives[trial], places[trial.context.moved.name])
        change = trial.change(lives[trial])
        tasks.append(Task(change, trial.context, asked.limits, agreeing_position=asked.place, marker=asked.marker))
    with begun(tasks, "sign-proof") as works:
        of = dict(zip(works, group, strict=True))
        steps = await _in_and_out(of, lives, eyes)
    return {trial: _judged(trial, steps[work]) for work, trial in of.items()}


def _judged(trial: TrialTable, steps: Steps) -> SignProof | VerifyError:
    try:
        return judged(trial.context, steps, trial.question.kind)
    except VerifyError as error:
        return error


async def _in_and_out(of: Mapping[Work, TrialTable], lives: Lives, eyes: Eyes) -> dict[Work, Steps]:
    """Load the trial tables, measure, and put the old tables back whatever happened."""
    works = tuple(of)
    names = ", ".join(work.name for work in works)
    failure: TrueflankError | None = None
    steps: dict[Work, Steps] = {}
    whole = False
    for work in works:
        keep(work, lives[of[work]])
    try:
        with foreseen(names):
            before = await _before(of, eyes)
            await _loaded(works, [lives[of[work]] for work in works])
            whole = True
            steps = await _measured(of, eyes, before)
    except TrueflankError as error:
        failure = error
        if all(work.marked is None for work in works):
            abort(works, error.message)
            raise
    why = failure.message if failure is not None else Message.of("W-PUSH-MEASURED")
    ended = await (taken_away(works, why) if whole else all_back(works, why))
    _not_held(ended, failure)
    if failure is not None:
        raise failure
    return steps


def _not_held(ended: Mapping[Work, Outcome], failure: TrueflankError | None) -> None:
    for work, outcome in ended.items():
        if outcome == "held-on":
            raise StillOn(
                "E-PUSH-HELD-ON", work.axis, axis=work.axis, backup=work.backup_path, why=failure
            ) from failure
        if outcome == "held":
            raise RollbackFailed(
                "E-PUSH-HELD", work.axis, axis=work.axis, backup=work.backup_path, why=failure
            ) from failure


async def _loaded(works: Sequence[Work], lives: Sequence[LiveSet]) -> None:
    """All in the control, compared; where `quiet` left off through the restart that lets them act when switched on."""
    enable = not quiet(works[0].context)
    loads = tuple(
        TableLoad(work, work.order(work.change.new, enable, "sign-proof", work.whole.number), live)
        for work, live in zip(works, lives, strict=True)
    )
    faults = await load(loads)
    if faults:
        raise next(iter(faults.values()))
    await release(loads)
    if enable or all(one.order.table.kind == "reversal" for one in loads):
        return
    context = works[0].context
    TrialTablesLoaded(", ".join(work.name for work in works)).tell(context.say)
    await context.controller.restarted(tuple(one.order for one in loads), context.start_timeout_s)
    for work in works:
        work.note(PushEvent.RESTARTED)


async def _before(of: Mapping[Work, TrialTable], eyes: Eyes) -> dict[Work, restart.Readings]:
    """Where only a restart switches a table, what is measured before it; nothing elsewhere."""
    if next(iter(of)).context.controller.capabilities.switches_now:
        return {}
    return {work: await restart.differences(work, of[work].peak, await eyes.on(work.axis), "") for work in of}


async def _restarted(work: Work, peak: float, reading: Reading, before: restart.Readings) -> Steps:
    after = await restart.differences(work, peak, reading, "")
    return Steps(*restart.step(before, after, restart.change(work, peak), PEAK))


async def _measured(
    of: Mapping[Work, TrialTable], eyes: Eyes, before: Mapping[Work, restart.Readings]
) -> dict[Work, Steps]:
    """Axis by axis, each with its instrument mounted once for all tables that move it."""
    axes = dict.fromkeys(work.axis for work in of)
    works = [work for axis in axes for work in of if work.axis == axis]
    plans = _plans(of, works, eyes)
    context = works[0].context
    await conversation.foresee(context, _after(plans, works, 0))
    found: dict[Work, Steps] = {}
    reading: Reading | None = None
    for place, work in enumerate(works):
        if reading is None or work.axis != works[place - 1].axis:
            reading = await eyes.on(work.axis)
        trial = of[work]
        if work in before:
            steps = await _restarted(work, trial.peak, reading, before[work])
        else:
            follows = _after(plans, works, place + 1)
            steps = await switched(work, trial.peak, reading, again=trial.question.again, follows=follows)
        work.note(PushEvent.MEASURED, mean=steps.mean, u=steps.u, each=list(steps.each))
        found[work] = steps
    await conversation.foresee(context, ())
    return found


def _plans(of: Mapping[Work, TrialTable], works: Sequence[Work], eyes: Eyes) -> dict[Work, list[StopPlan]]:
    """What each visits, the first of an axis with what mounts its instrument."""
    plans = {work: [plan_of(work, of[work].peak)] for work in works}
    for first in {work.axis: work for work in reversed(works)}.values():
        plans[first] = [*eyes.plans(first.axis), *plans[first]]
    return plans


def _after(plans: Mapping[Work, list[StopPlan]], works: Sequence[Work], place: int) -> list[StopPlan]:
    return [plan for work in works[place:] for plan in plans[work]]
