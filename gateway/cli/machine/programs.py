"""The command `program`: every NC program that a site would send, as files to be read before the first day."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.cli.options import JsonOption, SiteArgument, StoreOption
from gateway.cli.show import echo, show_json, show_table


def add_to(app: typer.Typer) -> None:
    """Give the command line this command."""
    app.command("program")(program_command)


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
    from gateway.domain import Proposal
    from gateway.store import Store
    from gateway.workflow import stages

    return Store(store).open(run).get(stages.PROPOSAL, Proposal)
