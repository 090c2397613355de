"""What people see in the terminal: errors, progress and tables, or the same as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer

from drivers.errors import TrueflankError, words
from drivers.local.names import visible
from gateway.say import Say, silence


def echo(text: str = "", *, err: bool = False, colour: str | None = None, bold: bool = False) -> None:
    """Print a line: the one place from which words reach a terminal, so nothing in a name can steer one."""
    typer.secho(visible(text), fg=colour, bold=bold, err=err)


def show_json(data: Any) -> None:
    """Print a result as data on standard output, ASCII alone, nothing in it that steers a terminal."""
    typer.echo(json.dumps(data, indent=2, default=str).replace("\x7f", "\\u007f"))


def show_error(error: TrueflankError, *, as_json: bool) -> None:
    """What, where, what to do; one line a cause when several devices failed."""
    causes: Sequence[tuple[str, TrueflankError]] = getattr(error, "causes", ())
    if as_json:
        record = error.as_record()
        record["causes"] = [{"device": name, **cause.as_record()} for name, cause in causes]
        show_json({"error": record})
        return
    for _name, cause in causes or (("", error),):
        place = f" [{cause.where}]" if cause.where else ""
        echo(f"{cause.code}{place}: {cause.what}", colour="red", err=True)
        if cause.hint:
            echo(f"  -> {cause.hint}", err=True)


@contextmanager
def progress(*, quiet: bool) -> Iterator[Say]:
    """A rich progress display fed by codes; stop-by-stop codes move a bar, others print a line."""
    if quiet:
        yield silence
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, highlight=False)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bars:
        tasks: dict[str, Any] = {}

        def say(code: str, /, **fields: object) -> None:
            if code == "P-STOP":
                name = f"{fields['axis']} {fields['program']}"
                done, total = int(str(fields["done"])), int(str(fields["total"]))
                if name not in tasks:
                    tasks[name] = bars.add_task(visible(name), total=total)
                bars.update(tasks[name], completed=done)
                if done == total:
                    bars.remove_task(tasks.pop(name))
                return
            bars.console.print(visible(words(code, **fields)), markup=False)

        yield say


def show_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table on standard output; numbers to the right."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    def plain(text: str) -> Text:
        return Text(visible(text))

    table = Table(title=plain(title), title_justify="left", title_style="bold")
    for index, heading in enumerate(headings):
        table.add_column(plain(heading), justify="left" if index == 0 else "right")
    for row in rows:
        table.add_row(*(plain(cell) for cell in row))
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 110)
    console.print(table)
