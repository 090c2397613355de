"""One machine through the closing run in virtual time, and the truth's word on it as a `MachineResult`."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest

from drivers.clock import Clock, LoopClock, run_virtual
from drivers.errors import TrueflankError
from drivers.message import prose
from drivers.units import deviation_scale
from gateway.config import SiteFile, load_site
from gateway.store import RunFolder
from gateway.tooth import FlankMap, FlankPrediction, InspectedFlank, ToothProposal, ToothVerdict
from gateway.workflow.complete_run import AFTER, close_site
from gateway.workflow.run import stages
from gateway.workflow.run.outcome import Outcome
from gateway.workflow.tooth.verdict import BEFORE
from simulators.cell import Cell
from simulators.cell.setup_files import write_site_of_files
from simulators.cellfile import CellFile
from simulators.grinding import WorkPiece
from simulators.nck.machine import compensation as table
from tests.closing.identified import Curve, FloatArray, identified
from tests.closing.judge import CROSS, OWN, Machine, b_left_on, floor, kept_floor, places, places_at, rms
from tests.closing.presses import Presses
from tests.closing.reckoned import BLOCK_S, usual_hours
from tests.closing.record import MachineResult, Normalised
from tests.closing.tables import Grid
from tests.selftested import cell_running

# How often a run may do what it must not repeat when it goes on after a stop.
ONCE = {"P-SETUP": 28, "P-PROPOSED": 10, "P-PUSH-ACTIVATE": 12, "P-GRIND-DONE": 3, "P-EVALUATED": 3}
Edit = Callable[[Cell, str], str]
Figures = Mapping[str, float]


@dataclass(frozen=True)
class Ground:
    """A part as the truth has it, and when its wheel began, in seconds of the cell's clock."""

    work: WorkPiece
    start_s: float


@dataclass
class Watched:
    """Listens to a run and keeps every part as soon as it has been inspected.

    ``absent_at`` names a part before which the operator goes home.
    """

    cell: Cell
    absent_at: str = ""
    folder: Path = Path()
    parts: dict[str, Ground] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    presses: Presses = field(default_factory=Presses)
    _began: float = 0.0

    def __post_init__(self) -> None:
        self.presses.log = self.cell.operator.log

    def say(self, code: str, /, **fields: object) -> None:
        """The run's progress."""
        self.said.append(code)
        self.presses.told(code, fields)
        if code == "P-RUN":
            self.folder = Path(str(fields["folder"]))
        if code == "P-PART":
            self._began = self.cell.clock.now()
            self.cell.operator.change(auto=fields["part"] != self.absent_at)
        work = self.cell.shop.ground
        if code == "P-PART-DONE" and work is not None:
            self.parts[str(fields["part"])] = Ground(work, self._began)


@dataclass(frozen=True)
class Closed:
    """A run that came to its end: its folder, its parts, M of each axis (by name) before and after.

    ``acted`` is what the axes' own tables added, um or arcsec by error motion, when it began.
    """

    cell: Cell
    site: SiteFile
    folder: RunFolder
    watched: Watched
    axes: Mapping[str, tuple[float, float]]
    acted: Mapping[str, Curve] = field(default_factory=dict)


@dataclass(frozen=True)
class Remedy:
    """The error that must end the run at first, and what somebody does at the machine before it goes on."""

    code: str
    act: Callable[[Cell], None]


async def closed(
    cell: Cell, clock: Clock, edit: Edit | None = None, absent_at: str = "", remedy: Remedy | None = None
) -> Closed:
    """Close the loop on a running cell; `edit` may change its site file first.

    Where the operator goes home before a part, the run must end with an error and go on when he is back.
    """
    path = cell.site_path
    if edit is not None:
        path.write_text(edit(cell, path.read_text(encoding="utf-8")), encoding="utf-8")
    site = load_site(path)
    names = [axis.name for axis in site.axes]
    before, acted = {name: cell.figures(name, step=0.5)["M"] for name in names}, acting(cell)
    watched = Watched(cell, absent_at)

    async def run(resume: RunFolder | None = None) -> Outcome:
        name = site.site.name
        return await close_site(site, path, apply=True, machine_name=name, clock=clock, say=watched.say, resume=resume)

    resume: RunFolder | None = None
    if remedy is not None:
        with pytest.raises(TrueflankError) as caught:
            await run()
        assert caught.value.code == remedy.code, str(caught.value)
        remedy.act(cell)
        watched.said.clear()  # what was refused had not been done: its set-up begins again
        resume = RunFolder(watched.folder)
    if absent_at:
        with pytest.raises(TrueflankError):
            await run(resume)
        resume = RunFolder(watched.folder)
        watched.absent_at = ""
        cell.operator.change(auto=True)
    outcome = await run(resume)
    axes = {name: (before[name], cell.figures(name, step=0.5)["M"]) for name in names}
    return Closed(cell, site, RunFolder(Path(outcome.run_folder)), watched, axes, acted=acted)


def quick(cell: Cell, text: str) -> str:
    """Every set-up as a file that the cell's bench wrote, and few targets where a push is judged on the axis."""
    path = cell.site_path
    path.write_text(text, encoding="utf-8")
    write_site_of_files(cell, path)
    axes, rest = path.read_text(encoding="utf-8").split("[[setups]]", 1)
    for dense, sparse in (("count = 21", "count = 9"), ("count = 25", "count = 13"), ("s = 5", "s = 3")):
        axes = axes.replace(dense, sparse)
    return f"{axes}[[setups]]{rest}"


