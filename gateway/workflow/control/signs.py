"""Sign proofs in a run: an axis' instrument mounted once, its sense proved, then the sign of every kind it sees."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

from drivers.message import Message, fixed
from drivers.offline_exchange import OfflineExchange, at_work
from drivers.ports.instruments import Recounting, RotaryCalibrator, TypedInstrument
from drivers.types.orders import SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.units import deviation_scale
from gateway.capture.live import combine_channels
from gateway.capture.readings import Readings
from gateway.capture.rig import Rig, prove_sense, sense_plan, setup_of
from gateway.config import AxisSection
from gateway.domain.proposals import TableChange, torn
from gateway.errors import VerifyError, WriteRefused
from gateway.events import SignProofStarted
from gateway.push import PushContext, Reading, ReadStop, SignQuestion, Steps, prove_signs, trials_stay_off
from gateway.workflow.axes.measure import MeasuredAxis
from gateway.workflow.run import stages
from gateway.workflow.run.audit_trail import AuditAdapter, record_left_out, record_repeated_proof, record_sign_proof
from gateway.workflow.run.context import RunContext
from gateway.workflow.run.push_context import record_failed_push, table_context
from gateway.workflow.tooth.ablation import best_remaining_tables, trial_of_run

# Switching a table moves the axis by micrometres: no motion is seen, so the reading waits longer instead.
SWITCH_SETTLE_S = 8.0


def can_prove_sign(at: RunContext, axis: AxisSection) -> bool:
    """Whether a push can prove a sign itself: an instrument sees the output axis, on a road that lets it."""
    controller = at.supervisor.controller
    if isinstance(controller, OfflineExchange) and (at_work().ends or not _is_typed_in(at, axis)):
        return False  # an instrument cannot be read while the axis stands at a stop of a program that was carried
    return bool(axis.measure.instrument) and controller.capabilities.proves_signs


def _is_typed_in(at: RunContext, axis: AxisSection) -> bool:
    return bool(axis.measure.instrument) and isinstance(
        at.supervisor.instrument(axis.measure.instrument), TypedInstrument
    )


@dataclass(frozen=True, slots=True)
class MountedInstrument:
    """An axis' instrument, mounted, its sense proved: it sees every sign of a table that moves this axis."""

    rig: Rig
    sense: int

    @asynccontextmanager
    async def reading(self) -> AsyncIterator[ReadStop]:
        """What it reads at a stop, from a new datum: between two proofs a push moves the axis at its own feed."""
        rig, axis = self.rig, self.rig.axis
        combine = combine_channels(axis, rig.instrument, self.sense)
        still = rig.controller.capabilities.switches_now
        window = replace(rig.window, settle_s=SWITCH_SETTLE_S) if still else rig.window
        scale = deviation_scale(axis.unit)
        if isinstance(rig.instrument, RotaryCalibrator):
            await rig.instrument.hold()
            await rig.instrument.track()
        if isinstance(rig.instrument, Recounting):
            await rig.instrument.set_datum()
        async with Readings(rig.instrument, rig.clock, combine) as readings:

            async def read_stop(_stop: Stop) -> tuple[float, float]:
                reading = await readings.settled(window)
                value = float(combine(reading.values[None, :])[0])
                return value * scale, float(reading.sigma.max()) * scale / reading.count**0.5

            yield read_stop


@dataclass(slots=True)
class MountedInstruments:
    """The instruments of a run's axes, each mounted when its axis' turn has come; it stays until the next one's."""

    at: RunContext
    last: MountedInstrument | None = None

    def plans(self, axis: str) -> Sequence[StopPlan]:
        """The moves that prove the instrument's sense."""
        section = self.at.axis(axis)
        setup = "" if self.at.standing.holds(section) else setup_of(section)
        return () if self._seen_by_last(axis) else (sense_plan(section, setup),)

    async def on(self, axis: str) -> Reading:
        """Mount it and prove its sense. Raises WriteRefused (E-RUN-NO-PROOF) where there is none."""
        if self.last is None or not self._seen_by_last(axis):
            self.last = await _mount(self.at, self.at.axis(axis))
        return self.last.reading

    def _seen_by_last(self, axis: str) -> bool:
        return self.last is not None and self.last.rig.axis.name == axis


