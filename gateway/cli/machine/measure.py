"""`measure`, `guard` and `measure dynamic`: all errors by set-ups, validity of a curve, fast recordings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError
from drivers.message import Message, prose
from gateway.cli.command_list import require_only
from gateway.cli.machine.hours import (
    USUAL_GOAL,
    GoalOption,
    HoursOption,
    ToleranceOption,
    planner_of,
    show_hours,
)
from gateway.cli.machine.tooth import FileOption, HeightsOption, guard_gear, show_lines
from gateway.cli.next_steps import show_next
from gateway.cli.options import JsonOption, SiteArgument, StoreOption, open_run, parse_name
from gateway.cli.output import echo, show_json, show_table
from gateway.cli.progress import progress
from gateway.cli.signals import run_to_end


def measure_command(
    site: SiteArgument,
    setups: Annotated[
        list[str] | None, typer.Option(help="Only this set-up or component; may be repeated.", show_default=False)
    ] = None,
    resume: Annotated[str, typer.Option(help="Continue this run: folder or id.", show_default=False)] = "",
    plan: Annotated[bool, typer.Option("--plan", help="List the set-ups in order and measure nothing.")] = False,
    hours: HoursOption = None,
    tolerance: ToleranceOption = None,
    goal: GoalOption = USUAL_GOAL,
    as_json: JsonOption = False,
) -> None:
    """Measure every error of the plan, set-up by set-up, or in limited hours those that gain most."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.store import RunFolder
    from gateway.workflow.errors21.measurement import measure_site
    from gateway.workflow.results.report import write_report
    from gateway.workflow.run.folder import store_of

    if plan:
        require_only("measure --plan")
    tree = load_site(site)
    planner = planner_of(tree, site, hours=hours, tolerance=tolerance, goal=goal)
    if planner is not None and setups:
        raise typer.BadParameter("give either --setups, or --hours and --tolerance", param_hint="--setups")
    if plan and planner is not None:
        show_hours(planner, as_json=as_json)
        return
    if plan:
        _show_plan(tree, as_json=as_json)
        return
    folder = open_run(store_of(tree, site), resume, "setups") if resume else None
    tooth = _tooth_spec(tree, site)

    async def main(say: Any) -> Any:
        asked = {"wanted": tuple(setups or ()), "resume": folder, "tooth": tooth, "chooses": planner}
        return await measure_site(tree, site, clock=LoopClock(), say=say, **asked)

    with progress(quiet=as_json, at=(tree, site)) as say:
        outcome = run_to_end(main(say), at=site)
    paths = write_report(RunFolder(Path(outcome.run_folder)))
    if as_json:
        show_json({**outcome.as_data(), "report": paths.as_data()})
    else:
        _show_errors(outcome)
        echo(f"report: {paths.html}")
        show_next(f"correct {site} --run {outcome.run_folder}")


