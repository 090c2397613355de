"""Options and table of a plan for limited hours, for `measure` and `close`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import words
from drivers.message import Message
from gateway.cli.output import echo_folded, show_json, show_table

HoursOption = Annotated[
    float | None,
    typer.Option(min=0.1, max=100.0, help="Measure no longer than this: what gains most per hour.", show_default=False),
]
ToleranceOption = Annotated[
    float | None,
    typer.Option(min=1e-3, help="Stop once the goal is proved within this, um or arcsec RMS.", show_default=False),
]
GoalOption = Annotated[str, typer.Option(help="With --hours or --tolerance: flank, drive, or an axis of the site.")]
USUAL_GOAL = "flank"


def planner_of(
    tree: Any, site: Path, *, hours: float | None, tolerance: float | None, goal: str, closing: bool | None = None
) -> Any:
    """The plan that was asked for; None without hours and tolerance. ``closing``: apply of a `close`, which has a rest.

    Raises typer.BadParameter for a goal without either, and what the plan raises.
    """
    if hours is None and tolerance is None:
        if goal != USUAL_GOAL:
            raise typer.BadParameter("--goal needs --hours or --tolerance", param_hint="--goal")
        return None
    from gateway.workflow.hours import HoursRequest, SiteHoursPlanner, closing_hours, goal_of_site

    asked = HoursRequest(hours, tolerance, goal)
    if closing is not None:
        asked = closing_hours(tree, site, asked, apply=closing)
    return SiteHoursPlanner(tree, goal_of_site(tree, site, goal), asked)


def show_hours(planner: Any, *, as_json: bool) -> None:
    """The plan as a table, what was left out with its price, and why it ends."""
    from gateway.capture.targets import targets_of

    found = planner.plan()
    if as_json:
        show_json(found.as_data())
        return
    unit, by = found.goal.unit, {one.key: one for one in found.setups}
    rows = []
    for step in found.plan.steps:
        for key in step.keys:
            last = key == step.keys[-1]
            size = f"{targets_of(by[key].axis).size} x {by[key].axis.measure.repetitions}"
            ends = (f"{60.0 * step.hours:.0f}", f"{step.u:.2f}") if last else ("", "")
            rows.append((key, by[key].setup.instrument or by[key].setup.source, size, *ends))
    heads = ("set-up", "instrument", "targets x repetitions", "min", f"goal u, {unit}")
    show_table(words("S-HOURS-TITLE", site=planner.site.site.name), heads, rows)
    counts = [one for one in found.plan.left_out if f"{one.u_with:.3f}" != f"{found.plan.u:.3f}"]
    left = [
        (", ".join(one.keys), f"{60.0 * one.hours:.0f}", f"{one.u_with:.3f}", f"{found.plan.u:.3f}") for one in counts
    ]
    if left:
        show_table(words("S-HOURS-LEFT"), ("set-ups", "min", "u with", "u without"), left)
    idle = [key for one in found.plan.left_out if one not in counts for key in one.keys]
    if idle:
        echo_folded(Message.of("S-HOURS-IDLE", count=len(idle), setups=", ".join(idle)), 2)
    for line in found.said:
        echo_folded(line, 2)