async def _mount(at: RunContext, axis: AxisSection) -> MountedInstrument:
    if not can_prove_sign(at, axis):
        raise WriteRefused("E-RUN-NO-PROOF", axis.name)
    SignProofStarted(axis.name).tell(at.say)
    rig, stands = at.rig(axis), at.standing.holds(axis)
    if stands:
        at.say("P-STANDS", component=axis.measure.component, axis=axis.name)
    sense = (await prove_sense(rig, stands=stands)).sense
    at.standing.note(axis)
    return MountedInstrument(rig, sense)


async def prove_table_signs(
    at: RunContext, wishes: Sequence[tuple[TableChange, PushContext]], eyes: MountedInstruments
) -> tuple[SignProof | VerifyError, ...]:
    """Prove the sign of each table's kind on its output axis; what was proved is stored. Raises as `prove_signs`."""
    for change, _ in wishes:
        if not can_prove_sign(at, at.axis(change.axis)):
            raise WriteRefused("E-RUN-NO-PROOF", change.axis)
    for change, context in wishes:
        if not trials_stay_off(
            context
        ):  # its table will act from the restart on: what needs the axis as it is comes before
            await eyes.on(change.axis)
    for change, _ in wishes:
        record_sign_proof(at, change)
    found = await prove_signs([_question(at, change, context) for change, context in wishes], eyes)
    for proof in found:
        if isinstance(proof, SignProof):
            at.proofs.save(proof)
            at.say("P-SIGN-PROVED", axis=proof.output_axis, slope=fixed(proof.slope, 3, signed=True))
    return found


def _question(at: RunContext, change: TableChange, context: PushContext) -> SignQuestion:
    table, grid = change.new, at.axis(change.new.input_axis).table

    def again(steps: Steps) -> None:
        record_repeated_proof(at, change, mean=steps.mean, u=steps.u, count=len(steps.each))

    return SignQuestion(
        context,
        grid.minimum,
        maximum=grid.maximum,
        step=grid.step,
        kind=table.kind,
        index=table.index,
        direction=table.direction,
        again=again,
    )


# The signs that a proposal needs: all in one transaction, each instrument mounted once for all that it sees.
#
# A sign that stays unknown costs its tables, not the run.

SignRequest = tuple[TableChange, PushContext]


async def prove_missing_signs(
    at: RunContext, changes: Sequence[TableChange], measured: Mapping[str, MeasuredAxis]
) -> tuple[TableChange, ...]:
    """The changes, their signs proved; those whose sign stays unknown are left out, with the reason.

    An axis without one keeps what it had, and the others are worth having: they need not fail with it. Of tables for a
    tooth go on what leaves the better flank without them. Raises as `prove_table_signs`, and VerifyError (E-PUSH-SIGN;
    E-PUSH-NO-PROOF where no table is left that is worth a push).
    """
    wishes = _unproved_changes(at, changes, measured)
    eyes = MountedInstruments(at)
    unproved: dict[tuple[str, str], VerifyError] = {}
    for group in _groups(wishes):
        mine = [change for change, _ in group]
        proofs = await record_failed_push(at, mine, prove_table_signs(at, group, eyes))
        for change, proof in zip(mine, proofs, strict=True):
            if isinstance(proof, VerifyError) and proof.code != "E-PUSH-NO-PROOF":
                raise proof
            if isinstance(proof, VerifyError):
                unproved[change.axis, change.new.kind] = proof
    return _without_unproved(at, changes, unproved) if unproved else tuple(changes)


