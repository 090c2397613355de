"""What people see in the terminal: errors, texts and tables, or the same as JSON; and how much of it."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from typing import Any

import typer

from drivers.errors import TrueflankError
from drivers.local.names import visible
from drivers.message import ENGLISH, Form, Message, advice, render
from drivers.terms import shown


class Voice(IntEnum):
    """From least to most."""

    QUIET = 0
    PLAIN = 1
    VERBOSE = 2


_chosen = {"voice": Voice.PLAIN}


def chosen_voice() -> Voice:
    """What was chosen on the command line."""
    return _chosen["voice"]


def use_voice(chosen: Voice) -> None:
    """Speak so from here on; every command begins with `Voice.PLAIN`."""
    _chosen["voice"] = chosen


def quiet_option(given: bool) -> bool:
    """-q was given, or not."""
    if given:
        use_voice(Voice.QUIET)
    return given


def verbose_option(given: bool) -> bool:
    """-v was given, or not."""
    if given:
        use_voice(Voice.VERBOSE)
    return given


# ---- texts, errors and tables

_SITE_WORD = re.compile(r"(?<=trueflank )([a-z][a-z-]*(?: [a-z][a-z-]*)?) SITE\b")
"""The site file in a command that a text recommends: the texts are one for all sites."""


NEXT = "next: "
LANGUAGE_VARIABLE = "TRUEFLANK_LANGUAGE"
_COMMAND_SITE = {"site": ""}


def remember_site(given: Mapping[str, Any]) -> None:
    """What a command was given: its site file stands in the commands that its texts recommend."""
    named = (given.get(name) for name in ("site", "place"))
    _COMMAND_SITE["site"] = next(
        (str(one) for one in named if isinstance(one, Path | str) and str(one).endswith(".toml")), ""
    )


def with_site(text: str) -> str:
    """The commands in a text with the site file of this command, so that they can be typed as they stand.

    As it is where the command was given none: then nobody knows which is meant.
    """
    site = _COMMAND_SITE["site"]
    return _SITE_WORD.sub(lambda found: f"{found[1]} {site}", text) if site else text


def language() -> str:
    """The language in which this process speaks to people: `VARIABLE` names it; English where that names none."""
    from drivers.languages import LANGUAGES

    asked = os.environ.get(LANGUAGE_VARIABLE, ENGLISH)
    return asked if asked in LANGUAGES else ENGLISH


def render_text(said: str | Message) -> str:
    """A message in the reader's language; a finished text as it is."""
    return render(said, language()) if isinstance(said, Message) else said


def text_of(code: str, /, **fields: object) -> str:
    """A text of the catalogue in the reader's language."""
    return render_text(Message(code, fields))


def echo(text: str | Message = "", *, err: bool = False, colour: str | None = None, bold: bool = False) -> None:
    """Print a line: the one place from which words reach a terminal, so nothing in a name can steer one.

    A terminal gets it broken between words; a command to copy stays one line.
    """
    # Named here: left to find it, click goes past whoever stands in for the stream, as the live panel does.
    stream = sys.stderr if err else sys.stdout
    said = visible(shown(with_site(render_text(text)), language()))
    if stream.isatty() and not said.startswith(NEXT):
        said = fold_text(said, shutil.get_terminal_size().columns, 2)
    typer.secho(said, file=stream, fg=colour, bold=bold)


def echo_folded(text: str | Message, hang: int, *, err: bool = False, colour: str | None = None) -> None:
    """Print a sentence; a terminal gets it broken between words, ``hang`` columns in after its first line."""
    stream, text = sys.stderr if err else sys.stdout, render_text(text)
    if stream.isatty():  # another program gets it as one line
        text = fold_text(visible(shown(with_site(text), language())), shutil.get_terminal_size().columns, hang)
    echo(text, err=err, colour=colour)


def fold_text(text: str, width: int, hang: int) -> str:
    """Text in lines of ``width`` columns at most, broken at blanks alone: a path stays whole, for whoever copies it.

    A line that fits stays as it is, blanks and all.
    """
    filled = textwrap.TextWrapper(
        width=max(width, hang + 20),
        subsequent_indent=" " * hang,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    )
    return "\n".join(line if len(line) <= width else filled.fill(line) for line in text.split("\n"))


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
        said = cause.message
        echo_folded(Message(said.code, said.fields, Form.REASON, cause.where), 2, colour="red", err=True)
        if hint := advice(said, language()):
            echo_folded(f"  -> {hint}", 5, err=True)


def count_words(count: int, one: str, many: str) -> str:
    """How many there are, in words: 1 axis, 2 axes."""
    return f"{count} {one if count == 1 else many}"


def show_table(
    title: str | Message, headings: Sequence[str | Message], rows: Iterable[Sequence[str | Message]]
) -> None:
    """A table on standard output; numbers to the right."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    def plain(text: str | Message) -> Text:
        return Text(visible(shown(with_site(render_text(text)))))

    echo(title, bold=True)  # as the table's own it would be broken to the table's width
    table = Table()
    for index, heading in enumerate(headings):
        table.add_column(plain(heading), justify="left" if index == 0 else "right")
    for row in rows:
        table.add_row(*(plain(cell) for cell in row))
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 110)
    console.print(table)


def show_strips(paint: Callable[[int, bool], Iterable[Any]]) -> None:
    """Lines of cells on standard output; ``paint`` makes them for so many columns, with colours or without."""
    from rich.console import Console

    console = Console(highlight=False, width=None if sys.stdout.isatty() else 110)
    colours = console.color_system in ("256", "truecolor") and not console.no_color
    for line in paint(console.width - 1, colours):
        console.print(line, no_wrap=True, crop=True)
