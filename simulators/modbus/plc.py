"""The PLC program: process image, status word, command numbers, session, heart-beats and the running command.

Theory of operation. A master writes a command and its number into the image; a program cycle later the PLC takes it if
the number is new, answers "busy", and runs it as a task that sleeps between its steps. A fresh command ends the one
under way at once. Reading shows a consistent picture: status and live registers are computed when they are read.
Nothing runs while nobody asks, except the command under way and the watch over the session's heart-beat.
"""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from drivers.clock import Clock, LoopClock
from simulators.modbus import registers as r
from simulators.modbus.commands import SELECT, PlcCommands
from simulators.modbus.frames import DEVICE_FAILURE, ILLEGAL_ADDRESS, NoAnswer, PduRefused
from simulators.modbus.registers import (
    BACKLASH_KIND,
    CEC,
    EEC,
    NO_SESSION,
    PlcCommand,
    PlcFault,
    ProcessImage,
    TableAddress,
)
from simulators.modbus.settings import PlcSettings
from simulators.modbus.state import CommandSteps, PlcPowerCut, PlcRelease, RetentiveMemory, TableLoad
from simulators.modbus.table_access import TableAccess
from simulators.nck import ForgottenMemory, Nck

READY, BUSY, DONE, FAILED, IN_RESET, STANDSTILL, REFERENCED, RELEASED = (1 << bit for bit in range(8))
ALARM, EEC_ON, CEC_ON, MAY_WRITE, WAITING, STALE = (1 << bit for bit in range(8, 14))
_MODES = {"JOG": 0, "MDA": 1, "AUTO": 2}
_NEEDED = READY | IN_RESET | STANDSTILL | RELEASED


class StatusRegisters:
    """Fills registers from the NCK. ``switches`` and ``is_off`` speak of a table as the PLC wants it seen."""

    def __init__(
        self, access: TableAccess, switches: Callable[[TableAddress], int], is_off: Callable[[TableAddress], bool]
    ) -> None:
        self._access = access
        self._switches = switches
        self._is_off = is_off

    def machine_bits(self, released: bool) -> int:
        """Bits 0 and 4..8 of the status word."""
        access = self._access
        facts = (
            (access.ready, READY),
            (access.in_reset, IN_RESET),
            (access.standstill, STANDSTILL),
            (access.referenced, REFERENCED),
            (released, RELEASED),
            (bool(access.first_alarm), ALARM),
        )
        return sum(bit for holds, bit in facts if holds)

    def table_bits(self, target: TableAddress | None, bits: int) -> int:
        """Bits 9..11; ``bits`` are the machine's."""
        if target is None:
            return 0
        switches = self._switches(target)
        found = EEC_ON if switches & 1 else 0
        if target.kind == CEC and switches & 2 and switches & 4:
            found |= CEC_ON
        may = target.kind in (EEC, CEC, BACKLASH_KIND) and bits & _NEEDED == _NEEDED and self._is_off(target)
        return found | (MAY_WRITE if may else 0)

    def show_machine(self, image: r.ProcessImage) -> None:
        """Registers that need no selection."""
        access, nck = self._access, self._access.nck
        image.words[r.UNITS] = int(bool(nck.get("$MN_SCALING_SYSTEM_IS_METRIC")))
        image.words[r.LEVEL] = nck.access_level
        image.put(r.SERIAL, r.text_words(nck.spec.identity[0], 16))
        image.put(r.NCK_VERSION, r.text_words(nck.spec.identity[1], 8))
        image.put(r.AXES, (max(access.axes), access.tables))
        image.put_dint(r.ALARM, access.first_alarm)
        image.words[r.MODE] = _MODES.get(nck.mode, 255)
        image.put_dint(r.AXIS_MAP, sum(1 << (number - 1) for number in access.axes))

    def show_selection(self, image: r.ProcessImage, target: TableAddress | None) -> None:
        """Registers of the selected axis and table; all 0 while nothing is selected."""
        for first, behind in (
            (r.POSITION, r.UNITS),
            (r.AXIS_NAME, r.MARKER),
            (r.SELECTED, r.ALARM),
            (r.ENCODERS, r.SIZE),
        ):
            image.put(first, [0] * (behind - first))
        if target is None:
            return
        self._show_axis(image, target)
        if target.kind in (EEC, CEC):
            self._show_table(image, target)

    def _show_axis(self, image: r.ProcessImage, target: TableAddress) -> None:
        access, axis = self._access, target.axis
        spec, view = access.axis(axis), access.nck.axis_state(access.axis(axis).name)
        eec = access.value(f"$VA_ENC{target.encoder + 1}_COMP_VAL[", axis)
        cec = access.value("$VA_CEC_COMP_VAL[", axis)
        image.put_dint(r.POSITION, access.value("$VA_IM[", axis, position=True))
        image.put_dint(r.ACTING, {EEC: eec, CEC: cec}.get(target.kind, 0))
        image.put(r.AXIS_NAME, r.text_words(spec.name, 8))
        image.put(r.SELECTED, (target.kind, target.index, target.encoder, axis))
        referenced = access.referenced_by(axis, target.encoder)
        acting = (access.acts_by(axis, encoder) for encoder in (0, 1))
        facts = (spec.rotary, spec.modulo, referenced, view.aa_stat == 4, access.stands(axis), *acting)
        image.words[r.AXIS_BITS] = sum(1 << bit for bit, holds in enumerate(facts) if holds)
        image.words[r.SWITCHES] = self._switches(target)
        image.put_dint(r.EEC_ACTING, eec)
        image.put_dint(r.CEC_ACTING, cec)
        image.put_dint(r.BACKLASH, access.backlash(target))
        image.words[r.ENCODERS] = access.encoders(axis)
        image.put_dint(r.BACKLASH_FACTOR, access.backlash_factor(axis))

    def _show_table(self, image: r.ProcessImage, target: TableAddress) -> None:
        found = self._access.parameters(target)
        image.words[r.TABLE_FLAGS] = found.flags
        for place, value in enumerate((found.minimum, found.step, found.maximum)):
            image.put_dint(r.TABLE_FLAGS + 1 + 2 * place, value)
        image.put(r.SWITCHES - 3, (found.input_axis, found.output_axis, found.factor))
        image.put_dint(r.WEIGHT, self._access.weight(target))