def _unproved_changes(
    at: RunContext, changes: Sequence[TableChange], measured: Mapping[str, MeasuredAxis]
) -> list[SignRequest]:
    """One change for each kind of table and output axis whose sign nobody knows, axis by axis."""
    captures = {name: item.capture for name, item in measured.items()}
    wanted: dict[tuple[str, str], SignRequest] = {}
    for change in changes:
        context = table_context(at, change.new, captures.get(change.axis))
        if not change.skipped and context.proof is None:
            wanted.setdefault((change.axis, change.new.kind), (change, replace(context, log=AuditAdapter(at))))
    axes = mounting_order(at, [axis for axis, _ in wanted])
    return [wish for axis in axes for (of, _), wish in wanted.items() if of == axis]


def mounting_order(at: RunContext, axes: Sequence[str]) -> list[str]:
    """Each axis once: first what stands mounted, last a laser's, which stays for measuring again."""
    found = {name: at.axis(name) for name in axes}
    return sorted(found, key=lambda name: (not at.standing.holds(found[name]), found[name].kind == "linear"))


def _groups(wishes: Sequence[SignRequest]) -> list[Sequence[SignRequest]]:
    """All together where no trial table acts but while it is measured; else one by one."""
    if wishes and trials_stay_off(wishes[0][1]):
        return [wishes]
    return [(wish,) for wish in wishes]


def _without_unproved(
    at: RunContext, changes: Sequence[TableChange], unproved: Mapping[tuple[str, str], VerifyError]
) -> tuple[TableChange, ...]:
    """The changes without those of a kind and axis that has no proof, and what these take with them."""
    open_ = [one for one in changes if not one.skipped]
    lost = {one.name: unproved[one.axis, one.new.kind].message for one in open_ if (one.axis, one.new.kind) in unproved}
    left = [one for one in open_ if one.name not in lost]
    halves = {one.axis for one in open_ if one.name in torn(left, changes)}
    for one in left:
        if one.axis in halves and one.layer == "axis" and one.new.kind != "axis":
            lost[one.name] = next(error.message for (axis, _), error in unproved.items() if axis == one.axis)
    left = [one for one in left if one.name not in lost]
    tables = [one for one in open_ if one.new.kind != "reversal"]
    if any(one.name in lost for one in tables):
        lost |= _tables_made_worse(at, tables, [one for one in left if one.new.kind != "reversal"], lost)
    if tables and all(one.name in lost for one in tables):
        raise next(iter(unproved.values()))
    for reason in dict.fromkeys(lost.values()):
        names = ", ".join(name for name, why in lost.items() if why == reason)
        at.say("P-PUSH-WITHOUT", axis=names, reason=reason)
    for one in open_:
        if one.name in lost:
            record_left_out(at, one, str(lost[one.name]))
    return tuple(replace(one, skipped=lost.get(one.name, one.skipped)) for one in changes)


def _tables_made_worse(
    at: RunContext, every: Sequence[TableChange], left: Sequence[TableChange], lost: Mapping[str, Message]
) -> dict[str, Message]:
    """Which tables of a tooth go too, and why: those that leave a worse flank once the ``lost`` ones are out."""
    if not left or not at.folder.has(stages.TOOTH):
        return {}
    names = ", ".join(one.name for one in every if one.name in lost)
    tried = trial_of_run(at, every)
    if tried is None:
        return {one.name: Message.of("W-PUSH-WITHOUT-UNKNOWN", names=names) for one in left}
    rest = best_remaining_tables(tried, every, left)
    figures = {"rest": fixed(rest.rms_um), "all": fixed(rest.all_um), "none": fixed(rest.none_um)}
    at.say("P-PUSH-WITHOUT-FLANK", names=names, **figures)
    go_on = {one.name for one in rest.changes}
    return {one.name: Message.of("W-PUSH-WITHOUT-WORSE", names=names) for one in left if one.name not in go_on}
