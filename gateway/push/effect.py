"""Proof of effect: what the controller says it applies, at a few positions, against what the tables say.

A cross table is one of several that move its output axis, so the sum of all is predicted from where their input
axes stand. No public text says in which sense a control counts its own sum of cross tables, nor whether factor tables
count by themselves: the sign was proved with an instrument and the values were read back, so here one sense and one
way of multiplying must fit all positions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.units import deviation_scale
from gateway.axes import AxisRecord
from gateway.errors import VerifyError
from gateway.interlocks import value_at
from gateway.interlocks.facts import rest_of
from gateway.interlocks.table import steepest
from gateway.push import conversation
from gateway.push.asking import with_all
from gateway.push.compare import aside, effect_positions, same_rest, same_table, table_in
from gateway.push.loading import Faults
from gateway.push.records.phases import PushEvent
from gateway.push.snapshot import live_of
from gateway.push.work import Work
from gateway.table.comparison import differences

# The axis stands within its exact stop window of the target: 0.01 mm or deg.
POSITION_SLACK = 0.01
SHOWN_SLACK = 0.01


@dataclass(frozen=True, slots=True)
class _Shown:
    """One position: what each way of adding up predicts, and what the controller says."""

    position: float
    expected: tuple[float, ...]
    found: float


async def prove_all(works: Sequence[Work], bases: dict[Work, LiveSet], faults: Faults) -> None:
    """Each table that moves while it is proved by one program; then reversals, by what that program has read.

    What one table lacks joins ``faults``. Raises VerifyError where it is the only one, and what the port raises.
    """
    moved = [work for work in works if work.change.new.kind != "reversal"]
    places = {work: _places(work, bases[work]) for work in works}
    context = works[0].context
    await conversation.foresee(context, [*(effect_plan(work, places[work]) for work in moved), *context.follows])
    seen: dict[str, LiveSet] = {}
    for work in moved:
        live = await _proved(work, bases[work], places[work], faults)
        if live is not None and work.change.new.kind == "axis":
            seen[work.axis] = live
    if not context.follows:
        await conversation.foresee(context, ())
    still = [work for work in works if work not in moved]
    unseen = [work for work in still if work.axis not in seen]
    seen |= dict(zip([work.axis for work in unseen], await live_of(unseen), strict=True)) if unseen else {}
    for work in still:
        await _proved(work, bases[work], places[work], faults, seen[work.axis])


def _places(work: Work, base: LiveSet) -> tuple[float, ...]:
    return proved_at(work.change.new, table_in(base, work.change.new), work.context.moved)


def proved_at(new: CompensationTable, old: LiveTable, axis: AxisRecord) -> tuple[float, ...]:
    """Where the input ``axis`` stops to prove that ``new`` acts in place of ``old``; pure."""
    return effect_positions(new, old, axis.room, axis.overrun)


async def _proved(
    work: Work, base: LiveSet, places: tuple[float, ...], faults: Faults, seen: LiveSet | None = None
) -> LiveSet | None:
    try:
        live = await prove_effect(work, places, with_all(base, work.acting), seen)
    except VerifyError as fault:
        if not work.of:
            raise
        faults[work] = fault
        return None
    work.note(PushEvent.EFFECT, shown=[list(place) for place in work.effect])
    return live


async def prove_effect(work: Work, positions: tuple[float, ...], base: LiveSet, seen: LiveSet | None = None) -> LiveSet:
    """Visit positions and compare what the controller says it applies with the table; then read all once more.

    What was read is returned. ``seen`` was read of its axis after all had been switched on: enough for a reversal.
    Raises VerifyError (E-PUSH-EFFECT, E-PUSH-OVERWRITTEN, E-PUSH-COUPLED) and what the port raises.
    """
    context, table = work.context, work.change.new
    if table.kind == "reversal":  # no control shows what it takes up: the value is read anew, its effect is measured
        live = seen if seen is not None else await conversation.read_live(context)
        _still_there(work, live, base)
        await work.same_machine()
        return live
    shown: list[_Shown] = []

    async def at_stop(stop: Stop, reached: StopReached) -> None:
        shown.append(await _look(work, base, stop, reached))

    order = work.order(table, True, "table", work.whole.number)
    ask = ("P-PUSH-EFFECT", {"axis": context.moved.name, "count": len(positions)})
    await conversation.visit(context, effect_plan(work, positions), at_stop, order, ask=ask)
    work.effect = _judged(work, table, shown)
    live = await context.controller.saved_tables(context.axis.name, context.proof)
    _still_there(work, live, base)
    await work.same_machine()
    return live


def effect_plan(work: Work, positions: tuple[float, ...]) -> StopPlan:
    """The stops of one proof of effect; no table is switched there."""
    along = conversation.along_of(work.context)
    ends = work.agreeing_position if work.context.controller.capabilities.stops else None
    return plan_to_prove(work.change.new, positions, along, ends)


def plan_to_prove(
    table: CompensationTable, positions: tuple[float, ...], along: conversation.Along, ends: float | None
) -> StopPlan:
    """As `effect_plan`; ``ends`` is where old and new agree, None where no program of ours leads there. Pure."""
    # The input axis of a cross table ends where it disturbs the next table of the same output least.
    where = (*positions, ends) if table.kind == "cross" and ends is not None else positions
    stops = conversation.stops_at(along.moved, where, both=bool(table.reverse), direction=table.direction)
    return conversation.plan_along(along, "TFEFFECT", stops)


async def _look(work: Work, base: LiveSet, stop: Stop, reached: StopReached) -> _Shown:
    table = work.change.new
    if table.kind == "axis":
        return _Shown(
            reached.target, (value_at(table, reached.target, reached.approach),), reached.encoder_compensation
        )
    rest = (one.table for one in rest_of(aside(base, work.beside), table) if one.enabled)
    every = (table, *rest, *(one for one in work.acting if one.kind == "cross"))
    # One for a single direction of the axis that moves acts only where that axis came from.
    acting = [one for one in every if one.input_axis != table.input_axis or one.direction in (0, stop.approach)]
    places = {table.input_axis: reached.target}
    if len(acting) > 1:
        state = await work.context.controller.state()
        places = {name: axis.position for name, axis in state.axes.items()} | places
    return _Shown(reached.target, sums(acting, places), reached.cross_compensation)


def sums(acting: list[CompensationTable], places: Mapping[str, float]) -> tuple[float, ...]:
    """What tables of one output may add up to: each alone; with products on top; factors by their products only."""
    alone = {table.index: value_at(table, places.get(table.input_axis, table.minimum)) for table in acting}
    plain = sum(alone.values())
    products = {
        table.index: alone[table.index] * alone[table.multiply_by - 1] / deviation_scale(table.output_unit)
        for table in acting
        if table.multiply_by - 1 in alone
    }
    if not products:
        return (plain,)
    factors = set(products) | {table.multiply_by - 1 for table in acting if table.index in products}
    only = sum(products.values()) + sum(value for index, value in alone.items() if index not in factors)
    return (plain + sum(products.values()), only)


def _judged(work: Work, table: CompensationTable, shown: list[_Shown]) -> tuple[tuple[float, float, float], ...]:
    """The first way of counting that fits everywhere. Raises VerifyError (E-PUSH-EFFECT)."""
    allowed = effect_tolerance(work, table)
    ways = range(max((len(one.expected) for one in shown), default=1))
    can = work.context.controller.capabilities
    for way in ways:
        for wanted in zip(*(can.shown(table.kind, one.expected[way]) for one in shown), strict=True):
            if all(abs(one.found - value) <= allowed for one, value in zip(shown, wanted, strict=True)):
                return tuple((one.position, value, one.found) for one, value in zip(shown, wanted, strict=True))
    worst = next((one for one in shown if not abs(one.found - one.expected[0]) <= allowed), shown[0] if shown else None)
    fields: dict[str, Any] = {"position": "no position", "expected": "a value", "found": "none"}
    if worst is not None:
        told = {"expected": round(worst.expected[0], 4), "found": round(worst.found, 4)}
        fields = {"position": round(worst.position, 4), **told}
    raise VerifyError("E-PUSH-EFFECT", work.axis, unit=table.deviation_unit, **fields)


def effect_tolerance(work: Work, table: CompensationTable) -> float:
    """How far the controller's own value may be from the table: last place, standing still, display."""
    return 2.0 * work.allowed + POSITION_SLACK * steepest(table) + SHOWN_SLACK


def _still_there(work: Work, live: LiveSet, base: LiveSet) -> None:
    wanted, found = LiveTable(work.change.new, enabled=True), table_in(live, work.change.new)
    if not same_table(wanted, found, work.allowed):
        different = differences(wanted.table, found.table, work.allowed) or ("the switch is off",)
        raise VerifyError("E-PUSH-OVERWRITTEN", work.axis, axis=work.axis, first=different[0])
    base, live = aside(base, work.siblings), aside(live, work.siblings)  # each of those is proved by itself
    switches = [one.enabled for one in rest_of(base, wanted.table)]
    again = [one.enabled for one in rest_of(live, wanted.table)]
    if not same_rest(base, live, wanted.table, work.allowed) or switches != again:
        raise VerifyError("E-PUSH-COUPLED", work.axis, axis=work.axis)
