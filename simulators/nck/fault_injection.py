"""Faults of a control: things it does by itself, and events from outside at a chosen program block.

By itself it may exchange points, switch tables on, switch on once more, or forget. At a block may come: mains failure,
drive alarm, key switch, change of mode, a second writer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

from simulators.nck.machine.compensation import Table
from simulators.nck.machine.core import Core
from simulators.nck.machine.data import CEC_ENABLE, ENC_ENABLE
from simulators.nck.spec import NckRefusal
from simulators.nck.switches import Switches
from simulators.nck.values import Value

ForgottenMemory = Literal["words", "memory", "switch"]
TABLE_SWITCHES = (ENC_ENABLE, CEC_ENABLE, "$SN_CEC_TABLE_ENABLE")


def enable_all(core: Core) -> None:
    """Every table that was ever loaded is switched on, and acts as after NEWCONF."""
    core.record_fault("enable")
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
    core.record_fault("enable")
    core.data.store(name, index, True)
    core.newconf()


def forget(core: Core, what: ForgottenMemory) -> None:
    """All R parameters, the points of every table, or every switch: as if they had never been written."""
    core.record_fault(f"forget {what}")
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


_HMI_LEVEL = 1


class BlockTarget(Protocol):
    """What can be done to a control at a block."""

    def power_cycle(self) -> None:
        """Power off and on."""
        ...

    def drive_alarm(self, number: int, text: str) -> None:
        """An alarm that stops whatever runs."""
        ...

    def set_access_level(self, level: int) -> None:
        """Key switch."""
        ...

    def change_mode_by_hand(self) -> None:
        """RESET and JOG."""
        ...

    def enable_by_itself(self) -> None:
        """Switch on every table that was ever loaded."""
        ...

    def forget(self, what: ForgottenMemory) -> None:
        """Lose R parameters, points or switches."""
        ...

    def set(self, name: str, value: Value, level: int) -> None:
        """Write a variable. Raises NckRefusal."""
        ...


class BlockEvents:
    """The events of `Switches`, each once; ``refused`` lists what the control refused to the second writer."""

    def __init__(self, switches: Switches, control: BlockTarget) -> None:
        self._control = control
        self._switches = switches
        self.refused: list[tuple[str, int]] = []
        acts: tuple[tuple[int | None, Callable[[], None]], ...] = (
            (switches.keyswitch_at_block, lambda: control.set_access_level(switches.block_access_level)),
            (switches.hmi_writes_at_block, self._write),
            (switches.mode_change_at_block, control.change_mode_by_hand),
            (switches.alarm_at_block, lambda: control.drive_alarm(switches.block_alarm, "fault of a drive")),
            (switches.enables_at_block, control.enable_by_itself),
            (switches.forgets_at_block, lambda: control.forget(switches.forgets)),
            (switches.power_cut_at_block, control.power_cycle),
        )
        self._open = [(block, act) for block, act in acts if block is not None]

    def at(self, block: int) -> None:
        """Block number ``block`` of a program is done."""
        if not self._open:
            return
        due = [act for place, act in self._open if place == block]
        self._open = [(place, act) for place, act in self._open if place != block]
        for act in due:
            act()

    def _write(self) -> None:
        for name, value in self._switches.hmi_writes:
            try:
                self._control.set(name, value, _HMI_LEVEL)
            except NckRefusal as refusal:
                self.refused.append((name, refusal.number))
