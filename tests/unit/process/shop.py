"""A simulated gear shop for the tests: a wheel with its faults, parts ground with it and inspected."""

from __future__ import annotations

import numpy as np

from drivers.types.gears import GearInspection
from gateway.correct.part.inspected import InspectionSource, inspected_flank
from gateway.gear.cycloid import CycloidGear
from gateway.process.wheel_form import ProcessPart
from gateway.tooth import InspectedFlank
from simulators.cellfile import InspectionMachine
from simulators.grinding import Grinder, WorkPiece
from simulators.inspection import GearMachine
from simulators.optics import OpticsBench
from simulators.truth import Truth
from tests.unit.simulators.planned_run import PlannedRun
from tests.unit.simulators.test_grinding import DISTANCE, ELEVEN, RV40, cell_of

GEAR = CycloidGear(**RV40)
DISC = CycloidGear(**ELEVEN)
DISC_DISTANCE = 190.0
ORDER = tuple(range(DISC.zc))


class Shop:
    """One machine with the gear of eleven lobes, which is ground quickly; each part is dressed for by itself."""

    def __init__(self, wheel: dict[str, object], motions: dict[str, object] | None = None, seed: int = 5) -> None:
        self.cell = cell_of(motions, gear=ELEVEN, wheel=wheel)  # type: ignore[arg-type]
        run = PlannedRun(self.cell, self.cell.part)  # type: ignore[arg-type]
        self._run = run
        self.grinder = Grinder(OpticsBench(Truth(self.cell), run), self.cell.part, self.cell.wheel, self._dressing)  # type: ignore[arg-type]
        spec = {"kind": "gear", "name": "gear", "noise_um": 0.2, "clamping": {"eccentric_um": 0.5}}
        self.machine = GearMachine(InspectionMachine.model_validate(spec), seed)
        self.count = 0

    def _dressing(self) -> float:
        return self._run.dressing_mm

    def set_up(self, x_um: float, dressing_um: float) -> None:
        """What a person sets for the next parts."""
        self._run = PlannedRun(self.cell, self.cell.part, x_mm=1e-3 * x_um, dressing_mm=1e-3 * dressing_um)  # type: ignore[arg-type]
        self.grinder._bench.machine = self._run

    def grind(self) -> WorkPiece:
        """Dress, clamp, grind."""
        self._run.start_s = self._run.end_s + 1.0 if self.count else 0.0
        self.count += 1
        work = self.grinder.load(self._run.start_s)
        self.grinder.follow(self._run.end_s, whole=True)
        self.grinder.unload(self._run.end_s)
        return work

    def inspect(self, work: WorkPiece) -> InspectedFlank:
        """What the gateway gets to know of a part."""
        got = self.machine.inspect(work, 15, 5)
        found = GearInspection(got.points_mm, got.space, got.flank, probe_u_um=0.2, source="machine")
        return inspected_flank(DISC, found, InspectionSource(f"part {self.count}", heights="middle"))

    def part(self, dressing: str = "") -> tuple[ProcessPart, InspectedFlank]:
        """The next part."""
        found = self.inspect(self.grind())
        return ProcessPart.of(found, order=ORDER, dressing=dressing), found


__all__ = ["DISC", "DISC_DISTANCE", "DISTANCE", "GEAR", "ORDER", "Shop", "np"]
