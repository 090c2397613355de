"""One push on the control, step by step: send, wait for the first half, release, wait for the second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, PointsDiffer
from drivers.sinumerik.ncprogram import pushing as pushing_program
from drivers.sinumerik.ncprogram.backup import Memory, Saving, Section
from drivers.sinumerik.ncprogram.legal import legal
from drivers.sinumerik.ncprogram.switching import switches
from drivers.sinumerik.ncprogram.words import HALF, MARKER_STATES, Phase, Word, program_path
from drivers.sinumerik.ncprogram.written import read_written
from drivers.sinumerik.opcua.dialogue import Dialogue, Glance, file_refused
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.opcua.transfer import Transfer
from drivers.sinumerik.tablefile.tables import sense_for
from drivers.types.abilities import Marker
from drivers.types.machine import ChannelStatus
from drivers.types.orders import PushBatch, PushOrder, ReadBack
from drivers.types.tables import LiveSet
from drivers.types.values import Sense

T = TypeVar("T")
GRACE_S = 3.0
FRESH_S = 60.0  # what stands may pass between a reading and the start that rests on it, wherever a person starts both


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
        self._memories: dict[str, Memory] = {}
        self._left: tuple[PushBatch, float] = ((), 0.0)

    async def prepare(self, loads: pushing_program.Loads) -> None:
        """Send, read back and select the two-half program; nothing in the control changes until NC START.

        Raises TableError (E-TABLE-NO-PROOF, E-TABLE-POINTS, E-TABLE-FINITE...), and as `legal`, before all writing.
        """
        (first, setting), batch = loads[0], tuple(order for order, _ in loads)
        axis = first.table.output_axis
        self._memories = {order.table.output_axis: own.memory for order, own in loads}
        if self._settings.two_programs:
            texts = {"LOAD": pushing_program.loading(loads), "ENAB": pushing_program.enabling(loads)}
        else:
            texts = {"PUSH": pushing_program.pushing(loads)}
        passed = [legal(program_path(purpose, axis), text, setting.memory.axes) for purpose, text in texts.items()]
        path = passed[0].program.path
        others = tuple({own.axis_number for _, own in loads} - {setting.axis_number})
        await self._dialogue.begin(setting.axis_number, first.transaction, path, others)
        await self.mark(batch, "in-progress")
        for program in passed:
            await self._transfer.send(program)
        await self._transfer.select(path)

    async def mark(self, batch: PushBatch, state: str) -> None:
        """Write the marker with the batch's number and head, by one request, never retried."""
        code = next(code for code, name in MARKER_STATES.items() if name == state)
        high, low = divmod(batch[0].head, HALF)
        head = {Word.HEAD_HIGH: float(high), Word.HEAD_LOW: float(low)}
        number = float(batch[0].transaction)
        await self._dialogue.write({Word.MARKER: number, Word.MARKER_STATE: float(code), **head})

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

    async def loaded(self, batch: PushBatch, timeout_s: float, configuration: Configuration) -> tuple[ReadBack, ...]:
        """Wait for the end of the first half: back-up of the old and read-back of the new, both as written there.

        The program that waits after its back-up is told to go on: nothing is switched or written before that.
        Raises PointsDiffer (E-NC-MISMATCH, count) when the program found differences in every table, DeviceRefused:
        E-NC-LEVEL where it could not be switched off, E-NC-FILE, E-NC-ALARM, E-NC-STOPPED; DeadlineExceeded;
        FileFormatError as `written.read_written` for a file that is not the whole one of this batch.
        """
        if not self._settings.two_programs:
            await self._until_saved(batch, timeout_s)
            await self._dialogue.write({Word.RELEASE: float(pushing_program.goes_on(batch))})
            self._dialogue.pace.again()
        good = await self.until(
            batch[0].transaction, timeout_s, lambda before, seen: self._is_loaded(batch, before, seen)
        )
        found: list[ReadBack] = []
        sections: tuple[Section, Section] = ("BACK", "READ")
        for place, order in enumerate(batch):
            memory = self._memories[order.table.output_axis]
            files = [pushing_program.saving(section, order, memory) for section in sections]
            old, new = [await live_tables(self._transfer, one, configuration, sense_for(order)) for one in files]
            found.append(ReadBack(old, new, bool(good >> place & 1)))
        return tuple(found)

    async def saved(self, batch: PushBatch, timeout_s: float, configuration: Configuration) -> tuple[LiveSet, ...]:
        """What the program found before it, once it stands after its back-up; nothing is switched or written yet.

        Raises as `loaded`, and as `live_tables`.
        """
        await self._until_saved(batch, timeout_s)
        return await self.backup(batch, configuration)

    async def _until_saved(self, batch: PushBatch, timeout_s: float) -> None:
        def is_saved(before: Glance | None, seen: Glance) -> bool | None:
            self._goes_on(batch, before, seen)
            return True if seen.phase == Phase.SAVED and seen.channel is not ChannelStatus.RESET else None

        await self.until(batch[0].transaction, timeout_s, is_saved)

    async def backup(self, batch: PushBatch, configuration: Configuration) -> tuple[LiveSet, ...]:
        """What stood before the batch, from the files that its own first half wrote; raises as `live_tables`."""
        found: list[LiveSet] = []
        for order in batch:
            memory = await self._reader.memory(configuration, order.table.output_axis, order.saved_encoder)
            saving = pushing_program.saving("BACK", order, memory)
            found.append(await live_tables(self._transfer, saving, configuration, sense_for(order)))
        return tuple(found)

    async def until(
        self,
        transaction: int,
        timeout_s: float,
        reached: Callable[[Glance | None, Glance], T | None],
        *,
        activated: bool = False,
    ) -> T:
        """Look until ``reached(before, seen)`` says something other than None of the program with this number.

        Once tables are ``activated`` a restart may end the session too, which is then opened again.
        """
        look = self._dialogue.look_after_activation if activated else self._dialogue.look_through_restart
        end = self._clock.now() + timeout_s
        before: Glance | None = None
        self._dialogue.pace.again()
        while True:
            seen = await look()
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

    def _is_loaded(self, batch: PushBatch, before: Glance | None, seen: Glance) -> int | None:
        """Which tables the program found as sent, bit by bit, once it waits."""
        ended = seen.channel is not ChannelStatus.ACTIVE
        if seen.phase == Phase.WAITING and (ended or not self._settings.two_programs):
            return round(seen.word(Word.GOOD))
        self._goes_on(batch, before, seen)
        return None

    def _goes_on(self, batch: PushBatch, before: Glance | None, seen: Glance) -> None:
        """Raises for a first half that has ended otherwise than by waiting."""
        self._dialogue.check_places(seen)
        mismatches = round(seen.word(Word.MISMATCHES))
        names, axes = _named(batch), ", ".join(dict.fromkeys(order.table.output_axis for order in batch))
        if seen.phase == Phase.ENDED_DISABLED and mismatches:
            raise PointsDiffer("E-NC-MISMATCH", self._where, count=mismatches, table=names)
        if seen.phase == Phase.LEFT and not seen.word(Word.ABORT):
            raise DeviceRefused("E-NC-LEVEL", self._where, table=names)
        if seen.phase == Phase.FILE_FAILED:
            raise file_refused(seen, self._where, axes)
        if seen.phase == Phase.WOULD_WAKE:
            raise DeviceRefused("E-NC-WAKES", self._where, table=names, axis=axes)
        stopped = before is not None and before.channel is seen.channel is ChannelStatus.RESET
        if seen.phase in (Phase.ENDED_DISABLED, Phase.LEFT) or stopped:
            raise DeviceRefused("E-NC-STOPPED", self._where, phase=seen.phase, table=names)

    async def release(self, batch: PushBatch, passed: PushBatch) -> None:
        """Set the release word to the transaction number, and which tables it holds for; select a second program."""
        bits = sum(1 << place for place, order in enumerate(batch) if order in passed)
        await self._dialogue.write({Word.PASSED: float(bits), Word.RELEASE: float(batch[0].transaction)})
        if self._settings.two_programs:
            second = program_path("ENAB", batch[0].table.output_axis)
            self._dialogue.follow(second)
            await self._transfer.select(second)
        self._dialogue.pace.again()

    async def enabled(self, passed: PushBatch, timeout_s: float, configuration: Configuration) -> tuple[bool, ...]:
        """True where the second half switched a table on, false when it, or a reset, left it off.

        The switch itself (MD32700, or SD41300) is read too where this user may; both must say so.
        """
        if not await self.until(passed[0].transaction, timeout_s, self._is_decided, activated=True):
            self._left = passed, self._clock.now()
            return (False,) * len(passed)
        return tuple([order.enable and await self._switched(order, configuration) for order in passed])

    async def read_again(self, asked: Mapping[str, int], configuration: Configuration) -> tuple[LiveSet, ...] | None:
        """What stands on axes, each with its measuring system, by the files of a way back that has just left all off.

        Its program compared every point once more after it had written them, and nothing of it was switched on; so no
        program needs to be started to read the same again. Somebody may change a table after it: one program of both
        halves is held against this before it writes; with two it is believed once. None where that does not hold: for
        other axes, after `FRESH_S`, when anything was sent since, when a switch reads on.
        """
        batch, since = self._left
        if self._settings.two_programs:
            self._left = (), 0.0
        of = {(order.table.output_axis, order.saved_encoder): order for order in batch}
        quiet = all(order.purpose == "restore" and not order.enable and not order.coupled for order in batch)
        if not (quiet and set(asked.items()) <= set(of)) or self._clock.now() - since > FRESH_S:
            return None
        if not self._is_as_left(batch, await self._dialogue.look()):
            return None
        for name in {name for order in batch for name in switches(order.table)}:
            if await self._reader.switch(name, configuration):
                return None
        found = [pushing_program.saving("READ", of[one], self._memories[one[0]]) for one in asked.items()]
        return tuple([await live_tables(self._transfer, one, configuration) for one in found])

    @staticmethod
    def _is_as_left(batch: PushBatch, seen: Glance) -> bool:
        words = {Word.TRANSACTION: batch[0].transaction, Word.MISMATCHES: 0, Word.GOOD: (1 << len(batch)) - 1}
        ended = seen.channel is ChannelStatus.RESET and seen.phase == Phase.ENDED_DISABLED
        return ended and all(seen.word(word) == value for word, value in words.items())

    async def _switched(self, order: PushOrder, configuration: Configuration) -> bool:
        names = switches(order.table)
        return all([await self._reader.switch(name, configuration) is not False for name in names])

    def _is_decided(self, before: Glance | None, seen: Glance) -> bool | None:
        self._dialogue.check_places(seen)
        if seen.phase == Phase.ENABLED:
            return True
        if seen.phase in (Phase.ENDED_DISABLED, Phase.LEFT):
            return False
        waits_for_second = self._settings.two_programs and seen.phase == Phase.WAITING
        stopped = before is not None and before.channel is seen.channel is ChannelStatus.RESET
        return False if stopped and not waits_for_second else None

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """Wait through one NCK reset and the reference run of every input axis. Raises as `activation`."""
        shown, axes = any(order.enable for order in passed), ", ".join(order.table.output_axis for order in passed)
        look_s, where = 0.4 * self._settings.poll_s, self._where
        await activation(
            self._dialogue, self._clock, axis=axes, timeout_s=timeout_s, look_s=look_s, where=where, shown=shown
        )


