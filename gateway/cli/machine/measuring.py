"""The commands `measure` and `guard`: all errors of a machine set-up by set-up, and whether what was approved holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.message import prose
from gateway.cli.machine.inspecting import FileOption, HeightsOption, guard_gear, show_lines
from gateway.cli.modes import only
from gateway.cli.onward import next_step
from gateway.cli.options import JsonOption, SiteArgument, named, open_run
from gateway.cli.screen.telling import progress
from gateway.cli.show import echo, show_json, show_table
from gateway.cli.stopping import run_to_end


def measure_command(
    site: SiteArgument,
    setups: Annotated[
        list[str] | None, typer.Option(help="Only this set-up or component; may be repeated.", show_default=False)
    ] = None,
    resume: Annotated[str, typer.Option(help="Continue this run: folder or id.", show_default=False)] = "",
    plan: Annotated[bool, typer.Option("--plan", help="List the set-ups in order and measure nothing.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure every error of the plan, set-up by set-up, and say which set-up would be worth most next."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.store import RunFolder
    from gateway.workflow.errors21.measurement import measure_site
    from gateway.workflow.results.report import write_report
    from gateway.workflow.run.folder import store_of

    if plan:
        only("measure --plan")
    tree = load_site(site)
    if plan:
        _show_plan(tree, as_json=as_json)
        return
    folder = open_run(store_of(tree, site), resume, "setups") if resume else None
    tooth = _tooth(tree, site)

    async def main(say: Any) -> Any:
        asked = {"wanted": tuple(setups or ()), "resume": folder, "tooth": tooth}
        return await measure_site(tree, site, clock=LoopClock(), say=say, **asked)

    with progress(quiet=as_json, at=(tree, site)) as say:
        outcome = run_to_end(main(say), at=site)
    paths = write_report(RunFolder(Path(outcome.run_folder)))
    if as_json:
        show_json({**outcome.as_data(), "report": paths.as_data()})
    else:
        _tell(outcome)
        echo(f"report: {paths.html}")
        next_step(f"correct {site} --run {outcome.run_folder}")


def guard_command(
    site: SiteArgument,
    run: Annotated[str, typer.Option(help="Run whose curve or part was approved: folder or id.")],
    axis: Annotated[str, typer.Option(help="Machine axis to check, e.g. C1.", show_default=False)] = "",
    gear: Annotated[bool, typer.Option("--gear", help="Check from an inspected gear, not from an axis.")] = False,
    part: Annotated[str, typer.Option(help="The approved part; default: after, or the only one.", callback=named)] = "",
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
    only("guard --axis")
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


def _tooth(tree: Any, site: Path) -> Any:
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
    show_table("set-ups in their order", ("set-up", "component", "axis", "instrument", "source"), rows)
    echo(f"set-ups: {len(found)}, changes of instrument, axis or artefact: {remountings(found)}")


def _tell(outcome: Any) -> None:
    rows = [
        (row.name, f"{row.low:+.2f}", f"{row.high:+.2f}", f"{row.U:.2f}", row.unit, row.state) for row in outcome.rows
    ]
    show_table("errors of the machine (U: k = 2)", ("error", "low", "high", "U", "unit", "state"), rows)
    for line in outcome.model.said:
        echo(f"  note: {line}")
    echo(prose(outcome.advice))
    echo(f"run folder: {outcome.run_folder}")
