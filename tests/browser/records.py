"""What the records on the disk say, as a person would read it: rounded to two digits, with a real minus sign."""

from __future__ import annotations

from typing import Any

from gateway.store import RunFolder
from tests.browser.hall import Hall


def text(value: float, digits: int = 2) -> str:
    """A number as it stands on the screen."""
    made = f"{value:.{digits}f}"
    return made.removeprefix("-") if float(made) == 0.0 else made.replace("-", "−")


def newest(at: Hall, stage: str) -> RunFolder:
    """The newest run that has this stage."""
    folders = [RunFolder(run.path) for run in at.store.runs() if not run.problem]
    return next(one for one in reversed(folders) if stage in one.stages)


def _record(run: RunFolder, stage: str) -> dict[str, Any]:
    return dict(run.envelope(stage)["record"])


def figures_of(run: RunFolder, axis: str, phase: str) -> dict[str, str]:
    """Each figure of ISO 230-2 as text."""
    record = _record(run, f"evaluation-{axis}-{phase}")
    return {name: text(record[name]) for name in record["U"]}


def proposal_of(run: RunFolder, change: int) -> list[str]:
    """What must stand in the facts of a new table: how many points, its range, smallest and largest value."""
    table = _record(run, "proposal")["changes"][change]["new"]
    values = table["deviations"]
    return [
        str(len(values)),
        f"{text(table['minimum'], 3)} … {text(table['maximum'], 3)}",
        f"{text(min(values))} … {text(max(values))}",
    ]
