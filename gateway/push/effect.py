"""Proof of effect: what the controller says it applies, at a few positions, against what the tables say.

A cross table is one of several that move its output axis, so the sum of all is predicted from where their input
axes stand. No public text says in which sense a control counts its own sum of cross tables, nor whether factor tables
count by themselves: the sign was proved with an instrument and the values were read back, so here one sense and one
way of multiplying must fit all positions.

The tables are read before the axes move to those positions, so `require_unchanged` looks once more just before the
commit: a value or a switch changed by hand in between must not be reported as ours. It asks for nothing that needs a
person: the whole table where it can be read directly, else its switch and what acts where the axis stands.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from drivers.message import Message
from drivers.types.stops import Stop, StopPlan, StopReached
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.types.values import Approach
from drivers.units import deviation_scale
from gateway.axes import AxisRecord
from gateway.errors import VerifyError
from gateway.interlocks import other_cross_tables, steepest, value_at
from gateway.push import controller_access
from gateway.push.compare import effect_positions, same_other_tables, same_table, table_in, without_tables
from gateway.push.disable import disable_order
from gateway.push.load import TableFaults, read_live_sets
from gateway.push.phases import PushEvent
from gateway.push.preflight import with_tables
from gateway.push.state import TableTransactionState
from gateway.table.comparison import differences

# The axis stands within its exact stop window of the target: 0.01 mm or deg.
POSITION_SLACK = 0.01
SHOWN_SLACK = 0.01


@dataclass(frozen=True, slots=True)
class _ShownEffect:
    """One position: what each way of adding up predicts, and what the controller says."""

    position: float
    expected: tuple[float, ...]
    found: float


async def prove_effects(
    works: Sequence[TableTransactionState], bases: dict[TableTransactionState, LiveSet], faults: TableFaults
) -> None:
    """Each table that moves while it is proved by one program; then reversals, by what that program has read.

    What one table lacks joins ``faults``. Raises VerifyError where it is the only one, and what the port raises.
    """
    moved = [work for work in works if work.change.new.kind != "reversal"]
    places = {work: _proof_positions_of(work, bases[work]) for work in works}
    context = works[0].context
    await controller_access.foresee(context, [*(effect_plan(work, places[work]) for work in moved), *context.follows])
    seen: dict[str, LiveSet] = {}
    for work in moved:
        live = await _prove_table(work, bases[work], places[work], faults)
        if live is not None and work.change.new.kind == "axis":
            seen[work.axis] = live
    if not context.follows:
        await controller_access.foresee(context, ())
    still = [work for work in works if work not in moved]
    unseen = [work for work in still if work.axis not in seen]
    seen |= dict(zip([work.axis for work in unseen], await read_live_sets(unseen), strict=True)) if unseen else {}
    for work in still:
        await _prove_table(work, bases[work], places[work], faults, seen[work.axis])


def _proof_positions_of(work: TableTransactionState, base: LiveSet) -> tuple[float, ...]:
    return proof_positions(work.change.new, table_in(base, work.change.new), work.context.input_axis)


def proof_positions(new: CompensationTable, old: LiveTable, axis: AxisRecord) -> tuple[float, ...]:
    """Where the input ``axis`` stops to prove that ``new`` acts in place of ``old``; pure."""
    return effect_positions(new, old, axis.room, axis.overrun)


async def _prove_table(
    work: TableTransactionState,
    base: LiveSet,
    places: tuple[float, ...],
    faults: TableFaults,
    seen: LiveSet | None = None,
) -> LiveSet | None:
    try:
        live = await prove_effect(work, places, with_tables(base, work.acting), seen)
    except VerifyError as fault:
        if not work.of:
            raise
        faults[work] = fault
        return None
    work.note(PushEvent.EFFECT, shown=[list(place) for place in work.effect])
    return live


async def prove_effect(
    work: TableTransactionState, positions: tuple[float, ...], base: LiveSet, seen: LiveSet | None = None
) -> LiveSet:
    """Visit positions and compare what the controller says it applies with the table; then read all once more.

    What was read is returned. ``seen`` was read of its axis after all had been switched on: enough for a reversal.
    Raises VerifyError (E-PUSH-EFFECT, E-PUSH-OVERWRITTEN, E-PUSH-COUPLED) and what the port raises.
    """
    context, table = work.context, work.change.new
    if table.kind == "reversal":  # no control shows what it takes up: the value is read anew, its effect is measured
        live = seen if seen is not None else await controller_access.read_live_tables(context)
        _require_still_live(work, live, base)
        await work.require_same_machine()
        return live
    shown: list[_ShownEffect] = []

    async def at_stop(stop: Stop, reached: StopReached) -> None:
        shown.append(await _read_position(work, base, stop, reached))

    order = work.order(table, True, "table", work.transaction.number)
    ask = ("P-PUSH-EFFECT", {"axis": context.input_axis.name, "count": len(positions)})
    await controller_access.visit(context, effect_plan(work, positions), at_stop, order, ask=ask)
    work.effect = _match_shown(work, table, shown)
    live = await context.controller.saved_tables(context.axis.name, context.proof)
    _require_still_live(work, live, base)
    await work.require_same_machine()
    return live


def effect_plan(work: TableTransactionState, positions: tuple[float, ...]) -> StopPlan:
    """The stops of one proof of effect; no table is switched there."""
    along = controller_access.plan_axes(work.context)
    ends = work.agreeing_position if work.context.controller.capabilities.stops else None
    return make_effect_plan(work.change.new, positions, along, ends)


def make_effect_plan(
    table: CompensationTable, positions: tuple[float, ...], along: controller_access.PlanAxes, ends: float | None
) -> StopPlan:
    """As `effect_plan`; ``ends`` is where old and new agree, None where no program of ours leads there. Pure."""
    # The input axis of a cross table ends where it disturbs the next table of the same output least.
    where = (*positions, ends) if table.kind == "cross" and ends is not None else positions
    stops = controller_access.stops_at(along.input_axis, where, both=bool(table.reverse), direction=table.direction)
    return controller_access.make_stop_plan(along, "TFEFFECT", stops)


async def _read_position(work: TableTransactionState, base: LiveSet, stop: Stop, reached: StopReached) -> _ShownEffect:
    table = work.change.new
    if table.kind == "axis":
        return _ShownEffect(
            reached.target, (value_at(table, reached.target, reached.approach),), reached.encoder_compensation
        )
    acting = _acting_cross_tables(work, base, stop.approach)
    places = {table.input_axis: reached.target}
    if len(acting) > 1:
        state = await work.context.controller.state()
        places = {name: axis.position for name, axis in state.axes.items()} | places
    return _ShownEffect(reached.target, possible_sums(acting, places), reached.cross_compensation)


def _acting_cross_tables(work: TableTransactionState, base: LiveSet, approach: Approach) -> list[CompensationTable]:
    """All cross tables of the output axis that should act when the input axis was reached by ``approach``."""
    table = work.change.new
    rest = (one.table for one in other_cross_tables(without_tables(base, work.beside), table) if one.enabled)
    every = (table, *rest, *(one for one in work.acting if one.kind == "cross"))
    # One for a single direction of the axis that moves acts only where that axis came from.
    return [one for one in every if one.input_axis != table.input_axis or one.direction in (0, approach)]


def possible_sums(acting: list[CompensationTable], places: Mapping[str, float]) -> tuple[float, ...]:
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


def _match_shown(
    work: TableTransactionState, table: CompensationTable, shown: list[_ShownEffect]
) -> tuple[tuple[float, float, float], ...]:
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


def effect_tolerance(work: TableTransactionState, table: CompensationTable) -> float:
    """How far the controller's own value may be from the table: last place, standing still, display."""
    return 2.0 * work.tolerance + POSITION_SLACK * steepest(table) + SHOWN_SLACK


