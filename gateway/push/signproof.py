"""The sign proof: in which direction this machine applies a table, measured on the machine itself.

A triangle table, zero at the reference and both ends, peak 3 um or 3 arcsec, is loaded and activated; the
input axis stands at the peak while the table is switched off and on three times and the output axis is measured.
The mean step must be the peak within 20 % and more than four times its uncertainty. An axis table: it must be
negative, as the manual says. A cross table: no public text settles the sign, so it is what is measured. What was there
is restored. Where only a restart switches tables, the same stops are measured before and after it (`proofs.restart`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, floor
from typing import Any

import numpy as np

from drivers.errors import TableError, TrueflankError, UnsupportedDevice
from drivers.terms import TableKind
from drivers.types.abilities import Marker, TableLimits
from drivers.types.orders import PushOrder, SignProof
from drivers.types.stops import Stop, StopReached
from drivers.types.tables import CompensationTable, LiveSet
from drivers.units import deviation_unit
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.errors import RollbackFailed, StillOn, VerifyError, WriteRefused
from gateway.evaluate.behaviour.repetitions import MAD_TO_SIGMA
from gateway.push import conversation, reversalproof
from gateway.push.asking import ask
from gateway.push.beginning import Task, begun
from gateway.push.compare import table_in
from gateway.push.context import PushContext
from gateway.push.loading import TableLoad, load, release
from gateway.push.proofs import restart
from gateway.push.records import journal
from gateway.push.records.lock import machine_lock
from gateway.push.snapshot import keep
from gateway.push.undo.restoring import roll_back
from gateway.push.unexpected import foreseen, unheard
from gateway.push.work import Reading, ReadStop, Work

PEAK = 3.0
WITHIN = 0.2
TIMES_U = 4.0
TIMES = 3
MEDIAN_U = 1.2533  # a median scatters by so much more than a mean


@dataclass(frozen=True, slots=True)
class Steps:
    """What switching on did: mean step in um or arcsec, positive when the axis moved positive, and its u."""

    mean: float
    u: float
    each: tuple[float, ...]


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
    return triangle_of(context.moved, context.axis, minimum=minimum, maximum=maximum, step=step, kind=kind, index=index)


def triangle_of(
    axis: AxisRecord,
    output: AxisRecord,
    minimum: float,
    maximum: float,
    step: float,
    kind: TableKind = "axis",
    index: int = 0,
) -> tuple[CompensationTable, float]:
    """As `triangle`, for an input ``axis`` and an ``output`` axis without a machine to push to."""
    if kind == "reversal":
        return reversalproof.trial_of(output, PEAK)
    count = round((maximum - minimum) / step) + 1
    at = min(max((axis.reference - minimum) / step, 0.0), float(count - 1))
    below, above = (0, floor(at + 1e-9)), (ceil(at - 1e-9), count - 1)
    first, last = max(below, above, key=lambda side: side[1] - side[0])
    peak = _peak(axis.room, minimum, step=step, first=first, last=last)
    if not first < peak < last:
        grid: dict[str, Any] = {"minimum": minimum, "maximum": maximum, "step": step}
        raise TableError("E-PUSH-TRIANGLE", axis.name, axis=axis.name, **grid)
    values = np.interp(np.arange(count), [first, peak, last], [0.0, PEAK, 0.0])
    table = CompensationTable(
        kind,
        axis.name,
        output_axis=output.name,
        minimum=minimum,
        maximum=maximum,
        step=step,
        deviations=tuple(round(float(value), 3) for value in values),
        modulo=axis.modulo,
        index=output.encoder if kind == "axis" else index,
        input_unit=axis.unit,
        output_unit=output.unit,
    )
    return table, minimum + peak * step


def _peak(travel: tuple[float, float], minimum: float, step: float, first: int, last: int) -> int:
    """The grid point nearest to the middle of the side that the axis can reach."""
    low = max(first + 1, ceil((travel[0] - minimum) / step))
    high = min(last - 1, floor((travel[1] - minimum) / step))
    return min(max((first + last) // 2, low), high) if low <= high else first


async def prove_sign(
    context: PushContext,
    minimum: float,
    maximum: float,
    step: float,
    reading: Reading,
    setup: str = "",
    kind: TableKind = "axis",
    index: int = 0,
    live: LiveSet | None = None,
) -> SignProof:
    """Prove the sign of one kind of table on one output axis, on the grid of the input axis; the caller keeps it.

    ``reading`` gives settled readings of the *output* axis at stops in um or arcsec, positive as the axis counts, and
    their u, once for each run of stops; only differences within one matter. ``setup`` is the operator's message for
    mounting the optics; ``index`` the number of the cross table to borrow; ``live`` what acts on the output axis where
    that was read just now, without a proof of any sign (None: it is read).
    Raises WriteRefused (E-PUSH-REFUSED), VerifyError (E-PUSH-NO-PROOF, E-PUSH-SIGN), RollbackFailed
    (E-PUSH-HELD), UnsupportedDevice (E-PUSH-NO-SWITCHING), BusyError, StoreError, and what port or reading raise;
    the old table is then live again.
    """
    raw = replace(unheard(context), proof=None)
    can = raw.controller.capabilities
    table, peak = triangle(raw, minimum, maximum=maximum, step=step, kind=kind, index=index)
    if not can.proves_signs:
        raise UnsupportedDevice("E-PUSH-NO-SWITCHING", raw.axis.name, table=table.name)
    folder = journal.machine_folder(raw.journals, raw.machine.serial)
    with machine_lock(folder):
        await _allowed(raw, _change(table, None), None)
        live = live if live is not None else await conversation.read_live(raw)
        if not can.switches_now:
            table = restart.against(table, live, raw, peak)
        change = _change(table, live)
        asked = await _allowed(raw, change, live)
        task = Task(change, raw, asked.limits, agreeing_position=asked.place, marker=asked.marker)
        with begun((task,), "sign-proof") as (work,):
            steps = await _proved(work, live, peak=peak, reading=reading, setup=setup)
    return _judged(raw, steps, kind)


@dataclass(frozen=True, slots=True)
class _Allowed:
    limits: TableLimits
    place: float
    marker: Marker | None


def _change(table: CompensationTable, live: LiveSet | None) -> TableChange:
    """Before the live table is known the triangle is asked about as if nothing were live."""
    nothing = np.zeros(0)
    held = table_in(live, table) if live is not None else None
    old, enabled = (held.table, held.enabled) if held is not None else (table, False)
    digest = live.digest if live is not None else ""
    return TableChange(
        table.output_axis,
        old,
        new=table,
        old_enabled=enabled,
        base_digest=digest,
        targets=nothing,
        predicted=nothing,
        predicted_U=nothing,
    )


async def _allowed(context: PushContext, change: TableChange, live: LiveSet | None) -> _Allowed:
    asked = await ask(change, context, "sign-proof", live)
    if asked.refusals or asked.agreeing_position is None:
        reasons = "; ".join(refusal.words for refusal in asked.refusals)
        raise WriteRefused("E-PUSH-REFUSED", change.axis, count=len(asked.refusals), reasons=reasons)
    return _Allowed(asked.limits, asked.agreeing_position, asked.marker)


async def _proved(work: Work, live: LiveSet, peak: float, reading: Reading, setup: str) -> Steps:
    """TableLoad the triangle, measure, and put the old table back whatever happened."""
    keep(work, live)
    failure: TrueflankError | None = None
    try:
        with foreseen(work.axis):
            now = work.context.controller.capabilities.switches_now
            before = () if now else await restart.differences(work, peak, reading, setup)
            order = work.order(work.change.new, True, "sign-proof", work.whole.number)
            await load((TableLoad(work, order, live),))
            await release((TableLoad(work, order, live),))
            if now:
                async with reading() as read_stop:
                    steps = await _measured(work, order, peak=peak, read_stop=read_stop, setup=setup)
            else:
                after = await restart.differences(work, peak, reading, "")
                steps = Steps(*restart.step(before, after, restart.change(work, peak), PEAK))
            work.note("MEASURED", mean=steps.mean, u=steps.u, each=list(steps.each))
    except TrueflankError as error:
        failure = error
        if work.marked is None:
            work.note("ABORTED", why=str(error))
            raise
    why = str(failure) if failure is not None else "the sign proof has been measured"
    outcome = await roll_back(work, why)
    if outcome == "held":
        raise RollbackFailed("E-PUSH-HELD", work.axis, axis=work.axis, backup=work.backup_path) from failure
    if outcome == "held-on":
        raise StillOn("E-PUSH-HELD-ON", work.axis, axis=work.axis, backup=work.backup_path) from failure
    if failure is not None:
        raise failure
    return steps


async def _measured(work: Work, order: PushOrder, peak: float, read_stop: ReadStop, setup: str) -> Steps:
    """Off and on three times while the input axis stands at the peak."""
    context = work.context
    trial = order.table if order.table.kind == "reversal" else None
    stops = reversalproof.stops_at(peak, reversalproof.ROUNDS) if trial is not None else _stops(context, peak)
    readings: list[tuple[float, float]] = []

    async def read(stop: Stop, _reached: StopReached) -> None:
        if trial is None or stop.switch is None:
            readings.append(await read_stop(stop))

    switched = order.table.index if order.table.kind == "cross" else None
    _say_switching(context, order)
    plan = conversation.plan_of(context, "TFSIGN", stops=stops, setup=setup, cross_table=switched, reversal=trial)
    ask = ("P-PUSH-SIGN", {"axis": context.axis.name, "position": peak})
    await conversation.visit(context, plan, read, order, ask=ask)
    return steps_of(reversalproof.reversals(readings) if trial is not None else readings)


def _stops(context: PushContext, peak: float) -> tuple[Stop, ...]:
    approach = conversation.approach_to(context, peak)
    return tuple(
        Stop(peak, approach, repetition=number // 2, label=number, switch=bool(number % 2))
        for number in range(2 * TIMES)
    )


def _say_switching(context: PushContext, order: PushOrder) -> None:
    told = {"count": TIMES, "amount": PEAK, "deviation_unit": order.table.deviation_unit}
    context.say("P-MOVE-SWITCHED", axis=context.axis.name, table=order.table.name, **told)


def steps_of(readings: list[tuple[float, float]]) -> Steps:
    """Mean of the on-minus-off differences of (value, u) pairs, off first; u from the larger of u and scatter.

    Of more than three the median, and their scatter without what lies out of line.
    """
    off, on = np.array(readings[0::2]), np.array(readings[1::2])
    each = on[:, 0] - off[:, 0]
    stated = float(np.sqrt(np.sum(on[:, 1] ** 2 + off[:, 1] ** 2))) / each.size
    root, told = float(np.sqrt(each.size)), tuple(float(value) for value in each)
    if each.size <= TIMES:
        return Steps(float(np.mean(each)), max(stated, float(np.std(each, ddof=1)) / root), told)
    centre = float(np.median(each))
    scatter = MEDIAN_U * MAD_TO_SIGMA * float(np.median(np.abs(each - centre))) / root
    return Steps(centre, max(stated, scatter), told)


def _judged(context: PushContext, steps: Steps, kind: TableKind) -> SignProof:
    axis = context.axis
    size_right = abs(abs(steps.mean) - PEAK) <= max(WITHIN * PEAK, 2.0 * steps.u if kind == "reversal" else 0.0)
    if not size_right or not abs(steps.mean) > TIMES_U * steps.u:
        told: dict[str, Any] = {"mean": round(steps.mean, 3), "u": round(steps.u, 3), "peak": PEAK}
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
