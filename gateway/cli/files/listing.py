"""The commands `runs list` and `runs show`: what a store holds, so that a run can be named."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import typer

from gateway.cli.options import JsonOption, RunArgument, StoreOption
from gateway.cli.show import echo, show_json, show_table

runs_app = typer.Typer(name="runs", help="The runs of a store: list them, show one.", no_args_is_help=True)


def add_to(app: typer.Typer) -> None:
    """Give the command line these commands."""
    app.add_typer(runs_app)


@runs_app.command("list")
def list_command(store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """List the runs of a store, oldest first."""
    from gateway.store import Store

    found = Store(store).runs()
    if as_json:
        show_json([asdict(one) for one in found])
        return
    if not found:
        echo(f"no run in {store}")
        return
    rows = [(one.run_id, one.machine, one.problem or one.state, str(len(one.stages))) for one in found]
    show_table(f"{len(rows)} run(s) in {store}", ("run", "machine", "state", "records"), rows)
    echo("next: trueflank runs show RUN; a unique beginning of its id is enough, or latest")


@runs_app.command("show")
def show_command(run: RunArgument, store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """Show a run: its machine, its state, what it holds and what ended it."""
    from gateway.store import Store

    folder = Store(store).open(run)
    summary = folder.summary()
    if as_json:
        show_json({**asdict(summary), "errors": folder.errors})
        return
    for name in ("run_id", "path", "site", "created_utc", "state", "machine", "software"):
        echo(f"{name.replace('_', ' '):12} {getattr(summary, name)}")
    echo(f"{'holds':12} {', '.join(summary.stages) or 'nothing yet'}")
    for error in folder.errors:
        echo(f"{'ended by':12} {error.get('code', '')}: {error.get('what', '')}")
