"""The commands `program` and `self-test`: every NC program as a file to be read, and whether the control takes them."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import Clock, LoopClock
from drivers.message import Message
from gateway.cli.onward import step_of
from gateway.cli.options import NEEDS, JsonOption, SiteArgument, StoreOption, open_run
from gateway.cli.show import echo, show_json, show_table


def program_command(
    site: SiteArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the programs.", show_default=False)],
    what: Annotated[
        str,
        typer.Option(
            help="self-test, measure, load, effect (with --run), proof, backup, grind, off or all; dwell for other "
            "capture programs."
        ),
    ] = "all",
    run: Annotated[
        str, typer.Option(help="Load the tables of this run's proposal and prove their effect.", show_default=False)
    ] = "",
    store: StoreOption = Path("runs"),
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    dwell: Annotated[float, typer.Option(min=0.1, max=600, help="Dwell: standstill at each target, s.")] = 6.0,
    settling: Annotated[
        float, typer.Option(min=0, max=600, help="Dwell: settling time of the capture program, s.")
    ] = 2.0,
    calibrator_feed: Annotated[float, typer.Option(min=1, help="Dwell: fastest feed of a rotary calibrator.")] = 720.0,
    number: Annotated[
        int,
        typer.Option(min=1, max=999_999_999, help="Program number to insert: that of a sent program, for comparison."),
    ] = 999_999,
    like: Annotated[
        Path | None,
        typer.Option(
            help="A program as it was sent or carried: its numbers are put in, to compare.", show_default=False
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write every program that this site would send, without a control; each is judged by the language's rules."""
    from drivers import registry
    from drivers.errors import ConfigError
    from drivers.programs import DayNumbers
    from gateway.config import load_site
    from gateway.workflow.programs import (
        DwellOptions,
        describe_dwell,
        dwell_plans,
        numbers_in,
        programs,
        target_lists,
        write_programs,
    )
    from gateway.workflow.run.paper_control import ALL_KINDS, SENT_KINDS, known_control

    chosen = tuple(one for one in ALL_KINDS if what == one or (what == "all" and one in SENT_KINDS))
    if not chosen:
        raise ConfigError("E-PROGRAM-WHAT", "--what", given=what, known=", ".join((*ALL_KINDS, "all")))
    tree, wish = load_site(site), DwellOptions(dwell, settling, calibrator_feed)
    numbers = numbers_in(tree, like) if like is not None else DayNumbers(order=number)
    proposal, tooth = _proposed(run, store) if run else (None, None)
    written = programs(tree, site, chosen, proposal, tooth=tooth, dwell=wish, numbers=numbers)
    lists: dict[str, str] = {}
    told: list[str] = []
    for axis, plan in dwell_plans(tree, wish) if what == "dwell" else ():
        lists |= target_lists(axis, plan)
        told.append(describe_dwell(axis, plan))
    write_programs({one.name: one.program.text for one in written} | lists, output, force=force)
    if as_json:
        show_json({"folder": str(output), "programs": [one.name for one in written], "lists": list(lists)})
        return
    rows = [(one.what, one.name) for one in written] + [("list", name) for name in lists]
    show_table("programs", ("what", "file"), rows)
    for line in told:
        echo(line)
    echo(f"{len(written)} programs in {output}; nothing was sent")
    runs_programs = f"{tree.controller.driver}-paper" in registry.known("paper")
    if what != "dwell" and runs_programs and not known_control(tree, site):
        echo(Message.of("W-PROGRAM-UNKNOWN"))


def _proposed(run: str, store: Path) -> tuple[Any, Any]:
    """A run's proposal, and that for its tooth where there is one."""
    from gateway.domain.proposals import Proposal
    from gateway.store import Store
    from gateway.tooth import ToothProposal
    from gateway.workflow.run import stages

    folder = open_run(Store(store), run, "proposal")
    tooth = folder.get(stages.TOOTH, ToothProposal) if folder.has(stages.TOOTH) else None
    return folder.get(stages.PROPOSAL, Proposal), tooth


def self_test_command(
    site: SiteArgument,
    axis: Annotated[str, typer.Option("--axis", help="This machine axis only.", show_default=False)] = "",
    as_json: JsonOption = False,
) -> None:
    """Let the control try every word of our programs: you start it, nothing moves, the outcome is kept."""
    from gateway.cli.machine.running import show_outcome

    show_outcome(self_tested(site, axis, quiet=as_json), as_json=as_json, onward=_after(site))


def _after(site: Path) -> str:
    """What to type after a self-test: the push that asked for it, where its run is the latest; else a run."""
    from gateway.config import load_site
    from gateway.errors import StoreError
    from gateway.store import LATEST, Needs
    from gateway.workflow.run.folder import store_of

    with contextlib.suppress(StoreError):
        latest = store_of(load_site(site), site).open(LATEST, Needs(*NEEDS["proposal"][:2])).summary()
        if latest.state == "proposed":
            return step_of("proposed", run=latest.path)
    return step_of("outdated", site=site)


def self_tested(
    site: Path, axis: str = "", *, quiet: bool, clock: Clock | None = None, own_operator: bool = False
) -> Any:
    """Test a site's control, and what came of it; the demo does this first, as anybody must."""
    from drivers.offline_exchange import PieceOfWork, exchange_files_for
    from gateway.cli.screen.telling import progress
    from gateway.cli.stopping import run_to_end
    from gateway.config import load_site
    from gateway.workflow.run.self_test import self_test_site

    tree, used = load_site(site), clock or LoopClock()
    with progress(quiet=quiet, at=(tree, site), own_operator=own_operator) as say:

        async def main() -> Any:
            return await self_test_site(tree, site, axis=axis, clock=used, say=say)

        with exchange_files_for(PieceOfWork(f"self-test {axis}", "go-on", ends=True)):
            return run_to_end(main(), at=site)
