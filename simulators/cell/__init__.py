"""A complete cell on loopback: truth, control, instruments, operator, and the site file that describes it."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, LoopClock
from simulators.cell.builder_cycle import cycle_path, cycle_text
from simulators.cell.capture_pc import CapturePc
from simulators.cell.connections import ControlConnections, Instruments
from simulators.cell.control import CellNck, ControlPanel, live_deviation, load_builder_tables, spec_of
from simulators.cell.site import gear_text, site_text
from simulators.cell.workplace import MailboxPanel, ShopFloor
from simulators.cellfile import CellAxis, CellFile, load_cell, with_connections
from simulators.faults import FaultPlan
from simulators.grinding import WorkPiece
from simulators.instrument_server import InstrumentServer
from simulators.modbus import PlcStation
from simulators.operator import Operator
from simulators.optics import OpticsBench
from simulators.truth import Truth

__all__ = ["Cell", "cell_running"]

FloatArray = NDArray[np.float64]
WireKind = Literal["tcp", "memory"]
_numbers = itertools.count(1)


class Cell:
    """One simulated machine with its wires.

    `source` is a packaged cell's name, a path or a `CellFile`; `seed` redraws the truth, `flip` reverses all
    its signs. `wires` "tcp" listens on free loopback ports, "memory" stays in this process and loop (OPC UA
    is on loopback in both). ``block_s`` is how much instrument time one block of a stream holds, at least.
    ``road`` "opcua", "modbus" or "both" stands before the cell file's `roads`, ``modbus`` over its settings of
    the PLC; ``faults`` are named by instrument, or "plc". ``paced`` is for gateways on the same clock.
    """

    def __init__(
        self,
        source: str | Path | CellFile,
        folder: Path,
        clock: Clock,
        *,
        seed: int | None = None,
        flip: bool = False,
        wires: WireKind = "tcp",
        block_s: float = 0.25,
        faults: dict[str, FaultPlan] | None = None,
        site_path: Path | None = None,
        road: str = "",
        modbus: dict[str, Any] | None = None,
        paced: bool = False,
    ) -> None:
        self.file = with_connections(source if isinstance(source, CellFile) else load_cell(source), road, modbus or {})
        self.clock = clock
        self.truth = Truth(self.file, seed, flip=flip)
        self.site_path = site_path or folder / "site.toml"
        self.nck = CellNck(spec_of(self.file, self.truth.seed), clock)
        self.panel = ControlPanel(self.nck)
        self.bench = OpticsBench(self.truth, self.nck)
        parameter = self.file.wheel.parameter
        self.shop = ShopFloor(
            self.file, self.bench, clock, lambda: 0.0 if parameter is None else self.nck.core.r[parameter]
        )
        self._folder = folder
        self._wires = wires
        self._number = next(_numbers)
        self.instruments = Instruments(
            bench=self.bench, clock=clock, block_s=block_s, faults=faults or {}, fetch=self._to_inspect
        ).all()
        self._urls: dict[str, str] = {}
        memory = f"cell-{self._number}" if wires == "memory" else ""
        self.connections = ControlConnections(
            file=self.file,
            nck=self.nck,
            clock=clock,
            folder=folder,
            memory=memory,
            plan=(faults or {}).get("plc"),
            paced=paced or bool(memory),
        )
        self.server, self.plc, self.password = self.connections.server, self.connections.plc, self.connections.password
        self.mailbox = MailboxPanel(self.plc) if self.plc is not None else None
        axes = [axis.name for axis in self.file.axes]
        self.operator = Operator(
            # Where files are carried, one person does all of it.
            spec=self.file.operator.model_copy(
                update={"auto": self.file.operator.auto and self.connections.porter is None}
            ),
            control=self.panel,
            bench=self.bench,
            clock=clock,
            axes=axes,
            panel=self.mailbox,
            table=self.shop,
        )

    def _to_inspect(self) -> WorkPiece | None:
        """The part ground last, carried to the inspection machine; nobody takes it out of a running program."""
        return None if self.nck.channel_status != 0 else self.shop.take_to_inspection()

    async def start(self) -> Path:
        """Switch everything on; returns the site file's path."""
        self._folder.mkdir(parents=True, exist_ok=True)
        await self._power_up()
        for name, answerer in self.instruments.items():
            self._urls[name] = await answerer.start(self._url(name))
        await self.connections.start()
        self.operator.start()
        self.shop.start()
        self._write_site()
        return self.site_path

    def run_builder_cycle(self) -> bool:
        """The person selects the builder's own cycle for the part; False without a part or while a program runs."""
        if self.file.part is None:
            return False
        self.nck.files.write(cycle_path(), cycle_text(self.file, self.file.part).encode("ascii"))
        return self.operator.select(cycle_path())

    async def _power_up(self) -> None:
        """The machine as one finds it on a working day: what its builder loaded acts, referenced, in AUTO."""
        load_builder_tables(self.nck, self.file, self.truth.seed)
        await self.nck.start()
        for axis in self.file.axes:
            if axis.backlash:
                self.nck.set(f"$MA_BACKLASH[0,{axis.name}]", axis.backlash, 0)
        self.nck.channel_reset()
        await self.operator.power_up()

    def _url(self, name: str) -> str:
        if self._wires == "memory":
            return f"memory://cell-{self._number}-{name}"
        kind = next(found.kind for found in self.file.instruments if found.name == name)
        return "socket://127.0.0.1:0" if kind == "umd" else "tcp://127.0.0.1:0"

    def _write_site(self) -> None:
        """The site file with the first road; further roads in files beside it, named after them."""
        self.site_path.parent.mkdir(parents=True, exist_ok=True)
        gear = self.site_path.with_suffix(".gear.toml")
        if self.file.part is not None:
            gear.write_text(gear_text(self.file.part), encoding="utf-8")
        for place, (road, controller) in enumerate(self.connections.sections().items()):
            path = self.site_path if place == 0 else self.site_path.with_suffix(f".{road}.toml")
            text = site_text(
                self.file, self.file.machine.serial, controller=controller, urls=self._urls, gear=str(gear.resolve())
            )
            path.write_text(text, encoding="utf-8")

    async def stop(self) -> None:
        """Switch everything off, in the other order."""
        await self.shop.stop()
        await self.operator.stop()
        await self.connections.stop()
        for answerer in self.instruments.values():
            await answerer.stop()
        await self.nck.stop()

    # ------------------------------------------------------------ the back door: the truth, for judges only

    def axis(self, name: str) -> CellAxis:
        """An axis of the cell file by name or letter."""
        return self.file.axis(name)

    def raw_deviation(self, axis: str, positions: FloatArray, direction: int, t: float | None = None) -> FloatArray:
        """Deviation of the bare mechanism, um or arcsec at 20 degC, without any compensation."""
        return self.truth.deviation(axis, positions, direction, self.clock.now() if t is None else t)

    def true_deviation(self, axis: str, positions: FloatArray, direction: int, t: float | None = None) -> FloatArray:
        """True position - commanded (n,), um or arcsec at 20 degC, as the control compensates right now."""
        moment = self.clock.now() if t is None else t
        return live_deviation(self.truth, self.nck, axis=axis, positions=positions, direction=direction, t=moment)

    def figures(self, axis: str, *, live: bool = True, step: float = 0.1) -> dict[str, float]:
        """M, B and E of the truth itself over the measured range on a grid: no noise, no instrument."""
        places, unit = self.grid(axis, step), self.true_deviation if live else self.raw_deviation
        up, down = (unit(axis, places, direction, 0.0) for direction in (1, -1))
        both = np.concatenate((up, down))
        mean_range = float(np.ptp((up + down) / 2.0))
        return {"M": mean_range, "B": float(np.max(np.abs(up - down))), "E": float(np.ptp(both))}

    def grid(self, axis: str, step: float = 0.1) -> FloatArray:
        """Positions over the measured range of an axis, or over the whole turn of a modulo axis."""
        spec = self.file.axis(axis)
        if spec.modulo:
            return np.arange(0.0, 360.0, step)
        targets = (spec.measure or {}).get("targets", {})
        ends = targets.get("positions") or (targets.get("first"), targets.get("last"))
        low, high = (min(ends), max(ends)) if None not in ends else spec.travel
        return np.asarray(low + step * np.arange(int((high - low) / step + 0.5) + 1))

    def write_result_file(self, axis: str, path: Path, repetitions: int = 5) -> Path:
        """Measure an axis with the capture PC at the instrument and save its .rtl or .rta."""
        spec = self.file.axis(axis)
        return CapturePc(
            bench=self.bench, nck=self.nck, axis=spec, start_s=self.clock.now(), start_utc=self.clock.utc()
        ).save(path, repetitions)

    # ------------------------------------------------------------ faults, set live

    async def power_cycle(self) -> None:
        """The main switch, off and on: the NCK, and the PLC with its wire if there is one."""
        if self.plc is not None:
            await self.plc.power_cycle()
        else:
            self.nck.power_cycle()

    def outlet(self, name: str) -> InstrumentServer:
        """An instrument's wire, or that of the PLC by the name "plc"."""
        return self.plc if name == "plc" and self.plc is not None else self.instruments[name]

    async def pull(self, instrument: str) -> None:
        """Pull an instrument's line."""
        await self.outlet(instrument).pull()

    async def plug(self, instrument: str) -> None:
        """Put the line back where it was."""
        outlet = self.outlet(instrument)
        await outlet.plug(outlet.home if isinstance(outlet, PlcStation) else self._urls[instrument])

    def beam(self, instrument: str, *, broken: bool) -> None:
        """Put something into the beam, or take it out."""
        (self.bench.broken.add if broken else self.bench.broken.discard)(instrument)


@contextlib.asynccontextmanager
async def cell_running(
    source: str | Path | CellFile, folder: Path, clock: Clock | None = None, **options: Any
) -> AsyncIterator[Cell]:
    """A cell for the length of a block."""
    cell = Cell(source, folder, clock or LoopClock(), **options)
    try:
        await cell.start()
        yield cell
    finally:
        await cell.stop()
