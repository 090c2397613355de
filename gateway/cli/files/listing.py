"""The commands below `runs`: what a store holds, so that a run can be named, and one that is taken away."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.onward import next_step, step_of
from gateway.cli.options import JsonOption, RunArgument, StoreOption, open_run
from gateway.cli.show import counted, echo, show_json, show_table


def list_command(store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """List the runs of a store, oldest first."""
    from gateway.store import Store

    found = Store(store).runs()
    if as_json:
        show_json([asdict(one) for one in found])
        return
    if not found:
        echo(f"no run in {store}; another folder: --store")
        next_step("run SITE")
        return
    rows = [(one.run_id, one.machine, one.problem or one.state, str(len(one.stages))) for one in found]
    show_table(f"{counted(len(rows), 'run', 'runs')} in {store}", ("run", "machine", "state", "records"), rows)
    echo("a run is named by its id, a unique beginning of it, or latest")
    next_step(f"runs show latest --store {store}")


def show_command(run: RunArgument, store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """Show a run: its machine, its state, what it holds and what ended it."""
    from gateway.store import Store

    folder = open_run(Store(store), run)
    summary = folder.summary()
    if as_json:
        show_json({**asdict(summary), "errors": folder.errors})
        return
    for name in ("run_id", "path", "site", "created_utc", "state", "machine", "software"):
        echo(f"{name.replace('_', ' '):12} {getattr(summary, name)}")
    echo(f"{'holds':12} {', '.join(summary.stages) or 'nothing yet'}")
    for error in folder.errors:
        echo(f"{'ended by':12} {error.get('code', '')}: {error.get('what', '')}")
    failed = folder.errors or summary.state == "failed" or not summary.stages
    next_step(step_of("failed", run=folder.path) if failed else f"report {folder.path}")


def latest_command(store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """Show the latest run of a store."""
    show_command("latest", store, as_json)


def remove_command(
    run: RunArgument,
    store: StoreOption = Path("runs"),
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Remove a run's folder. What pushed a table stays: rollback, verify-table and the audit log rest on it."""
    from drivers.clock import LoopClock
    from gateway.cli.stopping import run_to_end
    from gateway.store import Store
    from gateway.workflow.run.audit_trail import remove_run

    folder = open_run(Store(store), run)
    if not yes:
        typer.confirm(f"remove {folder.path} ({folder.state})?", abort=True, err=True)

    async def main() -> None:
        remove_run(folder, clock=LoopClock())

    run_to_end(main())
    echo(f"removed: {folder.run_id}")
