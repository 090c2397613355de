"""The command `close`: the whole loop, from all 21 errors to a test part that proves it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import Clock, LoopClock
from gateway.cli.machine.dayplan import show_day_of_closing
from gateway.cli.machine.running import onward_of, show_outcome
from gateway.cli.modes import only
from gateway.cli.options import ApplyOption, JsonOption, MachineOption, PlanOption, RiskOption, SiteArgument, open_run
from gateway.cli.screen.telling import progress
from gateway.cli.stopping import run_to_end
from gateway.remaining import RemainingTime
from gateway.say import Say


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
    plan: PlanOption = False,
    as_json: JsonOption = False,
) -> None:
    """Measure all errors, propose tables for the tooth; with --apply grind, push, grind again and prove it."""
    if plan:
        only("close --plan")
        show_day_of_closing(site, apply=apply, as_json=as_json)
        return
    from gateway.approve import take_risk

    with take_risk(risk):
        close_site_command(site, apply, machine, resume, as_json=as_json, keep_worse=keep_worse)


def close_site_command(
    site: Path, apply: bool, machine: str, resume: str = "", *, as_json: bool, keep_worse: bool = False
) -> None:
    """Close the loop at a site, and show what came of it."""
    asked = Closing(site, apply=apply, machine=machine, resume=resume, keep_worse=keep_worse)
    outcome = asked.run(quiet=as_json)
    show_outcome(outcome, as_json=as_json, onward=onward_of(outcome, site))


@dataclass(frozen=True, slots=True)
class Closing:
    """A closing run as it was asked for; ``wanted`` are the set-ups by key (none: all of the plan).

    The demo, which owns its cell and has an ``own_operator`` there, types the machine's name itself.
    """

    site: Path
    apply: bool
    machine: str = ""
    resume: str = ""
    keep_worse: bool = False
    own_operator: bool = False
    wanted: Sequence[str] = ()
    clock: Clock = field(default_factory=LoopClock)

    def stages(self) -> RemainingTime:
        """Its stages by the forecast of the site file; none where that cannot be made."""
        from gateway.config import load_site
        from gateway.workflow.forecast import day_of_closing, remaining_of

        tree, wanted = load_site(self.site), self.wanted
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

        async def main(say: Say) -> Any:
            return await close_site(tree, self.site, clock=self.clock, say=say, **asked)

        known = stages if stages is not None else self.stages()
        with progress(quiet=quiet, at=(tree, self.site), own_operator=self.own_operator, stages=known) as say:
            return run_to_end(main(say), at=self.site)
