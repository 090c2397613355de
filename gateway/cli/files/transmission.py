"""`evaluate --kind transmission`: a reducer's figures from records of its test bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from drivers.errors import ConfigError
from gateway.cli.exits import of_verdicts
from gateway.cli.files.evaluating import show_verdicts, verdict
from gateway.cli.show import echo, show_json, show_table
from gateway.evaluate.behaviour.order_causes import in_words
from gateway.workflow.files.drives import SENSES, DriveAnswer, DriveQuestion, evaluate_drives, read_drive

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
        echo(f"  note: {note}")
