"""Commands that meet devices or stored runs: run, push, recover, report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from drivers.clock import Clock, LoopClock
from drivers.errors import DeviceError
from drivers.message import Message
from gateway.cli import voice
from gateway.cli.onward import after_look, after_recovery, after_run, consent, next_step
from gateway.cli.options import load_site, open_run, with_control
from gateway.cli.screen.telling import progress
from gateway.cli.show import echo, rendered, show_json, show_table
from gateway.cli.stopping import run_to_end
from gateway.errors import StillOn
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
    with_control(tree)
    name = tree.site.name if typed_by_demo else machine
    used = clock or LoopClock()

    async def main(say: Say) -> Any:
        return await run_site(tree, site, apply=apply, machine_name=name, clock=used, say=say, axes=axes)

    known = remaining_of(lambda: day_of_run(tree, apply=apply, axes=axes))
    with progress(quiet=as_json, at=(tree, site), own_operator=typed_by_demo, stages=known) as say:
        outcome = run_to_end(main(say), at=site)
    onward = onward_of(outcome, site)
    show_outcome(outcome, as_json=as_json, onward="" if typed_by_demo else onward)


def onward_of(outcome: Any, site: Path) -> str:
    """The command to go on with after a run at this site."""
    return after_run(outcome.state, outcome.run_folder, str(site), worse=outcome.data.get("worse", ()))


@dataclass(frozen=True, slots=True)
class PushAsked:
    """What `push` was asked for: only these tables, with consent or to look, every point."""

    tables: tuple[str, ...] = ()
    apply: bool = False
    machine: str = ""
    points: bool = False


def push_run_command(run_folder: str, store: Path, asked: PushAsked, *, as_json: bool) -> None:
    """Show a stored proposal against the live machine, or apply it."""
    from gateway.store import Store
    from gateway.workflow.control.push import push_run
    from gateway.workflow.run.folder import site_of

    folder = open_run(Store(store), run_folder, "proposal")

    async def main(say: Say) -> Any:
        wanted: dict[str, Any] = {"apply": asked.apply, "machine_name": asked.machine, "tables": asked.tables}
        return await push_run(folder, clock=LoopClock(), say=say, **wanted)

    with progress(quiet=as_json, folder=folder) as say:
        outcome = run_to_end(main(say))
    tree, site = site_of(folder)
    options = consent(tree.controller.driver, tree.site.name)
    looked = after_look(outcome.data.get("refused_by", ()), outcome.run_folder, str(site), options)
    onward = onward_of(outcome, site) if asked.apply else looked
    show_outcome(outcome, as_json=as_json, points=asked.points, onward=onward)


def recover_command(
    site: Path, apply: bool, machine: str, choice: Any = "offered", *, take: str = "", as_json: bool
) -> None:
    """Say what an interrupted push or rollback left; with apply put it right."""
    from drivers.offline_exchange import PieceOfWork, exchange_files_for
    from gateway.broker import take_from_hung_gateway
    from gateway.workflow.control.rollback import recover_site

    tree = load_site(site)

    async def main(say: Say) -> Any:
        with take_from_hung_gateway(take), exchange_files_for(PieceOfWork("recover", "instead")):
            asked: dict[str, Any] = {"apply": apply, "machine_name": machine, "choice": choice}
            return await recover_site(tree, site, clock=LoopClock(), say=say, **asked)

    with progress(quiet=as_json, at=(tree, site)) as say:
        findings = run_to_end(main(say), at=site)
    if as_json:
        show_json([finding.as_data() for finding in findings])
    for finding in findings if apply and not as_json else ():  # what was found was said before it was carried out
        echo(_sentences(finding.said_at_last))
    for finding in () if as_json or apply else findings:
        echo(_sentences(finding.said), colour="red" if finding.still_on else None, bold=finding.still_on)
    if not apply and any(finding.still_on for finding in findings):
        raise typer.Exit(StillOn.exit_code)
    if not findings and not as_json:
        echo(f"{tree.site.name}: no push was left unfinished, and nothing of ours is left in the control")
    stands = any(finding.stands for finding in findings)
    if not as_json:
        next_step(after_recovery(findings, str(site), tree.site.name, apply=apply))
    if stands:
        raise typer.Exit(DeviceError.exit_code)


def _sentences(said: tuple[Message, ...]) -> str:
    """What was found, in the reader's language, each thought as a sentence."""
    return ". ".join(map(rendered, said))


def _counted(details: tuple[Message, ...]) -> tuple[Message, ...]:
    """How many lines more there are: the report has them all."""
    return (Message.of("S-RUN-DETAILS", count=len(details)),) if details else ()


def show_outcome(outcome: Any, *, as_json: bool, points: bool = False, onward: str = "") -> None:
    """Print what a workflow handed back, and the command to go on with; end with its exit code."""
    if as_json:
        show_json(outcome.as_data())
    else:
        if outcome.rows:
            show_table(outcome.title, outcome.headings, outcome.rows)
        for point in outcome.points if points else ():
            echo(point)
        told = outcome.details if voice.now() is voice.Voice.VERBOSE else _counted(outcome.details)
        for line in (*told, *outcome.lines[:-1], *outcome.places, *outcome.lines[-1:]):
            echo(line)
        if outcome.points and not points:
            echo(Message.of("S-RUN-POINTS"))
        if onward:
            next_step(onward)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)
