"""The `trueflank_cell` fixture: a simulated cell for a test, with its truth by a back door.

def test_my_driver(trueflank_cell):
    cell = trueflank_cell("demo", speed=100.0, seed=3)   # a process of its own, on loopback ports
    run_something(cell.site)                             # a ready site file
    assert max(cell.deviation("C1", [0.0, 90.0], 1)) < 1.0

def test_in_virtual_time(trueflank_cell):
    async def main(cell):                                # cell: simulators.cell.Cell, same loop
        ...
    trueflank_cell.in_memory(main, "zero")               # hours in seconds, nothing on a wire but OPC UA
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Coroutine, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import pytest

T = TypeVar("T")
STOP_S = 20.0


class WireCell:
    """A cell running as a child process; it ends with `stop`, or by itself when this process is gone."""

    def __init__(self, folder: Path, source: str | Path, options: Sequence[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._log = folder / "cell.stderr.txt"
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
                [sys.executable, "-m", "simulators.cell", str(source), "--site", str(folder / "site.toml"), *options],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
            )
        try:
            self.ready = self._line()
        except RuntimeError:
            self.stop()
            raise
        self.site = Path(self.ready["site"])

    def _line(self) -> dict[str, Any]:
        line = self._process.stdout.readline() if self._process.stdout else b""
        if not line:
            raise RuntimeError(f"the cell ended: {self._log.read_text(encoding='utf-8', errors='replace')}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _say(self, question: dict[str, Any]) -> dict[str, Any]:
        if self._process.stdin is None:
            raise RuntimeError("the cell has no stdin")
        self._process.stdin.write(json.dumps(question).encode() + b"\n")
        self._process.stdin.flush()
        answer = self._line()
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def ask(self, word: str, **fields: Any) -> dict[str, Any]:
        """Ask the back door: "deviation", "figures", "tables", "status", "senses"."""
        return self._say({"ask": word, **fields})

    def set(self, word: str, **fields: Any) -> dict[str, Any]:
        """Set a fault or press a button: "pull", "beam", "serial", "variable", "nc_start", "operator", ..."""
        return self._say({"set": word, **fields})

    def deviation(self, axis: str, positions: Sequence[float], direction: int, state: str = "live") -> list[float]:
        """True position - commanded in um or arcsec at 20 degC; state "raw" leaves every compensation out."""
        places = [float(position) for position in positions]
        answer = self.ask("deviation", axis=axis, positions=places, direction=direction, state=state)
        return [float(value) for value in answer["deviation"]]

    def stop(self) -> int:
        """Close its pipe and wait for its end; returns its exit code."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            return self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()
        finally:
            if self._process.stdout is not None:
                self._process.stdout.close()


class CellStarter:
    """What the fixture gives: call it for a cell on wires, or run a coroutine with one in virtual time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: list[WireCell] = []

    def __call__(
        self,
        source: str | Path = "demo",
        *,
        speed: float = 100.0,
        seed: int | None = None,
        flip: bool = False,
        options: Sequence[str] = (),
    ) -> WireCell:
        """Start a cell as a process of its own; it is stopped at the end of the test.

        ``options`` are further ones of `python -m simulators.cell`, e.g. ("--road", "modbus").
        """
        own = ["--speed", str(speed), *(["--seed", str(seed)] if seed is not None else [])]
        cell = WireCell(self._next_folder(), source, [*own, *(["--flip"] if flip else []), *options])
        self._running.append(cell)
        return cell

    def in_memory(self, main: Callable[[Any], Coroutine[Any, Any, T]], source: Any = "demo", **options: Any) -> T:
        """Run `main(cell)` beside a cell in one process and virtual time; options as for simulators.cell.Cell.

        ``wires`` is "memory" unless told otherwise.
        """
        from drivers.clock import LoopClock, run_virtual  # noqa: PLC0415 - pytest loads this file on every run
        from simulators.cell import cell_running  # noqa: PLC0415

        folder = self._next_folder()

        async def whole() -> T:
            async with cell_running(source, folder, LoopClock(), **{"wires": "memory", **options}) as cell:
                return await main(cell)

        return run_virtual(whole)

    def _next_folder(self) -> Path:
        existing = len(list(self._folder.glob("cell-*")))
        folder = self._folder / f"cell-{existing + 1}"
        folder.mkdir(parents=True)
        return folder

    def stop(self) -> None:
        """Stop every cell on wires."""
        while self._running:
            self._running.pop().stop()


@pytest.fixture
def trueflank_cell(tmp_path: Path) -> Iterator[CellStarter]:
    """Start simulated cells for one test; all are stopped when it ends. Without the extra "sim" the test says so."""
    from drivers.local.extras import need  # noqa: PLC0415 - pytest loads this file on every run

    need("sim", "trueflank_cell")
    starter = CellStarter(tmp_path)
    yield starter
    starter.stop()


class FaultBox:
    """What the fixture `trueflank_faults` gives: the list of faults, and a cell that has some of them."""

    def __init__(self, starter: CellStarter) -> None:
        from simulators.faults import named_faults  # noqa: PLC0415 - pytest loads this file on every run

        self._starter = starter
        self.known = {one.name: one.meaning for one in named_faults().values()}

    def in_memory(
        self,
        main: Callable[[Any], Coroutine[Any, Any, T]],
        faults: Mapping[str, Any],
        source: str | Path = "demo",
        wire: str = "laser",
        **options: Any,
    ) -> T:
        """As `trueflank_cell.in_memory`, with these faults by name; those of the wire are of instrument ``wire``.

        Raises ValueError for a name or a value that does not exist.
        """
        from simulators.cellfile import load_cell  # noqa: PLC0415
        from simulators.faults import with_faults  # noqa: PLC0415

        cell_file, more, quirks = with_faults(load_cell(source), faults, wire)

        async def whole(cell: Any) -> T:
            for name, value in quirks.items():
                setattr(cell.server.quirks, name, value)
            return await main(cell)

        return self._starter.in_memory(whole, cell_file, **{**options, **more})


@pytest.fixture
def trueflank_faults(trueflank_cell: CellStarter) -> FaultBox:
    """Faults of the simulator by name: `trueflank_faults.known` says what each means, `in_memory` plays them."""
    return FaultBox(trueflank_cell)
