"""The tables of a sign proof: what they contain, how they are switched and measured, the verdict on their steps.

A triangle table, zero at the reference and both ends, peak 3 um or 3 arcsec. The mean step of switching it is judged by
the rule that the interlock reads a stored proof with (`gateway.interlocks.proves`). An axis table: it must be negative,
as the manual says. A cross table: no public text settles the sign, so it is what is measured. A reversal: a trial value
as large while the axis goes away and comes back: what changes is B = mean(+) - mean(-), so it does not matter whether a
control takes a new value up at once or at the next turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np

from drivers.errors import UnsupportedDevice
from drivers.terms import TableKind
from drivers.types.orders import SignProof
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Approach
from drivers.units import deviation_unit
from gateway.domain.proposals import TableChange
from gateway.errors import VerifyError
from gateway.evaluate.behaviour.repetitions import MAD_TO_SIGMA
from gateway.interlocks import proves, value_at
from gateway.push import controller_access
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.state import Reading, TableTransactionState, with_safe_logger
from gateway.table.trial import PEAK, triangle_for_axes

# Tables that programs or the panel switch: off and on in turn while the input axis stands at the peak.
#
# Steps that prove nothing are measured as often again, and all of them are judged together. So readings that scatter,
# or one out of line, cost minutes and not the run; what is said of a wrong table gets surer by more steps, not weaker.

TIMES = 3
ROUNDS = 6
"""Four stops make one step, so one reading out of line must not decide: of so many it is seen and left out."""
OUT_OF_LINE = 4.0  # robust standard deviations from the median
LEAST_OUTLIER = 0.2 * PEAK
"""What is nearer to the median than this stays: it proves the same sign, and so few steps may agree by chance."""
_APPROACHES = (1, -1, 1)  # the first stop switches and is not read; the two others give B

Readings = list[tuple[float, float]]
"""Values in um or arcsec, each with its u."""
RepeatCallback = Callable[["Steps"], None]


@dataclass(frozen=True, slots=True)
class Steps:
    """What switching on did: mean step in um or arcsec, positive when the axis moved positive, and its u."""

    mean: float
    u: float
    each: tuple[float, ...]

    @property
    def prove(self) -> bool:
        """Whether they are a proof of a sign (`gateway.interlocks.proves`)."""
        return proves(self.mean / PEAK, self.u / PEAK)


def trials_stay_off(context: PushContext) -> bool:
    """Whether trial tables stay off but at their own stops: where programs of ours switch them."""
    can = context.controller.capabilities
    return can.stops and can.switches_now


def rounds_of(table: CompensationTable) -> int:
    """How often it goes off and on in one program."""
    return ROUNDS if table.kind == "reversal" else TIMES


def trial_plan(work: TableTransactionState, peak: float) -> StopPlan:
    """The stops that switch a trial table and, between them, show what the axis does."""
    context, table = work.context, work.change.new
    trial = table if table.kind == "reversal" else None
    cross = table.index if table.kind == "cross" else None
    stops = trial_stops(context, table, peak)
    along = controller_access.plan_axes(context)
    return controller_access.make_stop_plan(along, "TFSIGN", stops, cross_table=cross, reversal=trial)


async def measure_switching(
    work: TableTransactionState, peak: float, reading: Reading, again: RepeatCallback, follows: Sequence[StopPlan]
) -> Steps:
    """The steps of a trial table; ``follows`` are the plans that come after it.

    ``again`` hears the first steps where they prove nothing, before the table is switched once more. Raises what
    `conversation.visit`, the reading and ``again`` raise, VerifyError (E-PUSH-SWITCH).
    """
    table, told = work.change.new, {"axis": work.context.axis.name, "position": peak}
    readings = await _read_stops(work, peak, reading, ("P-PUSH-SIGN", told))
    steps = steps_from_readings(_readings_to_subtract(table, readings))
    if steps.prove:
        return steps
    again(steps)
    await controller_access.foresee(work.context, (trial_plan(work, peak), *follows))
    found = {"mean": round(steps.mean, 3), "u": round(steps.u, 3), "deviation_unit": table.deviation_unit}
    counted = {"count": rounds_of(table), "total": 2 * rounds_of(table)}
    readings += await _read_stops(work, peak, reading, ("P-PUSH-SIGN-AGAIN", told | found | counted))
    return steps_from_readings(_readings_to_subtract(table, readings))


async def _read_stops(
    work: TableTransactionState, peak: float, reading: Reading, ask: controller_access.StartPrompt
) -> Readings:
    context, table, readings = work.context, work.change.new, Readings()
    said = {
        "count": rounds_of(table),
        "most": 2 * rounds_of(table),
        "amount": PEAK,
        "deviation_unit": table.deviation_unit,
    }
    context.say("P-MOVE-SWITCHED", axis=work.axis, table=work.change.name, **said)
    async with reading() as read_stop:

        async def read(stop: Stop, _reached: StopReached) -> None:
            if is_reading_stop(table, stop):
                readings.append(await read_stop(stop))

        await controller_access.visit(context, trial_plan(work, peak), read, work.marked, ask=ask)
    await _require_loaded_off(work)
    return readings


async def _require_loaded_off(work: TableTransactionState) -> None:
    """What that program saved before its stops: the trial table, off. Elsewhere it is read when it goes."""
    if not trials_stay_off(work.context):
        return
    live = await work.context.controller.saved_tables(work.axis)
    work.seen = table_in(live, work.change.new)
    if work.seen.enabled:
        raise VerifyError("E-PUSH-SWITCH", work.axis, wanted=False, found=True)


def trial_stops(context: PushContext, table: CompensationTable, peak: float) -> tuple[Stop, ...]:
    """Off and on three times while the input axis stands at the peak; a reversal is come to from both sides.

    Where programs switch, one stop more leaves it off: `is_reading_stop` says which of them are read.
    """
    approach = controller_access.approach_to(context.input_axis, peak, table.direction)
    if table.kind == "reversal":
        read = _both_side_stops(peak, ROUNDS)
    else:
        read = tuple(
            Stop(peak, approach, repetition=number // 2, label=number, switch=bool(number % 2))
            for number in range(2 * TIMES)
        )
    last = Stop(peak, approach, repetition=read[-1].repetition + 1, label=0, switch=False)
    return (*read, last) if trials_stay_off(context) else read


def is_reading_stop(table: CompensationTable, stop: Stop) -> bool:
    """Whether the instrument is read at this stop of `trial_stops`."""
    if table.kind == "reversal":
        return stop.switch is None
    return stop.repetition < TIMES


def steps_from_readings(readings: Readings) -> Steps:
    """Mean of the on-minus-off differences of (value, u) pairs, off first; u from the larger of u and scatter.

    Of more than three, those that lie out of line with the median are left out of both.
    """
    off, on = np.array(readings[0::2]), np.array(readings[1::2])
    each = on[:, 0] - off[:, 0]
    squares = on[:, 1] ** 2 + off[:, 1] ** 2
    kept = each, squares
    if each.size > TIMES:
        off_by = np.abs(each - np.median(each))
        near = ~(off_by > max(OUT_OF_LINE * MAD_TO_SIGMA * float(np.median(off_by)), LEAST_OUTLIER))
        kept = each[near], squares[near]
    count = kept[0].size
    stated = float(np.sqrt(np.sum(kept[1]))) / count
    scatter = float(np.std(kept[0], ddof=1)) / count**0.5
    return Steps(float(np.mean(kept[0])), max(stated, scatter), tuple(float(value) for value in each))


def _both_side_stops(place: float, times: int) -> tuple[Stop, ...]:
    """Off, then on, each measured from - and from +; as often as asked."""
    one_round = [(way, number, on) for on in (False, True) for number, way in enumerate(_APPROACHES)]
    return tuple(
        Stop(place, 1 if way > 0 else -1, repetition, label, switch=on if number == 0 else None)
        for repetition in range(times)
        for label, (way, number, on) in enumerate(one_round)
    )


def _readings_to_subtract(table: CompensationTable, readings: Readings) -> Readings:
    """What `steps_from_readings` takes the differences of: the readings, or B of each turn."""
    return _reversal_readings(readings) if table.kind == "reversal" else readings


def _reversal_readings(readings: Readings) -> Readings:
    """B with its u from readings after - and + in turn, off and on alternating."""
    after = np.asarray(readings, dtype=np.float64).reshape(-1, 2, 2)
    B = after[:, 1, 0] - after[:, 0, 0]
    u = np.hypot(after[:, 1, 1], after[:, 0, 1])
    return [(float(value), float(doubt)) for value, doubt in zip(B, u, strict=True)]


class InstrumentProvider(Protocol):
    """Instruments that see output axes, each mounted when its axis' turn has come."""

    def plans(self, axis: str) -> Sequence[StopPlan]:
        """What mounting will visit, for a control that makes one program of plans."""
        ...

    async def on(self, axis: str) -> Reading:
        """Mount it: what then opens, for each table, the settled readings of this axis.

        A reading is of the *output* axis at a stop in um or arcsec, positive as the axis counts, with its u; only
        differences matter.
        """
        ...


