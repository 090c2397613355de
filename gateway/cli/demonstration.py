"""Starts a simulated cell as a child process and, for the demo, runs the main job against it."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError, words
from drivers.local.extras import need
from drivers.message import Message
from gateway.cli.demoending import Took, say_if_busy, say_stopped, show_ending
from gateway.cli.machine.programs import self_tested
from gateway.cli.machine.running import run_site_command, show_outcome
from gateway.cli.machine.whole_loop import Closing
from gateway.cli.show import echo

GRACE_S = 10.0
SHIPPED = "demo"
STARTER = (sys.executable, "-m", "simulators.cell")


@dataclass(frozen=True, slots=True)
class CellAsked:
    """A simulated cell as it was asked for: a shipped name or a file, its speed, and what its site file says.

    ``speed`` is how many seconds of it pass in one of ours; where it is ``shared`` with commands, at most, 0: no limit.
    """

    cell: str
    site: Path
    speed: float
    seed: int | None = None
    plan: bool = False
    filed: bool = False
    road: str = ""
    name: str = ""
    panel: bool = False
    shared: bool = False

    def command(self) -> list[str]:
        """What starts it."""
        given = ["--site", str(self.site), "--speed", str(self.speed)]
        given += ["--shared"] if self.shared else []
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


@dataclass(frozen=True, slots=True)
class Demo:
    """A demo as it was asked for: where it keeps its things, its cell, and what of the loop; ``run`` to go on with."""

    folder: Path
    cell: str
    speed: float
    seed: int | None = None
    axes: bool = False
    everything: bool = False
    run: str = ""

    @property
    def command(self) -> str:
        """The command line that asks for the same, but for the run."""
        words_of_it = ["trueflank demo", "--folder", shlex.quote(str(self.folder))]
        words_of_it += ["--cell", shlex.quote(self.cell)] if self.cell != SHIPPED else []
        words_of_it += ["--seed", str(self.seed)] if self.seed is not None else []
        words_of_it += ["--all"] if self.everything else []
        return " ".join(words_of_it + (["--axes"] if self.axes else []))

    @property
    def site(self) -> Path:
        """The site file that the cell writes."""
        return self.folder / "site.toml"

    @property
    def asked(self) -> CellAsked:
        """Its cell."""
        return CellAsked(self.cell, self.site, self.speed, self.seed, plan=not self.axes, shared=True)


def run_demo(demo: Demo, *, as_json: bool) -> None:
    """The loop on a simulated machine with the set-ups that pay, or all of them, or of the axes alone.

    Prints figures and paths. Where it stops it says in which stage, where its folder is, and how to go on. Raises
    ConfigError (E-DEMO-RESUME), and what the loop raises.
    """
    clock, began, worked = LoopClock(), time.perf_counter(), os.times()
    if not as_json:
        say_if_busy()
    if demo.axes:
        with cell_process(demo.asked):
            self_tested(demo.site, quiet=as_json, clock=clock, own_operator=True)
            run_site_command(demo.site, True, "", as_json=as_json, typed_by_demo=True, clock=clock)
        return
    _demand_resumable(demo)
    with cell_process(demo.asked):
        chosen = None if demo.everything else _that_pay(demo.site)
        if chosen is not None and not as_json:
            echo(Message.of("P-DEMO-SETUPS", **chosen.told))
        closing = Closing(
            demo.site,
            apply=True,
            resume=demo.run,
            own_operator=True,
            wanted=chosen.keys if chosen is not None else (),
            clock=clock,
        )
        stages = closing.stages()
        try:
            self_tested(demo.site, quiet=as_json, clock=clock, own_operator=True)
            outcome = closing.run(quiet=as_json, stages=stages)
        except TrueflankError:
            if not as_json:
                say_stopped(stages, demo.folder, demo.command)
            raise
    if as_json or outcome.exit_code:
        show_outcome(outcome, as_json=as_json)
        return
    ended = os.times()  # the cell has ended too, so its work is counted
    took = Took(time.perf_counter() - began, sum(ended[:4]) - sum(worked[:4]))
    show_ending(outcome, words("S-DEMO-PARTLY", **chosen.told) if chosen is not None else "", took, clock)


def _demand_resumable(demo: Demo) -> None:
    """Refuse to go on where the tables that a run had loaded ended with its simulated control. Raises ConfigError."""
    if not demo.run:
        return
    from gateway.cli.options import open_run
    from gateway.store import Store
    from gateway.workflow.run import stages

    folder = open_run(Store(demo.folder / "runs"), demo.run)
    if folder.has(stages.PROPOSAL):
        raise ConfigError("E-DEMO-RESUME", folder.run_id, command=demo.command)


def _that_pay(site: Path) -> Any:
    """The set-ups that pay by the ranking of the site as it is. Raises ConfigError, ModelError."""
    from gateway.config import load_site
    from gateway.workflow.errors21.measurement import worthwhile_setups
    from gateway.workflow.tooth.proposal import work_of

    tree = load_site(site)
    return worthwhile_setups(tree, work_of(tree, site).tooth)


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
