"""What is proposed against a measured reversal: the constant, and a pair of tables where B varies with the position."""

from __future__ import annotations

from collections.abc import Collection

from drivers.limits import ACCESS_LEVEL
from drivers.types.tables import CompensationTable, LiveSet
from gateway.config import AxisSection
from gateway.correct.plan.plan import CROSS
from gateway.correct.plan.reversal import reversal_pair
from gateway.domain.proposals import TableChange
from gateway.table import Grid
from gateway.table.limits import told
from gateway.workflow.axes.crossplaces import free_places, placed_change, places_of
from gateway.workflow.axes.reversing import SeenReversal, reversal_change, reversal_of_capture
from gateway.workflow.axes.structure import Structure
from gateway.workflow.bench import Bench


async def reversal_changes(
    at: Bench, axis: AxisSection, shown: Structure, live: LiveSet, *, resolution: float, taken: Collection[int] = ()
) -> tuple[TableChange, ...]:
    """The change of the constant reversal and after it those of a pair, where there is one; () where nothing tells B.

    ``resolution`` is that of the axis' tables, in the axis unit; cross tables of the numbers ``taken`` are proposed for
    others. Raises as `fit_means`, ValueOutOfRange (E-COMP-...).
    """
    seen = reversal_of_capture(axis, shown)
    if seen is None:
        return ()
    against = await _against(at, axis)
    can = at.supervisor.controller.capabilities
    pair, why = ((), "") if against or not seen.advice.depends else await _pair(at, axis, seen, live, taken)
    turned = reversal_change(axis, shown, live, seen=seen, can=can, resolution=resolution, against=against, pair=pair)
    if why:
        at.say("P-REVERSAL-VARIES", axis=axis.name, words=told(why, axis.name))
    return (turned, *pair)


async def _against(at: Bench, axis: AxisSection) -> str:
    """Why a reversal of this axis could not be pushed here, whatever was measured; "" where it could."""
    proved = at.proofs.find(at.machine, "reversal", axis.name) is not None
    if not proved and not axis.measure.instrument:
        return told("S-REVERSAL-PROOF", axis.name)
    level = (await at.supervisor.controller.state()).access_level
    return told("S-REVERSAL-ACCESS", axis.name, level=level, needed=ACCESS_LEVEL) if level > ACCESS_LEVEL else ""


async def _pair(
    at: Bench, axis: AxisSection, seen: SeenReversal, live: LiveSet, taken: Collection[int]
) -> tuple[tuple[TableChange, ...], str]:
    """Both tables, or () and the code of why there are none.

    The tooth's own cross tables come first: a pair takes what they leave.
    """
    can = at.supervisor.controller.capabilities
    cross = can.table("cross")
    if cross is None or cross.directions != "tables" or can.table("reversal") is None or not can.stops:
        return (), "S-REVERSAL-PAIR-ROAD"
    grid = Grid(axis.table.minimum, axis.table.maximum, axis.table.step)
    tables = reversal_pair(seen.curve, axis.unit, grid, reference=axis.reference, modulo=axis.modulo)
    sets = {axis.name: live}
    if len(await free_places(at, axis.name, sets, taken)) < _wanted(at, tables, live):
        return (), "S-REVERSAL-PAIR-ROOM"
    places = await places_of(at, tables, sets, spoken_for=taken)
    if any(place.reason for place in places):
        return (), "S-REVERSAL-PAIR-ROOM"
    return tuple(
        placed_change(at, table, place, sets, adds=True) for table, place in zip(tables, places, strict=True)
    ), ""


def _wanted(at: Bench, tables: tuple[CompensationTable, ...], live: LiveSet) -> int:
    """How many numbers must be free: for tables that have none yet, and for all that the tooth may ask for."""
    held = [one.table for one in (*live.cross, *live.others) if one.enabled or any(one.table.deviations)]
    ways = {one.direction for one in held if one.input_axis == one.output_axis == live.axis}
    of_tooth = sum(one.direction == 0 for one in held)
    tooth = max(len(CROSS) - of_tooth, 0) if at.site.work is not None else 0
    return tooth + sum(one.direction not in ways for one in tables)
