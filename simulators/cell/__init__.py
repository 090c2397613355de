"""A whole cell on loopback: truth, control, instruments and operator, and a site file that leads to them."""

from __future__ import annotations

import contextlib
import itertools
import secrets
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, LoopClock
from simulators.bridge import BridgeAnswerer
from simulators.cell.control import CellNck, ControlPanel, live_deviation, spec_of
from simulators.cell.results import CapturePc
from simulators.cell.site import site_text
from simulators.cellfile import Axis, CellFile, load_cell
from simulators.faults import FaultPlan
from simulators.opcua import SinumerikServer
from simulators.operator import Operator
from simulators.optics import Bench, LaserCounter, RotaryReader
from simulators.truth import Truth
from simulators.umd import UmdAnswerer

__all__ = ["Cell", "cell_running"]

FloatArray = NDArray[np.float64]
Wires = Literal["tcp", "memory"]
USER = "trueflank"
# In virtual time nobody is kept waiting by a slow poll, and every poll costs the test real time.
VIRTUAL_PACE = {"poll_s": 1.0, "fast_poll_s": 0.4}
_numbers = itertools.count(1)


class Cell:
    """One simulated machine with its wires.

    `source` is a packaged cell's name, a path or a `CellFile`; `seed` redraws the truth, `flip` reverses all
    its signs. `wires` "tcp" listens on free loopback ports, "memory" stays in this process and loop (OPC UA
    is on loopback in both). ``block_s`` is how much instrument time one block of a stream holds, at least.
    """

    def __init__(
        self,
        source: str | Path | CellFile,
        folder: Path,
        clock: Clock,
        *,
        seed: int | None = None,
        flip: bool = False,
        wires: Wires = "tcp",
        block_s: float = 0.25,
        faults: dict[str, FaultPlan] | None = None,
        site_path: Path | None = None,
    ) -> None:
        self.file = source if isinstance(source, CellFile) else load_cell(source)
        self.clock = clock
        self.truth = Truth(self.file, seed, flip=flip)
        self.site_path = site_path or folder / "site.toml"
        self.nck = CellNck(spec_of(self.file, self.truth.seed), clock)
        self.panel = ControlPanel(self.nck)
        self.bench = Bench(self.truth, self.nck)
        axes = [axis.name for axis in self.file.axes]
        self.operator = Operator(self.file.operator, self.panel, self.bench, clock, axes)
        self._folder = folder
        self._wires = wires
        self._number = next(_numbers)
        self.instruments = {
            spec.name: self._answerer(spec.name, block_s, (faults or {}).get(spec.name))
            for spec in self.file.instruments
        }
        self._urls: dict[str, str] = {}
        self.password = secrets.token_urlsafe(12)
        self.server = SinumerikServer(self.nck, clock, self._server_settings())

    def _answerer(self, name: str, block_s: float, plan: FaultPlan | None) -> UmdAnswerer | BridgeAnswerer:
        spec = next(found for found in self.file.instruments if found.name == name)
        around = plan.around if plan is not None else None
        if spec.kind == "umd":
            return UmdAnswerer(LaserCounter(spec, self.bench), self.bench, self.clock, block_s, around)
        return BridgeAnswerer(RotaryReader(spec, self.bench), self.bench, self.clock, block_s, around)

    def _server_settings(self) -> dict[str, Any]:
        own = {"users": {USER: self.password}, "folder": str(self._folder / "control")}
        return own | self.file.machine.opcua

    async def start(self) -> Path:
        """Switch everything on; returns the site file's path."""
        self._folder.mkdir(parents=True, exist_ok=True)
        await self._power_up()
        for name, answerer in self.instruments.items():
            self._urls[name] = await answerer.start(self._url(name))
        await self.server.start()
        self.operator.start()
        self._write_site()
        return self.site_path

    async def _power_up(self) -> None:
        """The machine as one finds it on a working day: referenced, in AUTO."""
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
        secret = self._folder / "password.txt"
        secret.touch(mode=0o600)
        secret.write_text(self.password + "\n", encoding="utf-8")
        settings: dict[str, Any] = {"user": USER, "password_file": str(secret.resolve())}
        certificate = Path(self.server.certificate)
        settings |= {"security": "Basic256Sha256", "server_certificate": str(certificate.resolve())}
        if self._wires == "memory":
            settings |= VIRTUAL_PACE
        controller = {"url": self.server.url, "settings": settings | self.file.site.controller_settings}
        text = site_text(self.file, self.file.machine.serial, controller, self._urls)
        self.site_path.parent.mkdir(parents=True, exist_ok=True)
        self.site_path.write_text(text, encoding="utf-8")

    async def stop(self) -> None:
        """Switch everything off, in the other order."""
        await self.operator.stop()
        await self.server.stop()
        for answerer in self.instruments.values():
            await answerer.stop()
        await self.nck.stop()

    # ------------------------------------------------------------ the back door: the truth, for judges only

    def axis(self, name: str) -> Axis:
        """An axis of the cell file by name or letter."""
        return self.file.axis(name)

    def raw_deviation(self, axis: str, positions: FloatArray, direction: int, t: float | None = None) -> FloatArray:
        """Deviation of the bare mechanism, um or arcsec at 20 degC, without any compensation."""
        return self.truth.deviation(axis, positions, direction, self.clock.now() if t is None else t)

    def true_deviation(self, axis: str, positions: FloatArray, direction: int, t: float | None = None) -> FloatArray:
        """True position - commanded (n,), um or arcsec at 20 degC, as the control compensates right now."""
        moment = self.clock.now() if t is None else t
        return live_deviation(self.truth, self.nck, axis, positions, direction, moment)

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
        return CapturePc(self.bench, self.nck, spec, self.clock.now(), self.clock.utc()).save(path, repetitions)

    # ------------------------------------------------------------ faults, set live

    async def pull(self, instrument: str) -> None:
        """Pull an instrument's line."""
        await self.instruments[instrument].pull()

    async def plug(self, instrument: str) -> None:
        """Put the line back where it was."""
        await self.instruments[instrument].plug(self._urls[instrument])

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
