"""The command `accept`: the shipped acceptance of a site, within an allowance, and the sheet to sign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import LoopClock
from drivers.errors import words
from gateway.cli.control.conforming import allowance
from gateway.cli.options import JsonOption, SiteArgument, with_control
from gateway.cli.show import echo, show_json
from gateway.cli.stopping import run_to_end
from gateway.events import DevicesOpened, received

NOT_ACCEPTED = 13


def accept_command(
    site: SiteArgument,
    allow: Annotated[
        str,
        typer.Option(
            "--allow", help="read: observe only; move: also jog; write: also try a table and restore the old one."
        ),
    ] = "read",
    machine: Annotated[str, typer.Option(help="The machine's name, typed to confirm --allow write.")] = "",
    sheet: Annotated[Path, typer.Option(help="File of the sheet to sign: .html or .pdf.")] = Path("acceptance.html"),
    language: Annotated[str, typer.Option(help="Language of the sheet: en, de or zh; default: the site file's.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Accept a site: every check within the allowance, and a sheet to sign; exit code 13 where one fails."""
    from gateway.acceptance.judging import cases, run_check
    from gateway.acceptance.results import CheckResult
    from gateway.acceptance.sheet import Occasion, check_sheet, write_sheet
    from gateway.acceptance.working import SiteDesk
    from gateway.config import load_site
    from gateway.workflow.run.context import check_name
    from gateway.workflow.run.folder import known_of, store_of

    tree, given, clock = load_site(site), allowance(allow), LoopClock()
    with_control(tree)
    check_name(tree, given == "write", machine, code="E-ACCEPT-NAME")
    check_sheet(sheet, language)

    told: set[str] = set()

    def say(code: str, /, **fields: object) -> None:
        """Each check opens the control anew; what it says of it is told once."""
        line = words(code, **fields)
        if not as_json and (not isinstance(received(code, fields), DevicesOpened) or line not in told):
            echo(f"  {line}")
        told.add(line)

    async def main() -> list[CheckResult]:
        results: list[CheckResult] = []
        for check, axis in cases(tree):
            result = await run_check(check, axis, SiteDesk(tree, site, clock, say), given)
            results.append(result)
            if not as_json:
                echo(f"{result.outcome:<8} {result.name}: {result.said}")
        return results

    results: list[Any] = run_to_end(main(), at=site)
    known = known_of(tree, store_of(tree, site).root).accepted
    write_sheet(sheet, results, Occasion(tree, site, given, clock.utc(), language=language, accepted=known))
    if as_json:
        show_json({"allow": given, "results": [one.as_record() for one in results], "sheet": str(sheet)})
    else:
        echo(f"the sheet to sign: {sheet}")
    if any(one.outcome == "failed" for one in results):
        raise typer.Exit(NOT_ACCEPTED)
