"""The sign of a table that programs or the panel switch: off and on in turn while its input axis stands at the peak.

Steps that prove nothing are measured as often again, and all of them are judged together. So readings that scatter, or
one out of line, cost minutes and not the run; what is said of a wrong table gets surer by more steps, not weaker.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import CompensationTable
from gateway.errors import VerifyError
from gateway.evaluate.behaviour.repetitions import MAD_TO_SIGMA
from gateway.interlocks import proves
from gateway.push import conversation
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.work import Reading, Work

PEAK = 3.0
TIMES = 3
ROUNDS = 6
"""Four stops make one step, so one reading out of line must not decide: of so many it is seen and left out."""
OUT_OF_LINE = 4.0  # robust standard deviations from the median
LEAST = 0.2 * PEAK
"""What is nearer to the median than this stays: it proves the same sign, and so few steps may agree by chance."""
_WAYS = (1, -1, 1)  # the first stop switches and is not read; the two others give B

Readings = list[tuple[float, float]]
"""Values in um or arcsec, each with its u."""
Again = Callable[["Steps"], None]


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


def quiet(context: PushContext) -> bool:
    """Whether trial tables stay off but at their own stops: where programs of ours switch them."""
    can = context.controller.capabilities
    return can.stops and can.switches_now


def times_of(table: CompensationTable) -> int:
    """How often it goes off and on in one program."""
    return ROUNDS if table.kind == "reversal" else TIMES


def plan_of(work: Work, peak: float) -> StopPlan:
    """The stops that switch a trial table and, between them, show what the axis does."""
    context, table = work.context, work.change.new
    trial = table if table.kind == "reversal" else None
    cross = table.index if table.kind == "cross" else None
    stops = stops_of(context, table, peak)
    along = conversation.along_of(context)
    return conversation.plan_along(along, "TFSIGN", stops, cross_table=cross, reversal=trial)


async def switched(work: Work, peak: float, reading: Reading, again: Again, follows: Sequence[StopPlan]) -> Steps:
    """The steps of a trial table; ``follows`` are the plans that come after it.

    ``again`` hears the first steps where they prove nothing, before the table is switched once more. Raises what
    `conversation.visit`, the reading and ``again`` raise, VerifyError (E-PUSH-SWITCH).
    """
    table, told = work.change.new, {"axis": work.context.axis.name, "position": peak}
    readings = await _read(work, peak, reading, ("P-PUSH-SIGN", told))
    steps = steps_of(_differing(table, readings))
    if steps.prove:
        return steps
    again(steps)
    await conversation.foresee(work.context, (plan_of(work, peak), *follows))
    found = {"mean": round(steps.mean, 3), "u": round(steps.u, 3), "deviation_unit": table.deviation_unit}
    counted = {"count": times_of(table), "total": 2 * times_of(table)}
    readings += await _read(work, peak, reading, ("P-PUSH-SIGN-AGAIN", told | found | counted))
    return steps_of(_differing(table, readings))


async def _read(work: Work, peak: float, reading: Reading, ask: conversation.Ask) -> Readings:
    context, table, readings = work.context, work.change.new, Readings()
    said = {
        "count": times_of(table),
        "most": 2 * times_of(table),
        "amount": PEAK,
        "deviation_unit": table.deviation_unit,
    }
    context.say("P-MOVE-SWITCHED", axis=work.axis, table=work.change.name, **said)
    async with reading() as read_stop:

        async def read(stop: Stop, _reached: StopReached) -> None:
            if is_read(table, stop):
                readings.append(await read_stop(stop))

        await conversation.visit(context, plan_of(work, peak), read, work.marked, ask=ask)
    await _as_loaded(work)
    return readings


async def _as_loaded(work: Work) -> None:
    """What that program saved before its stops: the trial table, off. Elsewhere it is read when it goes."""
    if not quiet(work.context):
        return
    live = await work.context.controller.saved_tables(work.axis)
    work.seen = table_in(live, work.change.new)
    if work.seen.enabled:
        raise VerifyError("E-PUSH-SWITCH", work.axis, wanted=False, found=True)


def stops_of(context: PushContext, table: CompensationTable, peak: float) -> tuple[Stop, ...]:
    """Off and on three times while the input axis stands at the peak; a reversal is come to from both sides.

    Where programs switch, one stop more leaves it off: `is_read` says which of them are read.
    """
    approach = conversation.approach_to(context.moved, peak, table.direction)
    if table.kind == "reversal":
        read = _both_sides(peak, ROUNDS)
    else:
        read = tuple(
            Stop(peak, approach, repetition=number // 2, label=number, switch=bool(number % 2))
            for number in range(2 * TIMES)
        )
    last = Stop(peak, approach, repetition=read[-1].repetition + 1, label=0, switch=False)
    return (*read, last) if quiet(context) else read


def is_read(table: CompensationTable, stop: Stop) -> bool:
    """Whether the instrument is read at this stop of `stops_of`."""
    if table.kind == "reversal":
        return stop.switch is None
    return stop.repetition < TIMES


def steps_of(readings: Readings) -> Steps:
    """Mean of the on-minus-off differences of (value, u) pairs, off first; u from the larger of u and scatter.

    Of more than three, those that lie out of line with the median are left out of both.
    """
    off, on = np.array(readings[0::2]), np.array(readings[1::2])
    each = on[:, 0] - off[:, 0]
    squares = on[:, 1] ** 2 + off[:, 1] ** 2
    kept = each, squares
    if each.size > TIMES:
        off_by = np.abs(each - np.median(each))
        near = ~(off_by > max(OUT_OF_LINE * MAD_TO_SIGMA * float(np.median(off_by)), LEAST))
        kept = each[near], squares[near]
    count = kept[0].size
    stated = float(np.sqrt(np.sum(kept[1]))) / count
    scatter = float(np.std(kept[0], ddof=1)) / count**0.5
    return Steps(float(np.mean(kept[0])), max(stated, scatter), tuple(float(value) for value in each))


def _both_sides(place: float, times: int) -> tuple[Stop, ...]:
    """Off, then on, each measured from - and from +; as often as asked."""
    one_round = [(way, number, on) for on in (False, True) for number, way in enumerate(_WAYS)]
    return tuple(
        Stop(place, 1 if way > 0 else -1, repetition, label, switch=on if number == 0 else None)
        for repetition in range(times)
        for label, (way, number, on) in enumerate(one_round)
    )


def _differing(table: CompensationTable, readings: Readings) -> Readings:
    """What `steps_of` takes the differences of: the readings, or B of each turn."""
    return _reversals(readings) if table.kind == "reversal" else readings


def _reversals(readings: Readings) -> Readings:
    """B with its u from readings after - and + in turn, off and on alternating."""
    after = np.asarray(readings, dtype=np.float64).reshape(-1, 2, 2)
    B = after[:, 1, 0] - after[:, 0, 0]
    u = np.hypot(after[:, 1, 1], after[:, 0, 1])
    return [(float(value), float(doubt)) for value, doubt in zip(B, u, strict=True)]
