"""The command `self-test`: the control tries every word of our programs, before any of them matters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import Clock, LoopClock
from gateway.cli.options import JsonOption, SiteArgument


def add_to(app: typer.Typer) -> None:
    """Give the command line this command."""
    app.command("self-test")(self_test_command)


def self_test_command(
    site: SiteArgument,
    axis: Annotated[str, typer.Option("--axis", help="This machine axis only.", show_default=False)] = "",
    as_json: JsonOption = False,
) -> None:
    """Let the control try every word of our programs: you press NC START, nothing moves, the outcome is kept."""
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
