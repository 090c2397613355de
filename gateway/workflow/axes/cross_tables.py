"""Where a control has room for cross tables: the live one of the same axes, else a free number with memory."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import DeviceRefused
from drivers.limits import Limits
from drivers.message import Message
from drivers.types.abilities import TableLimits
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from drivers.units import deviation_scale
from gateway.correct.flank.tables import Table
from gateway.correct.plan.plan import table_record
from gateway.domain.proposals import TableChange, TableFinding
from gateway.errors import CaptureError
from gateway.model.chain import Chain
from gateway.push import table_in
from gateway.table import check, effective
from gateway.table.comparison import acting_mean
from gateway.table.merging import round_to_resolution
from gateway.workflow.run.context import RunContext

TABLES = 62  # the highest numbers that any control has, and so all that are tried
NOTHING = np.zeros(0)
EMPTY = 8  # numbers without memory, one after the other, after which no more are looked for

PointsByNumber = Mapping[int, Mapping[int, int]]
"""Points of every free table number, by the number of the table that asks: the same memory may differ by axis."""


@dataclass(frozen=True, slots=True)
class TablePlace:
    """Where a table goes: its number and what the control holds there.

    ``reason`` says why nowhere (None: somewhere), ``full`` whether for want of room.
    """

    index: int
    limits: TableLimits | None
    reason: Message | None = None
    full: bool = False


async def table_places(
    at: RunContext,
    tables: Sequence[CompensationTable],
    live: Mapping[str, LiveSet],
    ranked: Sequence[int] = (),
    spoken_for: Collection[int] = (),
) -> tuple[TablePlace, ...]:
    """A place for each table: the live one of the same axes, else a free number with memory for its points.

    A live one that is off and too small is left as it is; one that acts has to be the place, or there is none. Memory
    is dealt out by `assign_numbers`: ``ranked`` are the tables' places in ``tables``, those that gain most first.
    Numbers that are ``spoken_for`` are nobody's.
    """
    kept = [_live_table_of(table, live) for table in tables]
    taken = {one.index for one in _tables_with_content(live)} | set(spoken_for)
    search = _MemorySearch(at)
    able = [n for n, table in enumerate(tables) if search.none or _effects_are_known(at, table, live)]
    stay = {n: await search.stays(tables[n], kept[n]) for n in able}
    asking = [n for n in able if stay[n] is None and not search.none and not _acts(kept[n])]
    needs = {n: len(tables[n].deviations) for n in asking}
    rooms = {n: await search.rooms(tables[n].output_axis, taken) for n in asking}
    seats = assign_numbers(needs, rooms, [n for n in ranked if n in needs])
    places: list[TablePlace] = []
    for n, table in enumerate(tables):
        number = seats.get(n, stay.get(n))
        place = await search.place(table, number, taken) if n in able else _no_place(table, taken, True)
        taken.add(place.index)
        places.append(place)
    return tuple(places)


async def free_places(
    at: RunContext, axis: str, live: Mapping[str, LiveSet], spoken_for: Collection[int] = ()
) -> Mapping[int, int]:
    """Points of every number that an axis can have and nobody uses or is promised."""
    search = _MemorySearch(at)
    return (
        {}
        if search.none
        else await search.rooms(axis, {one.index for one in _tables_with_content(live)} | set(spoken_for))
    )


def placed_change(
    at: RunContext, table: CompensationTable, place: TablePlace, live: Mapping[str, LiveSet], *, adds: bool
) -> TableChange:
    """A table as the change of what its place holds; skipped with the reason where it has none.

    With ``adds`` it comes on top of what acted there. Raises ValueOutOfRange (E-COMP-...) beyond the limits of a table.
    """
    base, name = live[table.output_axis], table.output_axis
    proof = at.proofs.find(at.machine, "cross", name)
    placed = replace(table, index=place.index)
    old = table_in(at.supervisor.controller.tables_by(base, proof), placed)
    findings: tuple[TableFinding, ...] = ()
    if place.limits is not None:
        placed = _merge_with_live(placed, old, place.limits, adds=adds)
        findings = check(placed, effective(old), Limits.of(placed.output_unit), placed.name)
    return TableChange(
        axis=name,
        old=old.table,
        new=placed,
        old_enabled=old.enabled,
        base_digest=base.digest,
        targets=NOTHING,
        predicted=NOTHING,
        predicted_U=NOTHING,
        findings=findings,
        skipped=place.reason,
        base=base,
    )


def _merge_with_live(table: CompensationTable, old: LiveTable, limits: TableLimits, *, adds: bool) -> CompensationTable:
    values = np.asarray(table.deviations, dtype=np.float64)
    if adds:
        values = values + acting_mean(effective(old), table.positions)
    return replace(
        table, deviations=round_to_resolution(values, limits.resolution * deviation_scale(table.output_unit))
    )


class _MemorySearch:
    """Looks for memory, each number asked once."""

    def __init__(self, at: RunContext) -> None:
        self._controller = at.supervisor.controller
        self._known: dict[tuple[str, int], TableLimits | None] = {}

    @property
    def none(self) -> bool:
        """Whether the control has no cross tables at all."""
        return self._controller.capabilities.table("cross") is None

    async def stays(self, table: CompensationTable, mine: LiveTable | None) -> int | None:
        """The number of the live table of the same axes, where it has memory enough; None: it cannot stay there."""
        if mine is None or self.none:
            return None
        limits = await self._limits(table.output_axis, mine.table.index)
        enough = limits is not None and limits.reserved_points >= len(table.deviations)
        return mine.table.index if enough else None

    async def place(self, table: CompensationTable, index: int | None, taken: set[int]) -> TablePlace:
        """The number that a table was given, if it holds it; None: nowhere."""
        if self.none:
            return TablePlace(_number_beyond_control(taken), None, Message.of("S-CROSS-NONE", table=table.name))
        limits = None if index is None else await self._limits(table.output_axis, index)
        if index is None or limits is None or limits.reserved_points < len(table.deviations):
            return _no_place(table, taken, False)
        return TablePlace(index, limits)

    async def rooms(self, axis: str, taken: set[int]) -> Mapping[int, int]:
        """Points of every free number that an axis can have."""
        found: dict[int, int] = {}
        empty = 0
        for number in (one for one in range(TABLES) if one not in taken):
            limits = await self._limits(axis, number)
            found |= {number: limits.reserved_points} if limits is not None and limits.reserved_points else {}
            empty = empty + 1 if limits is None or not limits.reserved_points else 0
            if limits is None or empty >= EMPTY:
                break
        return found

    async def _limits(self, axis: str, index: int) -> TableLimits | None:
        """None where the control has no table of that number."""
        if (axis, index) not in self._known:
            try:
                self._known[axis, index] = await self._controller.table_limits(axis, "cross", index)
            except DeviceRefused:
                self._known[axis, index] = None
        return self._known[axis, index]


def _number_beyond_control(taken: set[int]) -> int:
    """A number that no control has, for a table without a place."""
    return next(one for one in range(TABLES, 2 * TABLES) if one not in taken)


def _no_place(table: CompensationTable, taken: set[int], unproved: bool) -> TablePlace:
    number = _number_beyond_control(taken)
    if unproved:
        return TablePlace(number, None, Message.of("S-CROSS-UNPROVED", table=table.name, axis=table.output_axis))
    return TablePlace(
        number, None, Message.of("S-CROSS-FULL", table=table.name, points=len(table.deviations)), full=True
    )


def _tables_with_content(live: Mapping[str, LiveSet]) -> list[CompensationTable]:
    """Tables that hold something, whoever they belong to."""
    every = (table for one in live.values() for table in (*one.cross, *one.others))
    return [one.table for one in every if one.enabled or any(one.table.deviations)]


def _acts(mine: LiveTable | None) -> bool:
    return mine is not None and mine.enabled


def _live_table_of(table: CompensationTable, live: Mapping[str, LiveSet]) -> LiveTable | None:
    """The live table of the same axes, both directions, no factor; one that acts before others."""
    mine = live.get(table.output_axis)
    found = [one for one in mine.cross if _same(one.table, table)] if mine is not None else []
    held = sorted((one for one in found if one.enabled or any(one.table.deviations)), key=lambda one: not one.enabled)
    return held[0] if held else None


def _same(one: CompensationTable, other: CompensationTable) -> bool:
    axes = (one.input_axis, one.output_axis, one.direction, one.multiply_by)
    return axes == (other.input_axis, other.output_axis, other.direction, other.multiply_by)


def _effects_are_known(at: RunContext, table: CompensationTable, live: Mapping[str, LiveSet]) -> bool:
    """Whether it is known what the tables of the output axis do: none acts, or their sign is proved.

    One whose input axis stands still while work is measured and ground is a constant, whatever its sign.
    """
    mine = live.get(table.output_axis)
    if mine is None:
        raise CaptureError("E-RUN-LIVE", table.output_axis)
    moving = [one for one in mine.cross if one.table.input_axis in at.moved]
    acts = any(one.enabled and any(one.table.deviations) for one in moving)
    return not acts or at.proofs.find(at.machine, "cross", table.output_axis) is not None


def assign_numbers(needs: Mapping[int, int], rooms: PointsByNumber, ranked: Sequence[int] = ()) -> Mapping[int, int]:
    """A free number for each table that gets one; ``needs`` are points by table.

    Where there is no room for all, those come first that are ``ranked`` first; else the largest.
    """
    chosen: list[int] = []
    for one in ranked or _largest_first(needs, needs):
        if _assign_all(needs, rooms, [*chosen, one]) is not None:
            chosen.append(one)
    return _assign_all(needs, rooms, chosen) or {}


def _largest_first(needs: Mapping[int, int], which: Sequence[int] | Mapping[int, int]) -> list[int]:
    return sorted(which, key=lambda one: (-needs[one], one))


def _assign_all(needs: Mapping[int, int], rooms: PointsByNumber, which: Sequence[int]) -> Mapping[int, int] | None:
    """All of these in a place of their own, or None where one has none."""
    found: dict[int, int] = {}
    for one in _largest_first(needs, which):
        free = {number: points for number, points in rooms[one].items() if number not in found.values()}
        enough = [number for number, points in free.items() if points >= needs[one]]
        if not enough:
            return None
        found[one] = min(enough, key=lambda number: (free[number], number))
    return found


# Corrections of one axis over another as changes of the control's cross tables: placed, merged, checked, rounded.


async def cross_changes(
    at: RunContext,
    tables: Sequence[Table],
    chain: Chain,
    *,
    live: Mapping[str, LiveSet],
    adds: bool,
    spoken_for: Collection[int] = (),
) -> tuple[TableChange, ...]:
    """Corrections (one table for each output and input axis, chain letters) as changes of the control's cross tables.

    ``live`` are the live sets as captured, by machine axis. With ``adds`` the corrections come on top of what acted,
    else they are all that shall act. Numbers that are ``spoken_for`` are left alone. A change without a place is
    skipped and says why. Raises CaptureError (E-RUN-LIVE) without the live set of an output axis, ValueOutOfRange
    (E-COMP-...) beyond the limits of a table.
    """
    names = {axis.letter: axis.name for axis in at.site.axes}
    plain = [table_record(chain, table, "cross", names=names) for table in tables]
    places = await table_places(at, plain, live, spoken_for=spoken_for)
    return tuple(placed_change(at, table, place, live, adds=adds) for table, place in zip(plain, places, strict=True))


def acting_cross(at: RunContext, live: Mapping[str, LiveSet]) -> tuple[CompensationTable, ...]:
    """Cross tables that act between the axes of the site, as deviations by the proofs of their output axes.

    Those without a proof are left out.
    """
    found = []
    for name, one in live.items():
        proof = at.proofs.find(at.machine, "cross", name)
        if proof is not None:
            mine = at.supervisor.controller.tables_by(one, proof).cross
            found += [one.table for one in mine if one.enabled and one.table.input_axis in at.moved]
    return tuple(found)
