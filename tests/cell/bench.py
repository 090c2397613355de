"""Runs the main job on a cell in one process and virtual time, and lets the cell's truth judge it."""

from __future__ import annotations

import tomllib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import LoopClock, run_virtual
from gateway.approve import UNPROTECTED, take_risk
from gateway.config import load_site
from gateway.workflow.complete_run import run_site
from gateway.workflow.run.outcome import Outcome
from simulators.cell import Cell
from simulators.cell.site import section
from tests.selftested import cell_running

During = Callable[[Cell], Awaitable[None]]
Hook = Callable[[Cell, str, dict[str, object]], None]


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
    heard: Hook | None = None,
    **options: Any,
) -> Judged:
    """One whole run; `edit` may change the site file's text, `during` is awaited once the cell stands.

    `heard` (cell, code, fields) sees every progress code as it is said.
    """

    options.setdefault("block_s", 1.0)  # a quarter of the stream's blocks, and less real time

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
                if heard is not None:
                    heard(running, code, fields)

            name = site.site.name if apply else ""
            with take_risk(UNPROTECTED):
                outcome = await run_site(site, path, apply=apply, machine_name=name, clock=clock, say=say)
            return Judged(outcome, before, {name: running.figures(name) for name in names}, said)

    return run_virtual(job)


def short(
    axes: tuple[str, ...] = ("C1",), count: int = 9, repetitions: int = 2, **measure: Any
) -> Callable[[str], str]:
    """An edit of a site file: only these axes, fewer targets and repetitions, other keys of `measure`."""

    def edit(text: str) -> str:
        site = tomllib.loads(text)
        kept = [axis for axis in site["axes"] if axis["name"] in axes]
        for axis in kept:
            axis["measure"]["targets"] = {**axis["measure"]["targets"], "count": count}
            axis["measure"] |= {"repetitions": repetitions, **measure}
        parts = [section(name, site[name]) for name in ("site", "controller", "operator", "moves") if name in site]
        parts += [section("[instruments]", item) for item in site["instruments"]]
        for axis in kept:
            below = [section(f"axes.{name}", axis.pop(name)) for name in ("measure", "table")]
            parts += [section("[axes]", axis), *below]
        return "\n".join(parts)

    return edit
