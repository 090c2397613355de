"""The command `report`: a calibration report of a run or of result files, at any later time."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer

from drivers.errors import ConfigError
from drivers.message import Message
from gateway.cli.next_steps import next_command, show_next
from gateway.cli.options import (
    AcceptOption,
    AskOption,
    ColumnOption,
    JsonOption,
    StatementOption,
    StoreOption,
    accepted_doubts,
    load_site,
    open_run,
    statement_comparison,
)
from gateway.cli.output import echo, show_json
from gateway.workflow.run.outcome import of_verdicts


def report_command(
    what: Annotated[
        list[str] | None,
        typer.Argument(help="A run (folder, id, unique prefix, latest), or result files.", show_default=False),
    ] = None,
    store: StoreOption = Path("runs"),
    language: Annotated[str, typer.Option(help="en, de or zh; default: the site file's language.")] = "",
    site: Annotated[
        Path | None,
        typer.Option(help="Site file with the letterhead, tolerances and equipment to use.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder to write to; default: the run folder, or the current folder.", show_default=False),
    ] = None,
    unit: Annotated[str, typer.Option(help="Unit of an .rta's deviations: mrad, urad, arcsec or deg.")] = "",
    accept_doubt: AcceptOption = None,
    condition: Annotated[
        list[str] | None,
        typer.Option(
            help='Test condition that no file states: "feed=1000 mm/min", "X1.tables=none". Remembered.',
            show_default=False,
        ),
    ] = None,
    accept: StatementOption = None,
    ask: AskOption = True,
    column: ColumnOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the calibration report of a run, or of result files: PDF, HTML and data; 13 where a limit is exceeded."""
    try:
        from gateway.workflow.results.document import DocumentOptions
        from gateway.workflow.results.particulars import stated_conditions
    except ModuleNotFoundError as error:
        raise ConfigError("E-REPORT-EXTRA", "report", library=error.name) from error
    from gateway.workflow.files.headers import columns_of
    from gateway.workflow.files.reading import ReadOptions

    if not what:
        raise ConfigError("E-CLI-NO-FILES", "report")
    accepted = accepted_doubts(accept_doubt)
    told = DocumentOptions(
        language=language, site=(load_site(site), site) if site is not None else None, accepted=accepted
    )
    at = statement_comparison(None, accept, ask=ask and not as_json, tree=told.tree)
    said = stated_conditions(condition or ())
    how = ReadOptions(unit, columns=columns_of(column or []) or None)
    made, lines, data = (
        _report_files(what, store, how, told, out, at=at, said=said)
        if _files(what)
        else _report_run(what, store, told, out, at=at, said=said)
    )
    if as_json:
        show_json(data)
    else:
        for line in lines:
            echo(line)
        echo(f"calibration report {made.number}: {made.pdf}")
        for one in made.doubts:
            echo(f"in doubt: {one}")
        if made.verdicts:
            counted = ", ".join(f"{count} {verdict.upper()}" for verdict, count in Counter(made.verdicts).items())
            echo(Message.of("S-CLI-LIMITS", counted=counted))
        show_next(f"evaluate {what[0]}" if _files(what) else after_report(data["run"]))
    raise typer.Exit(of_verdicts((*made.verdicts, *("not decidable" for _ in made.doubts))))


def after_report(run: str) -> str:
    """What comes after the report of a run, by the state that the run is in."""
    from gateway.store import RunFolder
    from gateway.workflow.run.folder import site_path_of

    folder = RunFolder(Path(run))
    return next_command(folder.state, run=run, site=site_path_of(folder))


def _files(what: list[str]) -> bool:
    return len(what) > 1 or (Path(what[0]).is_file() or bool(Path(what[0]).suffix and not Path(what[0]).is_dir()))


def _report_run(
    what: list[str], store: Path, told: Any, out: Path | None, *, at: Any, said: Any
) -> tuple[Any, tuple[Message, ...], dict[str, Any]]:
    from drivers.clock import LoopClock
    from gateway.store import Maps, Store
    from gateway.workflow.results.document import with_options, write_document
    from gateway.workflow.results.endings import lines_of
    from gateway.workflow.results.from_files import is_imported, keep_conditions, material_of_import
    from gateway.workflow.results.report import material_of, standing_report, summary_of, write_index, write_report

    folder = open_run(Store(store), what[0], "report")
    if said:
        keep_conditions(folder, said)
    if is_imported(folder):
        material = with_options(material_of_import(folder, at, Maps(Store(store).root), told.accepted), told)
        made = write_document(material, out or folder.path, LoopClock().utc())
        return made, (), {**made.as_data(), "run": str(folder.path)}
    material = material_of(folder)
    paths = standing_report(folder, material) or write_report(folder, material)
    made = write_document(with_options(material, told), out or folder.path, LoopClock().utc())
    if out is None:
        folder.adopt(*made.files)
        write_index(folder, material)
    data = {**paths.as_data(), **made.as_data(), "html": str(paths.html), "document": str(made.html)}
    page = Message.of("S-REPORT-PAGE", path=str(paths.html))
    lines = (*lines_of(material), page, *_logo(material, told))
    return made, lines, {**data, "summary": summary_of(paths), "run": str(folder.path)}


def _logo(material: Any, told: Any) -> tuple[Message, ...]:
    """A word where the site file names a logo that could not be read."""
    asked = told.site[0].report.logo if told.site is not None else None
    return (Message.of("W-REPORT-LOGO", logo=asked),) if asked and not material.particulars.maker.logo else ()


def _report_files(
    what: list[str], store: Path, how: Any, told: Any, out: Path | None, *, at: Any, said: Any
) -> tuple[Any, tuple[str, ...], dict[str, Any]]:
    from drivers.clock import LoopClock
    from gateway.store import Store
    from gateway.workflow.results.document import with_options, write_document
    from gateway.workflow.results.from_files import material_of_files

    paths = [Path(one) for one in what]
    read = material_of_files(paths, how, Store(store), at, conditions=said, accepted=told.accepted)
    material = with_options(read, told)
    made = write_document(material, out or Path(), LoopClock().utc())
    return made, tuple(material.findings), made.as_data()
