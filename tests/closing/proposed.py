"""What a proposal would do to the true machine: its tables tried there, without a control that writes or a part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from drivers.clock import LoopClock
from drivers.types.tables import CompensationTable
from drivers.units import deviation_scale
from gateway.config import SiteFile, load_site
from gateway.domain.proposals import Proposal
from gateway.say import silence
from gateway.store import RunFolder
from gateway.tooth import ToothProposal
from gateway.workflow import complete_run
from gateway.workflow.complete_run import close_site
from gateway.workflow.run import stages
from gateway.workflow.run.outcome import Outcome
from simulators.cell.setup_files import write_site_of_files
from simulators.cellfile import CellFile
from simulators.grinding.grinder import rotation_axis_frame
from simulators.truth import Truth
from tests.closing.judge import places_at, rms
from tests.selftested import cell_running
from tests.unit.simulators.planned_run import ground

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tried:
    """True flanks before and with the proposed tables, set-up values right in both, RMS in um; ``missed_um`` of the
    prediction, whose standard uncertainty is ``u_um``, split by ``parts_um``. ``axes``: M of X1 and Z1 before and with
    their tables, um.
    """

    before_um: float
    after_um: float
    missed_um: float
    u_um: float
    axes: Mapping[str, tuple[float, float]]
    run: Path
    parts_um: Mapping[str, float] = field(default_factory=dict)


async def tried(file: CellFile, folder: Path, *, report: bool = True) -> Tried:
    """Measure every set-up from files, take the proposal, and grind on the truth with what it proposes.

    Without its ``report`` a run takes half the time.
    """
    clock = LoopClock()
    async with cell_running(file, folder, clock, wires="memory", block_s=1.0) as cell:
        path = write_site_of_files(cell, cell.site_path)
        with nullcontext() if report else patch.object(complete_run, "closing_outcome", _unreported):
            done = await close_site(load_site(path), path, apply=False, machine_name="", clock=clock, say=silence)
    run = RunFolder(Path(done.run_folder))
    tables = [one.new for one in run.get(stages.PROPOSAL, Proposal).changes if not one.skipped]
    return _judged(Truth(file), tables, run.get(stages.TOOTH, ToothProposal), run.path)


def _unreported(folder: RunFolder, _site: SiteFile) -> Outcome:
    return Outcome(folder.state, str(folder.path), rows=(), lines=(), data={})


def _judged(truth: Truth, tables: Sequence[CompensationTable], tooth: ToothProposal, run: Path) -> Tried:
    part, said = truth.cell.part, tooth.prediction
    assert part is not None
    at = places_at(part, said.after.theta_rad, said.after.z_mm)
    seat = rotation_axis_frame(truth, part.grinding.height_mm)
    first = at.set_right(at.flank(ground(truth, part, seat)))
    last = at.set_right(at.flank(ground(truth, part, seat, corrections=corrections(tables))))
    missed = rms(last - at.set_right(at.turned_off(said.after.deviation_um)))
    axes = {name: _ranges(truth, name, tables) for name in ("X1", "Z1")}
    return Tried(rms(first), rms(last), missed_um=missed, u_um=said.u_um, axes=axes, run=run, parts_um=said.parts_um)


def corrections(tables: Sequence[CompensationTable]) -> dict[str, Any]:
    """What the tables add to the encoders, mm or deg, by letter of the output axis: against what they cancel."""

    def added(out: str) -> Any:
        mine = [one for one in tables if one.output_axis[0] == out]
        scale = deviation_scale("deg" if out == "C" else "mm")
        return lambda at: -sum(_cancelled(one, at[one.input_axis[0]]) for one in mine) / scale

    return {out: added(out) for out in {one.output_axis[0] for one in tables}}


def _cancelled(table: CompensationTable, at: FloatArray) -> FloatArray:
    place = np.mod(at - table.minimum, table.maximum - table.minimum) + table.minimum if table.modulo else at
    return np.interp(place, table.positions, table.deviations)


def _ranges(truth: Truth, axis: str, tables: Sequence[CompensationTable]) -> tuple[float, float]:
    """M of an axis, bare and with its own table, um."""
    low, high = (-400.0, 0.0) if axis == "X1" else (0.0, 300.0)
    at = np.linspace(low, high, 801)
    bare = 0.5 * (truth.deviation(axis, at, 1) + truth.deviation(axis, at, -1))
    own = [one for one in tables if one.kind == "axis" and one.output_axis == axis]
    return float(np.ptp(bare)), float(np.ptp(bare - sum((_cancelled(one, at) for one in own), np.zeros_like(at))))
