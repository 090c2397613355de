"""The commands `run` and `close`: axes, or the whole loop up to a test part; with `--plan` the forecast of the day."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import Clock, LoopClock
from drivers.errors import words
from drivers.message import Message, fixed
from drivers.terms import spoken
from gateway.cli.command_list import require_only
from gateway.cli.machine.hours import (
    USUAL_GOAL,
    GoalOption,
    HoursOption,
    ToleranceOption,
    planner_of,
    show_hours,
)
from gateway.cli.next_steps import after_site_run, show_next, show_outcome
from gateway.cli.options import (
    ApplyOption,
    AxesOption,
    JsonOption,
    MachineOption,
    PlanOption,
    RiskOption,
    SiteArgument,
    load_site,
    open_run,
    parse_name,
    require_control,
)
from gateway.cli.output import echo_folded, show_json, show_table
from gateway.cli.progress import progress
from gateway.cli.signals import run_to_end
from gateway.remaining import RemainingTime
from gateway.say import Say


def run_site_command(
    site: Path,
    apply: bool,
    machine: str,
    *,
    as_json: bool,
    axes: tuple[str, ...] = (),
    typed_by_demo: bool = False,
    clock: Clock | None = None,
) -> None:
    """Run a site; the demo, which owns its cell, types the machine's name itself."""
    from gateway.workflow.complete_run import run_site
    from gateway.workflow.forecast import day_of_run, remaining_of

    tree = load_site(site)
    require_control(tree)
    name = tree.site.name if typed_by_demo else machine
    used = clock or LoopClock()

    async def main(say: Say) -> Any:
        return await run_site(tree, site, apply=apply, machine_name=name, clock=used, say=say, axes=axes)

    known = remaining_of(lambda: day_of_run(tree, apply=apply, axes=axes))
    with progress(quiet=as_json, at=(tree, site), own_operator=typed_by_demo, stages=known) as say:
        outcome = run_to_end(main(say), at=site)
    onward = after_site_run(outcome, site)
    show_outcome(outcome, as_json=as_json, onward="" if typed_by_demo else onward)


def run_command(
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
        require_only("run --plan")
        show_day_of_run(site, tuple(axis or ()), apply=apply, as_json=as_json)
        return
    from gateway.approve import take_risk

    with take_risk(risk):
        run_site_command(site, apply, machine, axes=tuple(axis or ()), as_json=as_json)


# ---- close


def close_command(
    site: SiteArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    risk: RiskOption = "",
    resume: Annotated[str, typer.Option(help="Continue this run: folder or id.", show_default=False)] = "",
    keep_worse: Annotated[
        bool,
        typer.Option("--keep-worse", help="Keep the new tables if the flank became worse; default: roll back."),
    ] = False,
    cycle: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="A person runs this program of the builder for each part, in place of ours.",
            show_default=False,
            callback=parse_name,
        ),
    ] = "",
    plan: PlanOption = False,
    hours: HoursOption = None,
    tolerance: ToleranceOption = None,
    goal: GoalOption = USUAL_GOAL,
    as_json: JsonOption = False,
) -> None:
    """Measure all errors, propose tables for the tooth; with --apply grind, push, grind again and prove it.

    With --hours the day is no longer than that: its other work counts, and the rest goes to the set-ups that gain most.
    """
    if plan:
        require_only("close --plan")
    limited = None
    if hours is not None or tolerance is not None or goal != USUAL_GOAL:
        limited = planner_of(load_site(site), site, hours=hours, tolerance=tolerance, goal=goal, closing=apply)
    if plan and limited is not None:
        show_hours(limited, as_json=as_json)
        return
    if plan:
        show_day_of_closing(site, apply=apply, as_json=as_json)
        return
    from gateway.approve import take_risk

    with take_risk(risk):
        more: dict[str, Any] = {"keep_worse": keep_worse, "cycle": cycle, "limited": limited}
        close_site_command(site, apply, machine, resume, as_json=as_json, **more)


def close_site_command(
    site: Path,
    apply: bool,
    machine: str,
    resume: str = "",
    *,
    as_json: bool,
    keep_worse: bool = False,
    cycle: str = "",
    limited: Any = None,
) -> None:
    """Close the loop at a site, and show what came of it; ``limited``: the plan that chooses what is measured."""
    more: dict[str, Any] = {"resume": resume, "keep_worse": keep_worse, "cycle": cycle, "limited": limited}
    asked = ClosingRequest(site, apply=apply, machine=machine, **more)
    outcome = asked.run(quiet=as_json)
    show_outcome(outcome, as_json=as_json, onward=after_site_run(outcome, site))


