"""Is the table that was approved the one that is live? Read from the control and compared point by point."""

from __future__ import annotations

from pathlib import Path

from drivers.clock import Clock
from drivers.errors import ConfigError, TrueflankError, words
from drivers.types import LiveSet, LiveTable
from gateway.config import SiteFile
from gateway.domain import Proposal
from gateway.errors import StoreError
from gateway.push import conversation
from gateway.push.compare import table_in, tolerance
from gateway.say import Say
from gateway.store import RunFolder
from gateway.table.threeway import ThreeWay, compare
from gateway.workflow import stages
from gateway.workflow.bench import Bench, bench, new_run
from gateway.workflow.outcome import Outcome
from gateway.workflow.rolling_back import context_of, history

DIFFERS_EXIT = 9


async def verify_table(
    site: SiteFile, site_path: Path, *, table: str, run: RunFolder | None, clock: Clock, say: Say
) -> Outcome:
    """The live table (an axis, or "C1-cec3") against the last committed push, or against what a run proposed.

    Changes no compensation; where the road runs programs the operator starts one that saves the tables. The
    outcome's exit code is 9 unless the live table is as approved. Raises ConfigError (E-RUN-AXIS), StoreError
    (E-VERIFY-NOTHING), and what the port raises.
    """
    folder = new_run(site, site_path)
    folder.set_state("verifying-table")
    try:
        async with bench(site, site_path, folder, clock, say) as at:
            approved, before, said = _wanted(at, table, run)
            found, live = await _compared(at, approved, before)
    except TrueflankError as error:
        folder.set_state("failed", error=error.as_record())
        raise
    folder.write_text("live-tables.mpf", live.native)
    folder.set_state(f"table-{found.kind}")
    data = {"axis": table, "against": said, "digest": live.digest, **found.as_data()}
    exit_code = 0 if found.kind == "as-approved" else DIFFERS_EXIT
    return Outcome(folder.state, str(folder.path), (), (said, found.words), data, exit_code)


async def _compared(at: Bench, approved: LiveTable, before: LiveTable | None) -> tuple[ThreeWay, LiveSet]:
    shape, context = approved.table, context_of(at, approved.table)
    limits = await context.controller.table_limits(shape.output_axis, shape.function, shape.index)
    live = await conversation.read_live(context, context.moved.reference)
    return compare(table_in(live, shape), approved, before, tolerance(limits, shape)), live


def _wanted(at: Bench, table: str, run: RunFolder | None) -> tuple[LiveTable, LiveTable | None, str]:
    """The table that should be live, the one before it, and where that is known from."""
    if run is not None:
        return _proposed(run, table)
    pushes = history(at, table)
    if not pushes:
        raise StoreError("E-VERIFY-NOTHING", str(at.store.root), table=table, serial=at.machine.serial)
    last = pushes[-1]
    said = words("W-VERIFY-AGAINST-PUSH", table=table, transaction=last.transaction, utc=last.utc)
    return last.new, last.old, said


def _proposed(run: RunFolder, table: str) -> tuple[LiveTable, LiveTable, str]:
    proposal = run.get(stages.PROPOSAL, Proposal)
    for change in proposal.changes:
        if change.name == table and not change.skipped:
            old = LiveTable(change.old, change.old_enabled)
            return LiveTable(change.new, enabled=True), old, words("W-VERIFY-AGAINST-RUN", table=table, run=run.run_id)
    known = ", ".join(change.name for change in proposal.changes if not change.skipped)
    raise ConfigError("E-RUN-AXIS", str(run.path), axis=table, known=known or "none")
