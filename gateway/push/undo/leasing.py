"""What a transaction that goes on was begun with, by its journal."""

from __future__ import annotations

from collections.abc import Sequence

from gateway.domain.proposals import TableChange
from gateway.push.beginning import Task
from gateway.push.context import PushContext
from gateway.push.records import journal
from gateway.push.undo.finding import before


async def leased(wishes: Sequence[tuple[TableChange, PushContext]], waits: journal.JournalRead) -> list[Task]:
    """The tasks of a transaction that goes on, as its journal has them: nothing spoke against them then."""
    controller = wishes[0][1].controller
    marker = before(waits) or (await controller.marker() if controller.capabilities.marker else None)
    tasks: list[Task] = []
    for change, context in wishes:
        limits = await controller.table_limits(change.axis, change.new.kind, change.new.index)
        place = float(waits.part(change.name if len(wishes) > 1 else "").entries[0].facts["place"])
        tasks.append(Task(change, context, limits, agreeing_position=place, marker=marker))
    return tasks