def _ignore_steps(_steps: Steps) -> None:
    """Nobody keeps it."""


@dataclass(frozen=True, slots=True)
class SignQuestion:
    """Which sign to prove: of a kind of table on the context's output axis, on this grid of its input axis.

    ``index`` is the number of the cross table to borrow, ``direction`` that of travel in which it is to act (0: both).
    ``again`` hears the first steps where they prove nothing, before the table is switched once more.
    """

    context: PushContext
    minimum: float
    maximum: float
    step: float
    kind: TableKind = "axis"
    index: int = 0
    direction: Approach | Literal[0] = 0
    again: Callable[[Steps], None] = _ignore_steps


@dataclass(frozen=True, slots=True)
class MountedInstrument:
    """Eyes that see already."""

    reading: Reading

    def plans(self, _axis: str) -> Sequence[StopPlan]:
        """Nothing to visit."""
        return ()

    async def on(self, _axis: str) -> Reading:
        """The reading it was made with."""
        return self.reading


@dataclass(frozen=True, slots=True, eq=False)
class TrialTable:
    """One question with its table, and where that has its peak."""

    question: SignQuestion
    context: PushContext
    table: CompensationTable
    peak: float

    def change(self, live: LiveSet | None) -> TableChange:
        """Before the live table is known the triangle is asked about as if nothing were live."""
        nothing = np.zeros(0)
        held = table_in(live, self.table) if live is not None else None
        old, enabled = (held.table, held.enabled) if held is not None else (self.table, False)
        digest = live.digest if live is not None else ""
        return TableChange(
            self.table.output_axis,
            old,
            new=self.table,
            old_enabled=enabled,
            base_digest=digest,
            targets=nothing,
            predicted=nothing,
            predicted_U=nothing,
        )


