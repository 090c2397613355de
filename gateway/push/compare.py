"""Are two tables the same at the controller's resolution, where do they agree, where is their effect plain?"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drivers.message import Message
from drivers.types.abilities import Capabilities, TableLimits
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.units import deviation_scale
from gateway.axes import AxisRecord
from gateway.interlocks import MAX_JUMP, other_cross_tables, value_at
from gateway.table.comparison import GRID_TOLERANCE, PARTS, differences, part_name

# A driver's stated resolution is taken up to this much, so that a wrong one cannot make all tables alike.
COARSEST = 0.05
_CURVES = ("deviations", "places", "reverse")


def tolerance(limits: TableLimits, table: CompensationTable) -> float:
    """Half the controller's last place in um or arcsec, and what decimal text may lose."""
    step = abs(limits.resolution) * deviation_scale(table.output_unit)
    return min(0.5 * step, COARSEST) + 1e-6


def same_table(one: LiveTable, two: LiveTable, allowed: float) -> bool:
    """Same table and same switch."""
    return one.enabled == two.enabled and not differences(one.table, two.table, allowed)


def same_set(one: LiveSet, two: LiveSet, allowed: float) -> bool:
    """Same tables, switches and backlash, whatever their text looks like."""
    if one.digest == two.digest:
        return True
    kept, found = _without_empty_tables(one.cross), _without_empty_tables(two.cross)
    if len(kept) != len(found) or abs(one.backlash - two.backlash) > GRID_TOLERANCE:
        return False
    pairs = ((one.own, two.own), *zip(kept, found, strict=True))
    return all(same_table(first, second, allowed) for first, second in pairs)


def same_other_tables(
    one: LiveSet, two: LiveSet, table: CompensationTable, allowed: float, *, beside: Sequence[CompensationTable] = ()
) -> bool:
    """Whether everything but ``table`` is the same. A cross table's push switches all tables of its output: those
    switches are then left out, also where one of those ``beside`` it is such a table."""
    others = any(each.kind == "cross" and each.output_axis == one.axis for each in beside)
    cross = table.kind == "cross" or others
    turned = table.kind != "reversal" and abs(one.backlash - two.backlash) > GRID_TOLERANCE
    if turned or (table.kind != "axis" and not same_table(one.own, two.own, allowed)):
        return False
    kept, found = (
        _without_empty_tables(other_cross_tables(one, table)),
        _without_empty_tables(other_cross_tables(two, table)),
    )
    if cross:
        kept, found = _switched_off_all(kept), _switched_off_all(found)
    pairs = (
        *zip(kept, found, strict=False),
        *zip(_other_outputs(one, table), _other_outputs(two, table), strict=False),
    )
    lengths = len(kept) == len(found) and len(_other_outputs(one, table)) == len(_other_outputs(two, table))
    return lengths and all(same_table(first, second, allowed) for first, second in pairs)


def _without_empty_tables(tables: tuple[LiveTable, ...]) -> tuple[LiveTable, ...]:
    """Without those that are off and hold nothing but zeros: they are as good as never loaded."""
    return tuple(one for one in tables if one.enabled or any(one.table.deviations))


def _switched_off_all(tables: tuple[LiveTable, ...]) -> tuple[LiveTable, ...]:
    return tuple(_switched_off(one) for one in tables)


def _switched_off(one: LiveTable) -> LiveTable:
    return dataclasses.replace(one, enabled=False)


def _other_outputs(live: LiveSet, table: CompensationTable) -> tuple[LiveTable, ...]:
    """Tables of other outputs, without what an order to ``table``'s number takes over from them."""
    return _without_empty_tables(
        tuple(one for one in live.others if table.kind != "cross" or one.table.index != table.index)
    )


