"""The command `teach`: the service on a simulated cell with one command, the machine's panel as a page beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gateway.cli.demonstration import CellAsked, cell_process, converse
from gateway.cli.service.serving import serve_command
from gateway.cli.show import echo


@dataclass(frozen=True, slots=True)
class Lesson:
    """A training: a shipped cell or a file, where everything is kept, its speed, and the page's port."""

    cell: str
    folder: Path
    speed: float
    port: int
    alone: bool = False


def teach_at(lesson: Lesson) -> None:
    """Run cell and service until Ctrl-C. Raises what starting either raises."""
    site = lesson.folder / "site.toml"
    told: dict[str, object] = {}
    asked = CellAsked(lesson.cell, site, lesson.speed, plan=True, panel=True)
    with cell_process(asked, told.update) as child:
        if lesson.alone and child.stdin is not None and child.stdout is not None:
            child.stdin.write("auto off\n")
            child.stdin.flush()
            child.stdout.readline()
        echo(f"the machine's panel: {told.get('panel', '')}   (keys, mounting, beams; or type here: help)")
        echo(
            "you are its operator: press its keys and mount there"
            if lesson.alone
            else "its operator does what the control asks for; --alone leaves that to you"
        )
        echo("the operator's page:")
        converse(child)
        serve_command([site], port=lesson.port)
