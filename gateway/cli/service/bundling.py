"""The command `support-bundle`: one zip for who helps from afar."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError
from gateway.cli.options import SiteArgument, load_site
from gateway.cli.show import echo
from gateway.cli.stopping import run_to_end

DOCTOR_S = 60.0


def support_bundle_command(
    site: SiteArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="The zip to write.")] = Path("trueflank-support.zip"),
    runs: Annotated[int, typer.Option(min=0, max=100, help="How many of the newest runs.")] = 3,
    doctor: Annotated[bool, typer.Option(help="Also check the connection to the control.")] = True,
) -> None:
    """Write site file, versions, logs, newest runs, wire traces and doctor into one zip, without secrets."""
    from drivers.local.ownfiles import open_own
    from gateway.cli.service.bundle import bundle
    from gateway.workflow.run.folder import store_of

    tree = load_site(site)
    store = store_of(tree, site)
    told = run_to_end(_doctor(tree, site), at=site) if doctor else {"left out": "--no-doctor"}
    data = bundle(tree, site, store, runs=runs, doctor=told)
    try:
        with open_own(output, "xb", secret=True) as file:
            file.write(data)
    except OSError as error:
        raise ConfigError("E-BUNDLE-WRITE", str(output), why=error.strerror or str(error)) from error
    size = f"{len(data) / 1e6:.1f} MB" if len(data) >= 1e6 else f"{-(-len(data) // 1000)} kB"
    echo(f"{output}: {size}; look through it before you send it")


async def _doctor(tree: Any, site: Path) -> dict[str, Any]:
    """The doctor's lines; why there are none where the control does not answer or somebody else is at work."""
    from gateway.broker import borrow_devices
    from gateway.cli.control.connecting import examined
    from gateway.workflow.run.folder import store_of

    clock = LoopClock()
    try:
        async with clock.deadline(DOCTOR_S, "doctor"), borrow_devices(store_of(tree, site).root, "doctor", clock):
            lines = await examined(tree, site, clock)
    except TrueflankError as error:
        return {"error": error.as_record()}
    return {"lines": [line.as_record() for line in lines]}
