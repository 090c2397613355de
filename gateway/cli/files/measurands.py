"""`evaluate --kind`: straightness, angles, squareness ..., circular tests, and drives on a test bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drivers.errors import ConfigError
from drivers.message import Message
from drivers.types.doubts import Doubt
from drivers.types.results import MeasuredSet
from gateway.cli.files.positioning import accepted_statements, show_verdicts, verdict
from gateway.cli.output import echo, show_json, show_table
from gateway.evaluate.behaviour.order_causes import in_words
from gateway.store import Value
from gateway.workflow.files.circles import evaluate_circles, read_circle
from gateway.workflow.files.drives import SENSES, DriveAnswer, DriveQuestion, evaluate_drives, read_drive
from gateway.workflow.files.kind_records import KindAnswer, KindQuestion, MeasuredFile
from gateway.workflow.run.outcome import of_verdicts

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
    read = tuple(one for path in files for one in _read_measured(path, asked))
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


def _read_measured(path: Path, asked: KindOptions) -> tuple[MeasuredFile, ...]:
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
        echo(Message.of("S-EVAL-NOTE", note=note))


# ---- circular tests, from samples or a maker's own results


@dataclass(frozen=True, slots=True)
class CircleOptions:
    """What was typed beside the files."""

    columns: Mapping[str, Value] = field(default_factory=dict)
    plot: Path | None = None
    limits: Mapping[str, float] = field(default_factory=dict)


def evaluate_ballbar_files(files: Sequence[Path], asked: CircleOptions, *, as_json: bool) -> int:
    """Print figures, causes and verdicts and draw the picture; the exit code of the verdicts.

    Raises ConfigError (E-CLI-NO-FILES, E-CIRCLE-PLOT: a maker's results have no samples to draw), ModelError,
    FileFormatError, StoreError.
    """
    if not files:
        raise ConfigError("E-CLI-NO-FILES", "evaluate")
    found = evaluate_circles([(path.name, read_circle(path, asked.columns)) for path in files])
    decided = found.answer.decided(asked.limits)
    if asked.plot is not None:
        if found.figures is None:
            raise ConfigError("E-CIRCLE-PLOT", str(files[0]))
        from gateway.report.drawings.circle import draw_circle

        draw_circle(found.figures.paths, asked.plot)
    if as_json:
        show_json(found.answer.as_data() | {"verdicts": [verdict(one) for one, _ in decided]})
    else:
        show_answer(found.answer, ())
        for place, (one, unit) in enumerate(decided, 1):
            show_verdicts([verdict(one)], unit, rule=place == len(decided))
        if asked.plot is not None:
            echo(f"picture: {asked.plot}")
    return of_verdicts([one.verdict for one, _ in decided])


# ---- drives, from records of a test bench

SHOWN_ORDERS = 8


@dataclass(frozen=True, slots=True)
class DriveOptions:
    """What was typed beside the files."""

    question: DriveQuestion
    plot: Path | None = None
    limits: Mapping[str, float] = field(default_factory=dict)


def evaluate_transmission(files: Sequence[Path], asked: DriveOptions, *, as_json: bool) -> int:
    """Print figures, orders and verdicts and draw the picture; the exit code of the verdicts.

    Raises ConfigError, ModelError, FileFormatError, StoreError.
    """
    if not files:
        raise ConfigError("E-CLI-NO-FILES", "evaluate")
    read = [(str(path), read_drive(path, asked.question.columns)) for path in files]
    found = evaluate_drives(read, asked.question)
    decided = found.decided(asked.limits)
    if asked.plot is not None:
        from gateway.report.drawings.drive import draw_drive

        draw_drive(found.figures, asked.plot, simulated=found.answer.simulated)
    if as_json:
        show_json(found.as_data() | {"verdicts": [verdict(one) for one, _ in decided]})
    else:
        _show(found)
        for place, (one, unit) in enumerate(decided, 1):
            show_verdicts([verdict(one)], unit, rule=place == len(decided))
        if asked.plot is not None:
            echo(f"picture: {asked.plot}")
    return of_verdicts([one.verdict for one, _ in decided])


def _show(found: DriveAnswer) -> None:
    rows = [
        (one.name, f"{one.value:.3f}", "-" if one.U is None else f"{one.U:.3f}", one.unit)
        for one in found.answer.figures
    ]
    show_table(f"{found.answer.kind} ({found.answer.standard})", ("figure", "value", "U (k=2)", "unit"), rows)
    for run in found.figures.running:
        under = "" if run.torque_nm is None else f", {run.torque_nm:.4g} Nm"
        lines = [
            (f"{one.order}", f"{one.amplitude_arcsec:.3f}", f"{one.phase_deg:.1f}", in_words(one.causes) or "-")
            for one in run.orders[:SHOWN_ORDERS]
        ]
        show_table(f"orders {SENSES[run.sense]}{under}", ("order", "amplitude arcsec", "phase deg", "cause"), lines)
    for note in dict.fromkeys(found.answer.notes):
        echo(Message.of("S-EVAL-NOTE", note=note))
