"""The command `demo`: a simulated cell, the whole loop on it, and its result as strips, lines and reports."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.text import Text

from drivers.clock import Clock, LoopClock
from drivers.errors import ConfigError, TrueflankError, words
from drivers.message import Message, fixed
from gateway.cli.cell import CellRequest, cell_process
from gateway.cli.machine.doctor import run_self_test
from gateway.cli.machine.run import ClosingRequest, run_site_command
from gateway.cli.next_steps import show_next, show_outcome
from gateway.cli.options import JsonOption
from gateway.cli.output import NEXT, echo, show_strips
from gateway.remaining import RemainingTime
from gateway.store import RunFolder
from gateway.tooth import FlankMap
from gateway.workflow.run import stages as names

SHIPPED_CELL = "demo"


@dataclass(frozen=True, slots=True)
class DemoRequest:
    """A demo as it was asked for: where it keeps its things, its cell, and what of the loop; ``run`` to go on with."""

    folder: Path
    cell: str
    speed: float
    seed: int | None = None
    axes: bool = False
    everything: bool = False
    run: str = ""

    @property
    def command(self) -> str:
        """The command line that asks for the same, but for the run."""
        words_of_it = ["trueflank demo", "--folder", shlex.quote(str(self.folder))]
        words_of_it += ["--cell", shlex.quote(self.cell)] if self.cell != SHIPPED_CELL else []
        words_of_it += ["--seed", str(self.seed)] if self.seed is not None else []
        words_of_it += ["--all"] if self.everything else []
        return " ".join(words_of_it + (["--axes"] if self.axes else []))

    @property
    def site(self) -> Path:
        """The site file that the cell writes."""
        return self.folder / "site.toml"

    @property
    def asked(self) -> CellRequest:
        """Its cell."""
        return CellRequest(self.cell, self.site, self.speed, self.seed, plan=not self.axes, shared=True)


def run_demo(demo: DemoRequest, *, as_json: bool) -> None:
    """The loop on a simulated machine with the set-ups that pay, or all of them, or of the axes alone.

    Prints figures and paths. Where it stops it says in which stage, where its folder is, and how to go on. Raises
    ConfigError (E-DEMO-RESUME), and what the loop raises.
    """
    clock, began, worked = LoopClock(), time.perf_counter(), os.times()
    if not as_json:
        warn_if_busy()
    if demo.axes:
        with cell_process(demo.asked):
            run_self_test(demo.site, quiet=as_json, clock=clock, own_operator=True)
            run_site_command(demo.site, True, "", as_json=as_json, typed_by_demo=True, clock=clock)
        return
    _demand_resumable(demo)
    with cell_process(demo.asked):
        chosen = None if demo.everything else _worthwhile_setups(demo.site)
        if chosen is not None and not as_json:
            echo(Message.of("P-DEMO-SETUPS", **chosen.told))
        closing = ClosingRequest(
            demo.site,
            apply=True,
            resume=demo.run,
            own_operator=True,
            wanted=chosen.keys if chosen is not None else (),
            clock=clock,
        )
        stages = closing.stages()
        try:
            run_self_test(demo.site, quiet=as_json, clock=clock, own_operator=True)
            outcome = closing.run(quiet=as_json, stages=stages)
        except TrueflankError:
            if not as_json:
                show_stopped_demo(stages, demo.folder, demo.command)
            raise
    if as_json or outcome.exit_code:
        show_outcome(outcome, as_json=as_json)
        return
    ended = os.times()  # the cell has ended too, so its work is counted
    took = DemoDuration(time.perf_counter() - began, sum(ended[:4]) - sum(worked[:4]))
    show_demo_result(outcome, words("S-DEMO-PARTLY", **chosen.told) if chosen is not None else "", took, clock)


def _demand_resumable(demo: DemoRequest) -> None:
    """Refuse to go on where the tables that a run had loaded ended with its simulated control. Raises ConfigError."""
    if not demo.run:
        return
    from gateway.cli.options import open_run
    from gateway.store import Store
    from gateway.workflow.run import stages

    folder = open_run(Store(demo.folder / "runs"), demo.run)
    if folder.has(stages.PROPOSAL):
        raise ConfigError("E-DEMO-RESUME", folder.run_id, command=demo.command)


def _worthwhile_setups(site: Path) -> Any:
    """The set-ups that pay by the ranking of the site as it is. Raises ConfigError, ModelError."""
    from gateway.config import load_site
    from gateway.workflow.errors21.measurement import worthwhile_setups
    from gateway.workflow.tooth.proposal import work_of

    tree = load_site(site)
    return worthwhile_setups(tree, work_of(tree, site).tooth)


def demo_command(
    folder: Annotated[Path, typer.Option(help="Folder for the demo's site file and runs.")] = Path("demo"),
    speed: Annotated[
        float | None,
        typer.Option(
            min=1,
            max=500,
            help="Machine seconds per real second at most; default: as fast as this computer allows.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulated machine.", show_default=False)] = None,
    cell: Annotated[str, typer.Option(help="Cell file, or the name of a shipped cell.")] = "demo",
    axes: Annotated[bool, typer.Option("--axes", help="Axes only: no other error, no part.")] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Measure every set-up of the plan; default: those that matter for the tooth.")
    ] = False,
    resume: Annotated[
        str, typer.Option(help="Continue this run of the demo, which stopped while measuring.", show_default=False)
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """Start a simulated grinder and close the whole loop on it, over its wires: errors, both layers, the part."""

    if axes and (everything or resume):
        raise typer.BadParameter("--axes is a demo of its own: leave --all and --resume away", param_hint="--axes")
    run_demo(
        DemoRequest(folder, cell, speed or 0.0, seed, axes=axes, everything=everything, run=resume), as_json=as_json
    )


# ---- the result: two strips and at most eight lines, or the stage where it stopped

BUSY_RATIO = 1.5
"""Load of the computer for each of its cores, and wall time for each second of work, from which it is called busy."""
USUAL_DEMO_S = 90.0


@dataclass(frozen=True, slots=True)
class DemoDuration:
    """How long a demo took on the wall, and how long its two processes worked, s."""

    wall_s: float
    worked_s: float

    @property
    def busy(self) -> bool:
        """Whether the computer had other things to do: it took long, and little of that was work of ours."""
        return self.wall_s > USUAL_DEMO_S and self.wall_s > BUSY_RATIO * self.worked_s


def warn_if_busy() -> None:
    """Say beforehand that the computer has more to do than it can: the demo takes longer, and comes out the same."""
    if not hasattr(os, "getloadavg"):
        return
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load > BUSY_RATIO * cores:
        echo(Message.of("P-DEMO-BUSY", load=fixed(load, 1), cores=cores))


def show_demo_result(outcome: Any, chosen: str, took: DemoDuration, clock: Clock) -> None:
    """The end of a demo that went well: the report as PDF, its page, the strips, at most eight lines.

    ``chosen`` says which set-ups were measured; "" where all were.
    """
    from gateway.workflow.results.report import material_of

    folder = RunFolder(Path(outcome.run_folder))
    material = material_of(folder)
    paper, page = _write_reports(folder, material, clock)
    show_tooth_strips(material)
    for line in (*result_lines(material, chosen), *_report_lines(paper, page), *_duration_lines(took)):
        echo(line)
    show_next(f"runs show {folder.run_id} --store {folder.path.parent}")


def show_tooth_strips(material: Any) -> None:
    """The tooth before, with its set-up values right, and after, as strips on one scale; nothing without both."""
    from gateway.report.tooth.flank import states

    by = {one.key: one.map for one in states(material.tooth)} if material.tooth is not None else {}
    named = [(word, by[key]) for word, key in (("before", "before-set-right"), ("after", "after")) if key in by]
    if len(named) == len(("before", "after")):
        show_strips(lambda columns, colours: tooth_strips(named, columns, colours=colours))
        echo(Message.of("S-DEMO-STRIP", top=fixed(largest_deviation_um(named), 1)))


def result_lines(material: Any, chosen: str) -> Iterator[str | Message]:
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


def _write_reports(folder: RunFolder, material: Any, clock: Clock) -> tuple[Path | None, Path]:
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


def _report_lines(paper: Path | None, page: Path) -> Iterator[str]:
    if paper is not None:
        yield words("S-DEMO-REPORT", path=paper)
    yield words("S-DEMO-PAGE", path=page)


def _duration_lines(took: DemoDuration) -> Iterator[str]:
    code = "S-DEMO-TOOK-BUSY" if took.busy else "S-DEMO-TOOK"
    yield words(code, wall=f"{took.wall_s:.0f}", worked=f"{took.worked_s:.0f}")


def show_stopped_demo(stages: RemainingTime | None, folder: Path, again: str) -> None:
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


# ---- strips of coloured cells for a terminal, or of plain characters
#
# One column is a space of the gear (several in a narrow terminal): the mean of its left flank above, of its right flank
# below. Red is surplus, blue is missing material, white is on size, as in the pictures of the report.

FloatArray = NDArray[np.float64]
NARROWEST, WIDEST = 10, 120
HALF = "▀"
RAMPS = {1: (231, 224, 217, 210, 203, 160), -1: (231, 189, 147, 111, 69, 26)}
"""Colours of a terminal's 256, from right to the end of the scale: surplus red, missing blue."""
LEVELS = (0.15, 0.5)
"""Shares of the scale at which a plain strip changes its character."""
PLAIN_CELLS = {0: ".", 1: "+", 2: "#", -1: "-", -2: "="}


