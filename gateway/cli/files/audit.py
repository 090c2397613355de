"""The commands below `audit`: verify, show and annotate the log of all actions; no machine is needed."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.message import Message
from gateway.cli.options import JsonOption
from gateway.cli.output import count_words, echo, show_json

PlaceArgument = Annotated[Path, typer.Argument(metavar="STORE", help="Store folder, or site file.", show_default=False)]
ENTRY_FIELDS = ("utc", "actor", "role", "action", "serial", "transaction")


def audit_verify_command(
    store: PlaceArgument,
    head: Annotated[list[str] | None, typer.Option(help="A head exported earlier; may be repeated.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Check every record, every file of every run, and heads exported earlier; exit code 11 when one is not whole."""
    from gateway import audit

    root = store_root(store)
    exported, kept = tuple(audit.parse_head(text) for text in head or ()), audit.check_store(root)
    health = audit.check_log(root, (*exported, *kept.heads))
    if as_json:
        show_json({**health.as_data(), "runs": kept.runs, "files": health.files, "wrong": list(kept.problems)})
        if not health.sound or kept.problems:
            raise typer.Exit(11)
        return
    for problem in kept.problems:
        echo(problem)
    audit.require_sound(root, (*exported, *kept.heads))
    files = count_words(health.files, "file", "files")
    echo(Message.of("S-AUDIT-WHOLE", root=root, seq=health.head.seq, files=files, head=health.head))
    code = "S-AUDIT-CHANGED" if kept.problems else "S-AUDIT-UNCHANGED"
    echo(Message.of(code, runs=kept.runs, count=len(kept.problems)))
    if health.torn_bytes:
        echo(Message.of("S-AUDIT-CRASH", torn_bytes=health.torn_bytes))
    if not exported:
        echo(Message.of("S-AUDIT-HEAD"))
    if kept.problems:
        raise typer.Exit(11)


def audit_head_command(store: PlaceArgument) -> None:
    """Print the head (number:hash); keep it where nobody who can write the store can change it."""
    from gateway import audit

    echo(str(audit.require_sound(store_root(store)).head))


def audit_show_command(
    store: PlaceArgument,
    last: Annotated[int, typer.Option(min=1, help="How many records, the newest.")] = 20,
    as_json: JsonOption = False,
) -> None:
    """Print the newest records; a damaged one is shown as such."""
    from collections import deque

    from gateway import audit

    found = list(deque(audit.read_entries(store_root(store)), maxlen=last))
    if as_json:
        show_json(found)
        return
    for entry in found:
        echo(_entry_line(entry))


def audit_correct_command(
    store: PlaceArgument,
    number: Annotated[int, typer.Argument(min=1, help="The record that is wrong.", show_default=False)],
    why: Annotated[str, typer.Argument(help="The correct statement.", show_default=False)],
) -> None:
    """Add a record that corrects an earlier one; nothing is ever changed."""
    from drivers.clock import LoopClock
    from drivers.errors import ConfigError
    from gateway import audit

    root = store_root(store)
    count = audit.require_sound(root).head.seq
    if number > count:
        raise ConfigError("E-AUDIT-NO-RECORD", str(root), number=number, count=count)

    async def main() -> audit.ChainHead:
        return audit.correct(root, number, why, clock=LoopClock())

    echo(f"record {asyncio.run(main()).seq} corrects record {number}")


def store_root(place: Path) -> Path:
    """The store's folder, given itself or the site file that names it. Raises ConfigError (E-CFG-..., E-CLI-READ)."""
    from drivers.errors import ConfigError

    if place.is_dir():
        return place
    if place.suffix != ".toml":
        raise ConfigError("E-CLI-READ", str(place), why=Message.of("W-AUDIT-NO-FOLDER"))
    from gateway.config import load_site
    from gateway.workflow.run.folder import store_of

    return store_of(load_site(place), place).root


def _entry_line(entry: dict[str, Any]) -> str:
    if entry["damaged"]:
        return f"{entry['place']}: DAMAGED {entry['text'][:100]}"
    acted = "  ".join(str(entry[name]) for name in ENTRY_FIELDS if entry[name] not in ("", 0))
    details = "  ".join(f"{key}={value}" for key, value in sorted(entry["details"].items()))
    return f"{entry['seq']:6}  {acted}  {details}"
