"""Runs the main job on a cell in one process and virtual time, and lets the cell's truth judge it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual
from gateway.config import load_site
from gateway.workflow.outcome import Outcome
from gateway.workflow.run import run_site
from simulators.cell import Cell, cell_running

During = Callable[[Cell], Awaitable[None]]


@dataclass(frozen=True)
class Judged:
    """A finished run: what it says and what the truth says, per axis {"M", "B", "E"}, in um or arcsec."""

    outcome: Outcome
    before: dict[str, dict[str, float]]
    after: dict[str, dict[str, float]]
    said: list[tuple[str, dict[str, object]]]


def main_job(
    folder: Path,
    cell: str | Path = "demo",
    *,
    apply: bool = True,
    during: During | None = None,
    edit: Callable[[str], str] | None = None,
    **options: Any,
) -> Judged:
    """One whole run; `edit` may change the site file's text, `during` is awaited once the cell stands."""

    async def job() -> Judged:
        clock = LoopClock()
        async with cell_running(cell, folder / "cell", clock, wires="memory", **options) as running:
            path = running.site_path
            if edit is not None:
                path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
            if during is not None:
                await during(running)
            site = load_site(path)
            names = [axis.name for axis in site.axes]
            before = {name: running.figures(name) for name in names}
            said: list[tuple[str, dict[str, object]]] = []

            def say(code: str, /, **fields: object) -> None:
                said.append((code, fields))

            name = site.site.name if apply else ""
            outcome = await run_site(site, path, apply=apply, machine_name=name, clock=clock, say=say)
            return Judged(outcome, before, {name: running.figures(name) for name in names}, said)

    return run_virtual(job)
