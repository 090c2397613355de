"""The cell with direct scales: what its builder left acting is measured, replaced, and put back as it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import TrueflankError
from gateway.config import load_site
from gateway.workflow.complete_run import run_site
from gateway.workflow.control.rollback import roll_back_site
from simulators.cell import Cell
from simulators.cellfile import CellFile, LoadedAxisTable, load_cell
from tests.cell.bench import main_job, short
from tests.selftested import cell_running
from tests.sizes import few

# 3 intervals of 90 mm and a rest of 80 mm, in which targets lie; the last point is zero and holds to the reference.
UNEVEN = {"minimum": -400.0, "maximum": -50.0, "step": 90.0}
EDIT = short(axes=("X1",), count=9, repetitions=3)
CURVE = {"kind": "polynomial", "coefficients": [0.0, 4.0, 3.0], "center": -130.0, "scale": 200.0}


def scales(uneven_step: str = "floor", **machine: Any) -> CellFile:
    """The cell with a table of X that ends in the measured range, and other keys of its control."""
    file = load_cell("scales")
    loaded = LoadedAxisTable.model_validate(UNEVEN | {"values": [CURVE]})
    axes = tuple(one.model_copy(update={"loaded": loaded}) if one.name == "X1" else one for one in file.axes)
    switches = {**file.machine.switches, "uneven_step": uneven_step, **machine.pop("switches", {})}
    changed = file.machine.model_copy(update={"switches": switches, **machine})
    return file.model_copy(update={"axes": axes, "machine": changed})


def tables(cell: Cell) -> Any:
    """Every table of the control and its switches."""
    axes = [axis.name for axis in cell.file.axes]
    names = [f"$MA_ENC_COMP_ENABLE[1,{axis}]" for axis in axes] + [f"$MA_CEC_ENABLE[{axis}]" for axis in axes]
    names += [f"$SN_CEC_TABLE_ENABLE[{number}]" for number in range(9)]
    return cell.nck.static_memory()["tables"], [cell.nck.get(name) for name in names]


@pytest.mark.long
def test_a_table_of_the_builder_is_merged_replaced_and_rolled_back_point_by_point(tmp_path: Path) -> None:
    async def job() -> None:
        clock = LoopClock()
        async with cell_running(scales(), tmp_path, clock, wires="memory", block_s=0.5) as cell:
            path = cell.site_path
            path.write_text(EDIT(path.read_text(encoding="utf-8")), encoding="utf-8")
            site, found, was = load_site(path), tables(cell), cell.figures("X1")
            name, said = site.site.name, []

            def say(code: str, /, **fields: object) -> None:
                said.append(code)

            outcome = await run_site(site, path, apply=True, machine_name=name, clock=clock, say=say)
            assert outcome.state == "better", outcome.lines
            assert cell.figures("X1")["M"] < 0.3 * was["M"]
            assert tables(cell) != found
            await roll_back_site(site, path, table="X1", apply=True, machine_name=name, clock=clock, say=say)
            assert tables(cell) == found

    run_virtual(job)


@pytest.mark.parametrize("reading", few(["stretched", "idle"]))
def test_a_control_that_takes_the_step_in_another_way_is_refused(tmp_path: Path, reading: str) -> None:
    with pytest.raises(TrueflankError) as caught:
        main_job(tmp_path, scales(reading), edit=short(axes=("X1",), count=5, repetitions=1))
    assert caught.value.code == "E-CAP-APPLIED"


@pytest.mark.long
@pytest.mark.parametrize(
    ("site_level", "code", "why"), [(3, "E-PUSH-REFUSED", "E-INT-ACCESS"), (7, "E-PUSH-HELD-ON", "E-NC-LEVEL")]
)
def test_switches_that_only_the_service_may_write_are_refused_with_the_reason(
    tmp_path: Path, site_level: int, code: str, why: str
) -> None:
    """Key switch at 3 (level 4): refused before all; by the control where the site file says the switches are open."""
    before: list[Any] = []
    told: list[str] = []

    async def during(cell: Cell) -> None:
        before.append(tables(cell))

    def heard(cell: Cell, said: str, fields: dict[str, object]) -> None:
        told.append(str(fields))
        before.append(tables(cell))

    def edit(text: str) -> str:
        return short(axes=("X1",), count=5, repetitions=3)(text).replace(
            "access_level = 7", f"access_level = {site_level}"
        )

    with pytest.raises(TrueflankError) as caught:
        main_job(tmp_path, scales(switches={"redefined": []}), edit=edit, during=during, heard=heard)
    assert caught.value.code == code
    assert why in "".join(told)
    assert all(one == before[0] for one in before)