def table_in(live: LiveSet, wanted: CompensationTable) -> LiveTable:
    """What the controller holds in the place of ``wanted``; all zero and disabled where there is nothing."""
    if wanted.kind != "cross":
        return live.own if wanted.kind == "axis" else live.reversal
    for one in live.cross:
        if one.table.index == wanted.index:
            return one
    nothing: dict[str, Any] = {"minimum": 0.0, "maximum": 0.0, "step": 0.0, "deviations": (0.0,), "modulo": False}
    return LiveTable(dataclasses.replace(wanted, **nothing, direction=0, multiply_by=0, table_type=0), enabled=False)


def with_table(live: LiveSet, table: CompensationTable) -> LiveSet:
    """The set after ``table`` was put into it and enabled, if it belongs to this axis; for comparison only."""
    if table.output_axis != live.axis:
        return live
    now = LiveTable(table, enabled=True)
    if table.kind == "axis":
        return dataclasses.replace(live, own=now, digest="")
    if table.kind == "reversal":
        backlash = -table.deviations[0] / deviation_scale(table.output_unit)
        return dataclasses.replace(live, backlash=backlash, digest="")
    cross = tuple(one for one in live.cross if one.table.index != table.index)
    return dataclasses.replace(live, cross=tuple(sorted((*cross, now), key=lambda one: one.table.index)), digest="")


def without_tables(live: LiveSet, tables: Sequence[CompensationTable]) -> LiveSet:
    """The set without these tables: they are judged by themselves. For comparison only.

    To write a cross table all of its output are switched: of other axes' tables those switches are left out as well.
    """
    if not tables:
        return live
    switched = {table.output_axis for table in tables if table.kind == "cross"}
    gone = {table.index for table in tables if table.kind == "cross"}
    others = (one for one in live.others if one.table.index not in gone)
    kinds = {table.kind for table in tables if table.output_axis == live.axis}
    nothing: dict[str, Any] = {"minimum": 0.0, "maximum": 0.0, "step": 0.0, "deviations": (0.0,)}
    off = LiveTable(dataclasses.replace(live.own.table, **nothing, places=(), reverse=(), modulo=False), enabled=False)
    return dataclasses.replace(
        live,
        own=off if "axis" in kinds else live.own,
        cross=tuple(one for one in live.cross if one.table.index not in gone),
        backlash=0.0 if "reversal" in kinds else live.backlash,
        others=tuple(_switched_off(one) if one.table.output_axis in switched else one for one in others),
        digest="",
    )


def three_way(old: CompensationTable, new: CompensationTable, live: CompensationTable, most: int = 8) -> list[Message]:
    """Where the live table is neither the old nor the new one: parameters, then points, ``most`` lines in all."""
    lines = [
        Message.of(
            "S-DIFF-THREE",
            name=part_name(name),
            old=getattr(old, name),
            new=getattr(new, name),
            live=getattr(live, name),
        )
        for name in PARTS
        if getattr(live, name) not in (getattr(old, name), getattr(new, name))
    ]
    for number, value in enumerate(live.deviations):
        before, after = _point(old, number), _point(new, number)
        if value not in (before, after):
            told = {"old": before, "new": after, "live": value, "unit": live.deviation_unit}
            lines.append(Message.of("S-DIFF-THREE-POINT", number=number, **told))
    return [*lines[:most], Message.of("S-DIFF-MORE", count=len(lines) - most)] if len(lines) > most else lines


def _point(table: CompensationTable, number: int) -> float | None:
    return table.deviations[number] if number < len(table.deviations) else None


def switch_position(old: LiveTable, new: CompensationTable, axis: AxisRecord, can: Capabilities) -> float | None:
    """Where the input axis must stand for the switching of old and new; anywhere where only a restart switches."""
    if not can.switches_now:
        return float(np.clip(axis.reference, *axis.room))
    return agreeing_position(old, new, axis.reference, axis.room)


