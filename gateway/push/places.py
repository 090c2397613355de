"""Which tables go into one transaction: those for which each input axis has one place that suits them all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.types.tables import LiveTable
from gateway.domain.proposals import TableChange
from gateway.interlocks import MAX_JUMP, value_at
from gateway.push.compare import place_for
from gateway.push.context import PushContext

Wish = tuple[TableChange, PushContext]
_SLACK = 1e-9


def common_places(wishes: Sequence[Wish]) -> dict[str, float | None]:
    """Where each input axis must stand; None where no one place suits all its tables."""
    return {name: _place([wish for wish in wishes if wish[1].moved.name == name]) for name in _inputs(wishes)}


def _inputs(wishes: Sequence[Wish]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(context.moved.name for _, context in wishes))


def _place(wishes: Sequence[Wish]) -> float | None:
    """As `agreeing_position`, of several: each place that suits one is tried on the others, the nearest first."""
    change, context = wishes[0]
    axis, can = context.moved, context.controller.capabilities
    if len(wishes) == 1 or not can.switches_now:
        return place_for(LiveTable(change.old, change.old_enabled), change.new, axis, can)
    low, high = axis.room
    points = {place for change, _ in wishes for place in change.new.positions if low <= place <= high}
    tried = [float(np.clip(axis.reference, low, high)), *sorted(points, key=lambda one: abs(one - axis.reference))]
    return next((place for place in tried if _suits(wishes, place)), None)


def _suits(wishes: Sequence[Wish], place: float) -> bool:
    """Whether switching all of them off and on there moves no output axis further than one table may."""
    for axis in {change.axis for change, _ in wishes}:
        mine = [change for change, _ in wishes if change.axis == axis and change.new.kind != "reversal"]
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
