"""Commands that meet devices or stored runs: run, push, recover, serve, report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from drivers.clock import Clock, LoopClock
from gateway.cli.options import load_site
from gateway.cli.show import echo, progress, show_json, show_table
from gateway.cli.stopping import run_to_end
from gateway.errors import StillOn
from gateway.say import Say


def run_site_command(
    site: Path,
    apply: bool,
    machine: str,
    *,
    as_json: bool,
    typed_by_demo: bool = False,
    clock: Clock | None = None,
) -> None:
    """Run a site; the demo, which owns its cell, types the machine's name itself."""
    from gateway.workflow.loop.run import run_site

    tree = load_site(site)
    name = tree.site.name if typed_by_demo else machine
    used = clock or LoopClock()

    async def main(say: Say) -> Any:
        return await run_site(tree, site, apply=apply, machine_name=name, clock=used, say=say)

    with progress(quiet=as_json) as say:
        outcome = run_to_end(main(say))
    show_outcome(outcome, as_json=as_json)


def push_run_command(run_folder: str, store: Path, apply: bool, machine: str, *, as_json: bool) -> None:
    """Show a stored proposal against the live machine, or apply it."""
    from gateway.store import Store
    from gateway.workflow.control.pushing import push_run

    folder = Store(store).open(run_folder)

    async def main(say: Say) -> Any:
        return await push_run(folder, apply=apply, machine_name=machine, clock=LoopClock(), say=say)

    with progress(quiet=as_json) as say:
        outcome = run_to_end(main(say))
    show_outcome(outcome, as_json=as_json)


def recover_command(site: Path, apply: bool, machine: str, *, as_json: bool) -> None:
    """Say what an interrupted push left; with apply put the old table back."""
    from gateway.workflow.control.recovering import recover_site

    tree = load_site(site)

    async def main(say: Say) -> Any:
        return await recover_site(tree, site, apply=apply, machine_name=machine, clock=LoopClock(), say=say)

    with progress(quiet=as_json) as say:
        findings = run_to_end(main(say))
    if as_json:
        show_json([finding.as_data() for finding in findings])
    for finding in () if as_json else findings:
        echo(finding.words, colour="red" if finding.still_on else None, bold=finding.still_on)
    if not apply and any(finding.still_on for finding in findings):
        raise typer.Exit(StillOn.exit_code)
    if not findings and not as_json:
        echo(f"{tree.site.name}: no push was left unfinished, and nothing of ours is left in the control")


def serve_command(site: Path, host: str, port: int) -> None:
    """Serve a site until it is stopped; raises Stopped when that cut a run short."""
    from gateway.daemon import Daily, serve, token_path
    from gateway.push.records.journal import JOURNALS
    from gateway.push.records.sent import SentBook
    from gateway.stopping import StopAsked
    from gateway.supervisor import Supervisor
    from gateway.workflow.aftercare import StandingAlarms, due
    from gateway.workflow.bench import store_of
    from gateway.workflow.control.verifying import verify_table
    from gateway.workflow.loop.run import run_site

    tree, clock = load_site(site), LoopClock()
    store, serial, hour = store_of(tree, site), tree.controller.serial, tree.site.verify_hour

    async def compare(say: Say) -> object:
        return await verify_table(tree, site, table="", run=None, clock=clock, say=say)

    def daily(devices: Supervisor) -> Daily | None:
        if not tree.site.verify_each_day:
            return None
        # With programs every reading is a start by the operator: it is told as due, and nothing starts by itself.
        job = None if devices.controller.capabilities.stops else compare
        return Daily(hour, lambda: due(store, serial, clock.utc(), hour), job)

    async def starter(say: Say) -> object:
        # Nobody at a desk can consent to a write: a run from the page only proposes.
        return await run_site(tree, site, apply=False, machine_name="", clock=clock, say=say)

    stopped = StopAsked()

    def ready(url: str) -> None:
        echo(f"{tree.site.name}: {url}   (token for starting runs: {token_path(store.root)}; Ctrl-C ends)")

    async def main() -> None:
        devices = Supervisor(tree, clock, book=SentBook(store.root / JOURNALS, tree.controller.serial))
        stop = stopped.asked
        await serve(
            tree,
            lambda: devices,
            starter,
            store=store,
            clock=clock,
            stop=stop,
            host=host,
            port=port,
            ready=ready,
            daily=daily(devices),
            alarms=StandingAlarms(store, serial),
        )

    run_to_end(main(), stop=stopped, ends_itself=True)
    if stopped.told:
        raise stopped.error()


def report_command(run_folder: str, store: Path, *, as_json: bool) -> None:
    """Render a stored run again."""
    from gateway.store import Store
    from gateway.workflow.results.ending import closing_lines
    from gateway.workflow.results.reporting import summary_of, write_report

    folder = Store(store).open(run_folder)
    paths = write_report(folder)
    if as_json:
        show_json({**paths.as_data(), "summary": summary_of(paths)})
        return
    for line in closing_lines(folder):
        echo(line)
    echo(f"report: {paths.html}")


def show_outcome(outcome: Any, *, as_json: bool) -> None:
    """Print what a workflow handed back, and end with its exit code."""
    if as_json:
        show_json(outcome.as_data())
    else:
        if outcome.rows:
            headings = ("axis", "parameter", "before", "after", "unit", "change")
            show_table("before and after (ISO 230-2:2014)", headings, outcome.rows)
        for line in outcome.lines:
            echo(line)
    if outcome.exit_code:
        raise typer.Exit(outcome.exit_code)
