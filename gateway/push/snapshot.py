"""What is live before anything is disabled: read, kept as text, and noted in every table's part of the journal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drivers.terms import spoken
from drivers.types.tables import LiveSet, LiveTable
from gateway.push import conversation
from gateway.push.compare import same_table, table_facts, table_in
from gateway.push.readback import is_coupled
from gateway.push.records.phases import PushEvent
from gateway.push.work import Work


async def snapshot(works: Sequence[Work]) -> tuple[LiveSet, ...]:
    """The live tables, kept as read, before anything is disabled; of each output axis once."""
    known = [work.context.read for work in works]
    read = tuple(live for live in known if live is not None)
    if len(read) < len(works):
        read = await live_of(works)
    for work, live in zip(works, read, strict=True):
        keep(work, live)
        if work.context.on_live is not None:
            work.context = replace(work.context, alarms=work.context.on_live(live))
    return read


async def live_of(works: Sequence[Work]) -> tuple[LiveSet, ...]:
    """What is live on each table's output axis, read afresh; of each axis once, and together where the road can."""
    asked = {(work.axis, work.context.sense): work.context for work in works}
    read = dict(zip(asked, await conversation.read_all(tuple(asked.values())), strict=True))
    return tuple(read[work.axis, work.context.sense] for work in works)


def keep(work: Work, live: LiveSet) -> None:
    """Keep the live tables' text, then note where; from here on the work knows what hangs together."""
    name = f"live-{work.name}-{work.whole.number:06d}{spoken().program_suffix}"
    work.backup_path = work.kept(name, live.native)
    work.base, work.coupled = live, is_coupled(live, work)
    work.restore_to = table_in(live, work.change.new)
    old = {"old": table_facts(work.restore_to.table), "old_enabled": work.restore_to.enabled}
    work.note(PushEvent.SNAPSHOT, path=work.backup_path, digest=live.digest, coupled=work.coupled, **old)


def already(work: Work, live: LiveSet) -> bool:
    """Whether the wanted table is live and enabled."""
    wanted = LiveTable(work.change.new, enabled=True)
    return same_table(wanted, table_in(live, work.change.new), work.allowed)
