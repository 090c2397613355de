"""Which tables go into one transaction: those for which each input axis has one place that suits them all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.types.abilities import Capabilities
from drivers.types.tables import LiveTable
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.interlocks import MAX_JUMP, value_at
from gateway.push.compare import place_for
from gateway.push.context import PushContext

Wish = tuple[TableChange, PushContext]
Moved = tuple[TableChange, AxisRecord]
"""A table with its input axis: what moves while it is switched."""
_SLACK = 1e-9


def common_places(wishes: Sequence[Wish]) -> dict[str, float | None]:
    """As `places_of`, of what is to be pushed."""
    return places_of(*_asked(wishes))


def _asked(wishes: Sequence[Wish]) -> tuple[list[Moved], Capabilities]:
    return [(change, context.moved) for change, context in wishes], wishes[0][1].controller.capabilities


def places_of(moved: Sequence[Moved], can: Capabilities) -> dict[str, float | None]:
    """Where each input axis must stand; None where no one place suits all its tables."""
    axes = {axis.name: axis for _, axis in reversed(moved)}
    names = dict.fromkeys(axis.name for _, axis in moved)
    return {
        name: place_of_all([change for change, axis in moved if axis.name == name], axes[name], can) for name in names
    }


def place_of_all(changes: Sequence[TableChange], axis: AxisRecord, can: Capabilities) -> float | None:
    """As `agreeing_position`, of several over one input axis: what suits one is tried on the others, nearest first."""
    change = changes[0]
    if len(changes) == 1 or not can.switches_now:
        return place_for(LiveTable(change.old, change.old_enabled), change.new, axis, can)
    low, high = axis.room
    points = {place for change in changes for place in change.new.positions if low <= place <= high}
    tried = [float(np.clip(axis.reference, low, high)), *sorted(points, key=lambda one: abs(one - axis.reference))]
    return next((place for place in tried if _suits(changes, place)), None)


def _suits(changes: Sequence[TableChange], place: float) -> bool:
    """Whether switching all of them off and on there moves no output axis further than one table may."""
    for axis in {change.axis for change in changes}:
        mine = [change for change in changes if change.axis == axis and change.new.kind != "reversal"]
        off = sum(abs(value_at(one.old, place)) for one in mine if one.old_enabled)
        on = sum(abs(value_at(one.new, place)) for one in mine)
        if max(off, on) > MAX_JUMP + _SLACK:
            return False
    return True


def together(wishes: Sequence[Wish]) -> tuple[tuple[Wish, ...], ...]:
    """The wishes in their order, as `transactions` of them."""
    if not wishes:
        return ()
    moved, can = _asked(wishes)
    return tuple(tuple(wishes[place] for place in group) for group in transactions(moved, can))


def transactions(moved: Sequence[Moved], can: Capabilities) -> tuple[tuple[int, ...], ...]:
    """Which tables go together, by their places in ``moved``: as few transactions as control and axes' places allow.

    One table each where the control takes no batch (`Capabilities.together`); a table without any place of its own is
    left alone, so that it is refused alone.
    """
    groups: list[list[int]] = []
    for place in range(len(moved)):
        if groups and can.together and _fits([moved[one] for one in (*groups[-1], place)], can):
            groups[-1].append(place)
        else:
            groups.append([place])
    return tuple(tuple(group) for group in groups)


def _fits(moved: Sequence[Moved], can: Capabilities) -> bool:
    return all(place is not None for place in places_of(moved, can).values())
