"""Commands that need no room of their own; heavy imports wait inside the command that needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivers.terms import spoken
from gateway.cli.machine.dayplan import show_day_of_run
from gateway.cli.modes import only
from gateway.cli.options import (
    ApplyOption,
    AxesOption,
    JsonOption,
    MachineOption,
    PlanOption,
    PointsOption,
    RiskOption,
    RunArgument,
    SiteArgument,
    StoreOption,
    TablesOption,
    TakeOption,
)
from gateway.cli.show import echo, show_json

WORDS = spoken()


def run(
    site: SiteArgument,
    axis: AxesOption = None,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    risk: RiskOption = "",
    plan: PlanOption = False,
    as_json: JsonOption = False,
) -> None:
    """Measure every axis, propose tables; with --apply push them, measure again and prove it."""
    if plan:
        only("run --plan")
        show_day_of_run(site, tuple(axis or ()), apply=apply, as_json=as_json)
        return
    from gateway.approve import take_risk
    from gateway.cli.machine.running import run_site_command

    with take_risk(risk):
        run_site_command(site, apply, machine, axes=tuple(axis or ()), as_json=as_json)


def push(
    run_folder: RunArgument,
    axis: TablesOption = None,
    points: PointsOption = False,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    risk: RiskOption = "",
    offline: Annotated[
        bool, typer.Option("--offline", help="Write programs for a person to carry to the control, then exit.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="With --offline: continue with the files that were brought back.")
    ] = False,
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Show a stored proposal's difference and every refusal; with --apply write it and measure again."""
    from gateway.approve import take_risk
    from gateway.cli.machine.running import PushAsked, push_run_command
    from gateway.workflow.run.push_context import push_by_files

    asked = PushAsked(tuple(axis or ()), apply, machine, points)
    with take_risk(risk), push_by_files(offline=offline, resume=resume):
        push_run_command(run_folder, store, asked, as_json=as_json)


def recover(
    site: SiteArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    finish: Annotated[
        bool, typer.Option("--finish", help="Finish an interrupted rollback: the earlier tables become active.")
    ] = False,
    undo: Annotated[
        bool, typer.Option("--undo", help="Undo an interrupted rollback: the pushed tables stay active.")
    ] = False,
    take: TakeOption = "",
    as_json: JsonOption = False,
) -> None:
    """Say what an interrupted push or rollback left behind; with --apply put it right."""
    from gateway.cli.machine.running import recover_command

    if finish and undo:
        raise typer.BadParameter("choose one of --finish and --undo", param_hint="--finish, --undo")
    choice = "finish" if finish else "undo" if undo else "offered"
    recover_command(site, apply, machine, choice, take=take, as_json=as_json)


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


def diff(
    first: Annotated[Path, typer.Argument(help="Table file or back-up.", show_default=False)],
    second: Annotated[Path, typer.Argument(help="The second file.", show_default=False)],
    rotary: Annotated[list[str] | None, typer.Option(help="An axis that is rotary.", show_default=False)] = None,
    linear: Annotated[list[str] | None, typer.Option(help="An axis that is linear.", show_default=False)] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare two table files point by point; exit code 0 the same, 1 different, 2 trouble."""
    from gateway.cli.files.tables import diff_files, said_units

    diff_files(first, second, said_units(rotary or [], linear or []), as_json=as_json)


def study(
    gear: Annotated[Path, typer.Argument(help="Gear file (TOML).", show_default=False)],
    errors: Annotated[
        Path, typer.Argument(help="Error file (TOML), a run's folder, or its errors.json.", show_default=False)
    ],
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures (PNG).", show_default=False)] = None,
    scheduler: Annotated[str, typer.Option(help="Dask scheduler, tcp://host:port.", show_default=False)] = "",
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Processes for the ranking.", show_default=False)
    ] = None,
    order: Annotated[
        str,
        typer.Option(help="Flank of the ranking: first, second or exact. With exact, before and after are exact too."),
    ] = "first",
    trajectories: Annotated[int, typer.Option(min=1, max=10_000, help="Morris trajectories.")] = 20,
    relative: Annotated[
        bool,
        typer.Option(
            "--relative",
            help="The six relative errors of wheel to work alone, without --paper; drawn into --plots, else here.",
        ),
    ] = False,
    paper: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the paper's figures and tables, and the disc as CSV and DXF.", show_default=False
        ),
    ] = None,
    height: Annotated[
        float | None,
        typer.Option(
            help="Middle of the work's face in the coordinates of Z, mm, for a run; default: as its site file has it.",
            show_default=False,
        ),
    ] = None,
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
        relative=relative,
        paper=paper,
        height=height,
    )


def schema(
    as_page: Annotated[bool, typer.Option("--page", help="Print the reference page instead, in Markdown.")] = False,
    api: Annotated[bool, typer.Option("--api", help="Print the service's routes instead (OpenAPI).")] = False,
    states: Annotated[bool, typer.Option("--states", help="Print the states of a push instead, in Markdown.")] = False,
) -> None:
    """Print the site file's JSON schema, the settings of every driver among it."""
    if api:
        only("schema --api")
        from gateway.web.document import described

        show_json(described())
        return
    if states:
        only("schema --states")
        from gateway.push import transitions_in_markdown

        echo(transitions_in_markdown().rstrip())
        return
    from gateway.config import page
    from gateway.config import schema as site_schema

    if as_page:
        only("schema --page")
        echo(page().rstrip())
    else:
        show_json(site_schema())