def guard_command(
    site: SiteArgument,
    run: Annotated[str, typer.Option(help="Run whose curve or part was approved: folder or id.")],
    axis: Annotated[str, typer.Option(help="Machine axis to check, e.g. C1.", show_default=False)] = "",
    gear: Annotated[bool, typer.Option("--gear", help="Check from an inspected gear, not from an axis.")] = False,
    part: Annotated[
        str, typer.Option(help="The approved part; default: after, or the only one.", callback=parse_name)
    ] = "",
    file: FileOption = None,
    heights: HeightsOption = "lower-face",
    limit: Annotated[
        float | None, typer.Option(min=0.01, help="Allowed change, um or arcsec.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check one axis at few targets, or a gear: still valid (0), re-measure this axis (20), cannot tell (21)."""
    if gear == bool(axis):
        raise typer.BadParameter("give either an axis or --gear", param_hint="--axis")
    if gear:
        guard_gear(site, run, part=part, file=file, heights=heights, limit_um=limit, as_json=as_json)
        return
    require_only("guard --axis")
    _guard_axis(site, run, axis, limit, as_json=as_json)


def _guard_axis(site: Path, run: str, axis: str, limit: float | None, *, as_json: bool) -> None:
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.axes.short_capture import guard_site
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    folder = open_run(store_of(tree, site), run, "curve", f"{axis}-")

    async def main(say: Any) -> Any:
        return await guard_site(tree, site, folder, axis, clock=LoopClock(), say=say, limit=limit)

    with progress(quiet=as_json, at=(tree, site)) as say:
        outcome = run_to_end(main(say), at=site)
    show_lines(outcome, as_json=as_json)


def _tooth_spec(tree: Any, site: Path) -> Any:
    """The work the site file names; None without. Raises what reading a gear file raises."""
    if tree.work is None:
        return None
    from gateway.correct.outlook.flank_uncertainty import ToothSpec
    from gateway.study.inputs import gear_of, load_gear

    file = load_gear(site.parent / tree.work.gear)
    return ToothSpec(gear_of(file), file.grinding.centre_distance_mm, tree.work.height_mm)


def _show_plan(tree: Any, *, as_json: bool) -> None:
    from gateway.workflow.errors21.setups import plan_setups, remountings

    found = plan_setups(tree)
    rows = [
        (one.key, one.setup.component, one.axis.name, one.setup.instrument or one.setup.source, one.setup.source)
        for one in found
    ]
    if as_json:
        keys = ("setup", "component", "axis", "instrument", "source")
        plan = [dict(zip(keys, row, strict=True)) for row in rows]
        show_json({"plan": plan, "remountings": remountings(found)})
        return
    show_table(Message.of("S-MEASURE-ORDER"), ("set-up", "component", "axis", "instrument", "source"), rows)
    echo(Message.of("S-MEASURE-CHANGES", count=len(found), changes=remountings(found)))


def _show_errors(outcome: Any) -> None:
    rows = [
        (row.name, f"{row.low:+.2f}", f"{row.high:+.2f}", f"{row.U:.2f}", row.unit, row.state) for row in outcome.rows
    ]
    show_table(Message.of("S-MEASURE-ERRORS"), ("error", "low", "high", "U", "unit", "state"), rows)
    for line in outcome.model.said:
        echo(f"  note: {line}")
    echo(prose(outcome.advice))
    echo(f"run folder: {outcome.run_folder}")


# ---- dynamic

RECORDING_ENDINGS = ("none", "value", "level", "external")


def dynamic_command(
    source: Annotated[
        Path, typer.Argument(metavar="SITE|FILE", help="Site file, .rtx, or a run's .f64.", show_default=False)
    ],
    instrument: Annotated[str, typer.Option(help="Instrument of the site.")] = "",
    seconds: Annotated[float, typer.Option(min=0.001, help="Duration after the trigger.")] = 20.0,
    trigger: Annotated[str, typer.Option(help="none, value=UM moved, level=UM crossed, external.")] = "none",
    pre: Annotated[float, typer.Option(min=0.0, help="Seconds kept from before the trigger.")] = 0.1,
    wait: Annotated[float, typer.Option(min=0.0, help="Seconds to wait for the trigger.")] = 60.0,
    axis: Annotated[str, typer.Option(help="Axis under observation, for the record.")] = "",
    channel: Annotated[str, typer.Option(help="Channel of the instrument (default: its first).")] = "",
    unit: Annotated[str, typer.Option(help="Unit of an .rtx's samples: mm, um, mrad, urad, arcsec or deg.")] = "",
    band: Annotated[
        float | None, typer.Option(min=1e-6, help="Settling band, um or arcsec.", show_default=False)
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="PNG to write for a file.", show_default=False)] = None,
    store: StoreOption = Path("runs"),
    as_json: JsonOption = False,
) -> None:
    """Record an instrument's stream to disk, or open a dynamic file, and show vibrations and settling."""
    if source.suffix.lower() == ".toml":
        from gateway.workflow.axes.dynamic import RecordingOptions

        start = parse_trigger(trigger, pre)
        wish = RecordingOptions(instrument, seconds, trigger=start, axis=axis, channel=channel, wait_s=wait, band=band)
        outcome = _capture(source, wish, as_json=as_json)
    else:
        outcome = _open_recording(source, unit, plot, band, store)
    if as_json:
        show_json(outcome.as_data())
    else:
        show_recording(outcome.as_data())


def parse_trigger(text: str, pre_s: float) -> Any:
    """A trigger from "value=0.5". Raises ConfigError (E-CLI-TRIGGER)."""
    from gateway.capture.dynamic import Trigger

    kind, mark, number = text.strip().partition("=")
    try:
        at = float(number) if mark else 0.0
    except ValueError:
        at = math.nan
    needs = kind in ("value", "level")
    if kind not in RECORDING_ENDINGS or needs != bool(mark) or not math.isfinite(at) or (kind == "value" and at <= 0.0):
        raise ConfigError("E-CLI-TRIGGER", "--trigger", text=text)
    return Trigger(kind, at, pre_s)  # type: ignore[arg-type]


def _capture(site: Path, wish: Any, *, as_json: bool) -> Any:
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.axes.dynamic import capture_dynamic

    tree = load_site(site)
    with progress(quiet=as_json, at=(tree, site)) as say:
        return run_to_end(capture_dynamic(tree, site, wish, clock=LoopClock(), say=say), at=site)


def _open_recording(path: Path, unit: str, plot: Path | None, band: float | None, store: Path) -> Any:
    from drivers.recordings import Recording
    from gateway.store import Maps
    from gateway.store.raw_stream import open_stream
    from gateway.workflow.axes.dynamic import outcome_of
    from gateway.workflow.files.reading import ReadOptions, read_file

    notes: tuple[Message, ...] = ()
    if path.suffix == ".f64":
        recording: Any = open_stream(path)
    else:
        read = read_file(path, ReadOptions(unit), Maps(store))
        recording, notes = read.content, read.notes
    if not isinstance(recording, Recording):
        raise ConfigError("E-CLI-NOT-DYNAMIC", str(path))
    return outcome_of(recording, path, plot or _require_free(path), band=band, notes=notes)


def _require_free(path: Path) -> Path:
    """NAME.png beside the working folder, numbered where it exists: a picture never replaces another."""
    number, found = 2, Path(f"{path.stem}.png")
    while found.exists():
        found, number = Path(f"{path.stem}-{number}.png"), number + 1
    return found


def show_recording(data: dict[str, Any]) -> None:
    """A record's results in words."""
    unit = data["unit"]
    head = Message.of(
        "S-MEASURE-STREAM",
        place=data["place"],
        samples=data["samples"],
        rate=data["rate_hz"],
        duration=data["duration_s"],
    )
    echo(Message.of("S-MEASURE-GAPS", head=head, gaps=data["gaps"], lost=data["lost"]))
    if "spectrum" in data:
        made = data["spectrum"]
        rows = [(f"{peak['frequency_hz']:.2f}", f"{peak['amplitude']:.4g}") for peak in made["peaks"]]
        title = f"vibrations ({made['averages']} averages, rms {made['rms']:.4g} {unit})"
        show_table(title, ("frequency Hz", f"amplitude {unit}"), rows)
    found = data["settling"]
    if found is None:
        echo(Message.of("S-MEASURE-SETTLING", missing=data["settling_missing"]))
    else:
        time = "never" if found["time_s"] is None else f"after {1000.0 * found['time_s']:.2f} ms"
        echo(f"settling: step {found['step']:.4g} {unit}, within {found['band']:g} {unit} {time}")
        echo(f"  overshoot {found['overshoot']:.4g} {unit}")
        if found["ringing"]:
            ringing = found["ringing"]
            echo(f"  ringing {ringing['frequency_hz']:.4g} Hz, {ringing['amplitude']:.4g} {unit}")
    echo(f"picture: {data['picture']}")
    for note in data["notes"]:
        echo(f"  note: {note}")
