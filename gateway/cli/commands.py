"""Every command of `trueflank`; heavy imports wait inside the command that needs them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="trueflank",
    help="Measure a gear grinder's axes, correct them through its controller, and prove the result.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

SiteArgument = Annotated[Path, typer.Argument(help="Site file (TOML).", show_default=False)]
RunArgument = Annotated[str, typer.Argument(help="Run folder, or its id with --store.", show_default=False)]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
ApplyOption = Annotated[bool, typer.Option("--apply", help="Write to the controller (else: propose only).")]
MachineOption = Annotated[str, typer.Option(help="The machine's name, typed to confirm --apply.")]
StoreOption = Annotated[Path, typer.Option(help="Folder that holds the runs.")]


@app.command()
def demo(
    folder: Annotated[Path, typer.Option(help="Where the demo keeps its site file and runs.")] = Path("demo"),
    speed: Annotated[float, typer.Option(min=1, max=200, help="Cell time against wall time.")] = 100.0,
    seed: Annotated[int | None, typer.Option(help="Draw another machine.", show_default=False)] = None,
    cell: Annotated[str, typer.Option(help="Cell file, or the name of a shipped cell.")] = "demo",
    as_json: JsonOption = False,
) -> None:
    """Start a simulated grinder and do the whole main job on it, over its wires."""
    from gateway.cli.demonstration import run_demo

    run_demo(folder, cell, speed, seed, as_json=as_json)


@app.command()
def simulate(
    cell: Annotated[str, typer.Argument(help="Cell file, or the name of a shipped cell (demo).")],
    site: Annotated[Path, typer.Option(help="Where to write the site file.")] = Path("cell/site.toml"),
    speed: Annotated[float, typer.Option(min=1, max=200, help="Cell time against wall time.")] = 10.0,
    seed: Annotated[int | None, typer.Option(help="Draw another machine.", show_default=False)] = None,
) -> None:
    """Start a simulated cell on free loopback ports and print its site file; Ctrl-C ends it."""
    from gateway.cli.demonstration import run_cell

    run_cell(cell, site, speed, seed)


@app.command()
def run(
    site: SiteArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    as_json: JsonOption = False,
) -> None:
    """Measure every axis, propose tables; with --apply push them, measure again and prove it."""
    from gateway.cli.running import run_site_command

    run_site_command(site, apply, machine, as_json=as_json)


@app.command()
def push(
    run_folder: RunArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Show a stored proposal's difference and every refusal; with --apply write it and measure again."""
    from gateway.cli.running import push_run_command

    push_run_command(run_folder, store, apply, machine, as_json=as_json)


@app.command()
def recover(
    site: SiteArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    as_json: JsonOption = False,
) -> None:
    """Say what an interrupted push left behind; with --apply put the old table back."""
    from gateway.cli.running import recover_command

    recover_command(site, apply, machine, as_json=as_json)


@app.command()
def check(
    site: SiteArgument,
    connect: Annotated[bool, typer.Option("--connect", help="Also open and identify every device.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Check a site file; with --connect also every device it names, all failures at once."""
    from gateway.cli.running import check_command

    check_command(site, connect, as_json=as_json)


@app.command()
def serve(
    site: SiteArgument,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 8617,
) -> None:
    """Open and watch the devices, show a read-only status page, start runs on command."""
    from gateway.cli.running import serve_command

    serve_command(site, host, port)


@app.command()
def evaluate(
    files: Annotated[list[Path], typer.Argument(help=".rtl, .rta or .csv files.", show_default=False)],
    standard: Annotated[str, typer.Option(help="Edition of ISO 230-2: 2014, 2006, 1997 or 1988.")] = "2014",
    unit: Annotated[str, typer.Option(help="Unit of an .rta's deviations: mrad, urad or arcsec.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Evaluate result files to ISO 230-2."""
    from gateway.cli.files import evaluate_files

    evaluate_files(files, standard, unit, as_json=as_json)


@app.command()
def lint(
    file: Annotated[Path, typer.Argument(help="Compensation table as text.", show_default=False)],
    as_json: JsonOption = False,
) -> None:
    """Say everything that is wrong or doubtful in a compensation table file."""
    from gateway.cli.files import lint_file

    lint_file(file, as_json=as_json)


@app.command()
def report(run_folder: RunArgument, store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """Write a run's report again (HTML, JSON, picture) and print where it is."""
    from gateway.cli.running import report_command

    report_command(run_folder, store, as_json=as_json)


@app.command()
def study(
    gear: Annotated[Path, typer.Argument(help="Gear file (TOML).", show_default=False)],
    errors: Annotated[Path, typer.Argument(help="Error file (TOML).", show_default=False)],
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures (PNG).", show_default=False)] = None,
    scheduler: Annotated[str, typer.Option(help="Dask scheduler, tcp://host:port.", show_default=False)] = "",
    workers: Annotated[int | None, typer.Option(help="Processes for the ranking.", show_default=False)] = None,
    order: Annotated[str, typer.Option(help="Flank of the ranking: first, second or exact.")] = "first",
    trajectories: Annotated[int, typer.Option(min=1, help="Morris trajectories.")] = 20,
    as_json: JsonOption = False,
) -> None:
    """Work out a gear on a machine: each error alone, ranking, cures, before and after."""
    from gateway.cli.study import study_command

    study_command(
        gear,
        errors,
        plots=plots,
        scheduler=scheduler,
        workers=workers,
        order=order,
        trajectories=trajectories,
        as_json=as_json,
    )


@app.command()
def schema() -> None:
    """Print the site file's JSON schema."""
    from gateway.config import schema as site_schema

    typer.echo(json.dumps(site_schema(), indent=2))
