"""The self-test of a whole cell: kept for each axis, refused words named, none needed on the mailbox."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import DeviceRefused, words
from drivers.types import MachineIdentity
from gateway.config import load_site
from gateway.say import silence
from gateway.store import SelfTestBook
from gateway.workflow.bench import store_of
from gateway.workflow.control.selftesting import self_test_site
from simulators.cell import Cell, cell_running
from simulators.cellfile import load_cell
from tests.selftested import machine_of

VERSION = load_cell("demo").machine.nck_version


def outcome_of(
    folder: Path, file: Any = "demo", axis: str = "", *, short_files: bool = False, **options: Any
) -> tuple[Any, SelfTestBook, Cell]:
    """The outcome or the refusal, what the store holds then, and the cell."""
    found: list[Any] = []

    async def job() -> None:
        clock = LoopClock()
        async with cell_running(file, folder, clock, wires="memory", **options) as cell:
            path = cell.site_path
            site = load_site(path)
            if short_files:
                cell.nck.set("$MN_LEN_PROTOCOL_FILE", 1, 0)
            try:
                outcome: Any = await self_test_site(site, path, axis=axis, clock=clock, say=silence)
            except DeviceRefused as error:
                outcome = error
            found.extend((outcome, SelfTestBook(store_of(site, path).root), cell))

    run_virtual(job)
    return found[0], found[1], found[2]


def test_every_axis_passes_and_is_kept_for_this_version(tmp_path: Path) -> None:
    outcome, book, cell = outcome_of(tmp_path)
    assert (outcome.state, list(outcome.data["axes"])) == ("self-tested", ["X1", "Z1", "C1"])
    machine = machine_of(cell.file)
    kept = book.last(machine, "X1", 0)
    assert kept is not None
    assert (kept.ok, kept.machine, kept.control_date[:2]) == (True, machine, "20")
    assert outcome.data["axes"]["X1"]["passed"] == list(kept.passed)
    other = MachineIdentity(machine.serial, "V5", machine.axis_names)
    old = book.last(other, "X1", 0)
    assert old is not None
    assert old.machine.differences(other) == ("version",)
    assert book.last(machine, "X1", 1) is None
    assert [entry for entry in cell.operator.log if entry != "NC START"] == ["went on with the self-test"] * 3


def test_a_word_that_is_not_passed_is_named_and_kept(tmp_path: Path) -> None:
    error, book, cell = outcome_of(tmp_path, "demo", axis="X1", short_files=True)
    assert isinstance(error, DeviceRefused)
    assert error.code == "E-SELF-TEST"
    kept = book.last(machine_of(cell.file), "X1", 0)
    assert kept is not None
    assert not kept.ok
    assert kept.failed[-1] in str(error)
    assert "MD11420" in str(error)


@pytest.mark.parametrize("road", ["modbus"])
def test_a_road_that_runs_no_programs_needs_none(tmp_path: Path, road: str) -> None:
    outcome, book, cell = outcome_of(tmp_path, "zero", road=road)
    assert outcome.state == "not-needed"
    assert outcome.lines == (words("W-SELF-TEST-NONE", site=cell.file.site.name),)
    assert book.all(cell.file.machine.serial) == ()