def _require_still_live(work: TableTransactionState, live: LiveSet, base: LiveSet) -> None:
    wanted, found = LiveTable(work.change.new, enabled=True), table_in(live, work.change.new)
    if not same_table(wanted, found, work.tolerance):
        different = differences(wanted.table, found.table, work.tolerance) or (Message.of("W-LIVE-SWITCH-OFF"),)
        raise VerifyError("E-PUSH-OVERWRITTEN", work.axis, axis=work.axis, first=different[0])
    base, live = (
        without_tables(base, work.siblings),
        without_tables(live, work.siblings),
    )  # each of those is proved by itself
    switches = [one.enabled for one in other_cross_tables(base, wanted.table)]
    again = [one.enabled for one in other_cross_tables(live, wanted.table)]
    if not same_other_tables(base, live, wanted.table, work.tolerance) or switches != again:
        raise VerifyError("E-PUSH-COUPLED", work.axis, axis=work.axis)


async def require_unchanged(
    works: Sequence[TableTransactionState], bases: Mapping[TableTransactionState, LiveSet]
) -> None:
    """The last look before the commit: the machine, its marker, and every table as far as nobody has to help.

    Raises VerifyError (E-PUSH-OTHER-MACHINE, E-PUSH-OVERWRITTEN, E-PUSH-COUPLED), BusyError (E-PUSH-ANOTHER) and what
    the port raises.
    """
    await works[0].require_same_machine()
    await works[0].require_own_marker()
    if not works[0].context.controller.capabilities.stops:
        for work, live in zip(works, await read_live_sets(works), strict=True):
            _require_still_live(work, live, with_tables(bases[work], work.acting))
        return
    for work in works:
        if work.change.new.kind != "reversal":  # no control shows what it takes up
            await _require_still_acting(work, with_tables(bases[work], work.acting))


async def _require_still_acting(work: TableTransactionState, base: LiveSet) -> None:
    """The switch reads on, and what acts where the input axis stands is one of the values that the tables predict.

    A value that does not fit counts only if a second reading finds the axis where it was: one that moves shows a
    position and a value of different moments.
    """
    first = await _read_acting(work, base)
    with contextlib.suppress(VerifyError):
        _match_shown(work, work.change.new, [first])
        return
    second = await _read_acting(work, base)
    if abs(second.position - first.position) <= POSITION_SLACK:
        _match_shown(work, work.change.new, [second])


async def _read_acting(work: TableTransactionState, base: LiveSet) -> _ShownEffect:
    controller, table = work.context.controller, work.change.new
    reading = await controller.switch_reading(disable_order(table))
    if reading.enabled is False:
        raise VerifyError("E-PUSH-OVERWRITTEN", work.axis, axis=work.axis, first=Message.of("W-LIVE-SWITCH-OFF"))
    places = {name: axis.position for name, axis in (await controller.state()).axes.items()}
    position = places[table.input_axis]
    approaches: tuple[Approach, ...] = (1, -1)
    if table.kind == "axis":
        expected = tuple(value_at(table, position, approach) for approach in approaches)
    else:
        sums = (possible_sums(_acting_cross_tables(work, base, approach), places) for approach in approaches)
        expected = tuple(value for ways in sums for value in ways)
    return _ShownEffect(position, expected, reading.acting)
