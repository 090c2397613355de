"""The command `watch`: result files that appear in a folder go into the site's store by themselves."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.cli.options import SiteArgument
from gateway.cli.screen.telling import progress
from gateway.cli.stopping import run_to_end

POLL_S = 2.0


def watch_command(
    site: SiteArgument,
    folder: Annotated[Path, typer.Option(help="Folder to watch.", show_default=False)],
    settle: Annotated[
        float, typer.Option(min=0.0, help="Seconds without growth after which a file is complete.")
    ] = 5.0,
    once: Annotated[bool, typer.Option("--once", help="Exit when no file is pending.")] = False,
) -> None:
    """Import each new result file of a folder once, until Ctrl-C; the files themselves are left as they are."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.files.importing import watcher_of

    tree = load_site(site)

    async def main(say: Any) -> None:
        clock, stop = LoopClock(), asyncio.Event()
        watcher = watcher_of(tree, site, folder, utc=clock.utc, settle_s=settle, say=say)
        if not once:
            await watcher.watch(clock, stop, POLL_S)
        while once:
            watcher.look(clock.now())
            if not watcher.waiting or clock.now() > 2.0 * settle + POLL_S:
                return
            await clock.sleep(min(max(settle, 0.01), POLL_S))

    with progress(quiet=False, at=(tree, site)) as say:
        run_to_end(main(say))
