"""`evaluate --kind ballbar`: circular tests from samples, or a maker's own results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from drivers.errors import ConfigError
from gateway.cli.exits import of_verdicts
from gateway.cli.files.evaluating import show_verdicts, verdict
from gateway.cli.files.geometry import show_answer
from gateway.cli.show import echo, show_json
from gateway.store import Value
from gateway.workflow.files.circles import evaluate_circles, read_circle


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
