"""The clock of a command: the system's at a machine, and the simulated machine's own beside one."""

from __future__ import annotations

import asyncio
import json
import tomllib
from collections.abc import Callable
from pathlib import Path

from drivers.clock import JoinedTimeLoop


def loop_at(site: Path | None) -> Callable[[], asyncio.AbstractEventLoop] | None:
    """What makes the loop for work at a site; None for the system's own, which every real machine gets.

    A site file that says it is simulated, and beside which a running cell keeps a clock, is worked at by that clock:
    no deadline then depends on how fast this computer is.
    """
    address = None if site is None else _address(site)
    if address is None:
        return None

    def joined() -> asyncio.AbstractEventLoop:
        try:
            return JoinedTimeLoop(address, name="trueflank")
        except (OSError, EOFError):  # that cell has ended; whoever opens its devices is told
            return asyncio.new_event_loop()

    return joined


def _address(site: Path) -> str | None:
    try:
        told = tomllib.loads(site.read_text(encoding="utf-8"))
        if told["site"]["simulated"] is not True:
            return None
        return str(json.loads(site.with_suffix(".cell.json").read_text(encoding="utf-8"))["clock"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
