"""The command `disable`: one table off, wherever its axis stands."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from drivers.terms import spoken
from gateway.cli.onward import after_dry, step_of
from gateway.cli.options import ApplyOption, JsonOption, MachineOption, SiteArgument, TakeOption


def disable(
    site: SiteArgument,
    axis: Annotated[str, typer.Option("--axis", help="Machine axis that the table compensates.")],
    table: Annotated[
        str, typer.Option("--table", help=f"A cross table, {spoken().cross_key}3; else the axis' {spoken().own}.")
    ] = "",
    apply: ApplyOption = False,
    machine: MachineOption = "",
    take: TakeOption = "",
    as_json: JsonOption = False,
) -> None:
    """Say what a table does to its axis now; with --apply switch it off and read that back. Writes no value."""
    from drivers.clock import LoopClock
    from drivers.offline_exchange import PieceOfWork, exchange_files_for
    from gateway.broker import take_from_hung_gateway
    from gateway.cli.machine.running import show_outcome
    from gateway.cli.screen.telling import progress
    from gateway.cli.stopping import run_to_end
    from gateway.config import load_site
    from gateway.workflow.control.disable import disable_site

    tree = load_site(site)
    asked: dict[str, Any] = {"axis": axis, "table": table, "apply": apply, "machine_name": machine}
    with progress(quiet=as_json, at=(tree, site)) as say:

        async def main() -> Any:
            with take_from_hung_gateway(take), exchange_files_for(PieceOfWork("disable", "instead")):
                return await disable_site(tree, site, clock=LoopClock(), say=say, **asked)

        outcome = run_to_end(main(), at=site)
    off = outcome.data["off"] if not apply else True
    dry = step_of("pushed", site=site)
    if not off:
        against = outcome.data["refused_by"]
        dry = after_dry("disable", str(site), axis, tree.site.name, table=table, refused_by=against)
    show_outcome(outcome, as_json=as_json, onward=f"recover {site}" if apply else dry)
