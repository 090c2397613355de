"""Asks a cell's control the written questions, in one process and virtual time, through the calls the command makes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual
from drivers.probes import Level, ProbedSession
from gateway.acceptance.comparison import recorded, replayed
from gateway.config import load_site
from gateway.say import silence
from simulators.cell import cell_running


def of_control(folder: Path, cell: Any = "demo", allow: Level = "write") -> ProbedSession:
    """A session recorded at a cell that poses as a control."""

    async def main() -> ProbedSession:
        async with cell_running(cell, folder, LoopClock(), wires="memory") as running:
            return await recorded(load_site(running.site_path), allow, LoopClock(), silence)

    return run_virtual(main)


def of_double(folder: Path, session: ProbedSession, cell: Any = "demo") -> ProbedSession:
    """The double's answers to a recorded session, its key switch where the control had it."""

    async def main() -> ProbedSession:
        async with cell_running(cell, folder, LoopClock(), wires="memory") as running:
            running.nck.set_access_level(int(session.about["access_level"]))
            return await replayed(load_site(running.site_path), session, LoopClock(), silence)

    return run_virtual(main)
