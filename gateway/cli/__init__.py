"""The command line: thin commands that read arguments, call a workflow and show the result.

`command_list` reads `order.toml` and loads the module of the command that is typed, and no other. The commands are in
`setup` (site file), `machine` (with a control), `files` (result files, tables, runs), `serve`, `service`, `cell` and
`demo`. They share `options`, `output`, `progress`, `next_steps` and `signals`. Others import `app` and `main` alone.
"""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

# Our matrices are small: threads of a BLAS cost every command a tenth of a second and only wait for each other; and one
# thread adds in the same order on every PC. Before numpy is loaded, or it is too late.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from gateway.cli.command_list import CONTEXT_SETTINGS, CommandList
from gateway.cli.output import Voice, echo, show_error, use_voice

app = typer.Typer(
    cls=CommandList,
    name="trueflank",
    help="Measure a gear grinder's axes, correct them through its controller, and prove the result.",
    context_settings=CONTEXT_SETTINGS,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib import metadata

        echo(f"trueflank {metadata.version('trueflank')}")
        raise typer.Exit


@app.callback()
def first(
    _version_wanted: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True, expose_value=False)
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print essential messages only.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print every step, as in the log.")] = False,
) -> None:
    """Begin every command with the plain voice, or with that asked for before its name."""
    use_voice(Voice.VERBOSE if verbose else Voice.QUIET if quiet else Voice.PLAIN)


def main() -> None:
    """Entry point of the `trueflank` command; exit codes follow the exception tree (docs/exit-codes.md)."""
    from drivers.errors import TrueflankError

    try:
        app()
    except TrueflankError as error:
        show_error(error, as_json="--json" in sys.argv)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
