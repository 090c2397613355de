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
_SLACK = 1e-9


def common_places(wishes: Sequence[Wish]) -> dict[str, float | None]:
    """Where each input axis must stand; None where no one place suits all its tables."""
    found: dict[str, float | None] = {}
    for name in _inputs(wishes):
        mine = [wish for wish in wishes if wish[1].moved.name == name]
        context = mine[0][1]
        changes = [change for change, _ in mine]
        found[name] = place_of_all(changes, context.moved, context.controller.capabilities)
    return found


def _inputs(wishes: Sequence[Wish]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(context.moved.name for _, context in wishes))


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
    """The wishes in their order, as few transactions as the control and its axes' places allow.

    One table each where the control takes no batch (`Capabilities.together`); a table without any place of its own is
    left alone, so that it is refused alone.
    """
    groups: list[list[Wish]] = []
    for wish in wishes:
        if groups and wish[1].controller.capabilities.together and _fits([*groups[-1], wish]):
            groups[-1].append(wish)
        else:
            groups.append([wish])
    return tuple(tuple(group) for group in groups)


def _fits(wishes: Sequence[Wish]) -> bool:
    return all(place is not None for place in common_places(wishes).values())
