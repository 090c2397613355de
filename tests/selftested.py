"""What a push needs first, at one place: that the control has passed the self-test, kept where a site's store keeps it.

`tests/cell/test_self_test.py` has a control do it; everybody else starts from here.
"""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import simulators.cell
from drivers.programs import SelfTested
from drivers.types.identity import MachineIdentity
from gateway.config import load_site
from gateway.store.machine_books import SelfTestBook
from gateway.workflow.run.folder import store_of
from simulators.cell import Cell
from simulators.cellfile import CellFile, limit_sample_rate, load_cell

DAY = "2026-11-20"
# As the demo's machine: a thousand lines a second of a counter are a quarter of a run's work and change nothing judged.
MOST_HZ = 250.0


def passed(machine: MachineIdentity, axis: str = "X1", encoder: int = 0) -> SelfTested:
    """A self-test that went well."""
    return SelfTested(machine, axis, encoder, f"{DAY}T08:00:00+00:00", control_date=DAY, passed=("READ",), failed=())


def machine_of(file: CellFile) -> MachineIdentity:
    """The fingerprint that a cell's control will show."""
    machine = file.machine
    return MachineIdentity(machine.serial, machine.nck_version, tuple(axis.name for axis in file.axes))


def keep(site_path: Path, file: CellFile) -> None:
    """Have the store of a cell's site know that every axis passed."""
    book = SelfTestBook(store_of(load_site(site_path), site_path).root)
    for test in _of(file):
        book.save(test)


def _of(file: CellFile) -> Iterator[SelfTested]:
    for axis in file.axes:
        yield from (passed(machine_of(file), axis.name, encoder) for encoder in (0, 1))


@contextlib.asynccontextmanager
async def cell_running(source: str | Path | CellFile, *given: Any, **options: Any) -> AsyncIterator[Cell]:
    """As `simulators.cell.cell_running`, at a site whose control has passed the self-test; `MOST_HZ` at most."""
    slower = limit_sample_rate(source if isinstance(source, CellFile) else load_cell(source), MOST_HZ)
    async with simulators.cell.cell_running(slower, *given, **options) as cell:
        keep(cell.site_path, cell.file)
        yield cell
