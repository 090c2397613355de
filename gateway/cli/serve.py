"""The commands `serve` and `simulate teach`: sites served until they are stopped, and a service on a simulated cell."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import LoopClock
from drivers.errors import words
from drivers.message import Message
from gateway.cli.cell import CellRequest, cell_process, relay_console
from gateway.cli.options import SpeedOption, load_site
from gateway.cli.output import echo, text_of
from gateway.cli.signals import run_to_end
from gateway.say import Say

SITE_FILE = "site.toml"
"""The site file of a folder."""


def serve_command(
    sites: Annotated[
        list[Path] | None,
        typer.Argument(metavar="SITE...", help="Site files (TOML), or a folder: its site.toml.", show_default=False),
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen on; beyond this computer only with TLS.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 selects a free one.")] = 8617,
) -> None:
    """Open and watch the devices of these sites, serve their pages, and lend the devices to commands.

    Without a site file in the folder the page asks what a site file needs, writes it and goes on.
    """
    from gateway.daemon import JournalForm
    from gateway.stopping import StopAsked

    journal = logging.StreamHandler()
    journal.setFormatter(JournalForm())
    logging.basicConfig(level=logging.WARNING, handlers=[journal])
    files, stopped = [one / SITE_FILE if one.is_dir() else one for one in sites or [Path()]], StopAsked()
    run_to_end(_serve_files(files, host, port, LoopClock(), stopped.asked), stop=stopped, ends_itself=True)
    if stopped.told:
        raise stopped.error()


async def _serve_files(files: list[Path], host: str, port: int, clock: LoopClock, stop: asyncio.Event) -> None:
    """The page that asks for a site file where there is none, then the sites."""
    from gateway.daemon import serve

    sessions = None
    if len(files) == 1 and files[0].name == SITE_FILE and files[0].parent.is_dir() and not files[0].exists():
        sessions, port = await _make_site_file(files[0], host, port, clock, stop)
        if stop.is_set():
            return
    serving = [_site_service(load_site(path), path, clock) for path in files]
    first, names = serving[0].store.root, ", ".join(one.site.site.name for one in serving)
    await serve(serving, clock=clock, stop=stop, host=host, port=port, ready=_show_url(names, first), sessions=sessions)


async def _make_site_file(file: Path, host: str, port: int, clock: LoopClock, stop: asyncio.Event) -> Any:
    from gateway.cli.setup.init import SiteMaker
    from gateway.daemon import serve_setup

    maker = SiteMaker(file)
    name = words("P-SERVE-NO-SITE", file=file)
    return await serve_setup(
        maker, maker.root, clock=clock, stop=stop, host=host, port=port, ready=_show_url(name, maker.root)
    )


def _show_url(names: str, root: Path) -> Callable[[str], None]:
    """Says where the page is, once it answers."""
    from gateway.users import first_token_path

    def ready(url: str) -> None:
        first = first_token_path(root)
        more = text_of("S-SERVE-FIRST", first=first) + " " if first.exists() else ""
        echo(f"{names}: {url}   ({more}Ctrl-C ends)")

    return ready


def _site_service(tree: Any, path: Path, clock: LoopClock) -> Any:
    """A site with everything that the daemon does for it."""
    from gateway.daemon import LazyDevices, ServiceParts
    from gateway.push import JOURNALS, SentProgramBook
    from gateway.supervisor import Supervisor, unopened_devices
    from gateway.workflow.files.importing import watcher_of
    from gateway.workflow.run.folder import store_of
    from gateway.workflow.run.identity import IdentityCheck
    from gateway.workflow.run.live_tables import StandingAlarms

    store, serial, folder = store_of(tree, path), tree.controller.serial, tree.service.watch

    def made() -> Supervisor:
        book, known = SentProgramBook(store.root / JOURNALS, serial), IdentityCheck(tree, path, store.root, clock)
        return Supervisor(tree, clock, book=book, recognise=known)

    devices = LazyDevices(made, unopened_devices(tree, clock))

    async def doctor(say: Say) -> object:
        return await _doctor_outcome(tree, path, clock, say)

    def watcher(say: Say) -> Any:
        return watcher_of(tree, path, path.parent / str(folder), utc=clock.utc, say=say)

    return ServiceParts(
        site=tree,
        path=path,
        store=store,
        devices=lambda: devices,
        doctor=doctor,
        daily=_daily_comparison(tree, path, store, devices, clock),
        alarms=StandingAlarms(store, serial),
        watcher=None if folder is None else watcher,
    )


def _daily_comparison(tree: Any, path: Path, store: Any, devices: Any, clock: LoopClock) -> Any:
    """What is compared each day; None where the site does not want it."""
    from gateway.daemon import DailyComparison
    from gateway.workflow.control.verify import verify_table
    from gateway.workflow.run.live_tables import overdue_tables

    serial, hour = tree.controller.serial, tree.site.verify_hour
    if not tree.site.verify_each_day:
        return None

    def alone() -> bool | None:
        # With programs every reading is a start by the operator: it is told as due, and nothing starts by itself.
        return None if devices.made is None else not devices.made.controller.capabilities.stops

    async def compare(say: Say) -> object:
        return await verify_table(tree, path, table="", run=None, clock=clock, say=say)

    return DailyComparison(hour, lambda: overdue_tables(store, serial, clock.utc(), hour), compare, alone)


async def _doctor_outcome(tree: Any, path: Path, clock: LoopClock, _say: Say) -> object:
    """The doctor's lines as an outcome."""
    from gateway.acceptance.control import examine_control
    from gateway.workflow.run.outcome import Outcome

    lines = await examine_control(tree, path, clock)
    told = tuple(one.message for one in lines)
    well = all(line.outcome == "ok" for line in lines)
    data = {"ok": well, "lines": [line.as_record() for line in lines]}
    return Outcome("examined", "", rows=(), lines=told, data=data, exit_code=0 if well else 5)


# ---- teach: the service on a simulated cell, and the machine's panel as a page


def teach_command(
    cell: Annotated[str, typer.Argument(help="Cell file, or the name of a shipped cell.", show_default=True)] = "demo",
    folder: Annotated[Path, typer.Option(help="Folder for the site file and the runs.")] = Path("teach"),
    speed: SpeedOption = 20.0,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the operator's page; 0 selects a free one.")
    ] = 8617,
    alone: Annotated[
        bool, typer.Option("--alone", help="You are the operator: no simulated person presses keys or mounts optics.")
    ] = False,
) -> None:
    """Train a calibration day: the service on a simulated cell, and the machine's panel as a page; Ctrl-C ends both."""
    site = folder / SITE_FILE
    told: dict[str, object] = {}
    with cell_process(CellRequest(cell, site, speed, plan=True, panel=True), told.update) as child:
        if alone and child.stdin is not None and child.stdout is not None:
            child.stdin.write("auto off\n")
            child.stdin.flush()
            child.stdout.readline()
        echo(Message.of("S-SERVE-PANEL", panel=told.get("panel", "")))
        echo(Message.of("S-SERVE-YOU") if alone else Message.of("S-SERVE-ALONE"))
        echo(Message.of("S-SERVE-PAGE"))
        relay_console(child)
        serve_command([site], port=port)
