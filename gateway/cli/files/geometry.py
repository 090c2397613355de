"""`evaluate --kind`: straightness, angles, squareness, axis location, rotary motion ... of files alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from gateway.cli.exits import of_verdicts
from gateway.cli.files.evaluating import accepted_statements, show_verdicts, verdict
from gateway.cli.show import echo, show_json, show_table
from gateway.workflow.files.kind_records import KindAnswer, KindQuestion, MeasuredFile

ALONG = ("positioning", "reversal")
MIXED = ("angular", "rotary-motion", "six-dof")
"""Kinds whose readings are no deviation along their own axis: angles over mm, lengths over deg."""
SHOWN = {"um": "µm", "urad": "µrad"}


@dataclass(frozen=True, slots=True)
class KindOptions:
    """What was typed beside the files."""

    kind: str
    question: KindQuestion
    unit: str = ""
    plot: Path | None = None
    phase: str = ""
    store: Path = Path("runs")
    limits: Mapping[str, float] = field(default_factory=dict)
    accepted: Mapping[str, str] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    compared: Any = None


def point_of(text: str) -> tuple[float, float, float]:
    """An offset in mm from "x,y,z". Raises ConfigError (E-CLI-OFFSET)."""
    cells = text.replace(";", ",").split(",")
    try:
        x, y, z = (float(cell) for cell in cells)
    except ValueError:
        raise ConfigError("E-CLI-OFFSET", "--offset", text=text) from None
    return x, y, z


def evaluate_kinds(files: Sequence[Path], asked: KindOptions, *, as_json: bool) -> int:
    """Print the figures of one kind with the verdicts asked for and draw its curves; the exit code of the verdicts.

    Raises ConfigError, ModelError, FileFormatError, StoreError.
    """
    from gateway.evaluate.behaviour.doubts import as_data, blocking_doubts, describe_doubts
    from gateway.evaluate.behaviour.positioning import withhold_verdicts
    from gateway.workflow.files.kinds import evaluate_kind, known_kind

    known_kind(asked.kind)
    if not files:
        raise ConfigError("E-CLI-NO-FILES", "evaluate")
    read = tuple(one for path in files for one in _measured(path, asked))
    answer = evaluate_kind(asked.kind, read, asked.question)
    if asked.plot is not None:
        from gateway.report.drawings.kinds import draw

        draw(answer, asked.plot)
    doubts = tuple(one for item in read for one in _doubts(item.measured, asked))
    decided = [(one, unit) for item, unit in answer.decided(asked.limits) for one in withhold_verdicts((item,), doubts)]
    if as_json:
        show_json(answer.as_data() | {"verdicts": [verdict(one) for one, _ in decided], "doubts": as_data(doubts)})
    else:
        show_answer(
            answer, [*describe_doubts(doubts), *(str(warning) for one in read for warning in one.measured.warnings)]
        )
        for place, (one, unit) in enumerate(decided, 1):
            show_verdicts([verdict(one)], unit, rule=place == len(decided))
        if asked.plot is not None:
            echo(f"picture: {asked.plot}")
    return of_verdicts([*(one.verdict for one, _ in decided), *("not decidable" for _ in blocking_doubts(doubts))])


def evaluate_gear_files(
    files: Sequence[Path], site: Path | None, limits: Mapping[str, float], plot: Path | None, *, as_json: bool
) -> int:
    """Print the figures of a gear measuring machine's file and judge them; the exit code of the verdicts.

    Raises ConfigError (E-CLI-NO-FILES, E-GEARFILE-SITE), FileFormatError, ModelError.
    """
    from gateway.workflow.files.gears import evaluate_gear

    if not files:
        raise ConfigError("E-CLI-NO-FILES", "evaluate")
    gear = None
    if site is not None:
        from gateway.config import load_site
        from gateway.study.inputs import gear_of
        from gateway.workflow.tooth.part_plan import gear_of_site

        gear = gear_of(gear_of_site(load_site(site), site))
    answer = evaluate_gear(files, gear)
    decided = answer.decided(limits)
    if plot is not None:
        from gateway.report.drawings.kinds import draw

        draw(answer, plot)
    if as_json:
        show_json(answer.as_data() | {"verdicts": [verdict(one) for one, _ in decided]})
    else:
        show_answer(answer, ())
        for place, (one, unit) in enumerate(decided, 1):
            show_verdicts([verdict(one)], unit, rule=place == len(decided))
        if plot is not None:
            echo(f"picture: {plot}")
    return of_verdicts([one.verdict for one, _ in decided])


def _doubts(measured: MeasuredSet, asked: KindOptions) -> tuple[Doubt, ...]:
    """Doubts that matter for the kind: of the reader, their size, and along the own axis whether a turn closes."""
    from gateway.evaluate.behaviour.doubts import accept_doubts, all_doubts, notable_doubts

    own = {one.code for one in measured.doubts}
    found = all_doubts(measured) if asked.kind not in MIXED else measured.doubts
    kept = (
        one for one in notable_doubts(found) if one.code in own or asked.kind in ALONG or one.code == "S-EVAL-SPREAD"
    )
    return accept_doubts(kept, asked.accepted)


def _measured(path: Path, asked: KindOptions) -> tuple[MeasuredFile, ...]:
    """A file read by its ending, or by the columns that were said once about its like; of a run every set asked for."""
    from gateway.store import Store
    from gateway.workflow.files.exporting import measured_items
    from gateway.workflow.files.headers import columns_of
    from gateway.workflow.files.reading import ReadOptions

    how = ReadOptions(asked.unit, columns=columns_of(asked.columns) or None, mixed=asked.kind in MIXED)
    held = measured_items(path, how, Store(asked.store), axis=asked.question.axis, phase=asked.phase)
    accepted_statements(path, held, asked.compared, asked.store)
    content = [(one.label, one.content) for one in held if isinstance(one.content, MeasuredSet)]
    if not content:
        raise ConfigError("E-CLI-KIND", str(path), kind=", ".join(type(one.content).__name__ for one in held))
    return tuple(MeasuredFile(Path(label).name, measured) for label, measured in content)


def show_answer(answer: KindAnswer, warnings: Sequence[str]) -> None:
    """Print figures with their U, then notes."""
    rows = [
        (one.name, f"{one.value:.3f}", "-" if one.U is None else f"{one.U:.3f}", SHOWN.get(one.unit, one.unit))
        for one in answer.figures
    ]
    show_table(f"{answer.kind} ({answer.standard})", ("figure", "value", "U (k=2)", "unit"), rows)
    for note in dict.fromkeys((*answer.notes, *warnings)):
        echo(f"  note: {note}")
