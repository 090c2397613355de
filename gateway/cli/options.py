"""Arguments and options that several commands share, and what may be a name in one."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError
from drivers.local.names import allowed, is_name, shown
from drivers.local.tomlfile import read_toml

SiteArgument = Annotated[Path, typer.Argument(help="Site file (TOML).", show_default=False)]
RunArgument = Annotated[
    str,
    typer.Argument(
        help="Run folder; its id, a unique beginning of it, or latest (the last that measured), with --store.",
        show_default=False,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
ApplyOption = Annotated[bool, typer.Option("--apply", help="Write to the controller (else: propose only).")]
MachineOption = Annotated[str, typer.Option(help="The machine's name, typed to confirm --apply.")]
RiskOption = Annotated[
    str, typer.Option(help="Type unprotected to push alone on an unprotected connection.", show_default=False)
]
AxesOption = Annotated[
    list[str] | None, typer.Option("--axis", help="Only this machine axis; may be repeated.", show_default=False)
]
PlanOption = Annotated[
    bool,
    typer.Option("--plan", help="Show the day beforehand: mountings, presses, restarts, hours; touch no device."),
]
TablesOption = Annotated[
    list[str] | None,
    typer.Option("--axis", help="Only this axis or table, as the proposal names it; may be repeated."),
]
PointsOption = Annotated[bool, typer.Option("--points", help="Show every interpolation point.")]
SpeedOption = Annotated[
    float, typer.Option(min=1, max=500, help="Machine seconds in one second of yours; deadlines keep to yours.")
]
ROADS = ("", "opcua", "modbus", "both")
TakeOption = Annotated[
    str, typer.Option(help="Why the devices are taken from a service that hangs.", show_default=False)
]
USUAL_STORE = Path("runs")
MOST_SITES = 50


def store_here(given: Path) -> Path:
    """The store that is meant where none is named: `runs` here, else that of the one site file here or a folder below.

    With none or several of them it stays `runs`: no command takes another machine's run for the latest.
    """
    if given != USUAL_STORE or given.exists():
        return given
    sites = [one for form in ("*.toml", "*/*.toml") for one in islice(Path().glob(form), MOST_SITES)]
    found = {store for site in sites if (store := _store_of(site)) is not None and store.is_dir()}
    return found.pop() if len(found) == 1 else given


def _store_of(site: Path) -> Path | None:
    """Where a site file keeps its runs; None for a file that is no site file."""
    try:
        named = read_toml(site)["site"].get("store", str(USUAL_STORE))
        return site.parent / named
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


StoreOption = Annotated[Path, typer.Option(help="Folder that holds the runs.", callback=store_here)]


def named(text: str) -> str:
    """An option that becomes a part of a file's name. Raises ConfigError (E-NAME)."""
    if text and not is_name(text):
        raise ConfigError("E-NAME", "command line", name=shown(text), allowed=allowed())
    return text


PartOption = Annotated[str, typer.Option(help="What the part is called in its run.", callback=named)]


def road_of(text: str) -> str:
    """A way into a simulated control. Raises typer.BadParameter."""
    if text not in ROADS:
        raise typer.BadParameter(f"{text!r} is none of {', '.join(ROADS[1:])}")
    return text


def load_site(path: Path) -> Any:
    """The site file of a command; what reads it is loaded now, so that --help is quick. Raises ConfigError."""
    from gateway.config import load_site as load

    return load(path)
