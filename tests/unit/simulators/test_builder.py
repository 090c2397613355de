"""What a cell's builder loaded stands in the control when it is switched on, and acts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from simulators.cell import Cell
from simulators.cellfile import CellFile, apply_changes, load_cell
from simulators.pytest_plugin import CellStarter


def test_the_tables_of_the_cell_with_scales_act_before_anybody_comes(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        nck = cell.nck
        assert nck.spec.places == ("X1", "Y1", "Z1", "", "C1")
        assert [nck.get(f"$MA_ENC_COMP_ENABLE[1,{axis}]") for axis in ("X1", "Z1", "C1")] == [True, True, False]
        assert [len(nck.core.memory.eec[index, 0].points) for index in (0, 2, 3)] == [0, 0, 0]
        assert all(nck.get(f"$SN_CEC_TABLE_ENABLE[{number}]") for number in range(5))
        assert all(nck.get(f"$MA_CEC_ENABLE[{axis}]") for axis in ("X1", "Y1", "Z1"))
        steps = [(one.maximum - one.minimum) / one.step for one in nck.core.memory.cec[:5]]
        assert all(abs(count - round(count)) > 0.01 for count in steps)
        assert not nck.alarms
        added = nck.compensated_encoder("X1", np.array([-400.0]), 1)[0] + 400.0
        own = nck.core.axis("X1").curve
        assert own is not None
        assert added == pytest.approx(-own.one(-400.0), abs=0.004)
        nck.set("$SN_CEC_TABLE_ENABLE[0]", 0, 7)  # the builder opened it to everybody

    trueflank_cell.in_memory(main, "scales")


def test_gaps_stay_zero(tmp_path: Path, trueflank_cell: CellStarter) -> None:
    file = load_cell("scales")
    cross = tuple(one.model_copy(update={"gaps": (1, 3)}) for one in file.machine.cross)
    file = file.model_copy(update={"machine": file.machine.model_copy(update={"cross": cross})})

    async def main(cell: Cell) -> None:
        points = cell.nck.core.memory.cec[0].points
        assert (points[1], points[3]) == (0.0, 0.0)
        assert all((points[0], points[2]))

    trueflank_cell.in_memory(main, file)


def test_a_cell_file_may_say_only_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(
        'like = "demo"\nname = "other"\n[machine]\ncec_points = []\n[[axes]]\nname = "Y1"\nletter = "Y"\n'
        'kind = "linear"\ntravel = [-5.0, 5.0]\n',
        encoding="utf-8",
    )
    other, demo = load_cell(path), load_cell("demo")
    assert (other.name, other.machine.cec_points, other.axis("Y").travel) == ("other", (), (-5.0, 5.0))
    assert other.machine.switches == demo.machine.switches
    assert [axis.name for axis in other.axes] == [axis.name for axis in demo.axes]
    assert isinstance(other, CellFile)


def test_a_likeness_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text('like = "nothing"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match="E-CELL-VALUE"):
        load_cell(path)


def test_named_entries_are_joined_and_other_lists_replaced() -> None:
    base = {"axes": [{"name": "a", "x": 1}, {"name": "b", "x": 2}], "setups": [1, 2], "part": {"u": 1, "v": 2}}
    found = apply_changes(base, {"axes": [{"name": "b", "x": 3}, {"name": "c"}], "setups": [3], "part": {"v": 4}})
    assert found == {
        "axes": [{"name": "a", "x": 1}, {"name": "b", "x": 3}, {"name": "c"}],
        "setups": [3],
        "part": {"u": 1, "v": 4},
    }
