"""The self-test of a whole cell: kept for each axis, refused words named, none needed on the mailbox."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import DeviceRefused, TrueflankError, words
from drivers.types.identity import MachineIdentity
from gateway.config import load_site
from gateway.say import silence
from gateway.store.machine_books import SelfTestBook
from gateway.workflow.axes.measure import fetch_tables
from gateway.workflow.run.context import open_context
from gateway.workflow.run.folder import new_run, store_of
from gateway.workflow.run.self_test import self_test_site
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
    assert tuple(map(str, outcome.lines)) == (words("W-SELF-TEST-NONE", site=cell.file.site.name),)
    assert book.all(cell.file.machine.serial) == ()


def test_a_cell_with_the_control_s_own_default_is_refused_with_the_size_it_needs(tmp_path: Path) -> None:
    """The shipped cells set MD11420 (`files_max_bytes`); one that keeps the small default is told what to set."""
    file = load_cell("zero")
    bare = file.model_copy(update={"machine": file.machine.model_copy(update={"switches": {}})})

    async def job() -> TrueflankError:
        clock = LoopClock()
        async with cell_running(bare, tmp_path, clock, wires="memory") as cell:
            path = cell.site_path
            site = load_site(path)
            async with open_context(
                site, path, folder=new_run(site, path), clock=clock, say=silence, instruments=()
            ) as at:
                with pytest.raises(DeviceRefused) as caught:
                    await fetch_tables(at, site.axes[0])
                assert "_N_TFMEAS_X1_MPF" not in cell.nck.files.list("/_N_MPF_DIR")
                return caught.value

    error = run_virtual(job)
    assert error.code == "E-NC-FILE-LIMIT"
    assert error.fields["limit_kb"] == 1
    needed = int(str(error.fields["needed_kb"]))
    assert 1 < needed <= 64
    assert f"set MD11420 $MN_LEN_PROTOCOL_FILE to {needed} or more" in str(error)
