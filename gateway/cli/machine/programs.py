"""The commands `program` and `self-test`: every NC program as a file to be read, and whether the control takes them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import Clock, LoopClock
from gateway.cli.options import JsonOption, SiteArgument, StoreOption
from gateway.cli.show import echo, show_json, show_table


def add_to(app: typer.Typer) -> None:
    """Give the command line these commands."""
    app.command("program")(program_command)
    app.command("self-test")(self_test_command)


def program_command(
    site: SiteArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the programs.", show_default=False)],
    what: Annotated[str, typer.Option(help="self-test, measure, load, proof, backup, grind, off or all.")] = "all",
    run: Annotated[str, typer.Option(help="Tables to load are this run's proposal.", show_default=False)] = "",
    store: StoreOption = Path("runs"),
    force: Annotated[bool, typer.Option("--force", help="Write over files that are there.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write every program that this site would send, without a control; each is judged by the language's rules."""
    from drivers.errors import ConfigError
    from gateway.config import load_site
    from gateway.workflow.programs import EVERY, kept, programs

    chosen = tuple(one for one in EVERY if what in ("all", one))
    if not chosen:
        raise ConfigError("E-PROGRAM-WHAT", "--what", given=what, known=", ".join((*EVERY, "all")))
    tree = load_site(site)
    written = programs(tree, site, chosen, _proposal(run, store) if run else None)
    kept(written, output, force=force)
    if as_json:
        show_json({"folder": str(output), "programs": [one.name for one in written]})
        return
    show_table("programs", ("what", "file"), [(one.what, one.name) for one in written])
    echo(f"{len(written)} programs in {output}; nothing was sent")


def _proposal(run: str, store: Path) -> Any:
    from gateway.domain.proposals import Proposal
    from gateway.store import Store
    from gateway.workflow import stages

    return Store(store).open(run).get(stages.PROPOSAL, Proposal)


def self_test_command(
    site: SiteArgument,
    axis: Annotated[str, typer.Option("--axis", help="This machine axis only.", show_default=False)] = "",
    as_json: JsonOption = False,
) -> None:
    """Let the control try every word of our programs: you start it, nothing moves, the outcome is kept."""
    from gateway.cli.machine.running import show_outcome

    show_outcome(self_tested(site, axis, quiet=as_json), as_json=as_json)


def self_tested(site: Path, axis: str = "", *, quiet: bool, clock: Clock | None = None) -> Any:
    """Test a site's control, and what came of it; the demo does this first, as anybody must."""
    from gateway.cli.show import progress
    from gateway.cli.stopping import run_to_end
    from gateway.config import load_site
    from gateway.workflow.control.selftesting import self_test_site

    tree, used = load_site(site), clock or LoopClock()
    with progress(quiet=quiet) as say:

        async def main() -> Any:
            return await self_test_site(tree, site, axis=axis, clock=used, say=say)

        return run_to_end(main())
