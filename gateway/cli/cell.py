"""Simulated cells as child processes: `simulate`, and `simulate panel` (the operator's console).

A cell ends when its standard input closes, so none outlives this process. Its first line of output, JSON, says that it
is ready.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TextIO
from urllib.parse import urlsplit

import typer

from drivers.errors import ConfigError
from drivers.local.extras import need
from drivers.message import Message
from gateway.cli.command_list import require_only
from gateway.cli.options import JsonOption, SpeedOption, parse_connection, parse_name
from gateway.cli.output import echo, show_json

CELL_END_S = 10.0


CELL_COMMAND = (sys.executable, "-m", "simulators.cell")


@dataclass(frozen=True, slots=True)
class CellRequest:
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
        return [*CELL_COMMAND, self.cell, *given]


@contextmanager
def cell_process(
    asked: CellRequest, heard: Callable[[dict[str, object]], None] = lambda _told: None
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
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, **_own_process_group()) as child:  # noqa: S603
        try:
            if child.stdout is None or child.stdin is None:
                raise ConfigError("E-CLI-CELL", cell, why=Message.of("W-CELL-NO-PIPES"))
            heard(_read_cell_start(child, cell))
            yield child
        finally:
            if child.stdin is not None:
                child.stdin.close()
            try:
                child.wait(CELL_END_S)
            except subprocess.TimeoutExpired:
                child.kill()


def _own_process_group() -> dict[str, Any]:
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"process_group": 0}


def _read_cell_start(child: subprocess.Popen[str], cell: str) -> dict[str, object]:
    line = child.stdout.readline() if child.stdout is not None else ""
    try:
        answer = json.loads(line)
    except ValueError as error:
        why = Message.of("W-CELL-SAID", line=line, poll=child.poll())
        if not line:
            why = Message.of("W-CELL-ENDED", poll=child.poll())
        raise ConfigError("E-CLI-CELL", cell, why=why) from error
    return dict(answer)


def list_cells() -> None:
    """The cells that come with trueflank, as their files describe them."""
    need("sim", "--list")
    done = subprocess.run([*CELL_COMMAND, "--list", "-"], capture_output=True, text=True, check=False)  # noqa: S603
    try:
        cells = dict(json.loads(done.stdout))
    except ValueError as error:
        raise ConfigError("E-CLI-CELL", "--list", why=done.stderr.strip()) from error
    for name, words_of_it in cells.items():
        echo(f"{name:<8} {words_of_it}")


def relay_console(child: subprocess.Popen[str]) -> None:
    """What is typed goes to the cell from now on, and what it answers is shown."""
    threading.Thread(target=_relay_keys, args=(child.stdin,), daemon=True, name="keys").start()
    threading.Thread(target=_show_answers, args=(child.stdout,), daemon=True, name="answers").start()


def _relay_keys(keys: TextIO | None) -> None:
    """What is typed here goes to the cell's panel; the end of our input is not that of the cell.

    Read below Python's buffer, whose lock this thread would still hold when the program ends.
    """
    with contextlib.suppress(OSError, ValueError):
        while keys is not None and (typed := os.read(sys.stdin.fileno(), 4096)):
            keys.write(typed.decode("utf-8", "replace"))
            keys.flush()


def _show_answers(answers: TextIO | None) -> None:
    with contextlib.suppress(OSError, ValueError):
        for line in answers or ():
            echo(line.rstrip())


def simulate_command(
    cell: Annotated[str, typer.Argument(help="Cell file, or the name of a shipped cell.", show_default=True)] = "demo",
    site: Annotated[Path, typer.Option(help="Path of the new site file.")] = Path("cell/site.toml"),
    speed: SpeedOption = 10.0,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulated machine.", show_default=False)] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Name every set-up and the work in the site file.")] = False,
    filed: Annotated[bool, typer.Option("--filed", help="All set-ups come from tables; with --plan.")] = False,
    road: Annotated[
        str,
        typer.Option(
            help="Connections to the control: opcua, modbus or both; default: those of the cell file.",
            callback=parse_connection,
        ),
    ] = "",
    name: Annotated[str, typer.Option(help="Name of the machine in the site file.", callback=parse_name)] = "",
    listed: Annotated[bool, typer.Option("--list", help="List the shipped cells and exit.")] = False,
) -> None:
    """Start a simulated cell on free loopback ports and print its site file; Ctrl-C ends it."""
    if listed:
        require_only("simulate --list")
        list_cells()
        return
    asked = CellRequest(cell, site, speed, seed, plan=plan or filed, filed=filed, road=road, name=name)
    with cell_process(asked) as child:
        echo(Message.of("S-CELL-RUNS", cell=cell, speed=speed, site=site))
        echo(Message.of("S-CELL-TRY", site=site))
        echo(Message.of("S-CELL-OPERATOR", site=site))
        relay_console(child)
        try:
            child.wait()
        except KeyboardInterrupt:
            echo(Message.of("S-CELL-ENDING"))


# ---- cell: the operator's console of a running cell, over loopback

ANSWER_S = 120.0
Ask = Any


def cell_command(
    site: Annotated[Path, typer.Argument(help="Site file of a running cell.", show_default=False)],
    keys: Annotated[
        list[str] | None, typer.Argument(help="Actions in order; without any, you type them.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Stand at a simulated cell: press its keys, mount, break the beam, take the part, change the weather.

    Without actions those that are typed, until the input ends. Raises ConfigError (E-CLI-NO-CELL, E-CLI-CELL-WORD).
    """
    with _open_console(site) as ask:
        for order in keys or ():
            show_cell_answer(order, _require_done(order, ask(order)), as_json=as_json)
        if keys:
            return
        echo(Message.of("P-CELL-CONSOLE"))
        show_cell_answer("status", ask("status"), as_json=False)
        for line in sys.stdin:
            typed = line.strip() or "status"
            show_cell_answer(typed, ask(typed), as_json=as_json)


