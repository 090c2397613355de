"""A machine measured from files and its first part, ground and inspected by the truth: what a closing run then asks it.

No program runs and nobody presses: the set-ups are files of the cell's bench, the part is ground in a planned run, and
`close_site` goes on with the run that holds both. So it is the command's own way from the readings to the proposal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from drivers.types.gears import GearInspection
from gateway.config import SiteFile, load_site
from gateway.correct.part.inspected import InspectionSource, inspected_flank
from gateway.domain.captures import Capture
from gateway.say import silence
from gateway.store import RunFolder
from gateway.tooth import FlankAgreement, GroundPart, InspectedFlank, SetupValues
from gateway.workflow.complete_run import close_site
from gateway.workflow.errors21.measurement import measure_site
from gateway.workflow.run import stages
from gateway.workflow.tooth.proposal import work_of
from gateway.workflow.tooth.verdict import BEFORE
from simulators.cell import Cell
from simulators.cell.setup_files import write_site_of_files
from simulators.cellfile import CellFile, InspectionMachine
from simulators.inspection import GearMachine
from simulators.truth import Truth
from tests.closing.reckoned import BLOCK_S
from tests.selftested import cell_running
from tests.unit.simulators.planned_run import ground

X_MM, DRESSING_MM = 0.02, -0.01
"""How far off its zeros the part is ground: nobody knows them before the first part."""


@dataclass(frozen=True)
class Asked:
    """What a run found of its part and how it ended: the error's code and exit code, none where it proposed."""

    found: FlankAgreement
    code: str
    exit_code: int
    proposed: bool
    text: str


def turned(file: CellFile, *components: str) -> CellFile:
    """The cell with the optics of these components mounted the wrong way round."""
    setups = [one.model_copy(update={"reversed": True}) if one.component in components else one for one in file.setups]
    assert set(components) <= {one.component for one in file.setups}
    return file.model_copy(update={"setups": tuple(setups)})


def part_of(file: CellFile, site: SiteFile, site_path: Path) -> InspectedFlank:
    """The part that the truth grinds, off its zeros, eccentric on both machines, as the gear machine finds it."""
    assert file.part is not None
    truth, gear = Truth(file), work_of(site, site_path).gear
    spec = next(one for one in file.instruments if isinstance(one, InspectionMachine))
    work = ground(truth, file.part, x_mm=X_MM, dressing_mm=DRESSING_MM)
    seen = GearMachine(spec, truth.seed).inspect(work, 11, 5)
    found = GearInspection(seen.points_mm, seen.space, seen.flank, deviation_um=seen.deviation_um)
    return inspected_flank(gear, found, InspectionSource(BEFORE, "truth", heights="middle"))


async def asked(
    file: CellFile, folder: Path, resume: Callable[[Cell, Path], None] | None = None
) -> tuple[Asked, Asked | None]:
    """Measure, put the part of the true machine into the run, and propose; ``resume`` acts before the run goes on.

    The second is None without it.
    """
    clock = LoopClock()
    async with cell_running(file, folder, clock, wires="memory", block_s=BLOCK_S) as cell:
        path = write_site_of_files(cell, cell.site_path)
        site = load_site(path)
        run = RunFolder(Path((await measure_site(site, path, clock=clock, say=silence)).run_folder))
        live = {
            axis: capture.live.digest
            for axis, capture in ((one.axis, one) for one in _captures(run))
            if capture.live is not None
        }
        run.put(stages.ground(BEFORE), GroundPart(BEFORE, SetupValues(), site_spaces(file), "", "", live))
        run.put(stages.inspected(BEFORE), part_of(file, site, path))
        first = await _closed(path, run, clock)
        if resume is None:
            return first, None
        resume(cell, path)
        return first, await _closed(path, RunFolder(run.path), clock)


def site_spaces(file: CellFile) -> int:
    """How many spaces the cell's part has."""
    assert file.part is not None
    return file.part.gear.zc


def _captures(run: RunFolder) -> list[Capture]:
    names = [name for name in run.stages if name.startswith("setup-") and not name.endswith(("-raw", "-proof"))]
    return [run.get(name, Capture) for name in names]


async def _closed(path: Path, run: RunFolder, clock: LoopClock) -> Asked:
    code, exit_code, text = "", 0, ""
    try:
        await close_site(load_site(path), path, apply=False, machine_name="", clock=clock, say=silence, resume=run)
    except TrueflankError as error:
        code, exit_code, text = error.code, error.exit_code, str(error)
    found = run.get(stages.AGREEMENT, FlankAgreement)
    return Asked(found, code, exit_code, proposed=run.has(stages.PROPOSAL), text=text)
