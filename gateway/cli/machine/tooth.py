"""The commands `correct`, `grind` and `inspect`: the proposal for the tooth, a test part, and its inspection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import typer

from drivers.message import Message, fixed
from gateway.cli.command_list import require_only
from gateway.cli.next_steps import show_next
from gateway.cli.options import JsonOption, PartOption, SiteArgument, open_run, parse_name
from gateway.cli.output import echo, show_json, show_table
from gateway.cli.progress import progress
from gateway.cli.signals import run_to_end
from gateway.workflow.files.headers import columns_of


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
        str, typer.Option(help="With --gear: which part of the run.", show_default=False, callback=parse_name)
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
        require_only("correct --run ERRORS")
        _correct_from_errors(site, Path(run), error_u, sense, as_json=as_json)
    else:
        require_only("correct --run")
        _correct_run(site, run, as_json=as_json)


def _correct_from_errors(site: Path, path: Path, error_u: str, sense: str, *, as_json: bool) -> None:
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


def _correct_run(site: Path, run: str, *, as_json: bool) -> None:
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
        _show_correction(found)


def _show_correction(found: Any) -> None:
    tooth, flank = found.tooth, found.tooth.prediction
    show_table("tables", ("table", "what", Message.of("S-POINTS-VALUES")), found.tables)
    setup = tooth.setup
    values = f"x zero {setup.x_um:+.1f} um, C zero {setup.c_arcsec:+.1f} arcsec, dressing {setup.dressing_um:+.1f} um"
    echo(Message.of("S-TOOTH-SETUP", values=values))
    echo(
        Message.of(
            "S-TOOTH-RMS",
            before=flank.before.rms_um,
            fair=found.fair_before_um,
            after=flank.rms_um,
            after_u=flank.rms_u_um,
            calculated=flank.after.rms_um,
            floor_um=flank.floor_um,
            u_um=flank.u_um,
        )
    )
    parts = ", ".join(f"{name} {value:.2f}" for name, value in flank.parts_um.items() if value >= 0.005)
    echo(Message.of("S-TOOTH-U-PARTS", parts=parts))
    rank = {one.error: one for one in tooth.ranking}
    rows = [
        (one.error, *_rank_words(rank.get(one.error)), f"{one.rms_um:.3f}", one.by, f"{one.floor_um:.3f}")
        for one in tooth.cures
    ]
    headings = ("error", "rank", "mu* um", "alone um", "cured by", "left um")
    show_table(Message.of("S-TOOTH-ERRORS"), headings, rows)
    for line in tooth.said:
        echo(str(line))
    echo(f"run folder: {found.run_folder}")
    show_next(f"push {found.run_folder}")


def _rank_words(one: Any) -> tuple[str, str]:
    """Its place among all, with the interval of both."""
    if one is None:
        return "-", "-"
    low, high = one.rank
    return (
        str(low) if low == high else f"{low}-{high}"
    ), f"{one.mu_star_um:.3f} ({one.low_um:.3f} .. {one.high_um:.3f})"


# ---- grind


def grind_command(
    site: SiteArgument,
    part: PartOption = "part",
    run: Annotated[str, typer.Option(help="Store it in this run: folder or id.", show_default=False)] = "",
    x_um: Annotated[
        float | None,
        typer.Option(help="Zero of the infeed, um; + cuts deeper. Default: the present value.", show_default=False),
    ] = None,
    c_arcsec: Annotated[
        float | None,
        typer.Option(help="Zero of the index axis, arcsec. Default: the present value.", show_default=False),
    ] = None,
    dressing_um: Annotated[
        float | None,
        typer.Option(
            help="Offset of the dressed profile along the wheel's axis, um. Default: the present value.",
            show_default=False,
        ),
    ] = None,
    machine: Annotated[
        str, typer.Option(help="The machine's name, typed to consent; without it nothing is sent.")
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """Grind a test part with these set-up values; without --machine show its places and values only."""
    from gateway.config import load_site
    from gateway.store.machine_books import SetupBook
    from gateway.tooth import SetupValues
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.part_plan import gear_of_site

    tree = load_site(site)
    store = store_of(tree, site)
    now = SetupBook(store.root).current(tree.controller.serial, gear_of_site(tree, site).name)
    given = {"x_um": x_um, "c_arcsec": c_arcsec, "dressing_um": dressing_um}
    setup = SetupValues(**{**asdict(now), **{key: value for key, value in given.items() if value is not None}})
    folder = open_run(store, run) if run else None
    if machine:
        _grind_part(tree, site, part, setup, machine, folder, as_json=as_json)
    else:
        _show_grinding(tree, site, part, setup, f" --run {run}" if run else "", as_json=as_json)


def _grind_part(tree: Any, site: Path, part: str, setup: Any, machine: str, folder: Any, *, as_json: bool) -> None:
    from drivers.clock import LoopClock
    from gateway.workflow.tooth.grinding import grind_site

    async def main(say: Any) -> Any:
        asked = {"part": part, "setup": setup, "machine_name": machine, "run": folder}
        return await grind_site(tree, site, clock=LoopClock(), say=say, **asked)

    with progress(quiet=as_json, at=(tree, site)) as say:
        made, used = run_to_end(main(say), at=site)
    if as_json:
        show_json({**asdict(made), "run_folder": str(used.path)})
        return
    echo(
        Message.of(
            "S-TOOTH-GROUND", part=made.part, spaces=made.spaces, started_utc=made.started_utc, ended_utc=made.ended_utc
        )
    )
    echo(f"run folder: {used.path}")
    show_next(f"inspect {site} --part {part} --run {used.path}")


def _show_grinding(tree: Any, site: Path, part: str, setup: Any, into: str, *, as_json: bool) -> None:
    """Where each axis goes, and what is set; the program itself with --json. Nothing is opened.

    ``into`` is the option of the run that the part goes into.
    """
    from drivers import registry
    from gateway.workflow.tooth.part_plan import entry_instructions, gear_of_site, grind_plan

    plan = grind_plan(tree, gear_of_site(tree, site), setup, part)
    name = f"{tree.controller.driver}-program"
    able = name in registry.known("program")
    text = registry.load(name, "program")(plan, tree.controller.settings, str(site)) if able else ""
    rows = [(axis.name, f"{place:.4f}") for axis, place in plan.places()]
    if as_json:
        places = [{"axis": axis, "place": float(place)} for axis, place in rows]
        values = asdict(setup)
        show_json({"setup": values, "places": places, "seconds": round(plan.seconds), "program": text, "able": able})
        return
    show_table("outermost places (mm, deg; machine coordinates)", ("axis", "place"), rows)
    echo(f"set-up values: x {setup.x_um:+.1f} um, C {setup.c_arcsec:+.1f} arcsec, dressing {setup.dressing_um:+.1f} um")
    echo(entry_instructions(tree.work, setup))
    if able:
        echo(Message.of("S-TOOTH-PROGRAM"))
    echo(Message.of("S-TOOTH-PLAN", spaces=plan.spaces, minutes=plan.seconds / 60.0))
    if able:
        show_next(f"grind {site} --part {part}{into} --machine {tree.site.name}")
    else:
        echo(Message.of("S-TOOTH-NO-PROGRAMS", driver=tree.controller.driver))
        show_next(f"inspect {site} --part {part}{into}")


# ---- inspect, and `guard` and `correct` from an inspected gear alone

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
    separate: Annotated[
        bool, typer.Option("--separate", help="Separate the deviations by cause: wheel, set-up, axes, clamping, wear.")
    ] = False,
    store: Annotated[
        bool,
        typer.Option(
            "--store", help="Keep it as a routine part: valid (0), dress or measure C (20), cannot tell (21)."
        ),
    ] = False,
    tolerance: Annotated[
        float | None,
        typer.Option(min=0.01, help="With --store: largest RMS of the deviation, um.", show_default=False),
    ] = None,
    dressed: Annotated[
        int,
        typer.Option(min=0, help="With --store: parts since dressing, with this one; 0: one more than before."),
    ] = 0,
    as_json: JsonOption = False,
) -> None:
    """Inspect the clamped part on the gear inspection machine, or read a file of its flank points."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.tooth.flank_picture import draw_flank
    from gateway.workflow.tooth.inspection import inspect_site

    if store and tolerance is None:
        raise typer.BadParameter("--store needs --tolerance", param_hint="--tolerance")
    tree = load_site(site)
    points = flank_file(file, heights, columns_of(column or []) or None)
    folder = open_run(store_of(tree, site), run) if run else None

    def work(say: Any) -> Any:
        return inspect_site(tree, site, part=part, clock=LoopClock(), say=say, run=folder, file=points)

    found, used = _run_at(work, (tree, site), as_json=as_json)
    picture = draw_flank(found, used.path)
    causes = None
    if separate or store:
        from gateway.workflow.tooth.processing import separate_part

        causes = separate_part(tree, site, used, found)
    judged = None
    if store and causes is not None:
        from gateway.workflow.tooth.processing import keep_routine_part

        judged = keep_routine_part(
            store_of(tree, site).root, causes, found, tolerance_um=float(tolerance or 0.0), dressed=dressed
        )
    if as_json:
        more = {} if causes is None else {"separation": causes.as_data()}
        more |= {} if judged is None else {"process": judged.as_data()}
        show_json(_inspection_record(found, str(used.path), str(picture)) | more)
    else:
        _show_inspection(found, str(used.path), str(picture))
        if causes is not None:
            show_separation(causes)
    if judged is not None:
        show_lines(judged, as_json=False, quiet=as_json)


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

    show_lines(_run_at(work, (tree, site), as_json=as_json), as_json=as_json)


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

    show_lines(_run_at(work, (tree, site), as_json=as_json), as_json=as_json)


