"""A part by tables and by the corrected copy of its program, on LinuxCNC's own kernel: the slides stand the same."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.exchange.linuxcnc import LinuxCncScrew
from drivers.types.tables import CompensationTable
from gateway.shadow.reading import ProgramAxis, ProgramReader
from gateway.shadow.writing import CopySettings, ProgramCopy, TableCorrection, write_copy
from tests.interop.linuxcnc_host import running

pytestmark = [pytest.mark.interop, pytest.mark.wall_time, pytest.mark.timeout(1800)]

AXES = (
    ProgramAxis("X", travel=(-20.0, 300.0)),
    ProgramAxis("Y"),
    ProgramAxis("Z"),
    ProgramAxis("A", rotary=True, travel=(-20.0, 380.0)),
)
PROGRAM = "G0 X0 A0\nG1 X30 A20 F1200\nG1 X42.5 A20 F1200\nG1 X7.5 A5 F1200\n"
X = CompensationTable("axis", "X", "X", 0.0, 50.0, 10.0, (0.0, 12.0, 18.0, -9.0, -15.0, 0.0))
A = CompensationTable("axis", "A", "A", 0.0, 30.0, 10.0, (0.0, 25.0, -20.0, 0.0), input_unit="deg", output_unit="deg")
RESOLUTION = 2e-5  # mm and deg: 1e-6 of the copy's text, and what a screw of the plant makes of a moment's lag


@pytest.fixture
def folders() -> Iterator[tuple[Path, Path]]:
    with tempfile.TemporaryDirectory(prefix="tf-copy-") as made:
        base = Path(made)
        base.chmod(0o755)
        for name in ("tables", "copy"):
            (base / name).mkdir()
        yield base / "tables", base / "copy"


def copied() -> ProgramCopy:
    correction = TableCorrection([X, A], letters={"X": "X", "A": "A"})
    blocks = ProgramReader(AXES).read(PROGRAM, "part.ngc")
    return write_copy(blocks, AXES, correction, CopySettings(chord_mm=1e-4, chord_deg=1e-4, longest={}))


async def places(folder: Path, files: dict[str, str], blocks: list[str]) -> np.ndarray:
    """Where the slides of X and A truly stand after each block (n, 2), mm and deg."""
    async with running(folder, files) as host:
        await host.person("walk", ["G0 X-10 A-10"])
        seen = await host.person("walk", blocks)
    return np.array([[one["true"][0], one["true"][3]] for one in seen])


async def test_the_slides_stand_the_same_by_tables_and_by_the_copy(folders: tuple[Path, Path]) -> None:
    copy = copied()
    text = [line for line in copy.text.splitlines() if line.startswith(("G0", "G1"))]
    assert len(text) == len(copy.points) > 4
    wanted = [f"G1 X{point.positions['X']:.6f} A{point.positions['A']:.6f} F1200" for point in copy.points]
    screw = LinuxCncScrew()
    files = {"x.comp": screw.text([X], "trims", ()), "a.comp": screw.text([A], "trims", ())}
    by_tables = await places(folders[0], files, wanted)
    by_copy = await places(folders[1], {}, text)
    plain = np.array([[point.positions["X"], point.positions["A"]] for point in copy.points])
    moved = np.abs(by_copy - plain)
    assert moved[:, 0].max() > 0.01
    assert np.abs(by_tables - by_copy).max() < RESOLUTION, by_tables - by_copy
