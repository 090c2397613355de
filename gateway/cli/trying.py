"""The commands for who has no machine at hand: demo, teach, simulate, cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.modes import only
from gateway.cli.options import JsonOption, SpeedOption, named, road_of


def demo(
    folder: Annotated[Path, typer.Option(help="Folder for the demo's site file and runs.")] = Path("demo"),
    speed: Annotated[
        float | None,
        typer.Option(
            min=1,
            max=500,
            help="Machine seconds per real second at most; default: as fast as this computer allows.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulated machine.", show_default=False)] = None,
    cell: Annotated[str, typer.Option(help="Cell file, or the name of a shipped cell.")] = "demo",
    axes: Annotated[bool, typer.Option("--axes", help="Axes only: no other error, no part.")] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Measure every set-up of the plan; default: those that matter for the tooth.")
    ] = False,
    resume: Annotated[
        str, typer.Option(help="Continue this run of the demo, which stopped while measuring.", show_default=False)
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """Start a simulated grinder and close the whole loop on it, over its wires: errors, both layers, the part."""
    from gateway.cli.demonstration import Demo, run_demo

    if axes and (everything or resume):
        raise typer.BadParameter("--axes is a demo of its own: leave --all and --resume away", param_hint="--axes")
    run_demo(Demo(folder, cell, speed or 0.0, seed, axes=axes, everything=everything, run=resume), as_json=as_json)


def simulate(
    cell: Annotated[str, typer.Argument(help="Cell file, or the name of a shipped cell.", show_default=True)] = "demo",
    site: Annotated[Path, typer.Option(help="Path of the new site file.")] = Path("cell/site.toml"),
    speed: SpeedOption = 10.0,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulated machine.", show_default=False)] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Name every set-up and the work in the site file.")] = False,
    filed: Annotated[bool, typer.Option("--filed", help="All set-ups come from tables; with --plan.")] = False,
    road: Annotated[
        str,
        typer.Option(
            help="Connections to the control: opcua, modbus or both; default: those of the cell file.", callback=road_of
        ),
    ] = "",
    name: Annotated[str, typer.Option(help="Name of the machine in the site file.", callback=named)] = "",
    listed: Annotated[bool, typer.Option("--list", help="List the shipped cells and exit.")] = False,
) -> None:
    """Start a simulated cell on free loopback ports and print its site file; Ctrl-C ends it."""
    from gateway.cli.demonstration import CellAsked, list_cells, run_cell

    if listed:
        only("simulate --list")
        list_cells()
        return
    run_cell(CellAsked(cell, site, speed, seed, plan=plan or filed, filed=filed, road=road, name=name))


def teach(
    cell: Annotated[str, typer.Argument(help="Cell file, or the name of a shipped cell.", show_default=True)] = "demo",
    folder: Annotated[Path, typer.Option(help="Folder for the site file and the runs.")] = Path("teach"),
    speed: SpeedOption = 20.0,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the operator's page; 0 selects a free one.")
    ] = 8617,
    alone: Annotated[
        bool, typer.Option("--alone", help="You are the operator: no simulated person presses keys or mounts optics.")
    ] = False,
) -> None:
    """Train a calibration day: the service on a simulated cell, and the machine's panel as a page; Ctrl-C ends both."""
    from gateway.cli.teaching import Lesson, teach_at

    teach_at(Lesson(cell, folder, speed, port, alone=alone))


def cell(
    site: Annotated[Path, typer.Argument(help="Site file of a running cell.", show_default=False)],
    keys: Annotated[
        list[str] | None, typer.Argument(help="Actions in order; without any, you type them.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Stand at a simulated cell: press its keys, mount, break the beam, take the part, change the weather."""
    from gateway.cli.console import stand_at

    stand_at(site, tuple(keys or ()), as_json=as_json)