def show_cell_answer(order: str, answer: dict[str, Any], *, as_json: bool) -> None:
    """An answer of the cell, as people read it or as data."""
    if as_json:
        show_json(answer)
    elif "error" in answer:
        echo(str(answer["error"]), colour="red")
    elif set(answer) <= {"done", "pressed", "taken"}:
        echo(Message.of("P-CELL-DONE" if all(answer.values()) else "P-CELL-NOTHING", order=order))
    else:
        for line in cell_answer_lines(answer):
            echo(line)


def cell_answer_lines(answer: dict[str, Any]) -> Iterator[str]:
    """One line for each thing an answer holds."""
    width = max(len(key) for key in answer)
    for key, value in answer.items():
        yield f"{key:<{width}}  {_cell_value(value)}"


def _cell_value(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_cell_value(one)}" for name, one in value.items())
    if isinstance(value, list):
        return ", ".join(str(one) for one in value[-5:]) or "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _require_done(order: str, answer: dict[str, Any]) -> dict[str, Any]:
    if "error" in answer:
        raise ConfigError("E-CLI-CELL-WORD", "cell", order=order, why=answer["error"])
    return answer


@contextmanager
def _open_console(site: Path) -> Iterator[Ask]:
    """A conversation with the cell that wrote a site file: one line, one answer. Raises ConfigError (E-CLI-NO-CELL)."""
    try:
        place = urlsplit(str(json.loads(site.with_suffix(".cell.json").read_text(encoding="utf-8"))["judge"]))
        wire = socket.create_connection((place.hostname or "", place.port or 0), ANSWER_S)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError("E-CLI-NO-CELL", str(site), why=str(error)) from error
    with wire, wire.makefile("rwb") as lines:

        def ask(order: str) -> dict[str, Any]:
            try:
                lines.write(order.encode("utf-8") + b"\n")
                lines.flush()
                return dict(json.loads(lines.readline()))
            except (OSError, ValueError) as error:
                raise ConfigError("E-CLI-NO-CELL", str(site), why=str(error)) from error

        yield ask
