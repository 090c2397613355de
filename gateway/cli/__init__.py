"""The command line: thin commands that read arguments, call a workflow and show what comes back."""

from __future__ import annotations

import sys

from gateway.cli.commands import app
from gateway.cli.show import show_error


def main() -> None:
    """Entry point of the `trueflank` command; exit codes follow the exception tree."""
    from drivers.errors import TrueflankError

    try:
        app()
    except TrueflankError as error:
        show_error(error, as_json="--json" in sys.argv)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
