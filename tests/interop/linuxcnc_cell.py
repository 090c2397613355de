"""A cell whose control is LinuxCNC's own kernel: simulated instruments look at the plant, a person obeys the messages.

The plant (linuxcnc/plant.py) is the truth, and knows nothing of our simulators: they are told where its slides truly
stand, over a machine without any error of their own.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import numpy as np

from drivers.clock import LoopClock
from simulators.bridge import BridgeServer
from simulators.cellfile import CellFile
from simulators.optics import LaserCounter, OpticsBench, RotaryReader
from simulators.truth import Truth
from simulators.umd import UmdServer
from tests.interop.linuxcnc_host import ROOT, TOKEN, Host

EXAMPLE = ROOT / "examples" / "sites" / "linuxcnc-mill.toml"
JOINTS = {"X1": 0, "C1": 3}
LOOK_S, BLOCK_S, RUN_S = 0.01, 0.02, 1800.0
CELL: dict[str, Any] = {
    "name": "plant",
    "axes": [
        {"name": "X1", "letter": "X", "kind": "linear", "travel": [-500.0, 1500.0]},
        {"name": "C1", "letter": "C", "kind": "rotary", "travel": [-30.0, 390.0]},
    ],
    # What is left at a point of a table is judged to 0.01 um: these scatter by less.
    "instruments": [
        {"kind": "umd", "name": "laser", "noise": {"stop": 0.002, "sample": 0.01}},
        {"kind": "bridge", "name": "calibrator", "turn_deg_per_s": 400.0, "noise": {"stop": 0.002, "sample": 0.02}},
    ],
    "setups": [
        {"component": "EXX", "axis": "X", "instrument": "laser", "optics": "linear", "dead_path_mm": 0.0},
        {"component": "ECC", "axis": "C", "instrument": "calibrator", "optics": "rotary"},
    ],
}


class Plant(LoopClock):
    """Where the slides truly stood (a simulators.optics.MotionSource), and the instruments' clock.

    That clock stands at the last look: what an instrument reads is known at both ends, however busy the computer is.
    """

    def __init__(self, host: Host) -> None:
        super().__init__()
        self._host = host
        self._times: list[float] = [super().now()]
        self._true: list[list[float]] = [[0.0] * 4]

    async def watch(self) -> None:
        while True:
            with contextlib.suppress(OSError, ValueError, TypeError):
                seen = await self._host.person("true")
                self._true.append(seen["true"])
                self._times.append(super().now())
                del self._times[:-2000], self._true[:-2000]
            await self.sleep(LOOK_S)

    def now(self) -> float:
        return self._times[-1]

    def encoder(self, axis: str, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        places = np.interp(times, self._times, [true[JOINTS[axis]] for true in self._true])
        return places, np.ones_like(places)


@contextlib.asynccontextmanager
async def instruments(host: Host) -> AsyncIterator[tuple[str, str]]:
    """Laser and calibrator mounted on the mill; their urls."""
    plant = Plant(host)
    bench = OpticsBench(Truth(CellFile.model_validate(CELL)), plant)
    for setup in bench.cell.setups:
        bench.mount(setup)
    laser = UmdServer(LaserCounter(bench.cell.instruments[0], bench), bench, plant, BLOCK_S)
    calibrator = BridgeServer(RotaryReader(bench.cell.instruments[1], bench), bench, plant, BLOCK_S)
    watching = asyncio.get_running_loop().create_task(plant.watch())
    try:
        yield await laser.start("socket://127.0.0.1:0"), await calibrator.start("tcp://127.0.0.1:0")
    finally:
        await laser.stop()
        await calibrator.stop()
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)


def site_of(host: Host, serial: str, urls: tuple[str, str], changes: dict[str, str]) -> Path:
    """The example's site file with this mill's addresses, and ``changes`` from pattern to text; each must fit."""
    text = EXAMPLE.read_text(encoding="utf-8")
    told = {
        r"tcp://127\.0\.0\.1:5011": f"tcp://127.0.0.1:{host.port}",
        r"mill-0123456789ab": serial,
        r"COM5": urls[0],
        r"tcp://127\.0\.0\.1:9311": urls[1],
        **changes,
    }
    for pattern, new in told.items():
        text, count = re.subn(pattern, new, text)
        assert count, pattern
    folder = host.folder.parent / "site"
    folder.mkdir()
    (folder / "token.txt").write_text(TOKEN)
    (folder / "token.txt").chmod(0o600)
    path = folder / "site.toml"
    path.write_text(text, encoding="utf-8")
    return path


async def command(*words: str, heard: Callable[[str], Any] | None = None) -> tuple[int, str]:
    """Run `trueflank` with these words; ``heard`` is awaited for each line of it."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "gateway.cli", *words),
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "400"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    assert process.stdout is not None
    lines: list[str] = []
    try:
        async with LoopClock().deadline(RUN_S, "trueflank"):
            async for line in process.stdout:
                lines.append(line.decode().rstrip())
                if heard is not None:
                    await heard(lines[-1])
            await process.wait()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return process.returncode or 0, "\n".join(lines)


class Person:
    """Obeys what the screen says: presses Cycle Start, restarts LinuxCNC and homes its axes."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.restarts = 0

    async def hears(self, line: str) -> None:
        told = line.lower()
        if "restart of linuxcnc" in told and "reference the axes" in told:
            self.restarts += 1
            await self.host.restart()
        elif "press cycle start" in told:
            await self.host.person("start")
            if "mount" in told:
                await self.host.person("resume")
