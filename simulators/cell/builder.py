"""The machine's builder: puts the tables of the cell file into the control before it is first switched on."""

from __future__ import annotations

import numpy as np

from drivers.units import deviation_scale
from simulators.cellfile import CellAxis, CellFile
from simulators.cellfile.terms import Loaded, LoadedAxis, LoadedCross
from simulators.nck.control import Nck
from simulators.truth.terms import curve

MAKER = 0
DECIMALS = 6


def build(nck: Nck, cell: CellFile, seed: int) -> None:
    """Load every table that the cell file names, and switch on what it says is on. Raises NckRefusal."""
    for axis in cell.axes:
        if axis.loaded is not None:
            _own(nck, axis, axis.loaded, seed)
    for number, cross in enumerate(cell.machine.cross):
        _cross(nck, cell, number, cross=cross, seed=seed)


def _own(nck: Nck, axis: CellAxis, table: LoadedAxis, seed: int) -> None:
    tail = f"{axis.encoder},{axis.name}"
    for place, value in _points(table, axis, axis, seed).items():
        nck.set(f"$AA_ENC_COMP[{axis.encoder},{place},{axis.name}]", value, MAKER)
    for part, number in _grid(table).items():
        nck.set(f"$AA_ENC_COMP_{part}[{tail}]", number, MAKER)
    nck.set(f"$AA_ENC_COMP_IS_MODULO[{tail}]", table.modulo, MAKER)
    nck.set(f"$MA_ENC_COMP_ENABLE[{tail}]", table.enabled, MAKER)


def _cross(nck: Nck, cell: CellFile, number: int, *, cross: LoadedCross, seed: int) -> None:
    source, output = cell.axis(cross.input), cell.axis(cross.output)
    nck.set(f"$MA_CEC_ENABLE[{output.name}]", False, MAKER)
    for place, value in _points(cross, source, output, seed).items():
        nck.set(f"$AN_CEC[{number},{place}]", value, MAKER)
    for part, figure in _grid(cross).items():
        nck.set(f"$AN_CEC_{part}[{number}]", figure, MAKER)
    nck.set(f"$AN_CEC_INPUT_AXIS[{number}]", source.name, MAKER)
    nck.set(f"$AN_CEC_OUTPUT_AXIS[{number}]", output.name, MAKER)
    nck.set(f"$AN_CEC_DIRECTION[{number}]", cross.direction, MAKER)
    nck.set(f"$SN_CEC_TABLE_ENABLE[{number}]", cross.enabled, MAKER)
    on = any(one.enabled and one.output == cross.output for one in cell.machine.cross[: number + 1])
    nck.set(f"$MA_CEC_ENABLE[{output.name}]", on, MAKER)


def _points(table: Loaded, source: CellAxis, output: CellAxis, seed: int) -> dict[int, float]:
    """Values in mm or deg of the output axis, by point, without the gaps."""
    count = int((table.maximum - table.minimum) / table.step + 1e-9) + 1
    places = table.minimum + table.step * np.arange(count, dtype=np.float64)
    name = f"loaded {output.name} {source.name}"
    drawn = curve(table.values, source.travel, rotary=source.kind == "rotary", seed=seed, name=name, redraw=False)(
        places
    )
    scale = deviation_scale("deg" if output.kind == "rotary" else "mm")
    return {k: round(float(v) / scale, DECIMALS) for k, v in enumerate(drawn) if k not in table.gaps}


def _grid(table: Loaded) -> dict[str, float]:
    return {"STEP": table.step, "MIN": table.minimum, "MAX": table.maximum}