def strip_cells(flank: FlankMap, width: int) -> FloatArray:
    """Means (2, N) um of left and right flanks, space by space, N at most ``width``; + surplus."""
    spaces, points, _ = flank.deviation_um.shape
    sides = flank.deviation_um.reshape(spaces, 2, points // 2, -1).mean(axis=(2, 3)).T
    if spaces <= width:
        return np.repeat(sides, width // spaces, axis=1)
    edges = np.linspace(0, spaces, width + 1).astype(int)
    return np.stack([sides[:, low:high].mean(axis=1) for low, high in pairwise(edges)], axis=1)


def tooth_strips(named: Sequence[tuple[str, FlankMap]], columns: int, *, colours: bool) -> tuple[Text, ...]:
    """One line for each named flank with its RMS, all on one scale; none wider than ``columns``."""
    head = max(len(name) for name, _ in named) + 1
    tail = max(len(_rms(flank)) for _, flank in named) + 1
    width = max(min(columns - head - tail, WIDEST), NARROWEST)
    rows = [(name, flank, strip_cells(flank, width)) for name, flank in named]
    top = max(1e-9, *(float(np.max(np.abs(row))) for _, _, row in rows))
    paint = _coloured_row if colours else _plain_row
    return tuple(Text.assemble(f"{name:<{head}}", paint(row / top), f" {_rms(flank)}") for name, flank, row in rows)


def largest_deviation_um(named: Sequence[tuple[str, FlankMap]]) -> float:
    """The end of the scale of such strips at their widest, um."""
    return max(float(np.max(np.abs(strip_cells(flank, WIDEST)))) for _, flank in named)


def _rms(flank: FlankMap) -> str:
    return f"{flank.rms_um:.2f}"


def _coloured_row(row: FloatArray) -> Text:
    return Text.assemble(
        *((HALF, f"color({_cell_colour(left)}) on color({_cell_colour(right)})") for left, right in row.T)
    )


def _cell_colour(share: float) -> int:
    """White at 0, red at 1, blue at -1."""
    ramp = RAMPS[1 if share > 0.0 else -1]
    return ramp[min(round(abs(share) * (len(ramp) - 1)), len(ramp) - 1)]


def _plain_row(row: FloatArray) -> Text:
    """The flank of each column that is further off."""
    largest = np.take_along_axis(row, np.argmax(np.abs(row), axis=0)[None], axis=0)[0]
    levels = np.sign(largest).astype(int) * np.searchsorted(LEVELS, np.abs(largest), side="right")
    return Text("".join(PLAIN_CELLS[int(level)] for level in levels))
