"""One push on the control, step by step: send, wait for the first half, release, wait for the second."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, PointsDiffer
from drivers.sinumerik.ncprogram import pushing as pushing_program
from drivers.sinumerik.ncprogram.backup import Memory, Saving, Section
from drivers.sinumerik.ncprogram.legal import legal
from drivers.sinumerik.ncprogram.measuring import Setting
from drivers.sinumerik.ncprogram.words import HALF, MARKER_STATES, Phase, Word, program_path
from drivers.sinumerik.ncprogram.written import read_written
from drivers.sinumerik.opcua.dialogue import Dialogue, Glance, file_refused
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.opcua.transfer import Transfer
from drivers.sinumerik.tablefile.tables import sense_for
from drivers.types.abilities import Marker
from drivers.types.machine import ChannelStatus
from drivers.types.orders import PushOrder
from drivers.types.tables import LiveSet
from drivers.types.values import Sense

T = TypeVar("T")


async def live_tables(transfer: Transfer, saving: Saving, configuration: Configuration, cec_sign: Sense = 1) -> LiveSet:
    """Fetch the file of one run of our program and read it; raises what `Transfer.fetch` and `read_written` do."""
    text = await transfer.fetch(saving.path)
    return read_written(text, saving.path, saving=saving, units=configuration.units, cec_sign=cec_sign)


class Pushing:
    """The push half of the driver; it shares dialogue, reader and transfer with the measuring half."""

    def __init__(
        self,
        dialogue: Dialogue,
        reader: MachineReader,
        transfer: Transfer,
        settings: UaSettings,
        clock: Clock,
        where: str,
    ) -> None:
        self._dialogue = dialogue
        self._reader = reader
        self._transfer = transfer
        self._settings = settings
        self._clock = clock
        self._where = where
        self._memory = Memory(0)

    async def prepare(self, order: PushOrder, setting: Setting) -> None:
        """Send, read back and select the two-half program; nothing in the control changes until NC START.

        Raises TableError (E-TABLE-NO-PROOF, E-TABLE-POINTS, E-TABLE-FINITE...), and as `legal`, before all writing.
        """
        axis, self._memory = order.table.output_axis, setting.memory
        if self._settings.two_programs:
            texts = {"LOAD": pushing_program.loading(order, setting), "ENAB": pushing_program.enabling(order, setting)}
        else:
            texts = {"PUSH": pushing_program.pushing(order, setting)}
        passed = [legal(program_path(purpose, axis), text, setting.memory.axes) for purpose, text in texts.items()]
        first = passed[0].program.path
        await self._dialogue.begin(setting.axis_number, order.transaction, first)
        await self.mark(order, "in-progress")
        for program in passed:
            await self._transfer.send(program)
        await self._transfer.select(first)

    async def mark(self, order: PushOrder, state: str) -> None:
        """Write the marker with the order's number and head, by one request, never retried."""
        code = next(code for code, name in MARKER_STATES.items() if name == state)
        high, low = divmod(order.head, HALF)
        head = {Word.HEAD_HIGH: float(high), Word.HEAD_LOW: float(low)}
        await self._dialogue.write({Word.MARKER: float(order.transaction), Word.MARKER_STATE: float(code), **head})

    async def marker(self) -> Marker:
        """The marker as it stands; anything that is not one of ours is none."""
        seen = await self._dialogue.look()
        number, code = seen.word(Word.MARKER), seen.word(Word.MARKER_STATE)
        state = MARKER_STATES.get(int(code)) if code.is_integer() else None
        if state is None or not number.is_integer() or number < 1:
            return Marker(0, "none")
        high, low = seen.word(Word.HEAD_HIGH), seen.word(Word.HEAD_LOW)
        whole = all(half.is_integer() and 0 <= half < HALF for half in (high, low))
        return Marker(int(number), state, int(high) * HALF + int(low) if whole else 0)

    async def loaded(self, order: PushOrder, timeout_s: float, configuration: Configuration) -> tuple[LiveSet, LiveSet]:
        """Wait for the end of the first half: (back-up of the old, read-back of the new), both as written there.

        Raises PointsDiffer (E-NC-MISMATCH, count) when the program found differences, DeviceRefused: E-NC-LEVEL when
        the compensation could not be switched off, E-NC-FILE, E-NC-ALARM, E-NC-STOPPED; DeadlineExceeded;
        FileFormatError as `written.read_written` for a file that is not the whole one of this very order.
        """
        await self._until(order, timeout_s, self._is_loaded)
        sections: tuple[Section, Section] = ("BACK", "READ")
        files = [pushing_program.saving(section, order, self._memory) for section in sections]
        backup, readback = [await live_tables(self._transfer, one, configuration, sense_for(order)) for one in files]
        return backup, readback

    async def backup(self, order: PushOrder, configuration: Configuration) -> LiveSet:
        """What stood before the order, from the file that its own first half wrote; raises as `live_tables`."""
        table = order.table
        memory = await self._reader.memory(configuration, table.output_axis, order.saved_encoder)
        saving = pushing_program.saving("BACK", order, memory)
        return await live_tables(self._transfer, saving, configuration, sense_for(order))

    async def _until(
        self, order: PushOrder, timeout_s: float, reached: Callable[[PushOrder, Glance | None, Glance], T | None]
    ) -> T:
        """As `until`, for a push's order."""
        return await self.until(order.transaction, timeout_s, lambda before, seen: reached(order, before, seen))

    async def until(
        self, transaction: int, timeout_s: float, reached: Callable[[Glance | None, Glance], T | None]
    ) -> T:
        """Look until ``reached(before, seen)`` says something other than None of the program with this number."""
        end = self._clock.now() + timeout_s
        before: Glance | None = None
        self._dialogue.pace.again()
        while True:
            seen = await self._dialogue.look_through_restart()
            if seen is not None:
                await self._dialogue.check_alarms(seen)
                ours = seen.word(Word.TRANSACTION) == transaction
                answer = reached(before, seen) if ours else None
                if answer is not None:
                    return answer
                before = seen if ours else None
            if self._clock.now() >= end:
                phase = seen.phase if seen is not None else "unknown"
                raise DeadlineExceeded("E-NC-NO-START", self._where, timeout_s=timeout_s, phase=phase)
            await self._dialogue.wait()

    def _is_loaded(self, order: PushOrder, before: Glance | None, seen: Glance) -> bool | None:
        mismatches = round(seen.word(Word.MISMATCHES))
        at_rest = seen.channel is not ChannelStatus.ACTIVE
        if seen.phase == Phase.WAITING and at_rest:
            return True
        if seen.phase == Phase.ENDED_DISABLED and mismatches:
            raise PointsDiffer("E-NC-MISMATCH", self._where, count=mismatches, table=order.table.name)
        if seen.phase == Phase.LEFT and not seen.word(Word.ABORT):
            raise DeviceRefused("E-NC-LEVEL", self._where, table=order.table.name)
        if seen.phase == Phase.FILE_FAILED:
            raise file_refused(seen, self._where, order.table.output_axis)
        if seen.phase == Phase.WOULD_WAKE:
            raise DeviceRefused("E-NC-WAKES", self._where, table=order.table.name, axis=order.table.output_axis)
        stopped = before is not None and before.channel is seen.channel is ChannelStatus.RESET
        if seen.phase in (Phase.ENDED_DISABLED, Phase.LEFT) or stopped:
            raise DeviceRefused("E-NC-STOPPED", self._where, phase=seen.phase, table=order.table.name)
        return None

    async def release(self, order: PushOrder) -> None:
        """Set the release word to the transaction number; never retried. Two programs: select the second."""
        await self._dialogue.write({Word.RELEASE: float(order.transaction)})
        if self._settings.two_programs:
            second = program_path("ENAB", order.table.output_axis)
            self._dialogue.follow(second)
            await self._transfer.select(second)
        self._dialogue.pace.again()

    async def enabled(self, order: PushOrder, timeout_s: float, configuration: Configuration) -> bool:
        """True when the second half switched the table on, false when it, or a reset, left it off.

        The switch itself (MD32700, or SD41300) is read too where this user may; both must say so.
        """
        if not await self._until(order, timeout_s, self._is_decided):
            return False
        names = pushing_program.switches(order.table)
        return all([await self._reader.switch(name, configuration) is not False for name in names])

    def _is_decided(self, _order: PushOrder, before: Glance | None, seen: Glance) -> bool | None:
        if seen.phase == Phase.ENABLED:
            return True
        if seen.phase in (Phase.ENDED_DISABLED, Phase.LEFT):
            return False
        waits_for_second = self._settings.two_programs and seen.phase == Phase.WAITING
        stopped = before is not None and before.channel is seen.channel is ChannelStatus.RESET
        return False if stopped and not waits_for_second else None
