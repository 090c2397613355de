"""Is the table that was approved the one that is live? Read from the control and compared point by point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.message import Message
from drivers.terms import spoken
from drivers.types.tables import LiveSet, LiveTable
from gateway.config import SiteFile
from gateway.domain.proposals import Proposal
from gateway.errors import StoreError
from gateway.push import (
    JOURNALS,
    all_pushes,
    consent_set,
    read_live_of_axes,
    read_live_tables,
    table_in,
    tolerance,
    unfinished_tables,
)
from gateway.say import Say
from gateway.store import RunFolder
from gateway.table.live_comparison import compare_three_tables
from gateway.workflow.control.rollback import rollback_context, rollback_lines
from gateway.workflow.run import stages
from gateway.workflow.run.audit_trail import record_look
from gateway.workflow.run.context import RunContext, axis_named, keep_look, open_context, run_or_look
from gateway.workflow.run.live_tables import (
    TableLook,
    compare_with,
    describe_comparisons,
    expected_tables,
    record_looks,
)
from gateway.workflow.run.outcome import Outcome
from gateway.workflow.run.push_context import push_context

DIFFERS_EXIT = 9


async def verify_table(
    site: SiteFile, site_path: Path, *, table: str, run: RunFolder | None, clock: Clock, say: Say
) -> Outcome:
    """The live table by its name against the last committed push, or against what a run proposed.

    Changes no compensation, and leaves a run folder only where something differs. Where the road runs programs the
    operator starts one, which saves the tables of all axes. Without ``table`` every table that a committed push left.
    What is not as pushed is an alarm, and the outcome's exit code is 9. Raises ConfigError (E-RUN-AXIS),
    StoreError (E-VERIFY-NOTHING), and what the port raises.
    """
    if table and run is None:
        axis_named(site, site_path, spoken().axis_of(table))
    with run_or_look(site, site_path, "verifying-table", look=True) as folder:
        async with open_context(site, site_path, folder=folder, clock=clock, say=say, instruments=()) as at:
            outcome = await (_against_pushes(at, table) if run is None else _against_run(at, table, run))
            record_look(at, "verify-table", table=table or "all", found=outcome.state)
            return replace(outcome, run_folder=keep_look(at) if outcome.exit_code else "")


async def _against_pushes(at: RunContext, table: str) -> Outcome:
    every = await expected_tables(at)
    wanted = tuple(one for one in every if table in ("", one.push.table))
    if not wanted:
        raise StoreError("E-VERIFY-NOTHING", str(at.store.root), table=table or "any table", serial=at.machine.serial)
    looks: list[TableLook] = []
    suffix = spoken().program_suffix
    names = tuple(dict.fromkeys(one.push.axis for one in wanted))
    for axis, live in zip(names, await read_axes(at, names), strict=True):
        at.folder.write_text(f"live-tables{suffix}" if table else f"live-tables-{axis}{suffix}", live.native)
        found = compare_with(wanted, live)
        record_looks(at, found, aloud=False)
        looks += found
    return _outcome(at, table, looks)


def _outcome(at: RunContext, table: str, looks: list[TableLook]) -> Outcome:
    kinds = {look.found.kind for look in looks} - {"as-approved"}
    at.folder.set_state(f"table-{min(kinds) if kinds else 'as-approved'}")
    rows = [{"axis": one.name, "against": one.against, "digest": one.digest, **one.found.as_data()} for one in looks]
    journals, serial = at.store.root / JOURNALS, at.machine.serial
    left, back = unfinished_tables(journals, serial), consent_set(all_pushes(journals, serial), table)
    data: dict[str, Any] = {**(rows[0] if table else {"tables": rows}), "unfinished": len(left)}
    data["rollback"] = [one.table for one in back.tables] if back is not None else []
    return Outcome(
        state=at.folder.state,
        run_folder=str(at.folder.path),
        rows=(),
        lines=(*_comparison_lines(looks), *rollback_lines(back)),
        data=data,
        exit_code=DIFFERS_EXIT if kinds else 0,
    )


def _comparison_lines(looks: Sequence[TableLook]) -> Iterator[Message]:
    """What was compared with which push, once for each, and what is live: what is in order in one line."""
    pushes: dict[int, list[TableLook]] = {}
    for look in looks:
        pushes.setdefault(look.expected.push.transaction, []).append(look)
    for together in pushes.values():
        yield describe_comparisons(together)
        right = [look.found for look in together if look.found.kind == "as-approved"]
        for enabled in (True, False):
            if same := [found for found in right if found.live_enabled is enabled]:
                yield replace(same[0], name=", ".join(found.name for found in same)).message
        yield from (look.found.message for look in together if look.found not in right)


async def read_axes(at: RunContext, names: Sequence[str]) -> tuple[LiveSet, ...]:
    """The live tables of axes as stored; with programs the operator starts one that saves those of all."""
    return await read_live_of_axes([push_context(at, at.axis(name), None) for name in names])


async def _against_run(at: RunContext, table: str, run: RunFolder) -> Outcome:
    approved, before, said = _proposed_table(run, table)
    shape, context = approved.table, rollback_context(at, approved.table)
    limits = await context.controller.table_limits(shape.output_axis, shape.kind, shape.index)
    live = await read_live_tables(context)
    found = compare_three_tables(table_in(live, shape), approved, before, tolerance(limits, shape))
    at.folder.write_text(f"live-tables{spoken().program_suffix}", live.native)
    at.folder.set_state(f"table-{found.kind}")
    data = {"axis": table, "against": str(said), "digest": live.digest, **found.as_data()}
    exit_code = 0 if found.kind == "as-approved" else DIFFERS_EXIT
    return Outcome(
        state=at.folder.state,
        run_folder=str(at.folder.path),
        rows=(),
        lines=(said, found.message),
        data=data,
        exit_code=exit_code,
    )


def _proposed_table(run: RunFolder, table: str) -> tuple[LiveTable, LiveTable, Message]:
    proposal = run.get(stages.PROPOSAL, Proposal)
    for change in proposal.changes:
        if change.name == table and not change.skipped:
            old = LiveTable(change.old, change.old_enabled)
            said = Message.of("W-VERIFY-AGAINST-RUN", table=table, run=run.run_id)
            return LiveTable(change.new, enabled=True), old, said
    known = ", ".join(change.name for change in proposal.changes if not change.skipped)
    raise ConfigError("E-RUN-AXIS", str(run.path), axis=table, known=known or "none")