# Less than this is rounding: a clock might not move at all in it.
NO_TIME_S = 1e-6


class Plc:
    """Serves the mailbox of one NCK as registers. Nothing runs while nobody asks, but what a command does."""

    def __init__(self, nck: Nck, clock: Clock, settings: PlcSettings) -> None:
        self.settings = settings
        self.memory = RetentiveMemory()
        # What a PC has to do in time counts in seconds of the PC, however fast the machine is simulated: at sixty times
        # its speed a session of 5 s of the machine would end while a busy PC takes a breath.
        self._pc = LoopClock()
        self.release = PlcRelease(self._pc)
        self.on_power_cut: Callable[[], None] = lambda: None
        self.on_session: Callable[[], None] = lambda: None
        self._clock = clock
        self.nck = nck
        self._access = TableAccess(nck, settings.write_level)
        self._status = StatusRegisters(self._access, self.switches, self.is_off)
        self._commands = PlcCommands(self, self._access)
        self._tasks: set[asyncio.Task[None]] = set()
        self._failure: BaseException | None = None
        self._late_done = self._foreign_done = False
        self.loads_done = 0
        self._begin_life(0.0)
        self.powered = False

    def _begin_life(self, now_s: float) -> None:
        """Everything as after a PLC start."""
        self.image = ProcessImage(self.settings.low_first)
        self.session = 0
        self.load: TableLoad | None = None
        self.waiting = self.confirmed = False
        self.claimed_off: set[tuple[int, int, int]] = set()
        self.backlash: dict[tuple[int, int, int], int] = {}
        self.release.begin(0)
        self._selected: TableAddress | None = None
        self._state = self._taken = 0
        self._job: tuple[asyncio.Task[None], CommandSteps] | None = None
        self._evaluating = False
        self._started_s, self._beat_s = now_s, 0.0

    def power_on(self) -> None:
        """Start the program; what is retentive is there again."""
        if not self.settings.retentive:
            self.memory = RetentiveMemory()
        self._begin_life(self._clock.now())
        self.powered = True

    def power_off(self) -> None:
        """Stop at once, wherever it is."""
        self.powered = False
        self.waiting = False
        for task in self._tasks:
            task.cancel()

    async def stop(self) -> None:
        """Power off and wait for all that ran; raises what the program itself died of, if it did."""
        self.power_off()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._failure is not None:
            raise self._failure

    def change(self, **options: Any) -> None:
        """Another set-up or another fault from now on; names as in the cell file. Raises ConfigError."""
        self.settings = self.settings.changed(options)
        self.image.low_first = self.settings.low_first

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work, name="plc")
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if error is not None and self._failure is None:
            self._failure = error

    # -- the panel and the key ---------------------------------------------------------------------

    def confirm(self) -> bool:
        """The button at the panel, pressed now; False when nothing waits for it."""
        if not self.waiting or self.settings.confirm_dead:
            return False
        self.confirmed = True
        return True

    def withdraw_release(self) -> None:
        """The person takes the release back."""
        self.release.set(False)

    # -- what the commands ask ---------------------------------------------------------------------

    def now(self) -> float:
        """Seconds of the PLC's clock."""
        return self._clock.now()

    def switches(self, target: TableAddress) -> int:
        """The switch bits as the PLC shows them."""
        bits = self._access.switches(target)
        return bits & ~{EEC: 1, CEC: 6}.get(target.kind, 8) if target.table in self.claimed_off else bits

    def is_off(self, target: TableAddress) -> bool:
        """Whether the PLC takes the table for off."""
        return target.table in self.claimed_off or self._access.is_off(target)

    def forget(self, what: ForgottenMemory) -> None:
        """What was kept is lost: words of the PLC, or points or switches of the control."""
        if what == "words":
            self.nck.core.record_fault("forget words")
            self.memory = RetentiveMemory()
            self.close_session()
        else:
            self.nck.forget(what)

    def switch_on_again(self, target: TableAddress) -> None:
        """`PlcSettings.enables_twice_s`."""
        self._spawn(self._enable_again(target))

    async def _enable_again(self, target: TableAddress) -> None:
        await self._clock.sleep(self.settings.enables_twice_s)
        if not self.nck.booting:
            self.nck.core.record_fault("enable")
            self._access.switch(target, on=True)
            self._access.activate_switches()

    def open_session(self, number: int) -> None:
        """A session begins, and the watch over register 15 with it."""
        self.session = number
        self._beat_s = self._pc.now()
        self.release.begin(number)
        self._spawn(self._watch(number))
        self.on_session()

    def close_session(self) -> None:
        """The session ends; nothing is switched."""
        self.session = 0
        self.release.begin(0)
        self.load = None

    async def _watch(self, number: int) -> None:
        while self.session == number:
            left = self._beat_s + self.settings.session_s - self._pc.now()
            if left <= NO_TIME_S:
                self._lose_session()
                return
            await self._pc.sleep(left)

    def _lose_session(self) -> None:
        self._end_job()
        self.close_session()
        self._set_result(FAILED, NO_SESSION, 0)

    # -- the wire's side (frames.Registers) -----------------------------------------------------------

    def read(self, address: int, count: int) -> Sequence[int]:
        """Registers as they are now. Raises PduRefused."""
        self._check_power()
        if address + count > r.SIZE:
            raise PduRefused(ILLEGAL_ADDRESS)
        if address <= r.SESSION:
            self._show_head()
        if address + count > r.LIVE:
            self._show_live()
        return self.image.words[address : address + count]

    def write(self, address: int, values: Sequence[int]) -> None:
        """Registers 15..135. Raises PduRefused, NoAnswer."""
        self._check_power()
        if address not in r.WRITABLE or address + len(values) > r.WRITABLE.stop:
            raise PduRefused(ILLEGAL_ADDRESS)
        number = dict(enumerate(values, start=address)).get(r.NUMBER)
        if number is not None and self._is_late(address, values):
            self._late_done = True
            self._spawn(self._write_late(address, values, number))
            raise NoAnswer
        self._accept(address, values, number)

    def _accept(self, address: int, values: Sequence[int], number: int | None) -> None:
        if address == r.PC_HEARTBEAT and values[0] != self.image.words[r.PC_HEARTBEAT]:
            self._beat_s = self._pc.now()
        self.image.put(address, values)
        fresh = number != self._taken or self.settings.redo_repeats
        if number is not None and fresh and not self._evaluating:
            self._evaluating = True
            self._spawn(self._cycle())

    def _check_power(self) -> None:
        if not self.powered:
            raise PduRefused(DEVICE_FAILURE)

    def _is_late(self, address: int, values: Sequence[int]) -> bool:
        command = dict(enumerate(values, start=address)).get(r.COMMAND, self.image.words[r.COMMAND])
        return bool(self.settings.late_command) and command == self.settings.late_command and not self._late_done

    async def _write_late(self, address: int, values: Sequence[int], number: int) -> None:
        await self._clock.sleep(self.settings.late_s)
        self._accept(address, values, number)

    # -- the cycle ---------------------------------------------------------------------------------

    async def _cycle(self) -> None:
        """One program cycle after the number changed."""
        await self._clock.sleep(self.settings.scan_s)
        self._evaluating = False
        for register, value in self.settings.overwrites:
            self.image.words[register] = value
        number = self.image.words[r.NUMBER]
        if number != self._taken or self.settings.redo_repeats:
            self._take(PlcCommand.of(self.image), number if number == self._taken else self._taken % 0xFFFF + 1)

    def _take(self, command: PlcCommand, expected: int) -> None:
        busy = self._state == BUSY
        self._end_job()
        self._taken = command[r.NUMBER]
        self.image.put(r.COMMAND_CRC, self.image.words[r.CRC : r.DATA])
        self._set_result(BUSY, 0, 0)
        work = self._commands.work(command, expected, busy=busy)
        self._job = (self._spawn(self._run(command, work)), work)
        self._foreign()

    async def _run(self, command: PlcCommand, work: CommandSteps) -> None:
        try:
            for pause_s in work:
                await self._clock.sleep(pause_s)
        except PlcFault as fault:
            self._set_result(FAILED, fault.code, fault.detail)
        except PlcPowerCut:
            self.settings = dataclasses.replace(self.settings, power_cut_after=0)
            self.on_power_cut()
        else:
            self._selected = self._commands.selected_by(command) or self._selected
            self._set_result(DONE, 0, 0)

    def _end_job(self) -> None:
        job, self._job = self._job, None
        if job is not None:
            task, work = job
            work.close()  # at once: nothing of it may happen after the next command has begun
            task.cancel()

    def _set_result(self, state: int, code: int, detail: int) -> None:
        self._state = state
        self.image.words[r.ERROR] = code
        self.image.put(r.DETAIL, (detail & 0xFFFF, detail >> 16 & 0xFFFF))

    def _foreign(self) -> None:
        """Another PC writes a command of its own, once, when its turn has come."""
        if self._foreign_done or not self.settings.second_master or self._taken != self.settings.second_master:
            return
        self._foreign_done = True
        head = [SELECT, self._taken % 0xFFFF + 1, 1, 1, *[0] * 14]
        crc = r.dint_words(r.crc_of(head), self.settings.low_first)
        self._accept(r.COMMAND, [*head, *crc], head[1])

    # -- live registers ---------------------------------------------------------------------------

    def _show_head(self) -> None:
        image, settings = self.image, self.settings
        since_s = 0.0 if settings.stale_heartbeat else self.now() - self._started_s
        bits = self._status.machine_bits(self.release.counts)
        bits |= self._status.table_bits(self._selected, bits) | self._state | (WAITING if self.waiting else 0)
        bits |= STALE if self.release.on and not self.release.counts else 0
        image.put(r.MAGIC, (r.MAGIC_WORD, settings.map_version))
        image.put_dint(r.ORDER_TEST, r.ORDER_WORD)
        image.put(r.HEARTBEAT, (int(since_s) & 0xFFFF, bits, self._taken))
        image.words[r.RESERVED] = self._access.reserved(self._selected) if self._selected else 0
        image.words[r.STORED] = len(self.load.values) if self.load else 0
        image.words[r.SESSION] = self.session

    def _show_live(self) -> None:
        self._status.show_machine(self.image)
        self._status.show_selection(self.image, self._selected)
        self.image.put(r.MARKER, (*self.memory.marker, self.memory.marker_state))
        self.image.put(r.MARKER_HEAD, self.memory.marker_head)
        self.image.words[r.RELEASE_LEFT] = self.release.left_s
