"""The command `init`: a site file from a few answers and from what the control itself tells; it overwrites nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError, words
from gateway.cli.begin.checking import checked, lead_on, tell
from gateway.cli.begin.questions import Asker, answers
from gateway.cli.show import echo

FileArgument = Annotated[Path, typer.Argument(help="Site file to write; none is overwritten.")]
AnswerOption = Annotated[
    list[str] | None, typer.Option("--answer", help="KEY=VALUE: answer a question in advance.", show_default=False)
]


def init_command(
    file: FileArgument = Path("site.toml"),
    from_cell: Annotated[
        str,
        typer.Option("--from-cell", help="Describe a shipped simulated cell, for example demo.", show_default=False),
    ] = "",
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: use the defaults and the given answers.")] = False,
    answer: AnswerOption = None,
) -> None:
    """Write a commented site file: a few questions, the rest is read from the control; nothing moves."""
    absent(file)
    if not file.parent.is_dir():
        raise ConfigError("E-INIT-FOLDER", str(file), folder=str(file.parent))
    if from_cell:
        from gateway.cli.begin.fromcell import cell_text

        text = cell_text(from_cell, file)
    else:
        from gateway.cli.begin.wizard import wizard_text

        text = wizard_text(file, Asker(answers(answer or []), yes))
    keep(file, text)
    echo("\n" + words("P-INIT-WRITTEN", file=file))
    found = checked(file)
    tell(found, file, [], as_json=False)
    lead_on(found, file, connected=False)


def absent(file: Path) -> None:
    """Nothing stands there yet. Raises ConfigError (E-INIT-EXISTS)."""
    if file.exists() or file.is_symlink():
        raise ConfigError("E-INIT-EXISTS", str(file))


def keep(file: Path, text: str) -> None:
    """Write a new site file. Raises ConfigError (E-INIT-EXISTS, E-INIT-WRITE)."""
    absent(file)
    try:
        with file.open("x", encoding="utf-8") as written:
            written.write(text)
    except OSError as error:
        raise ConfigError("E-INIT-WRITE", str(file), why=error.strerror or str(error)) from error
