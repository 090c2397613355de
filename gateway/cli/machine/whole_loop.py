"""The command `close`: the whole loop, from all 21 errors to a test part that proves it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import Clock, LoopClock
from gateway.cli.machine.dayplan import show_day_of_closing
from gateway.cli.machine.running import onward_of, show_outcome
from gateway.cli.options import ApplyOption, JsonOption, MachineOption, PlanOption, RiskOption, SiteArgument, open_run
from gateway.cli.screen.telling import progress
from gateway.cli.stopping import run_to_end
from gateway.say import Say


def close_command(
    site: SiteArgument,
    apply: ApplyOption = False,
    machine: MachineOption = "",
    risk: RiskOption = "",
    resume: Annotated[str, typer.Option(help="Go on with this run: folder or id.", show_default=False)] = "",
    keep_worse: Annotated[
        bool,
        typer.Option("--keep-worse", help="Leave the new tables on where the flank became worse; else they go back."),
    ] = False,
    plan: PlanOption = False,
    as_json: JsonOption = False,
) -> None:
    """Measure all errors, propose tables for the tooth; with --apply grind, push, grind again and prove it."""
    if plan and resume:
        raise typer.BadParameter("--plan shows a whole day: leave --resume away", param_hint="--resume")
    if plan:
        show_day_of_closing(site, apply=apply, as_json=as_json)
        return
    from gateway.approve import risking

    with risking(risk):
        close_site_command(site, apply, machine, resume, as_json=as_json, keep_worse=keep_worse)


def close_site_command(
    site: Path,
    apply: bool,
    machine: str,
    resume: str = "",
    *,
    as_json: bool,
    keep_worse: bool = False,
    typed_by_demo: bool = False,
    clock: Clock | None = None,
    wanted: Sequence[str] = (),
) -> None:
    """Close the loop at a site; the demo, which owns its cell, types the machine's name itself."""
    from gateway.config import load_site
    from gateway.workflow.loop.tooth_loop import close_site
    from gateway.workflow.runsite import store_of

    tree, used = load_site(site), clock or LoopClock()
    folder = open_run(store_of(tree, site), resume) if resume else None
    name = tree.site.name if typed_by_demo else machine

    async def main(say: Say) -> Any:
        asked: dict[str, Any] = {"apply": apply, "machine_name": name, "resume": folder, "back": not keep_worse}
        asked |= {"wanted": wanted}
        return await close_site(tree, site, clock=used, say=say, **asked)

    with progress(quiet=as_json, at=(tree, site), own_operator=typed_by_demo) as say:
        outcome = run_to_end(main(say))
    onward = onward_of(outcome, site)
    show_outcome(outcome, as_json=as_json, onward="" if typed_by_demo else onward)
