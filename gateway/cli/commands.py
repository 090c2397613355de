"""Every command of `trueflank`; heavy imports wait inside the command that needs them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from drivers.terms import spoken
from gateway.cli.options import ApplyOption, JsonOption, MachineOption, RunArgument, SiteArgument, StoreOption
from gateway.cli.show import echo

WORDS = spoken()
app = typer.Typer(
    name="trueflank",
    help="Measure a gear grinder's axes, correct them through its controller, and prove the result.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)


@app.command()
def demo(
    folder: Annotated[Path, typer.Option(help="Where the demo keeps its site file and runs.")] = Path("demo"),
    speed: Annotated[float, typer.Option(min=1, max=500, help="Cell time against wall time.")] = 150.0,
    seed: Annotated[int | None, typer.Option(help="Draw another machine.", show_default=False)] = None,
    cell: Annotated[str, typer.Option(help="Cell file, or the name of a shipped cell.")] = "demo",
    axes: Annotated[bool, typer.Option("--axes", help="The axes alone: no other error, no part.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Start a simulated grinder and close the whole loop on it, over its wires: 21 errors, both layers, the part."""
    from gateway.cli.demonstration import run_demo

    run_demo(folder, cell, speed, seed, axes=axes, as_json=as_json)


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
    from gateway.cli.machine.running import run_site_command

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
    from gateway.cli.machine.running import push_run_command

    push_run_command(run_folder, store, apply, machine, as_json=as_json)


@app.command()
def recover(
    site: SiteArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    as_json: JsonOption = False,
) -> None:
    """Say what an interrupted push left behind; with --apply put the old table back."""
    from gateway.cli.machine.running import recover_command

    recover_command(site, apply, machine, as_json=as_json)


@app.command()
def serve(
    site: SiteArgument,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 8617,
) -> None:
    """Open and watch the devices, show a read-only status page, start runs on command."""
    from gateway.cli.machine.running import serve_command

    serve_command(site, host, port)


