"""The command `inspect`, and what `guard` and `correct` do from an inspected gear alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import typer

from drivers.message import Message, fixed
from gateway.cli.options import JsonOption, PartOption, SiteArgument, open_run
from gateway.cli.screen.telling import progress
from gateway.cli.show import echo, show_json, show_table
from gateway.cli.stopping import run_to_end
from gateway.workflow.files.headers import columns_of

Heights = Literal["lower-face", "middle"]
HEIGHTS: tuple[str, ...] = ("lower-face", "middle")
SHOWN = ("F_alpha", "f_Halpha", "f_falpha", "F_beta", "f_Hbeta", "f_fbeta", "F_p", "f_p", "F_r")
FileOption = Annotated[
    Path | None, typer.Option(help="File of flank points in place of the machine.", show_default=False)
]
HeightsOption = Annotated[str, typer.Option(help="Zero of the heights in the file: lower-face or middle.")]
RunOption = Annotated[str, typer.Option(help="Store it in this run: folder or id.", show_default=False)]


def inspect_command(
    site: SiteArgument,
    part: PartOption = "part",
    run: RunOption = "",
    file: FileOption = None,
    heights: HeightsOption = "lower-face",
    column: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE of the file's column map; asked once for each heading.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Inspect the clamped part on the gear inspection machine, or read a file of its flank points."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.flank_picture import draw_flank
    from gateway.workflow.tooth.inspection import inspect_site

    tree = load_site(site)
    points = flank_file(file, heights, columns_of(column or []) or None)
    folder = open_run(store_of(tree, site), run) if run else None

    def work(say: Any) -> Any:
        return inspect_site(tree, site, part=part, clock=LoopClock(), say=say, run=folder, file=points)

    found, used = _run(work, (tree, site), as_json=as_json)
    picture = draw_flank(found, used.path)
    if as_json:
        show_json(_data(found, str(used.path), str(picture)))
    else:
        _tell(found, str(used.path), str(picture))


def guard_gear(
    site: Path,
    run: str,
    part: str,
    file: Path | None,
    heights: str,
    limit_um: float | None,
    *,
    as_json: bool,
) -> None:
    """Compare the clamped part with the approved one of a run: 0 still valid, 20 changed, 21 cannot tell."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.inspection import guard_gear_site

    tree = load_site(site)
    folder = open_run(store_of(tree, site), run, "part")
    asked: dict[str, Any] = {"part": part, "file": flank_file(file, heights), "limit_um": limit_um}

    def work(say: Any) -> Any:
        return guard_gear_site(tree, site, folder, clock=LoopClock(), say=say, **asked)

    show_lines(_run(work, (tree, site), as_json=as_json), as_json=as_json)


def correct_gear(site: Path, gear: str, part: str, heights: str, *, as_json: bool) -> None:
    """Propose cross tables and set-up values from a run's inspected part, or from a file of flank points."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.from_gear import propose_from_gear

    tree = load_site(site)
    source = flank_file(Path(gear), heights) if Path(gear).is_file() else open_run(store_of(tree, site), gear, "part")

    def work(say: Any) -> Any:
        return propose_from_gear(tree, site, source, clock=LoopClock(), say=say, part=part)

    show_lines(_run(work, (tree, site), as_json=as_json), as_json=as_json)


def flank_file(path: Path | None, heights: str, columns: Any = None) -> Any:
    """The file of flank points that was asked for; None without. Raises typer.BadParameter."""
    from gateway.workflow.tooth.inspection import FlankFile

    if heights not in HEIGHTS:
        raise typer.BadParameter(f"{heights!r} is none of {', '.join(HEIGHTS)}", param_hint="--heights")
    return FlankFile(path, cast(Heights, heights), columns) if path is not None else None


def show_lines(outcome: Any, *, as_json: bool) -> None:
    """What a workflow handed back, and its exit code where it has one."""
    if as_json:
        show_json(outcome.as_data())
    else:
        for line in outcome.lines:
            echo(line)
    if getattr(outcome, "exit_code", 0):
        raise typer.Exit(outcome.exit_code)


def _run(work: Callable[[Any], Any], at: tuple[Any, Path], *, as_json: bool) -> Any:
    with progress(quiet=as_json, at=at) as say:
        return run_to_end(work(say), at=at[1])


def _data(found: Any, folder: str, picture: str) -> dict[str, Any]:
    figures = {"rms_um": found.fitted.rms_um, "rms_u_um": found.rms_u_um, "largest_um": found.fitted.largest_um}
    points = {"points": int(found.k.size), "point_u_um": found.u_um, "figures": dict(found.figures)}
    kept = {"said": list(map(str, found.said)), "run_folder": folder, "picture": picture}
    return {"part": found.part, "source": found.source, "serial": found.serial, **figures, **points, **kept}


def _tell(found: Any, folder: str, picture: str) -> None:

    flank = {"rms": fixed(found.fitted.rms_um), "u": fixed(found.rms_u_um), "u_point": fixed(found.u_um)}
    more = {"largest": fixed(found.fitted.largest_um), "points": found.k.size}
    echo(Message.of("W-INSPECTED", part=found.part, **flank, **more))
    show_table("largest of all flanks", ("value", "um"), [(name, f"{found.figures[name]:.2f}") for name in SHOWN])
    for line in found.said:
        echo(f"  note: {line}")
    echo(f"picture: {picture}")
    echo(f"run folder: {folder}")