@dataclass(frozen=True, slots=True)
class ClosingRequest:
    """A closing run as it was asked for; ``wanted`` are the set-ups by key (none: all of the plan).

    ``limited`` chooses them for limited hours instead (`gateway.workflow.hours`).

    The demo, which owns its cell and has an ``own_operator`` there, types the machine's name itself.
    """

    site: Path
    apply: bool
    machine: str = ""
    resume: str = ""
    keep_worse: bool = False
    own_operator: bool = False
    wanted: Sequence[str] = ()
    cycle: str = ""
    limited: Any = None
    clock: Clock = field(default_factory=LoopClock)

    def stages(self) -> RemainingTime:
        """Its stages by the forecast of the site file; none where that cannot be made."""
        from gateway.config import load_site
        from gateway.workflow.forecast import day_of_closing, remaining_of

        tree, wanted = load_site(self.site), self.wanted or (self.limited.plan().plan.keys if self.limited else ())
        return remaining_of(lambda: day_of_closing(tree, self.site, apply=self.apply, wanted=wanted))

    def run(self, *, quiet: bool, stages: RemainingTime | None = None) -> Any:
        """Do it with its progress shown; returns its outcome. Raises what `close_site` raises."""
        from gateway.config import load_site
        from gateway.workflow.complete_run import close_site
        from gateway.workflow.run.folder import store_of

        tree = load_site(self.site)
        folder = open_run(store_of(tree, self.site), self.resume) if self.resume else None
        asked: dict[str, Any] = {"apply": self.apply, "resume": folder, "back": not self.keep_worse}
        asked |= {"machine_name": tree.site.name if self.own_operator else self.machine, "wanted": self.wanted}
        asked |= {"cycle": self.cycle, "chooses": self.limited}

        async def main(say: Say) -> Any:
            return await close_site(tree, self.site, clock=self.clock, say=say, **asked)

        known = stages if stages is not None else self.stages()
        with progress(quiet=quiet, at=(tree, self.site), own_operator=self.own_operator, stages=known) as say:
            return run_to_end(main(say), at=self.site)


# ---- --plan: the day as a table, what it asks of a person, and its hours


def show_day_of_run(site: Path, axes: Sequence[str], *, apply: bool, as_json: bool) -> None:
    """The day of `run`. Raises as `day_of_run`."""
    from gateway.config import typed_rotary
    from gateway.workflow.forecast import day_of_run

    tree = load_site(site)
    require_control(tree)
    if not as_json:
        for name in typed_rotary(tree):
            if not axes or name in axes:
                echo_folded(f"W-CFG-TYPED-ROTARY: {name}: {words('W-CFG-TYPED-ROTARY')}", 2)
    named = "".join(f" --axis {name}" for name in axes)
    _show_day(day_of_run(tree, apply=apply, axes=axes), f"run {site}{named}", apply=apply, as_json=as_json)


def show_day_of_closing(site: Path, *, apply: bool, as_json: bool) -> None:
    """The day of `close`. Raises as `day_of_closing`."""
    from gateway.workflow.forecast import day_of_closing

    tree = load_site(site)
    require_control(tree)
    _show_day(day_of_closing(tree, site, apply=apply), f"close {site}", apply=apply, as_json=as_json)


def _show_day(day: Any, command: str, *, apply: bool, as_json: bool) -> None:
    if as_json:
        show_json(day.as_data())
        return
    terms = spoken()
    headings = ("work", "of", Message.of("S-OPTICS-PLACE"), terms.start, terms.restart, "min")
    show_table(
        words("S-DAY-TITLE", command=day.command, site=day.site), headings, [_day_row(day, one) for one in day.pieces]
    )
    counts = {"mountings": len(day.mountings), "blanks": day.blanks}
    counts |= {"presses": len(day.presses), "resets": len(day.resets)}
    echo_folded(Message.of("S-DAY-COUNTS", **counts), 2)
    stages = ", ".join(f"{stage} {hours:.1f} h" for stage, hours in day.by_stage().items())
    echo_folded(
        Message.of("S-DAY-HOURS", hours=fixed(day.hours, 1), stages=stages, extra=fixed(day.most_extra_h, 1)), 2
    )
    if day.unprotected:
        echo_folded(Message.of("P-UNPROTECTED", road=day.unprotected), 2)
    echo_folded(Message.of("S-DAY-SUPPOSES" if apply else "S-DAY-NO-APPLY"), 2)
    show_next(command + (" --apply --machine NAME" if apply else ""))


def _day_row(day: Any, piece: Any) -> tuple[str, ...]:
    place = piece.mounting.words if piece.mounting is not None else "blank" if piece.clampings else ""
    asked = (str(len(asks) or "") for asks in (piece.asks.presses, piece.asks.resets))
    return piece.stage, piece.name, place, *asked, f"{piece.seconds(day.times) / 60.0:.0f}"