def flank_file(path: Path | None, heights: str, columns: Any = None) -> Any:
    """The file of flank points that was asked for; None without. Raises typer.BadParameter."""
    from gateway.workflow.tooth.inspection import FlankFile

    if heights not in HEIGHTS:
        raise typer.BadParameter(f"{heights!r} is none of {', '.join(HEIGHTS)}", param_hint="--heights")
    return FlankFile(path, cast(Heights, heights), columns) if path is not None else None


def show_lines(outcome: Any, *, as_json: bool, quiet: bool = False) -> None:
    """What a workflow handed back, and its exit code where it has one; ``quiet``: the code alone."""
    if as_json:
        show_json(outcome.as_data())
    elif not quiet:
        for line in outcome.lines:
            echo(line)
    if getattr(outcome, "exit_code", 0):
        raise typer.Exit(outcome.exit_code)


def _run_at(work: Callable[[Any], Any], at: tuple[Any, Path], *, as_json: bool) -> Any:
    with progress(quiet=as_json, at=at) as say:
        return run_to_end(work(say), at=at[1])


def _inspection_record(found: Any, folder: str, picture: str) -> dict[str, Any]:
    figures = {"rms_um": found.fitted.rms_um, "rms_u_um": found.rms_u_um, "largest_um": found.fitted.largest_um}
    points = {"points": int(found.k.size), "point_u_um": found.u_um, "figures": dict(found.figures)}
    kept = {"said": list(map(str, found.said)), "run_folder": folder, "picture": picture}
    return {"part": found.part, "source": found.source, "serial": found.serial, **figures, **points, **kept}


