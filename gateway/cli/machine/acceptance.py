"""`doctor accept` and `doctor compare`: the acceptance sheet of a site, and a control compared with its simulator."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.clock import LoopClock
from drivers.message import Message
from drivers.probes import Level, ProbedSession, differences, read_session
from gateway.cli.machine.doctor import examine, parse_level, report_record
from gateway.cli.options import JsonOption, SiteArgument, load_site, require_control
from gateway.cli.output import echo, show_json
from gateway.cli.signals import run_to_end

NOT_ACCEPTED_EXIT = 13


def acceptance_command(
    site: SiteArgument,
    level: Annotated[
        str,
        typer.Option(
            "--level",
            help="read: look; program: also start programs that move nothing; motion: also jog each axis; write: also "
            "try a table and restore the old one.",
        ),
    ] = "read",
    machine: Annotated[str, typer.Option(help="The machine's name, typed to confirm --level write.")] = "",
    sheet: Annotated[Path, typer.Option(help="File of the sheet to sign: .html or .pdf.")] = Path("acceptance.html"),
    language: Annotated[str, typer.Option(help="Language of the sheet: en, de or zh; default: the site file's.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Accept a site: the doctor up to a level, and a sheet to sign; exit code 13 where something is wrong."""
    from gateway.acceptance.sheet import Occasion, check_sheet, write_sheet
    from gateway.workflow.run.context import check_name
    from gateway.workflow.run.folder import known_of, store_of

    tree, given = load_site(site), parse_level(level)
    require_control(tree)
    check_name(tree, given == "write", machine, code="E-ACCEPT-NAME")
    check_sheet(sheet, language)
    results = examine(tree, site, given, as_json=as_json, above=True)
    known = known_of(tree, store_of(tree, site).root).accepted
    write_sheet(sheet, results, Occasion(tree, site, given, LoopClock().utc(), language=language, accepted=known))
    failed = any(one.outcome == "wrong" for one in results)
    if as_json:
        show_json({**report_record(tree, given, results), "ok": not failed, "sheet": str(sheet)})
    else:
        echo(Message.of("S-ACCEPT-SHEET", sheet=sheet))
    if failed:
        raise typer.Exit(NOT_ACCEPTED_EXIT)


# ---- compare

DIFFERENT_EXIT = 13
CELL_SPEED = 20.0

CompareLevelOption = Annotated[
    str,
    typer.Option(
        "--level", help="read: ask only; program: also start programs that move nothing; write: also offer values."
    ),
]


def conform_command(
    site: SiteArgument,
    level: CompareLevelOption = "read",
    machine: Annotated[str, typer.Option(help="The machine's name, typed to confirm --level write.")] = "",
    session: Annotated[
        Path | None, typer.Option("--session", help="Replay this recorded session without the control.")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for session, test and rows.")] = Path(
        "conform"
    ),
    cell: Annotated[str, typer.Option(help="The simulator: cell file, or the name of a shipped cell.")] = "demo",
    record_only: Annotated[bool, typer.Option("--record-only", help="Ask the control only, no simulator.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Ask the control and its double the same questions; exit code 13 and a failing test where they differ."""
    from gateway.acceptance.comparison import written

    told = _ignore_progress if as_json else _show_progress
    control = read_session(session) if session is not None else _record_control(site, parse_level(level), machine, told)
    double = None if record_only else _replay_simulator(control, cell, told)
    found = differences(control, double) if double is not None else ()
    files = written(output, control, found, cell)
    asked = sum(answer.asked for answer in control.answers)
    if as_json:
        lines = [{"name": one.probe.name, "control": one.control, "double": one.double} for one in found]
        show_json({"asked": asked, "differences": lines, "files": [str(file) for file in files]})
    else:
        for one in found:
            echo(one.line)
        told_end = Message.of("S-ACCEPT-NOTHING") if double is None else Message.of("S-ACCEPT-DIFFER", count=len(found))
        echo(
            Message.of(
                "S-ACCEPT-ANSWERED",
                asked=asked,
                count=len(control.answers),
                ended=told_end,
                files=", ".join(map(str, files)),
            )
        )
    if found:
        raise typer.Exit(DIFFERENT_EXIT)


def _record_control(site: Path, level: Level, machine: str, told: Any) -> ProbedSession:
    from gateway import audit
    from gateway.acceptance.comparison import prober_of, recorded
    from gateway.broker import borrow_devices
    from gateway.workflow.run.context import check_name
    from gateway.workflow.run.folder import store_of

    tree, clock = load_site(site), LoopClock()
    check_name(tree, level == "write", machine, code="E-ACCEPT-NAME")
    prober_of(tree, clock)
    root = store_of(tree, site).root

    async def main() -> ProbedSession:
        async with borrow_devices(root, "conform", clock):
            if level != "read":
                audit.record(root, "conform", clock=clock, serial=tree.controller.serial, details={"allow": level})
            return await recorded(tree, level, clock, told)

    return run_to_end(main(), at=site)


def _replay_simulator(control: ProbedSession, cell: str, told: Any) -> ProbedSession:
    """The double's answers, from a simulated cell with the key switch where the control had it."""
    from gateway.acceptance.comparison import replayed
    from gateway.cli.cell import CellRequest, cell_process

    with tempfile.TemporaryDirectory(prefix="trueflank-double-") as folder:
        path = Path(folder) / "site.toml"
        with cell_process(CellRequest(cell, path, CELL_SPEED, road="opcua")) as child:
            order = {"set": "access_level", "value": int(control.about.get("access_level", "2"))}
            if child.stdin is not None and child.stdout is not None:
                child.stdin.write(json.dumps(order) + "\n")
                child.stdin.flush()
                child.stdout.readline()
            return run_to_end(replayed(load_site(path), control, LoopClock(), told), at=path)


def _show_progress(code: str, /, **fields: object) -> None:
    echo(Message.of(code, **fields))


def _ignore_progress(_code: str, /, **_fields: object) -> None:
    """The result alone is printed."""
