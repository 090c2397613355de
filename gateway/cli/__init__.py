"""The command line: thin commands that read arguments, call a workflow and show what comes back."""

from __future__ import annotations

import sys

from gateway.cli.begin import checking, initialising
from gateway.cli.commands import app
from gateway.cli.control import auditing, connecting, consenting, switching
from gateway.cli.files import explaining, importing, listing, replaying, watching
from gateway.cli.machine import correcting, dynamic, grinding, inspecting, measuring, programs, whole_loop
from gateway.cli.show import show_error

initialising.add_to(app)
checking.add_to(app)
auditing.add_to(app)
consenting.add_to(app)
switching.add_to(app)
connecting.add_to(app)
replaying.add_to(app)
importing.add_to(app)
listing.add_to(app)
explaining.add_to(app)
watching.add_to(app)
dynamic.add_to(app)
measuring.add_to(app)
correcting.add_to(app)
grinding.add_to(app)
programs.add_to(app)
inspecting.add_to(app)
whole_loop.add_to(app)


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