def _show_inspection(found: Any, folder: str, picture: str) -> None:

    flank = {"rms": fixed(found.fitted.rms_um), "u": fixed(found.rms_u_um), "u_point": fixed(found.u_um)}
    more = {"largest": fixed(found.fitted.largest_um), "points": found.k.size}
    echo(Message.of("W-INSPECTED", part=found.part, **flank, **more))
    show_table(Message.of("S-TOOTH-LARGEST"), ("value", "um"), [(name, f"{found.figures[name]:.2f}") for name in SHOWN])
    for line in found.said:
        echo(f"  note: {line}")
    echo(f"picture: {picture}")
    echo(f"run folder: {folder}")


def show_separation(found: Any, plot: Path | None = None, *, as_json: bool = False) -> None:
    """Print shares with their u and what goes with them, and draw them where asked."""
    if plot is not None:
        from gateway.study.dresser import separation_sheet
        from gateway.study.plots.charts import new_sheet

        new_sheet((11.0, 4.4), lambda figure: separation_sheet(figure, found.found)).savefig(plot)
    if as_json:
        show_json(found.as_data())
        return
    total = Message.of("S-TOOTH-IN-ALL", parts=", ".join(found.found.parts), total_um=found.found.total_um)
    show_table(total, ("share", "um RMS", "u"), found.rows)
    for line in found.lines:
        echo(line)
