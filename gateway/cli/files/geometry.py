"""`evaluate --kind`: straightness, angles, squareness, axis location, rotary motion ... of files alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers import registry
from drivers.errors import ConfigError
from drivers.types.results import MeasuredSet
from gateway.cli.show import echo, show_json, show_table
from gateway.workflow.files.kindrecords import KindAnswer, KindQuestion, MeasuredFile

MIXED = ("angular", "rotary-motion")
"""Kinds whose readings are no deviation along their own axis: angles over mm, lengths over deg."""
TABLES = (".csv", ".txt", ".dat", ".tsv")
SHOWN = {"um": "µm", "urad": "µrad"}


@dataclass(frozen=True, slots=True)
class KindOptions:
    """What was typed beside the files."""

    kind: str
    question: KindQuestion
    unit: str = ""
    plot: Path | None = None
    store: Path = Path("runs")


def evaluate_kinds(files: Sequence[Path], asked: KindOptions, *, as_json: bool) -> None:
    """Print the figures of one kind and draw its curves. Raises ConfigError, ModelError, FileFormatError."""
    from gateway.workflow.files.kinds import evaluate_kind, known_kind

    known_kind(asked.kind)
    if not files:
        raise ConfigError("E-CLI-NO-FILES", "evaluate")
    read = tuple(MeasuredFile(path.name, _measured(path, asked)) for path in files)
    answer = evaluate_kind(asked.kind, read, asked.question)
    if asked.plot is not None:
        from gateway.report.drawings.kinds import draw

        draw(answer, asked.plot)
    if as_json:
        show_json(answer.as_data())
        return
    _show(answer, [warning for one in read for warning in one.measured.warnings])
    if asked.plot is not None:
        echo(f"picture: {asked.plot}")


def _measured(path: Path, asked: KindOptions) -> MeasuredSet:
    """A file read by its ending, or by the columns that were said once about its like."""
    from gateway.store import Store
    from gateway.workflow.files.exporting import items
    from gateway.workflow.files.importing import How

    if asked.kind in MIXED and path.suffix.lower() in TABLES:
        found: MeasuredSet = registry.load("csv", "file")(asked.unit, mixed=True).read(path)
        return found
    content = [one.content for one in items(path, How(asked.unit), Store(asked.store))]
    if len(content) != 1 or not isinstance(content[0], MeasuredSet):
        raise ConfigError("E-CLI-KIND", str(path), kind=", ".join(type(one).__name__ for one in content))
    return content[0]


def _show(answer: KindAnswer, warnings: Sequence[str]) -> None:
    rows = [
        (one.name, f"{one.value:.3f}", "-" if one.U is None else f"{one.U:.3f}", SHOWN.get(one.unit, one.unit))
        for one in answer.figures
    ]
    show_table(f"{answer.kind} ({answer.standard})", ("figure", "value", "U (k=2)", "unit"), rows)
    for note in (*answer.notes, *warnings):
        echo(f"  note: {note}")