def triangle(
    context: PushContext,
    minimum: float,
    maximum: float,
    step: float,
    kind: TableKind = "axis",
    index: int = 0,
) -> tuple[CompensationTable, float]:
    """The proof's table on the input axis' grid, and where its peak is; ``index`` is the cross table's number.

    Zero at the reference (and its two neighbours when it lies between points), at both ends and everywhere
    outside the longer side of the reference. Raises TableError (E-PUSH-TRIANGLE) when no peak fits.
    """
    return triangle_for_axes(
        context.input_axis, context.axis, minimum=minimum, maximum=maximum, step=step, kind=kind, index=index
    )


def make_trial(question: SignQuestion) -> TrialTable:
    """The question's trial table. Raises TableError (E-PUSH-TRIANGLE), UnsupportedDevice (E-PUSH-NO-SWITCHING)."""
    context = replace(with_safe_logger(question.context), proof=None)
    table, peak = triangle(
        context,
        question.minimum,
        maximum=question.maximum,
        step=question.step,
        kind=question.kind,
        index=question.index,
    )
    table = replace(table, direction=question.direction) if question.kind == "cross" else table
    if not context.controller.capabilities.proves_signs:
        raise UnsupportedDevice("E-PUSH-NO-SWITCHING", context.axis.name, table=table.name)
    return TrialTable(question, context, table, peak)


