"""Grinds a part with whatever tables act now, by a program of the judge's own, and switches tables off and on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.cell import Cell
from simulators.grinding import WorkPiece
from tests.closing.judge import Places
from tests.unit.simulators.planned_run import ground

FloatArray = NDArray[np.float64]
PATH = "/_N_MPF_DIR/_N_AGAIN_MPF"
COUNT = "R[99]"
LONGEST_S = 20000
PROGRAM = """G500 D0 G90 G94 G60 G601
MSG("TRUEFLANK LOAD BLANK AGAIN")
M0
MSG("")
SUPA G0 Z1={low} Y1=0
SUPA G0 X1={clear}
SUPA G0 C1=DC({first})
S1500 M3
FOR R1=0 TO {last}
SUPA G0 C1=DC(({spaces}-R1)*360/{spaces})
SUPA G1 X1={deep} F1000
SUPA G1 Z1={high} F3000
SUPA G1 Z1={low}
SUPA G0 X1={clear}
ENDFOR
M5
STOPRE
R99=R99+1
M30
"""


async def switched(cell: Cell, name: str, *, on: bool) -> None:
    """Set a switch of every measured axis ("$MA_...[{axis}]") with a manufacturer's rights, and restart the control."""
    for axis in cell.file.axes:
        if axis.measure is not None:
            cell.nck.set(name.format(axis=axis.name), int(on), 0)
    cell.nck.nck_reset()
    while cell.nck.booting:
        await cell.clock.sleep(1.0)
    for axis in cell.file.axes:
        cell.nck.reference_axis(axis.name)
    while not all(cell.nck.axis_state(axis.name).referenced for axis in cell.file.axes):
        await cell.clock.sleep(1.0)


async def ground_now(cell: Cell) -> tuple[WorkPiece, float]:
    """A new part, and the second of the cell's clock at which its program was started."""
    began, before = cell.clock.now(), cell.nck.get(COUNT)
    cell.nck.set_mode("AUTO")
    cell.nck.files.write(PATH, _program(cell).encode())
    assert cell.nck.select(PATH, 1) == 0
    while cell.nck.get(COUNT) == before:
        await cell.clock.sleep(5.0)
        assert cell.clock.now() - began < LONGEST_S, f"the program did not end: {cell.nck.alarms} {cell.operator.log}"
    work = cell.shop.ground
    assert work is not None
    assert work.finished
    return work, began


def _program(cell: Cell) -> str:
    part = cell.file.part
    assert part is not None
    half, height = 0.5 * part.gear.b + 8.0, part.grinding.height_mm
    deep = -part.grinding.centre_distance_mm
    return PROGRAM.format(
        low=height - half, high=height + half, deep=deep, clear=deep - 10.0,
        first=5.0, spaces=part.gear.zc, last=part.gear.zc - 1,
    )  # fmt: skip


def expected(cell: Cell, work: WorkPiece, start_s: float, at: Places) -> FloatArray:
    """The flank (K, T, Z) in um that the truth and what the control adds right now would leave on such a part."""

    def added(name: str, direction: int) -> Any:
        return lambda places: cell.nck.compensated_encoder(name, places[name[0]], direction) - places[name[0]]

    corrections = {"X": added("X1", 1), "Z": added("Z1", 1), "C": added("C1", -1)}
    made = ground(cell.truth, work.spec, work.seat, corrections=corrections, start_s=start_s)
    return at.flank(made)