def acting(cell: Cell) -> dict[str, Curve]:
    """What the control adds to each measured axis now, um or arcsec by error motion."""
    found: dict[str, Curve] = {}
    for axis in cell.file.axes:
        if axis.measure is not None:
            scale = deviation_scale("deg" if axis.kind == "rotary" else "mm")
            found[str(axis.measure["component"])] = partial(_added, cell.nck.core.axis(axis.name).curve, scale)
    return found


def _added(curve: table.Curve | None, scale: float, at: FloatArray) -> FloatArray:
    return np.zeros_like(at) if curve is None else -scale * curve.at(at)


async def close_machine(
    file: CellFile,
    seed: int,
    folder: Path,
    *,
    short: bool,
    edit: Edit | None = None,
    absent_at: str = "",
    remedy: Remedy | None = None,
    least: bool = True,
) -> MachineResult:
    """The whole run on one machine, judged; an error of ours that ended it is its result. On a virtual loop."""
    clock, began = LoopClock(), perf_counter()
    start_s = clock.now()
    assert file.part is not None
    blank = MachineResult(file.name, seed, file.part.name, file.part.gear.zc, short, clock.utc().isoformat())
    async with cell_running(file, folder, clock, wires="memory", block_s=BLOCK_S) as cell:
        try:
            result = judged(await closed(cell, clock, edit, absent_at, remedy), blank, least=least)
        except TrueflankError as error:
            result = replace(blank, failed=f"{error.code} {error.where}")
        took_s = clock.now() - start_s
        hours = usual_hours(load_site(cell.site_path).times, result.presses, took_s)
        return replace(result, virtual_s=took_s, hours=hours, wall_s=perf_counter() - began)


def judged(done: Closed, blank: MachineResult, *, least: bool = True) -> MachineResult:
    """What the truth says of a finished run, and what the run said of itself; ``least_um`` only where asked for."""
    folder, parts = done.folder, done.watched.parts
    tooth = folder.get(stages.TOOTH, ToothProposal)
    verdict = folder.get(stages.TOOTH_VERDICT, ToothVerdict)
    before, after = parts[BEFORE], parts[AFTER]
    at = places(before.work.spec)
    first = at.flank(before.work)
    grids = grids_of(done.cell.site_path)
    machine = Machine(done.cell.truth, after.work.spec, after.work.seat, after.start_s)
    said = tooth.prediction
    cross = CROSS if any(done.cell.file.machine.cec_points) else OWN
    return replace(
        blank,
        before_um=rms(first),
        set_right_um=rms(at.set_right(first)),
        after_um=rms(at.flank(after.work)),
        floor_um=kept_floor(machine, grids, cross).rms_um,
        least_um=floor(machine, grids, cross=cross).rms_um if least else 0.0,
        u_um=said.u_um,
        predicted_um=said.rms_um,
        rms_u_um=said.rms_u_um,
        points=normalised(after.work, said),
        components=identified(folder, done.cell.truth, done.acted),
        axes=done.axes,
        b_left=(tooth.b_left, b_seen(folder, after.work)),
        done_twice=tuple(sorted(code for code in ONCE if done.watched.said.count(code) > most(code, done.cell.file))),
        outcome=verdict.outcome,
        words=prose(verdict.words),
        presses=done.watched.presses,
    )


def most(code: str, file: CellFile) -> int:
    """How often at most; a live axis table comes back once more, after its sign was proved."""
    live = sum(axis.loaded is not None and axis.loaded.enabled for axis in file.axes)
    return ONCE[code] + (live if code == "P-PUSH-ACTIVATE" else 0)


def normalised(work: WorkPiece, said: FlankPrediction) -> Normalised:
    """(true flank - predicted flank) / u at every point of the prediction."""
    at = places_at(work.spec, said.after.theta_rad, said.after.z_mm)
    return Normalised.of((at.flank(work) - said.after.deviation_um) / said.u_point_um)


def b_seen(folder: RunFolder, work: WorkPiece) -> float:
    """The share of B that the inspected parts before and after show to stay."""
    first, last = (folder.get(stages.inspected(part), InspectedFlank).fitted for part in (BEFORE, AFTER))
    at = places_at(work.spec, first.theta_rad, first.z_mm)
    return b_left_on(_whole(first), _whole(last), at)


def _whole(flank: FlankMap) -> np.ndarray:
    return np.asarray(flank.deviation_um)


def grids_of(site_path: Path) -> dict[str, Grid]:
    """The control's grids by axis letter, as the site file has them."""
    site = tomllib.loads(site_path.read_text(encoding="utf-8"))
    found = {}
    for axis in site["axes"]:
        table = axis["table"]
        low, high, step = (float(table[key]) for key in ("minimum", "maximum", "step"))
        found[str(axis["letter"])] = Grid(low, high, step, float(axis["reference"]), modulo=bool(axis["modulo"]))
    return found


def run_machine(file: CellFile, seed: int, folder: Path, *, short: bool = False, **how: Any) -> MachineResult:
    """The same on a virtual loop of its own."""
    return run_virtual(lambda: close_machine(file, seed, folder, short=short, **how))