def _named(batch: PushBatch) -> str:
    return ", ".join(order.table.name for order in batch)


async def activation(
    dialogue: Dialogue, clock: Clock, axis: str, timeout_s: float, look_s: float, where: str, *, shown: bool = True
) -> None:
    """Return when the axis is referenced and the channel in reset, after the reference was seen to be lost.

    A look is taken every ``look_s``. The restart may still pass between two looks, so a state that stays as
    wanted for `GRACE_S` counts as well: whether the table acts is proved by its live values, not here. Where nothing
    will act, not ``shown``, only a restart that was seen counts.
    Raises DeadlineExceeded (E-NC-NO-ACTIVATION) and what the session raises.
    """
    end = clock.now() + timeout_s
    seen_down, settled_since = False, None
    dialogue.pace.again()
    while True:
        seen = await dialogue.look_after_activation()
        now = clock.now()
        seen_down = seen_down or seen is None or not seen.referenced
        if seen is None or not _is_back(seen):
            settled_since = None
        else:
            settled_since = now if settled_since is None else settled_since
            if seen_down or (shown and now - settled_since >= GRACE_S):
                return
        if now >= end:
            raise DeadlineExceeded("E-NC-NO-ACTIVATION", where, axis=axis, timeout_s=timeout_s)
        await dialogue.wait(look_s)


def _is_back(seen: Glance) -> bool:
    asks = seen.message.startswith(pushing_program.ACTIVATE)
    return seen.referenced and seen.channel is ChannelStatus.RESET and not asks
