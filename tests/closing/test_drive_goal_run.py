"""A whole closing run for the drive: [gear.goal] transmission in the cell, judged by the flanks truly ground."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.gear.flank import flank_grid
from gateway.reducer.figures import without_limit
from gateway.reducer.records import Reducer
from gateway.reducer.uncertainty import essentials
from gateway.study.drive import reducer_of
from gateway.study.inputs import gear_of, load_gear
from gateway.tooth import FlankMap, ToothProposal
from gateway.workflow.complete_run import AFTER
from gateway.workflow.run import stages
from gateway.workflow.tooth.verdict import BEFORE
from simulators.cell import Cell
from simulators.cellfile import load_cell, with_plan
from simulators.grinding import WorkPiece
from tests.closing.judge import places_at
from tests.closing.reckoned import BLOCK_S
from tests.closing.runs import Closed, closed, quick
from tests.selftested import cell_running

GOAL = '\n[gear.goal]\nkind = "transmission"\ntransmission_arcsec = 60.0\n'
REDUCER = '\n[reducer]\ndatum = "crank-holes"\n'


def for_a_drive(cell: Cell, text: str) -> str:
    """The quick plan, a drive in the gear file, and its transmission error as the goal of the site."""
    site = quick(cell, text)
    gear = cell.site_path.parent / cell_gear(site)
    gear.write_text(gear.read_text(encoding="utf-8") + REDUCER, encoding="utf-8")
    return site + GOAL


def cell_gear(site: str) -> str:
    """The gear file that the site file names."""
    return next(line for line in site.splitlines() if line.startswith("gear = ")).partition("=")[2].strip().strip('"')


def true_flank(drive: Reducer, work: WorkPiece) -> FlankMap:
    """What was ground, as the truth has it, set right: a customer's discs are ground so."""
    grid = flank_grid(drive.gear, profile=11, width=5)
    at = places_at(work.spec, grid.thetas, grid.zs)
    return FlankMap(grid.thetas, grid.zs, at.set_right(work.surplus_um(at.spaces, grid.thetas, grid.zs)))


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_run_for_the_drive_halves_its_transmission_error_by_truth(tmp_path: Path) -> None:
    async def job() -> Closed:
        clock = LoopClock()
        plan = with_plan(load_cell("eleven"))
        async with cell_running(plan, tmp_path, clock, wires="memory", block_s=BLOCK_S) as cell:
            return await closed(cell, clock, for_a_drive)

    done = run_virtual(job)
    tooth = done.folder.get(stages.TOOTH, ToothProposal)
    assert tooth.drive is not None
    assert done.site.work is not None
    file = load_gear(tmp_path / done.site.work.gear)
    assert file.reducer is not None
    drive = without_limit(reducer_of(file.reducer, gear_of(file)))
    nominal = essentials(drive, [None] * len(drive.discs)).error_arcsec
    before, after = (
        essentials(drive, [true_flank(drive, done.watched.parts[name].work)] * len(drive.discs)).error_arcsec
        for name in (BEFORE, AFTER)
    )
    rows = {row.name: row.transmission_arcsec for row in tooth.drive.rows}
    print(f"nominal {nominal:.2f}, true before {before:.2f}, after {after:.2f}; said {rows}; {tooth.drive}")
    assert tooth.drive.goal == "transmission"
    assert after - nominal < 0.5 * (before - nominal)
    # Predicted without pins, cranks and clamping: what those add is in the expected figure with its u.
    expected, u = tooth.drive.transmission_arcsec, tooth.drive.transmission_u_arcsec
    assert after < expected + 2.0 * u
    assert rows["present state"] == pytest.approx(before, rel=0.35)
    assert rows["this goal: transmission"] == pytest.approx(after, rel=0.35)
    assert after < 0.5 * rows["axis tables"]
    assert after < rows["rms"]
    assert [one.name for one in tooth.drive.limits] == ["transmission_arcsec"]
    assert np.isfinite(u)
    assert u > 0.0
