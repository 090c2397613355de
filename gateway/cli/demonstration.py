"""Starts a simulated cell as a child process and, for the demo, runs the main job against it."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from drivers.clock import LoopClock
from drivers.errors import ConfigError, words
from drivers.local.extras import need
from gateway.cli.machine.programs import self_tested
from gateway.cli.machine.running import run_site_command
from gateway.cli.machine.whole_loop import close_site_command
from gateway.cli.onward import next_step
from gateway.cli.show import echo

GRACE_S = 10.0
STARTER = (sys.executable, "-m", "simulators.cell")


@dataclass(frozen=True, slots=True)
class CellAsked:
    """A simulated cell as it was asked for: a shipped name or a file, its speed, and what its site file says."""

    cell: str
    site: Path
    speed: float
    seed: int | None = None
    plan: bool = False
    filed: bool = False
    road: str = ""
    name: str = ""
    panel: bool = False

    def command(self) -> list[str]:
        """What starts it."""
        given = ["--site", str(self.site), "--speed", str(self.speed)]
        given += ["--plan"] if self.plan else []
        given += ["--filed"] if self.filed else []
        given += ["--panel"] if self.panel else []
        for option in ("seed", "road", "name"):
            value = getattr(self, option)
            given += [f"--{option}", str(value)] if value not in ("", None) else []
        return [*STARTER, self.cell, *given]


@contextmanager
def cell_process(
    asked: CellAsked, heard: Callable[[dict[str, object]], None] = lambda _told: None
) -> Iterator[subprocess.Popen[str]]:
    """A cell in a process of its own, ready and with its site file written; ended when the block ends.

    ``heard`` gets what it says of itself when it is ready.
    """
    need("sim", asked.cell)
    asked.site.parent.mkdir(parents=True, exist_ok=True)
    cell, command = asked.cell, asked.command()
    # The cell ends by itself when its standard input closes, so no orphan outlives us on any system.
    # Ctrl-C in the terminal is ours: the machine must still be there while a run leaves it in order.
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, **_apart()) as child:  # noqa: S603
        try:
            if child.stdout is None or child.stdin is None:
                raise ConfigError("E-CLI-CELL", cell, why="it has no pipes")
            heard(_ready(child, cell))
            yield child
        finally:
            if child.stdin is not None:
                child.stdin.close()
            try:
                child.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                child.kill()


def _apart() -> dict[str, Any]:
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"process_group": 0}


def _ready(child: subprocess.Popen[str], cell: str) -> dict[str, object]:
    line = child.stdout.readline() if child.stdout is not None else ""
    try:
        answer = json.loads(line)
    except ValueError as error:
        why = f"it said {line!r} and ended with code {child.poll()}"
        if not line:
            why = f"it ended with code {child.poll()}, for what it says above"
        raise ConfigError("E-CLI-CELL", cell, why=why) from error
    return dict(answer)


def run_demo(
    folder: Path, cell: str, speed: float, seed: int | None, *, axes: bool, everything: bool, as_json: bool
) -> None:
    """The loop on a simulated machine with the set-ups that pay, or all with ``everything``; prints figures and paths.

    With ``axes`` it is the loop of the axes alone.
    """
    site = folder / "site.toml"
    clock = LoopClock()
    with cell_process(CellAsked(cell, site, speed, seed, plan=not axes)):
        wanted = () if axes or everything else _that_pay(site, quiet=as_json)
        started = clock.utc()
        self_tested(site, quiet=as_json, clock=clock, own_operator=True)
        if axes:
            run_site_command(site, True, "", as_json=as_json, typed_by_demo=True, clock=clock)
        else:
            close_site_command(site, True, "", as_json=as_json, typed_by_demo=True, clock=clock, wanted=wanted)
        seconds = (clock.utc() - started).total_seconds()
    if not as_json:
        echo(f"(all of it took {seconds:.0f} s)")
        next_step(f"report latest --store {folder / 'runs'}")


def _that_pay(site: Path, *, quiet: bool) -> tuple[str, ...]:
    """The set-ups that pay by the ranking of the site as it is, and what the rest is worth, said. Raises ConfigError."""
    from gateway.config import load_site
    from gateway.workflow.errors21.paying import setups_that_pay
    from gateway.workflow.tooth.proposal import work_of

    tree = load_site(site)
    found = setups_that_pay(tree, work_of(tree, site).tooth)
    if not quiet:
        echo(words("P-DEMO-SETUPS", **found.told))
    return found.keys


def list_cells() -> None:
    """The cells that come with trueflank, as their files describe them."""
    need("sim", "--list")
    done = subprocess.run([*STARTER, "--list", "-"], capture_output=True, text=True, check=False)  # noqa: S603
    try:
        cells = dict(json.loads(done.stdout))
    except ValueError as error:
        raise ConfigError("E-CLI-CELL", "--list", why=done.stderr.strip()) from error
    for name, words_of_it in cells.items():
        echo(f"{name:<8} {words_of_it}")


def run_cell(asked: CellAsked) -> None:
    """Run a cell until Ctrl-C."""
    with cell_process(asked) as child:
        echo(f"cell {asked.cell} runs at {asked.speed:g} x wall time; site file: {asked.site}")
        echo(f"try: trueflank check {asked.site} --connect   or   trueflank run {asked.site}")
        echo(f"a simulated operator works at it; do so yourself: trueflank cell {asked.site}, or type here (help)")
        converse(child)
        try:
            child.wait()
        except KeyboardInterrupt:
            echo("ending the cell")


def converse(child: subprocess.Popen[str]) -> None:
    """What is typed goes to the cell from now on, and what it answers is shown."""
    threading.Thread(target=_hand_on, args=(child.stdin,), daemon=True, name="keys").start()
    threading.Thread(target=_show, args=(child.stdout,), daemon=True, name="answers").start()


def _hand_on(keys: TextIO | None) -> None:
    """What is typed here goes to the cell's panel; the end of our input is not that of the cell.

    Read below Python's buffer, whose lock this thread would still hold when the program ends.
    """
    with contextlib.suppress(OSError, ValueError):
        while keys is not None and (typed := os.read(sys.stdin.fileno(), 4096)):
            keys.write(typed.decode("utf-8", "replace"))
            keys.flush()


def _show(answers: TextIO | None) -> None:
    with contextlib.suppress(OSError, ValueError):
        for line in answers or ():
            echo(line.rstrip())
