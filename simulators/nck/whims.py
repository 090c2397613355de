"""What a control may do that nobody asked of it: exchange points, switch on by itself or once more, forget."""

from __future__ import annotations

from typing import Literal

from simulators.nck.machine.core import Core
from simulators.nck.machine.data_table import CEC_ENABLE, ENC_ENABLE
from simulators.nck.machine.memory import Table

Forgotten = Literal["words", "memory", "switch"]
SWITCHES = (ENC_ENABLE, CEC_ENABLE, "$SN_CEC_TABLE_ENABLE")


def enable_all(core: Core) -> None:
    """Every table that was ever loaded is switched on, and acts as after NEWCONF."""
    core.whim("enable")
    for (axis, encoder), table in core.memory.eec.items():
        if table.step > 0.0:
            core.data.store(ENC_ENABLE, (encoder, axis), True)
    for number, cross in enumerate(core.memory.cec):
        if cross.step > 0.0 and cross.output_axis:
            core.data.store("$SN_CEC_TABLE_ENABLE", (number,), True)
            core.data.store(CEC_ENABLE, (core.axis(cross.output_axis).index,), True)
    core.newconf()


def enable_again(core: Core, name: str, index: tuple[int, ...]) -> None:
    """A switching on that was done is done a second time."""
    core.whim("enable")
    core.data.store(name, index, True)
    core.newconf()


def forget(core: Core, what: Forgotten) -> None:
    """All R parameters, the points of every table, or every switch: as if they had never been written."""
    core.whim(f"forget {what}")
    if what == "words":
        core.r = [0.0] * len(core.r)
    elif what == "memory":
        tables: list[Table] = [*core.memory.eec.values(), *core.memory.cec]
        for table in tables:
            table.points = [0.0] * len(table.points)
    else:
        for axis in core.axes:
            core.data.store(CEC_ENABLE, (axis.index,), False)
            for encoder in (0, 1):
                core.data.store(ENC_ENABLE, (encoder, axis.index), False)
        core.newconf()
