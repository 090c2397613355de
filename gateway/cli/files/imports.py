"""The commands `import`, `import watch` and `runs export`: result files into the store, measured results out of it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError, TrueflankError
from gateway.cli.options import (
    AcceptOption,
    AskOption,
    ColumnOption,
    JsonOption,
    SiteArgument,
    SiteOption,
    StatementOption,
    StoreOption,
    accepted_doubts,
    accepted_words,
    run_or_file,
    statement_comparison,
)
from gateway.cli.output import echo, show_error, show_json, text_of
from gateway.cli.progress import progress
from gateway.cli.signals import run_to_end


def import_command(
    files: Annotated[list[Path], typer.Argument(help="Result files of capture programs.", show_default=False)],
    store: StoreOption = Path("runs"),
    unit: Annotated[str, typer.Option(help="Unit of the values in an .rta or .rtx file; asked once.")] = "",
    machine: Annotated[str, typer.Option(help="Name of the machine; its unit is remembered.")] = "",
    column: ColumnOption = None,
    gear: Annotated[bool, typer.Option("--gear", help="The tables hold flank points of a gear.")] = False,
    forget: Annotated[bool, typer.Option("--forget", help="Forget the stored answers for such files.")] = False,
    motion: Annotated[str, typer.Option(help="Only this error motion of a table with several: EXX.")] = "",
    site: SiteOption = None,
    accept: StatementOption = None,
    ask: AskOption = True,
    accept_doubt: AcceptOption = None,
    as_json: JsonOption = False,
) -> None:
    """Take result files into the store; what they do not say is said once and remembered."""
    from datetime import UTC, datetime

    from gateway.store import Store
    from gateway.workflow.files.headers import columns_of
    from gateway.workflow.files.importing import import_file
    from gateway.workflow.files.reading import ReadOptions

    how = ReadOptions(unit, machine, columns_of(column or []) or None, gear=gear, forget=forget, motion=motion)
    at = statement_comparison(site, accept, ask=ask and not as_json)
    told: list[dict[str, Any]] = []
    failures: list[TrueflankError] = []
    accepted = accepted_doubts(accept_doubt)
    for path in files:
        try:
            done = import_file(path, Store(store), how, lambda: datetime.now(UTC), at=at, accepted=accepted)
        except TrueflankError as error:
            failures.append(error)
            told.append({"file": str(path), "error": error.as_record()})
            continue
        told += [_import_file(path, one) for one in done]
    _show_imports(told, failures, as_json=as_json)


def _import_file(path: Path, done: Any) -> dict[str, Any]:
    told = {"file": str(path), "run": done.run_id, "folder": str(done.folder), "kind": done.kind}
    told |= {"component": done.component, "new": done.new, "sha256": done.sha256, "notes": list(map(str, done.notes))}
    stated = {one.key: one.value for one in done.stated.facts}
    return told | {"stated": stated, "accepted": [accepted_words(one) for one in done.stated.accepted]}


def _show_imports(told: list[dict[str, Any]], failures: list[TrueflankError], *, as_json: bool) -> None:
    if as_json:
        show_json(told)
    for one in () if as_json else told:
        if "error" not in one:
            what = text_of("S-IMPORT-NEW" if one["new"] else "S-IMPORT-BEFORE")
            name = f"{one['file']} {one['component']}".strip()
            echo(f"{name}: {what} {one['run']} ({one['kind']})")
            for note in (*one["notes"], *one["accepted"]):
                echo(f"  note: {note}")
    for failure in () if as_json else failures:
        show_error(failure, as_json=False)
    if failures:
        raise typer.Exit(failures[0].exit_code)


def export_command(
    source: Annotated[str, typer.Argument(metavar="RUN|FILE", help="Run folder or id, or a file.", show_default=False)],
    to: Annotated[str, typer.Option(help="rtl, rta, csv, or rtx for dynamic captures.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")],
    axis: Annotated[str, typer.Option(help="Axis of the run.")] = "",
    phase: Annotated[str, typer.Option(help="before or after, where the run has both.")] = "",
    unit: Annotated[str, typer.Option(help="Unit of the file, if it does not state one.")] = "",
    column: ColumnOption = None,
    store: StoreOption = Path("runs"),
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a run's capture, or any file that can be read, in a form that others read."""
    from gateway.store import Store
    from gateway.workflow.files.exporting import export, measured_items
    from gateway.workflow.files.headers import columns_of
    from gateway.workflow.files.reading import ReadOptions

    how = ReadOptions(unit, columns=columns_of(column or []) or None)
    found = measured_items(run_or_file(store, source), how, Store(store), axis=axis, phase=phase)
    if len(found) > 1:
        raise ConfigError("E-EXPORT-SEVERAL", source, labels=", ".join(item.label for item in found))
    notes = [*map(str, found[0].notes), *map(str, export(found[0], to.lower(), output, unit=unit, force=force))]
    if as_json:
        show_json({"source": found[0].label, "file": str(output), "notes": notes})
        return
    echo(f"{found[0].label} -> {output}")
    for note in notes:
        echo(f"  note: {note}")


# ---- watch

POLL_S = 2.0


def watch_command(
    site: SiteArgument,
    folder: Annotated[Path, typer.Option(help="Folder to watch.", show_default=False)],
    settle: Annotated[
        float, typer.Option(min=0.0, help="Seconds without growth after which a file is complete.")
    ] = 5.0,
    once: Annotated[bool, typer.Option("--once", help="Exit when no file is pending.")] = False,
) -> None:
    """Import each new result file of a folder once, until Ctrl-C; the files themselves are left as they are."""
    from drivers.clock import LoopClock
    from gateway.config import load_site
    from gateway.workflow.files.importing import watcher_of

    tree = load_site(site)

    async def main(say: Any) -> None:
        clock, stop = LoopClock(), asyncio.Event()
        watcher = watcher_of(tree, site, folder, utc=clock.utc, settle_s=settle, say=say)
        if not once:
            await watcher.watch(clock, stop, POLL_S)
        while once:
            watcher.look(clock.now())
            if not watcher.waiting or clock.now() > 2.0 * settle + POLL_S:
                return
            await clock.sleep(min(max(settle, 0.01), POLL_S))

    with progress(quiet=False, at=(tree, site)) as say:
        run_to_end(main(say))
