"""Each instrument of a cell file on its wire."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from drivers.clock import Clock
from simulators.bridge import BridgeAnswerer
from simulators.cellfile import Instrument
from simulators.faults import FaultPlan
from simulators.grinding import WorkPiece
from simulators.inspection import GearMachine
from simulators.optics import LaserCounter, OpticsBench, RotaryReader, SensorReader
from simulators.sensing import GearAnswerer, SensorAnswerer
from simulators.umd import UmdAnswerer

Answerer = UmdAnswerer | BridgeAnswerer
Fetch = Callable[[], WorkPiece | None]


class Instruments:
    """Makes the answerers of one cell; ``fetch`` gives the part to inspect."""

    def __init__(
        self, bench: OpticsBench, clock: Clock, block_s: float, faults: Mapping[str, FaultPlan], fetch: Fetch
    ) -> None:
        self._bench = bench
        self._clock = clock
        self._block_s = block_s
        self._faults = faults
        self._fetch = fetch

    def all(self) -> dict[str, Answerer]:
        """Every instrument of the cell file by its name."""
        return {spec.name: self._answerer(spec) for spec in self._bench.cell.instruments}

    def _answerer(self, spec: Instrument) -> Answerer:
        bench, clock, block_s = self._bench, self._clock, self._block_s
        plan = self._faults.get(spec.name)
        around = plan.around if plan is not None else None
        match spec.kind:
            case "umd":
                return UmdAnswerer(
                    counter=LaserCounter(spec, bench), bench=bench, clock=clock, block_s=block_s, around=around
                )
            case "bridge":
                return BridgeAnswerer(
                    reader=RotaryReader(spec, bench), bench=bench, clock=clock, block_s=block_s, around=around
                )
            case "gear":
                return GearAnswerer(
                    machine=GearMachine(spec, bench.truth.seed),
                    fetch=self._fetch,
                    bench=bench,
                    clock=clock,
                    around=around,
                )
            case _:
                return SensorAnswerer(
                    sensor=SensorReader(spec, bench), bench=bench, clock=clock, block_s=block_s, around=around
                )
