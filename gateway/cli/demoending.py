"""How the demo ends: the tooth before and after as two strips and at most eight lines, or where it stopped and why."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import Clock
from drivers.errors import words
from drivers.message import Message, fixed
from gateway.cli.onward import next_step
from gateway.cli.show import NEXT, echo, show_strips
from gateway.remaining import RemainingTime
from gateway.store import RunFolder
from gateway.workflow.run import stages as names

SLOW = 1.5
"""Load of the computer for each of its cores, and wall time for each second of work, from which it is called busy."""
MOST_S = 90.0


@dataclass(frozen=True, slots=True)
class Took:
    """How long a demo took on the wall, and how long its two processes worked, s."""

    wall_s: float
    worked_s: float

    @property
    def busy(self) -> bool:
        """Whether the computer had other things to do: it took long, and little of that was work of ours."""
        return self.wall_s > MOST_S and self.wall_s > SLOW * self.worked_s


def say_if_busy() -> None:
    """Say beforehand that the computer has more to do than it can: the demo takes longer, and comes out the same."""
    if not hasattr(os, "getloadavg"):
        return
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load > SLOW * cores:
        echo(Message.of("P-DEMO-BUSY", load=fixed(load, 1), cores=cores))


def show_ending(outcome: Any, chosen: str, took: Took, clock: Clock) -> None:
    """The end of a demo that went well: the report as PDF, its page, the strips, at most eight lines.

    ``chosen`` says which set-ups were measured; "" where all were.
    """
    from gateway.workflow.results.report import material_of

    folder = RunFolder(Path(outcome.run_folder))
    material = material_of(folder)
    paper, page = _written(folder, material, clock)
    show_tooth(material)
    for line in (*lines_of(material, chosen), *_papers(paper, page), *_times(took)):
        echo(line)
    next_step(f"runs show {folder.run_id} --store {folder.path.parent}")


def show_tooth(material: Any) -> None:
    """The tooth before, with its set-up values right, and after, as strips on one scale; nothing without both."""
    from gateway.cli.screen.strip import strips, top_um
    from gateway.report.tooth.flank import states

    by = {one.key: one.map for one in states(material.tooth)} if material.tooth is not None else {}
    named = [(word, by[key]) for word, key in (("before", "before-set-right"), ("after", "after")) if key in by]
    if len(named) == len(("before", "after")):
        show_strips(lambda columns, colours: strips(named, columns, colours=colours))
        echo(Message.of("S-DEMO-STRIP", top=fixed(top_um(named), 1)))


def lines_of(material: Any, chosen: str) -> Iterator[str | Message]:
    """What became of axes and tooth, one line each, and which set-ups were measured for it."""
    from gateway.report import parameter_rows
    from gateway.report.lines import figure

    rows = [row for axis in material.axes for row in parameter_rows(axis.axis, axis.before, axis.after)]
    told = (row for row in rows if row.parameter == "M" and row.before is not None and row.after is not None)
    axes = ", ".join(f"{row.axis} {row.before:.1f} → {row.after:.1f} {row.unit}" for row in told)
    yield words("S-DEMO-AXES", axes=axes)
    if material.tooth is not None:
        yield figure(material.tooth)
    if chosen:
        yield chosen


def _written(folder: RunFolder, material: Any, clock: Clock) -> tuple[Path | None, Path]:
    """The calibration report as PDF, where what makes one is installed, and the run's page with it."""
    from gateway.workflow.results.report import write_index

    made = None
    try:
        from gateway.workflow.results.document import write_document
    except ModuleNotFoundError:
        pass  # without the extra `report` there is no PDF, and its line is left out
    else:
        done = write_document(material, folder.path, clock.utc())
        folder.adopt(*done.files)
        made = done.pdf
    return made, write_index(folder, material)


def _papers(paper: Path | None, page: Path) -> Iterator[str]:
    if paper is not None:
        yield words("S-DEMO-REPORT", path=paper)
    yield words("S-DEMO-PAGE", path=page)


def _times(took: Took) -> Iterator[str]:
    code = "S-DEMO-TOOK-BUSY" if took.busy else "S-DEMO-TOOK"
    yield words(code, wall=f"{took.wall_s:.0f}", worked=f"{took.worked_s:.0f}")


def say_stopped(stages: RemainingTime | None, folder: Path, again: str) -> None:
    """Where a demo stopped: its stage, its folder, and the command to go on, or to begin anew.

    ``again`` is the demo's command line. The simulated control ends with it, so that a run that had begun to propose
    tables has no machine any more on which it could go on.
    """
    run = Path(stages.run) if stages is not None and stages.run else None
    number, total = (stages.number, stages.total) if stages is not None else (0, 0)
    said = stages.said if stages is not None and stages.number else "self-test"
    echo(Message.of("P-DEMO-STOPPED", number=number, total=total, stage=said), err=True)
    echo(Message.of("P-DEMO-STOPPED-FOLDER", folder=run or folder), err=True)
    goes_on = run is not None and not RunFolder(run).has(names.PROPOSAL)
    echo(f"{NEXT}{again}{f' --resume {run.name}' if goes_on and run is not None else ''}", err=True)