@app.command()
def evaluate(
    files: Annotated[list[Path] | None, typer.Argument(help="Result files, or runs.", show_default=False)] = None,
    standard: Annotated[str, typer.Option(help="Standard by name, or an edition of ISO 230-2; list: all.")] = "2014",
    unit: Annotated[str, typer.Option(help="Unit of an .rta's deviations: mrad, urad or arcsec.")] = "",
    limit: Annotated[list[str] | None, typer.Option(help="Judge a parameter: A=10. May be repeated.")] = None,
    air: Annotated[str, typer.Option(help="Re-compensate: edlen, ciddor or edlen-1966.")] = "",
    expansion: Annotated[float | None, typer.Option(min=-5, max=100, help="Re-compensate: ppm/K.")] = None,
    material_degc: Annotated[float | None, typer.Option(help="Material, degC: for U, and to re-compensate.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the Monte Carlo.")] = 1,
    axis: Annotated[str, typer.Option(help="Of a run: this axis only.")] = "",
    phase: Annotated[str, typer.Option(help="Of a run: before or after only.")] = "",
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Evaluate result files or runs to ISO 230-2 or another standard, with uncertainty and verdicts."""
    from gateway.cli.files.evaluating import EvaluationOptions, evaluate_files, limits_of, list_standards

    if standard == "list":
        list_standards(as_json=as_json)
        return
    asked = EvaluationOptions(
        standard=standard,
        unit=unit,
        limits=limits_of(limit or ()),
        air=air,
        expansion_ppm_per_k=expansion,
        material_degc=material_degc,
        seed=seed,
        store=store,
        axis=axis,
        phase=phase,
    )
    evaluate_files(files or [], asked, as_json=as_json)


@app.command()
def lint(
    file: Annotated[Path, typer.Argument(help="Compensation table as text, or an NC archive.", show_default=False)],
    control: Annotated[str, typer.Option(help=f"Size limits of a control: {WORDS.controls}.")] = "",
    points: Annotated[
        int | None, typer.Option(min=0, help=f"Reserved {WORDS.own} points, {WORDS.own_reserve}.", show_default=False)
    ] = None,
    cross_points: Annotated[
        int | None,
        typer.Option(
            f"--{WORDS.cross_key}-points",
            min=0,
            help=f"Reserved {WORDS.cross} points, {WORDS.cross_reserve}.",
            show_default=False,
        ),
    ] = None,
    velocity: Annotated[
        float | None, typer.Option(min=0, help="Velocity of the input axis, mm/min or deg/min.", show_default=False)
    ] = None,
    reference: Annotated[
        list[str] | None, typer.Option(help="[AXIS=]POSITION where tables must be zero.", show_default=False)
    ] = None,
    rotary: Annotated[list[str] | None, typer.Option(help="An axis that is rotary.", show_default=False)] = None,
    linear: Annotated[list[str] | None, typer.Option(help="An axis that is linear.", show_default=False)] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Count warnings as errors.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Say everything that is wrong or doubtful in a compensation table file."""
    from drivers.tablefile import TableMachine
    from gateway.cli.files.tables import lint_file, positions, said_units

    known = TableMachine(
        control=control.upper().removesuffix("SL").strip(),
        own_points=points,
        cross_points=cross_points,
        velocity=velocity,
        references=positions(reference or [], "--reference"),
        units=said_units(rotary or [], linear or []),
    )
    lint_file(file, known, strict=strict, as_json=as_json)


@app.command()
def diff(
    first: Annotated[Path, typer.Argument(help="Table file or back-up.", show_default=False)],
    second: Annotated[Path, typer.Argument(help="The other one.", show_default=False)],
    rotary: Annotated[list[str] | None, typer.Option(help="An axis that is rotary.", show_default=False)] = None,
    linear: Annotated[list[str] | None, typer.Option(help="An axis that is linear.", show_default=False)] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare two table files point by point; exit code 0 the same, 1 different, 2 trouble."""
    from gateway.cli.files.tables import diff_files, said_units

    diff_files(first, second, said_units(rotary or [], linear or []), as_json=as_json)


@app.command()
def convert(
    result: Annotated[Path, typer.Argument(help="Measured result file.", show_default=False)],
    to: Annotated[
        str, typer.Option(help=f"{WORDS.own_key} (mean of both directions) or {WORDS.cross_key} (a pair by direction).")
    ],
    axis: Annotated[str, typer.Option(help=f"Machine axis name, {WORDS.axis_name}.")],
    output: Annotated[Path, typer.Option("--output", "-o", help=f"File to write: {WORDS.suffixes}.")],
    reference: Annotated[
        float | None, typer.Option(help="Machine position where the table must be zero.", show_default=False)
    ] = None,
    datum: Annotated[
        list[str] | None,
        typer.Option(help="FILE=MACHINE position; twice if they count against each other.", show_default=False),
    ] = None,
    minimum: Annotated[float | None, typer.Option("--min", help="First point.", show_default=False)] = None,
    maximum: Annotated[float | None, typer.Option("--max", help="Last point.", show_default=False)] = None,
    step: Annotated[float | None, typer.Option(help="Distance of the points.", show_default=False)] = None,
    modulo: Annotated[bool, typer.Option("--modulo", help="Endless rotary axis, 0 to 360 deg.")] = False,
    unit: Annotated[str, typer.Option(help="Unit of the deviations, where the file does not say it.")] = "",
    index: Annotated[
        int, typer.Option(min=0, help=f"Encoder ({WORDS.own_key}: 0 or 1) or first table number ({WORDS.cross_key}).")
    ] = 0,
    form: Annotated[str, typer.Option(help="program, ini, axis-ini, archive or numbered.")] = "",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a compensation table file of a measured result file; the datum must be given."""
    from gateway.cli.files.convert import ConversionOptions, convert_file

    wish = ConversionOptions(
        result=result,
        to=to,
        axis=axis,
        reference=reference,
        datum=tuple(datum or ()),
        minimum=minimum,
        maximum=maximum,
        step=step,
        modulo=modulo,
        unit=unit,
        index=index,
        form=form,
        output=output,
        force=force,
    )
    convert_file(wish, as_json=as_json)


@app.command()
def report(run_folder: RunArgument, store: StoreOption = Path("runs"), as_json: JsonOption = False) -> None:
    """Write a run's report again (HTML, JSON, picture) and print where it is."""
    from gateway.cli.machine.running import report_command

    report_command(run_folder, store, as_json=as_json)


@app.command()
def study(
    gear: Annotated[Path, typer.Argument(help="Gear file (TOML).", show_default=False)],
    errors: Annotated[Path, typer.Argument(help="Error file (TOML).", show_default=False)],
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures (PNG).", show_default=False)] = None,
    scheduler: Annotated[str, typer.Option(help="Dask scheduler, tcp://host:port.", show_default=False)] = "",
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Processes for the ranking.", show_default=False)
    ] = None,
    order: Annotated[str, typer.Option(help="Flank of the ranking: first, second or exact.")] = "first",
    trajectories: Annotated[int, typer.Option(min=1, max=10_000, help="Morris trajectories.")] = 20,
    as_json: JsonOption = False,
) -> None:
    """Work out a gear on a machine: each error alone, ranking, cures, before and after."""
    from gateway.cli.files.study import study_command

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
def schema(
    as_page: Annotated[bool, typer.Option("--page", help="The page of reference instead, in Markdown.")] = False,
) -> None:
    """Print the site file's JSON schema, the settings of every driver among it."""
    from gateway.config.reference import page
    from gateway.config.reference import schema as site_schema

    echo(page().rstrip() if as_page else json.dumps(site_schema(), indent=2))
