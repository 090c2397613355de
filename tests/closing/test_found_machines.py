"""Closing runs on machines as they stand in workshops: live cross tables and few points, or no cross tables at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.message import prose
from gateway.store import Store
from gateway.tooth import ToothProposal
from gateway.workflow.run import stages
from simulators.cell import Cell
from simulators.cellfile import load_cell, with_plan
from tests.closing.record import MachineResult
from tests.closing.runs import Remedy, run_machine
from tests.closing.test_short import kept, short

pytestmark = [pytest.mark.timeout(1800), pytest.mark.long]
DISTURB, STAY = (0, 1), (2, 3, 4)


def run(name: str, folder: Path, remedy: Remedy | None = None) -> MachineResult:
    file = with_plan(load_cell(name))
    found = run_machine(file, file.seed, folder, short=True, edit=short, remedy=remedy)
    print(found)
    assert kept(found) == []
    assert found.done_twice == ()
    return found


def test_live_cross_tables_and_the_second_measuring_system(tmp_path: Path) -> None:
    """The run names the two tables that disturb; once they are off it ends at the floor, the others as they were."""
    cells: list[Cell] = []

    def switched_off(cell: Cell) -> None:
        cells.append(cell)
        for number in DISTURB:
            cell.nck.set(f"$SN_CEC_TABLE_ENABLE[{number}]", False, 7)
        theirs.extend(str(cell.nck.core.memory.cec[number]) for number in (*DISTURB, *STAY))

    theirs: list[str] = []
    found = run("scales", tmp_path, Remedy("E-SETUP-CROSS", switched_off))
    assert found.outcome == "better"
    assert found.after_um < 0.5 * found.set_right_um
    (cell,) = cells
    assert [str(cell.nck.core.memory.cec[number]) for number in (*DISTURB, *STAY)] == theirs
    assert [bool(cell.nck.get(f"$SN_CEC_TABLE_ENABLE[{number}]")) for number in (*DISTURB, *STAY)] == [0, 0, 1, 1, 1]
    assert all(cell.nck.get(f"$MA_CEC_ENABLE[{axis}]") for axis in ("X1", "Y1"))
    assert not any(cell.nck.get(f"$MA_ENC_COMP_ENABLE[0,{axis}]") for axis in ("X1", "Z1", "C1"))


def test_a_control_without_cross_tables_gets_axis_tables_and_is_told_what_stays(tmp_path: Path) -> None:
    found = run("plain", tmp_path)
    assert found.outcome in ("better", "unchanged")
    assert found.after_um < found.set_right_um
    (stored,) = list(tmp_path.rglob("tooth.json"))
    folder = Store(stored.parents[1]).open(stored.parent.name)
    assert "remain on the flank; with cross tables" in prose(folder.get(stages.TOOTH, ToothProposal).said)
