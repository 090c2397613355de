"""The command `logs`: the full record of what happened, of one run or of a whole store, and as it goes on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from gateway.cli.options import JsonOption, StoreOption, open_run
from gateway.cli.show import echo

POLL_S = 0.5


def logs_command(
    run: Annotated[str, typer.Option(help="Only this run: id, unique prefix, or latest.")] = "",
    store: StoreOption = Path("runs"),
    last: Annotated[int, typer.Option(min=1, max=1_000_000, help="How many lines at most, the newest.")] = 200,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Follow new lines until Ctrl-C.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Print the full record of what happened: of one run, or as it happens; --json gives the lines as they are kept."""
    from drivers.errors import ConfigError
    from gateway.store import Store
    from gateway.store.log_book import LogBook, lines_of

    wanted = open_run(Store(store), run).run_id if run else ""
    lines = [line for line in lines_of(store) if wanted in ("", line.get("run"))]
    if not lines and not follow:
        raise ConfigError("E-LOG-NONE", str(store), store=str(store))
    for line in lines[-last:]:
        _tell(line, as_json=as_json)
    if follow:
        _follow(LogBook.place(store), wanted, as_json=as_json)


def _follow(path: Path, run: str, *, as_json: bool) -> None:
    """Every whole line that is added, also after the log has turned over."""
    from drivers.clock import LoopClock
    from gateway.cli.stopping import run_to_end
    from gateway.store.log_book import LogTail

    async def main() -> None:
        clock, tail = LoopClock(), LogTail(path)
        while True:
            for line in tail.new():
                if run in ("", line.get("run")):
                    _tell(line, as_json=as_json)
            await clock.sleep(POLL_S)

    run_to_end(main())


def _tell(line: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        echo(json.dumps(line))
        return
    utc, level, run, device = (str(line.get(key, "")) for key in ("utc", "level", "run", "device"))
    echo(f"{utc[:23]} {level:<7} {run[-4:]:<4} {device[:16]:<16} {line.get('code', '')}: {line.get('words', '')}")
