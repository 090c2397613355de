"""The NCK as one object: its life, the operator's panel, the PLC's signals, writes from outside, what is visible."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from simulators.nck import fault_injection
from simulators.nck.channel import ACTIVE, Channel, Mode
from simulators.nck.fault_injection import BlockEvents
from simulators.nck.language.parser import parse
from simulators.nck.machine import core
from simulators.nck.machine.axis import AxisView
from simulators.nck.machine.core import Core
from simulators.nck.machine.data import ENC_STATE, IS_METRIC, Alarm
from simulators.nck.machine.files import FileSystem
from simulators.nck.program import inifile
from simulators.nck.program.inifile import IniReport
from simulators.nck.program.variables import Variables, split_name
from simulators.nck.spec import AxisSpec, NckRefusal, NckSpec
from simulators.nck.values import Value

Array = NDArray[np.float64]


class Display:
    """The control as it shows itself; nothing here changes it."""

    def __init__(
        self, spec: NckSpec, clock: Clock, power_cut: Callable[[], None], at_block: Callable[[int], None]
    ) -> None:
        self.spec = spec
        self.core = Core(spec, clock)
        self.variables = Variables(self.core)
        self.channel = Channel(self.core, self.variables, power_cut, at_block)
        self.booting = False

    @property
    def channel_status(self) -> int:
        """0 reset, 1 active, 2 interrupted."""
        return self.channel.status

    @property
    def program_status(self) -> int:
        """1 interrupted, 2 stopped, 3 running, 5 aborted (also after a program's end)."""
        return self.channel.program_status

    @property
    def program_line(self) -> int:
        """Source line under execution, from 1; 0 in reset."""
        return self.channel.line

    @property
    def program_name(self) -> str:
        """Name of the program under execution, else of the one selected."""
        return self.channel.program_name

    @property
    def selected(self) -> str:
        """Path of the selected program, or ""."""
        return self.channel.selected

    @property
    def mode(self) -> Mode:
        """AUTO, JOG or MDA."""
        return self.channel.mode

    @property
    def message(self) -> str:
        """The part program's MSG text."""
        return self.channel.message

    @property
    def files(self) -> FileSystem:
        """The file system."""
        return self.channel.files

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Alarms standing, oldest first."""
        return self.core.alarms.standing

    @property
    def access_level(self) -> int:
        """Protection level active, 0..7; smaller has more rights."""
        return self.core.access_level

    def axis_state(self, name: str) -> AxisView:
        """An axis now, by machine name, AXn or letter. Raises NckRefusal 12550."""
        return self.core.view(self.core.axis(name).index)

    def axis_stat(self, name: str) -> int:
        """``$AA_STAT`` of an axis now: what `axis_state` says of it, without the rest. Raises NckRefusal 12550."""
        return self.core.axis(name).state(self.core.clock.now())

    def encoder(self, axis: str, times: Array) -> tuple[Array, Array]:
        """Place of the axis in terms of encoder 1 (mm or deg, turns unlimited) and sign of last travel.

        At clock times in the past up to now; about the last 90 s are kept. Raises NckRefusal 12550.
        """
        found = self.core.axis(axis)
        wanted = np.asarray(times, dtype=np.float64)
        return found.encoders(wanted), found.directions(wanted)

    def get(self, name: str) -> Value:
        """A variable by its NC name. Raises NckRefusal 12550, 17020, 17030."""
        return self.variables.read(*split_name(name))


__all__ = ["Alarm", "AxisSpec", "AxisView", "Nck", "NckRefusal", "NckSpec"]

_SEARCH_S = 0.5


class Nck(Display):
    """A control with its machine. Panel methods are synchronous, as a person presses keys.

    Tables and data set before `start` are what the control boots with. After every boot the mode is JOG and
    no axis is referenced (but those with absolute encoders that were). ``on_block`` is called with the number
    of each program block when it is done, counted from 1 at NC START; what it does to the control happens
    there.
    """

    def __init__(self, spec: NckSpec, clock: Clock) -> None:
        super().__init__(spec, clock, self.power_cycle, self._at_block)
        self._clock = clock
        self._boot_task: asyncio.Task[None] | None = None
        self._referencing: dict[int, asyncio.Task[None]] = {}
        self._again: set[asyncio.Task[None]] = set()
        self.variables.on_switched_on = self._switched_on
        self.events = BlockEvents(spec, self)
        self.on_block: Callable[[int], None] | None = None

    # -- life --------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Switch the control on."""
        parse("")  # builds the parser now, not under the first program
        self.core.boot()
        self._show_units()

    async def stop(self) -> None:
        """Switch it off and end all its tasks."""
        tasks = [*self._referencing.values(), *self._again]
        tasks += [] if self._boot_task is None else [self._boot_task]
        self.channel.abort()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, self.channel.ended(), return_exceptions=True)
        # A wait cancelled inside the run ends one turn of the loop later.
        await self._clock.sleep(0.0)

    # -- from outside ------------------------------------------------------------------------------

    def set(self, name: str, value: Value, level: int) -> None:
        """Write a variable with a protection level. Raises NckRefusal with the alarm's number."""
        plain, indices = split_name(name)
        if self.booting:
            raise NckRefusal(0, "the control is starting")
        if not isinstance(value, bool | int | float | str):
            raise NckRefusal(12150, f"{plain}: operation does not fit the data type")
        if plain == "R" and not self.spec.r_writable:
            raise NckRefusal(17070, "R parameters are not writable from outside")
        self.variables.write(plain, indices, value, level, program=False)

    def load_ini(self, data: bytes, level: int) -> IniReport:
        """Load NC active data (an INI file of tables or data), as MD11220 says; see `inifile`."""
        if self.booting:
            raise NckRefusal(0, "the control is starting")
        return inifile.load(data, self.core, self.variables, level)

    def eec_ini(self, axis: str, encoder: int = 0) -> bytes:
        """The EEC table of an axis as an INI file. Raises NckRefusal 12550."""
        return inifile.eec_text(self.core, self.variables, self.core.axis(axis).index, encoder)

    def cec_ini(self, number: int) -> bytes:
        """A CEC table as an INI file. Raises NckRefusal 17020."""
        return inifile.cec_text(self.core, self.variables, number)

    def static_memory(self) -> dict[str, Any]:
        """What survives power off; fit for JSON."""
        return core.save_static_memory(self.core, self.files, self.selected)

    def restore_static_memory(self, content: dict[str, Any]) -> None:
        """Before `start`: what another object's `static_memory` gave. Raises ValueError."""
        self.channel.selected = core.restore_static_memory(content, self.core, self.files)

    def select(self, path: str, channel: int = 1) -> int:
        """Select a program: 0 ok, 1 no such channel, 2 not found, 3 channel not in reset, 4 refused."""
        if channel != 1:
            return 1
        return 4 if self.booting else self.channel.select(path)

    def unselect(self) -> int:
        """Unselect: 0 ok, 3 channel not in reset."""
        return self.channel.unselect()

    # -- the operator's panel ----------------------------------------------------------------------

    def nc_start(self) -> bool:
        """NC START: begin the selected program, or go on after M0 or NC STOP. False when refused.

        Refused while booting or referencing, outside AUTO, with a reset alarm or 4076 standing, without a
        program, or (alarm 22062) with an axis not referenced and MD20700 set.
        """
        self.core.alarms.clear("start")
        return not self.booting and not self._still_referencing() and self.channel.start()

    def nc_stop(self) -> None:
        """NC STOP: motion stops at once; NC START goes on."""
        self.channel.stop()

    def channel_reset(self) -> None:
        """RESET: the program is aborted, messages and reset alarms go, NEWCONF data act."""
        if self.booting:
            return
        self._break_off()
        self.core.alarms.clear("start", "reset")
        self.core.channel_data_reset()

    def acknowledge_alarms(self) -> None:
        """The cancel key; acknowledging 4075 locks NC start by 4076 until power on."""
        gone = self.core.alarms.clear("cancel", "start")
        if any(alarm.number == 4075 for alarm in gone):
            self.core.alarms.raise_(4076, "machine data were written without access rights", "power_on")

    def set_mode(self, mode: Mode) -> bool:
        """Choose AUTO, JOG or MDA; not while a program runs. Raises ValueError for another word."""
        return self.channel.set_mode(mode)

    def set_access_level(self, level: int) -> None:
        """Key switch or password. Raises ValueError outside 0..7."""
        if not 0 <= level <= 7:
            raise ValueError("a protection level is 0..7")
        self.core.access_level = level

    def set_feed_override(self, percent: float) -> None:
        """Override switch, for the next blocks. Raises ValueError outside 1..120."""
        if not 1.0 <= percent <= 120.0:
            raise ValueError("the override is 1..120 %")
        self.core.override_percent = percent

    def set_skip(self, *, active: bool) -> None:
        """Whether blocks marked / are skipped."""
        self.channel.skip_active = active

    def set_optional_stop(self, *, active: bool) -> None:
        """Whether M1 stops."""
        self.channel.optional_stop = active

    def reference_axis(self, name: str) -> bool:
        """Send an axis to its reference; it is referenced when it has arrived (see `axis_state`).

        False when refused: booting, or a program is running. Works in any mode and leaves it as it is.
        """
        index = self.core.axis(name).index
        if self.booting or self.channel.status == ACTIVE:
            return False
        task = self._referencing.get(index)
        if task is None or task.done():
            self._referencing[index] = asyncio.ensure_future(self._reference(index))
        return True

    def lose_reference(self, name: str) -> None:
        """An encoder fault: the axis is no longer referenced and what compensated it goes."""
        self.core.axis(name).referenced = False
        self.core.refresh()

    def lose_absolute_position(self, name: str) -> None:
        """The absolute encoder's position is lost: MD34210 falls from 2 to 1, alarm 26030, no reference."""
        axis = self.core.axis(name)
        self.core.data.store(ENC_STATE, (axis.active_encoder, axis.index), 1)
        self.core.alarms.raise_(26030, f"axis {axis.spec.name}: encoder absolute position lost", "power_on")
        self.lose_reference(name)

    def select_encoder(self, name: str, encoder: int) -> bool:
        """The PLC selects measuring system 0 or 1 (DB31.DBX1.5, 1.6). False when refused, with 25100."""
        return self.core.select_encoder(self.core.axis(name).index, encoder)

    def set_dynamic_backlash(self, name: str, *, active: bool) -> None:
        """The PLC asks for dynamic backlash compensation (DB31.DBX25.0)."""
        self.core.axis(name).backlash.dynamic_on = active
        self.core.refresh()

    def drive_alarm(self, number: int, text: str) -> None:
        """An alarm of a drive or the PLC: what runs stops, RESET clears it."""
        self.channel.interrupt(number, text)

    def change_mode_by_hand(self) -> None:
        """Somebody presses RESET and chooses JOG."""
        self.channel_reset()
        self.channel.set_mode("JOG")

    def nck_reset(self) -> None:
        """NCK reset: everything stops, references are lost, what is stored acts after the start."""
        self._restart(self.spec.boot_s, power_on=False)

    def power_cycle(self) -> None:
        """Power off and on."""
        self._restart(2.0 * self.spec.boot_s, power_on=True)

    def cut_power_after(self, blocks: int) -> None:
        """For tests: the mains fail when that many more blocks have been executed."""
        self.channel.cut_after_blocks = blocks

    def power_cut_at_block(self, block: int) -> None:
        """For tests: the mains fail when that many blocks have been executed, from now or the next NC START."""
        self.cut_power_after(block)

    def enable_by_itself(self) -> None:
        """For tests: the control switches on every table that was ever loaded."""
        fault_injection.enable_all(self.core)

    def forget(self, what: fault_injection.ForgottenMemory) -> None:
        """For tests: the control loses R parameters, points or switches."""
        fault_injection.forget(self.core, what)

    # -- inside ------------------------------------------------------------------------------------

    def _switched_on(self, name: str, index: tuple[int, ...]) -> None:
        if self.core.spec.enables_again_s > 0.0:
            task = asyncio.ensure_future(self._enable_again(name, index))
            self._again.add(task)
            task.add_done_callback(self._again.discard)

    async def _enable_again(self, name: str, index: tuple[int, ...]) -> None:
        await self._clock.sleep(self.core.spec.enables_again_s)
        if not self.booting:
            fault_injection.enable_again(self.core, name, index)

    def _at_block(self, block: int) -> None:
        self.events.at(block)
        if self.on_block is not None:
            self.on_block(block)

    def _still_referencing(self) -> bool:
        return any(not task.done() for task in self._referencing.values())

    def _break_off(self) -> None:
        self.channel.abort()
        for task in self._referencing.values():
            task.cancel()
        self._referencing.clear()
        self.core.halt()

    async def _reference(self, index: int) -> None:
        axis = self.core.axes[index]
        axis.referenced = False
        self.core.refresh()
        target = axis.spec.reference
        if axis.spec.modulo:
            target += 360.0 * round((axis.end_point - target) / 360.0)
        seconds = self.core.move({index: target}, None)
        await self._clock.sleep(seconds + _SEARCH_S)
        axis.referenced = True
        if axis.spec.absolute_encoder:
            self.core.data.store(ENC_STATE, (axis.active_encoder, index), 2)
        self.core.refresh()

    def _restart(self, seconds: float, *, power_on: bool) -> None:
        self._break_off()
        if self._boot_task is not None:
            self._boot_task.cancel()
        self.booting = True
        self.channel.mode = "JOG"
        for axis in self.core.axes:
            if not axis.spec.absolute_encoder:
                axis.encoders_referenced = [False, False]
        self.core.refresh()
        self._boot_task = asyncio.ensure_future(self._boot(seconds, power_on))

    async def _boot(self, seconds: float, power_on: bool) -> None:
        await self._clock.sleep(seconds)
        self.core.alarms.clear("start", "cancel", "reset", "power_on")
        if self.core.boot(power_on=power_on):
            self.files.wipe()
            self.channel.selected = ""
        self._show_units()
        self.booting = False

    def _show_units(self) -> None:
        system = "metric" if self.core.data.stored(IS_METRIC) else "inch"
        if system != self.spec.unit_system:
            self.spec = replace(self.spec, unit_system=system)