def judge_steps(context: PushContext, steps: Steps, kind: TableKind) -> SignProof:
    """The proof of a kind of table on an output axis. Raises VerifyError (E-PUSH-NO-PROOF, E-PUSH-SIGN)."""
    axis = context.axis
    if not steps.prove:
        told: dict[str, Any] = {"mean": round(steps.mean, 3), "u": round(steps.u, 3), "peak": PEAK}
        told["count"] = len(steps.each)
        raise VerifyError("E-PUSH-NO-PROOF", axis.name, axis=axis.name, unit=deviation_unit(axis.unit), **told)
    if kind != "cross" and steps.mean > 0:
        told = {"mean": round(steps.mean, 3), "unit": deviation_unit(axis.unit)}
        raise VerifyError("E-PUSH-SIGN", axis.name, axis=axis.name, **told)
    moment = context.clock.utc().isoformat(timespec="seconds")
    sign = SignProof.sign_of(steps.mean)
    return SignProof(
        context.machine,
        kind,
        output_axis=axis.name,
        slope=steps.mean / PEAK,
        slope_u=steps.u / PEAK,
        sign=sign,
        date_utc=moment,
    )


# Tables that only a restart switches: the same stops before and after it, a peak against a zero.
#
# The step is the change of the distance between both places, so a datum that the restart took away is no matter. What
# acted before and what acts after are both known; by their difference the step is judged.

RESTART_ROUNDS = 4
RestartReadings = tuple[tuple[float, float], ...]
"""Peak less zero of each round, and its u; um or arcsec."""


def _zero_position(context: PushContext) -> float:
    return float(np.clip(context.input_axis.reference, *context.input_axis.room))


def _peak_rise(context: PushContext, table: CompensationTable, peak: float) -> float:
    """Value of a table at the peak less that at the zero, each as it is come to."""
    at, zero = controller_access.approach_to(context.input_axis, peak), _zero_position(context)
    return value_at(table, peak, at) - value_at(table, zero, controller_access.approach_to(context.input_axis, zero))


def _live_rise(context: PushContext, old: LiveTable, peak: float) -> float:
    return _peak_rise(context, old.table, peak) if old.enabled else 0.0


def turn_against_live(table: CompensationTable, live: LiveSet, context: PushContext, peak: float) -> CompensationTable:
    """The triangle, upside down where that is further from what acts now: the step is never smaller than its peak."""
    if _live_rise(context, table_in(live, table), peak) <= 0.0:
        return table
    return replace(table, deviations=tuple(-value + 0.0 for value in table.deviations))


def restart_change(work: TableTransactionState, peak: float) -> float:
    """By how much the deviation at the peak, less that at the zero, changes from the old table to the triangle."""
    context = work.context
    return _peak_rise(context, work.change.new, peak) - _live_rise(context, work.restore_to, peak)


async def measure_differences(
    work: TableTransactionState, peak: float, reading: Reading, setup: str
) -> RestartReadings:
    """Measure at the zero and at the peak in turn. Raises what `conversation.visit` and the reading raise."""
    context, zero, found = work.context, _zero_position(work.context), []
    places = (zero, peak)
    stops = tuple(
        Stop(
            places[number % 2],
            controller_access.approach_to(context.input_axis, places[number % 2]),
            number // 2,
            number,
        )
        for number in range(2 * RESTART_ROUNDS)
    )

    told = {"axis": context.axis.name, "count": RESTART_ROUNDS, "zero": zero, "position": peak}
    plan = controller_access.make_stop_plan(controller_access.plan_axes(context), "TFSIGN", stops, setup=setup)
    async with reading() as read_stop:

        async def read(stop: Stop, _reached: StopReached) -> None:
            found.append(await read_stop(stop))

        await controller_access.visit(context, plan, read, ask=("P-PUSH-SIGN-STOPS", told))
    pairs = zip(found[0::2], found[1::2], strict=True)
    return tuple((high[0] - low[0], float(np.hypot(high[1], low[1]))) for low, high in pairs)


def restart_step(
    before: RestartReadings, after: RestartReadings, moved: float, peak: float
) -> tuple[float, float, tuple[float, ...]]:
    """What a table of ``peak`` would have done: its step, u of it (the larger of stated and scatter), each round.

    ``input_axis`` is the change of the tables between both runs, of at least the size of ``peak``.
    """
    was, now = np.asarray(before), np.asarray(after)
    scale = peak / moved
    each = (now[:, 0] - was[:, 0]) * scale
    stated = np.sqrt(np.sum(now[:, 1] ** 2 + was[:, 1] ** 2)) / each.size
    scatter = np.hypot(np.std(now[:, 0], ddof=1), np.std(was[:, 0], ddof=1)) / np.sqrt(each.size)
    u = float(max(stated, scatter)) * abs(scale)
    return float(np.mean(each)), u, tuple(float(value) for value in each)