def agreeing_position(
    old: LiveTable, new: CompensationTable, reference: float, travel: tuple[float, float]
) -> float | None:
    """Where disabling the old and enabling the new both move the output axis by 1 um / 1 arcsec at most.

    A position of the tables' input axis, as ``reference`` and ``travel``. Both acts switch a table against
    nothing, so each must be near zero there. The reference position if it will do, else the nearest
    interpolation point inside the travel; None when there is none. A reference outside the travel is no such place:
    the end next to it is tried.
    """
    if new.kind == "reversal":  # it acts at every place alike
        return float(np.clip(reference, *travel))
    places = [
        float(np.clip(reference, *travel)),
        *sorted(_points_inside(new, travel), key=lambda place: abs(place - reference)),
    ]
    for place in places:
        before = value_at(old.table, place) if old.enabled else 0.0
        if abs(before) <= MAX_JUMP and abs(value_at(new, place)) <= MAX_JUMP:
            return float(place)
    return None


def _points_inside(table: CompensationTable, travel: tuple[float, float]) -> list[float]:
    return [float(place) for place in table.positions if travel[0] <= place <= travel[1]]


def effect_positions(
    new: CompensationTable, old: LiveTable, travel: tuple[float, float], overrun: float
) -> tuple[float, ...]:
    """Three positions that tell the new table best from nothing and from the old: rising, falling, and far off.

    A position is worth |new| + |new - old|. Linear axes keep ``overrun`` away from the ends of the travel.
    """
    margin = 0.0 if new.modulo else overrun
    low, high = travel[0] + margin, travel[1] - margin
    grid = np.asarray(new.positions)
    places = np.unique(np.concatenate([grid, (grid[:-1] + grid[1:]) / 2.0]))
    places = places[(places >= low) & (places <= high)]
    if new.modulo:
        places = places[places < new.maximum - GRID_TOLERANCE]
    if places.size == 0:
        places = np.clip(grid[[0, -1]], min(low, high), max(low, high))
    return _choose_three(new, old, places)


def _choose_three(new: CompensationTable, old: LiveTable, places: np.ndarray[Any, Any]) -> tuple[float, ...]:
    worth, slope = _distinctness(new, old, places), _slopes(new, places)
    order = np.argsort(-worth, kind="stable")
    best, rank = places[order], slope[order]
    far = 0.1 * abs(new.maximum - new.minimum)
    chosen: list[float] = []
    for side, apart in ((best[rank > 0], far), (best[rank < 0], far), (best, far), (best, 0.0)):
        room = 1 if apart and side is not best else 3 - len(chosen)
        chosen += _spaced_positions(side, chosen, apart, room)
    return tuple(sorted(chosen))


def _spaced_positions(places: np.ndarray[Any, Any], chosen: list[float], apart: float, room: int) -> list[float]:
    """The first places, at most ``room``, that keep their distance from those chosen and from each other."""
    found: list[float] = []
    for place in places:
        if len(found) < room and all(abs(place - other) > apart for other in (*chosen, *found)):
            found.append(float(place))
    return found


def _distinctness(new: CompensationTable, old: LiveTable, places: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    after = np.array([value_at(new, place) for place in places])
    before = np.array([value_at(old.table, place) if old.enabled else 0.0 for place in places])
    return np.asarray(np.abs(after) + np.abs(after - before))


def _slopes(table: CompensationTable, places: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    near = table.step / 4.0
    rise = [value_at(table, place + near) - value_at(table, place - near) for place in places]
    return np.sign(np.round(np.array(rise), 9))


def table_facts(table: CompensationTable) -> dict[str, Any]:
    """A table as JSON data for the journal; floats keep every digit."""
    facts = dataclasses.asdict(table)
    facts["deviations"] = [float(value) for value in table.deviations]
    return facts


def table_from_facts(facts: Mapping[str, Any]) -> CompensationTable:
    """The table that `table_facts` noted."""
    known: dict[str, Any] = {"places": (), "reverse": (), **facts}
    return CompensationTable(**{**known, **{name: tuple(map(float, known[name])) for name in _CURVES}})
