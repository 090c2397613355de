"""What a push at a bench works with, and the audit log's word on how it ended."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Sequence
from dataclasses import replace
from typing import TypeVar

from drivers.errors import TrueflankError
from drivers.types.tables import CompensationTable
from gateway.approve import is_risk_taken
from gateway.config import AxisSection
from gateway.domain.captures import Capture
from gateway.domain.proposals import TableChange
from gateway.push import JOURNALS, PushContext
from gateway.workflow.bench import Bench
from gateway.workflow.consents import failed, tell
from gateway.workflow.selftests import last_of

Done = TypeVar("Done")


def table_context(at: Bench, table: CompensationTable, capture: Capture | None) -> PushContext:
    """What a push of this very table works with: its axes, and the proof of its kind if there is one."""
    context = push_context(at, at.axis(table.output_axis), capture)
    other = at.facts(at.axis(table.input_axis)) if table.input_axis != table.output_axis else None
    return replace(context, input=other, proof=at.proofs.find(at.machine, table.kind, table.output_axis))


def push_context(at: Bench, axis: AxisSection, capture: Capture | None) -> PushContext:
    """What a push of this axis works with; the operator's consent was checked before the bench was opened."""
    operator, name = at.site.operator, at.site.site.name
    return PushContext(
        controller=at.supervisor.controller,
        clock=at.clock,
        folder=at.folder,
        journals=at.store.root / JOURNALS,
        axis=at.facts(axis),
        machine=at.machine,
        typed_name=name,
        site_name=name,
        capture=capture,
        start_timeout_s=operator.start_timeout_s,
        stop_timeout_s=operator.stop_timeout_s,
        approvals_needed=at.site.site.approvals,
        access_level_needed=at.site.controller.access_level,
        say=at.say,
        self_test=last_of(at, axis),
        risk_taken=is_risk_taken(),
    )


async def kept(at: Bench, changes: Sequence[TableChange], work: Awaitable[Done]) -> Done:
    """Keep in the audit log how a push or sign proof ended that leaves no record, a stop from outside included."""
    try:
        return await work
    except (TrueflankError, asyncio.CancelledError) as error:
        for change in changes:
            if not change.skipped:
                tell(at, failed(at, change, error))
        raise
