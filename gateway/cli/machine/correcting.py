"""The command `correct`: what a measured run, or an inspected gear, proposes for the tooth, and what it will do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.cli.machine.inspecting import HeightsOption, correct_gear
from gateway.cli.modes import only
from gateway.cli.onward import next_step
from gateway.cli.options import JsonOption, SiteArgument, named, open_run
from gateway.cli.screen.telling import progress
from gateway.cli.show import echo, show_json, show_table
from gateway.cli.stopping import run_to_end


def correct_command(
    site: SiteArgument,
    run: Annotated[
        str,
        typer.Option(
            help="Measured run: folder or id; or a file of errors (Etalon exchange, ISG, error-csv): a forecast.",
            show_default=False,
        ),
    ] = "",
    gear: Annotated[
        str,
        typer.Option(help="Start from an inspected part: a run, or a file of flank points.", show_default=False),
    ] = "",
    part: Annotated[
        str, typer.Option(help="With --gear: which part of the run.", show_default=False, callback=named)
    ] = "",
    heights: HeightsOption = "lower-face",
    error_u: Annotated[
        str,
        typer.Option(
            "--error-u", help="File of errors: U (k = 2) of its lengths and angles, um,arcsec.", show_default=False
        ),
    ] = "",
    sense: Annotated[
        str,
        typer.Option(help="File of errors of another program: values are error or correction.", show_default=False),
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """Propose axis tables, cross tables and set-up values for the tooth from a measured run, and predict the flank."""
    if bool(run) == bool(gear):
        raise typer.BadParameter("give either a measured run or an inspected gear", param_hint="--run, --gear")
    if gear:
        correct_gear(site, gear, part, heights, as_json=as_json)
    elif Path(run).is_file():
        only("correct --run with a file of errors")
        _from_errors(site, Path(run), error_u, sense, as_json=as_json)
    else:
        only("correct --run")
        _from_run(site, run, as_json=as_json)


def _from_run(site: Path, run: str, *, as_json: bool) -> None:
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.proposal import correct_site

    tree = load_site(site)
    folder = open_run(store_of(tree, site), run, "errors")

    async def main(say: Any) -> Any:
        return await correct_site(tree, site, folder, clock=LoopClock(), say=say)

    with progress(quiet=as_json, at=(tree, site)) as say:
        found = run_to_end(main(say), at=site)
    if as_json:
        show_json(found.as_data())
    else:
        _tell(found)


def _from_errors(site: Path, path: Path, error_u: str, sense: str, *, as_json: bool) -> None:
    """The forecast of a file of errors: nothing is stored, for what compensated is in no such file."""
    from gateway.cli.files.day import tell_forecast
    from gateway.config import load_site
    from gateway.workflow.day.making import forecast
    from gateway.workflow.errors21.error_file import model_of_errors, read_errors, stated_errors
    from gateway.workflow.errors21.measurement import grids
    from gateway.workflow.tooth.proposal import work_of

    tree = load_site(site)
    model = model_of_errors(read_errors(path, sense), stated_errors(error_u), tree)
    found = forecast(model, work_of(tree, site), grids(tree))
    if as_json:
        said = list(map(str, model.said))
        show_json({"state": "forecast", "measured": list(model.measured), "said": said, "forecast": found.as_data()})
        return
    for line in model.said:
        echo(f"note: {line}")
    tell_forecast(found)


def _tell(found: Any) -> None:
    tooth, flank = found.tooth, found.tooth.prediction
    show_table("tables", ("table", "what", "points and values"), found.tables)
    setup = tooth.setup
    values = f"x zero {setup.x_um:+.1f} um, C zero {setup.c_arcsec:+.1f} arcsec, dressing {setup.dressing_um:+.1f} um"
    echo(f"set-up values: {values}; the trial part tells the final ones")
    echo(
        f"flank RMS: {flank.before.rms_um:.2f} um before ({found.fair_before_um:.2f} um with its set-up values right), "
        f"{flank.rms_um:.2f} +- {flank.rms_u_um:.2f} um after (calculated {flank.after.rms_um:.2f} um, "
        f"floor {flank.floor_um:.2f} um; u {flank.u_um:.2f} um)"
    )
    parts = ", ".join(f"{name} {value:.2f}" for name, value in flank.parts_um.items() if value >= 0.005)
    echo(f"u is made of (um): {parts}")
    rank = {one.error: one for one in tooth.ranking}
    rows = [
        (one.error, *_ranked(rank.get(one.error)), f"{one.rms_um:.3f}", one.by, f"{one.floor_um:.3f}")
        for one in tooth.cures
    ]
    headings = ("error", "rank", "mu* um", "alone um", "cured by", "left um")
    show_table("errors on the tooth", headings, rows)
    for line in tooth.said:
        echo(str(line))
    echo(f"run folder: {found.run_folder}")
    next_step(f"push {found.run_folder}")


def _ranked(one: Any) -> tuple[str, str]:
    """Its place among all, with the interval of both."""
    if one is None:
        return "-", "-"
    low, high = one.rank
    return (
        str(low) if low == high else f"{low}-{high}"
    ), f"{one.mu_star_um:.3f} ({one.low_um:.3f} .. {one.high_um:.3f})"
