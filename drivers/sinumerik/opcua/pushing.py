"""Pushing, switching off and self-test through OPC UA: programs sent, followed to their end, and what is read back.

A push sends one program, waits for its back-up and its first half, releases what the gateway found right, and waits for
the second half (`drivers.sinumerik.ncprogram.build_push_program`). A broken session leaves the outcome unknown: it
is read back, never repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, PointsDiffer, words
from drivers.message import Message
from drivers.programs import SelfTest, SelfTested
from drivers.sinumerik.ncprogram import pushing as push_program
from drivers.sinumerik.ncprogram import selftest, switching
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints, Section, read_backup
from drivers.sinumerik.ncprogram.checks import check_program
from drivers.sinumerik.ncprogram.measuring import MachineSetting
from drivers.sinumerik.ncprogram.selftest import SelfTestReport
from drivers.sinumerik.ncprogram.switching import switches
from drivers.sinumerik.ncprogram.words import HALF, MARKER_STATES, Phase, Word, file_path, program_path
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.program_dialogue import HARMLESS, ProgramDialogue, StatusSnapshot, Transfer, file_error
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.tablefile.tables import order_sense
from drivers.types.abilities import Marker
from drivers.types.identity import MachineIdentity
from drivers.types.machine import ChannelStatus
from drivers.types.orders import DisableOrder, PushBatch, PushOrder, ReadBack, SwitchReading
from drivers.types.tables import LiveSet
from drivers.types.values import Sense

# Push.

T = TypeVar("T")
GRACE_S = 3.0
FRESH_S = 60.0  # what stands may pass between a reading and the start that rests on it, wherever a person starts both


async def fetch_live_tables(
    transfer: Transfer, saving: BackupFile, configuration: Configuration, cec_sign: Sense = 1
) -> LiveSet:
    """Fetch the file of one run of our program and read it; raises what `Transfer.fetch` and `read_backup` do."""
    text = await transfer.fetch(saving.path)
    return read_backup(text, saving.path, saving=saving, units=configuration.units, cec_sign=cec_sign)


class Pushing:
    """The push half of the driver; it shares dialogue, reader and transfer with the measuring half."""

    def __init__(
        self,
        dialogue: ProgramDialogue,
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
        self._memories: dict[str, ReservedPoints] = {}
        self._left: tuple[PushBatch, float] = ((), 0.0)

    async def prepare(self, loads: push_program.Loads) -> None:
        """Send, read back and select the two-half program; nothing in the control changes until NC START.

        Raises TableError (E-TABLE-NO-PROOF, E-TABLE-POINTS, E-TABLE-FINITE...), and as `check_program`, before all
        writing.
        """
        (first, setting), batch = loads[0], tuple(order for order, _ in loads)
        axis = first.table.output_axis
        self._memories = {order.table.output_axis: own.memory for order, own in loads}
        if self._settings.two_programs:
            texts = {
                "LOAD": push_program.build_loading_program(loads),
                "ENAB": push_program.build_enabling_program(loads),
            }
        else:
            texts = {"PUSH": push_program.build_push_program(loads)}
        passed = [
            check_program(program_path(purpose, axis), text, setting.memory.axes) for purpose, text in texts.items()
        ]
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
        FileFormatError as `backup.read_backup` for a file that is not the whole one of this batch.
        """
        if not self._settings.two_programs:
            await self._until_saved(batch, timeout_s)
            await self._dialogue.write({Word.RELEASE: float(push_program.go_on_word(batch))})
            self._dialogue.pace.again()
        good = await self.until(
            batch[0].transaction, timeout_s, lambda before, seen: self._is_loaded(batch, before, seen)
        )
        found: list[ReadBack] = []
        sections: tuple[Section, Section] = ("BACK", "READ")
        for place, order in enumerate(batch):
            memory = self._memories[order.table.output_axis]
            files = [push_program.backup_file_of(section, order, memory) for section in sections]
            old, new = [
                await fetch_live_tables(self._transfer, one, configuration, order_sense(order)) for one in files
            ]
            found.append(ReadBack(old, new, bool(good >> place & 1)))
        return tuple(found)

    async def never_started(self, batch: PushBatch) -> bool:
        """Whether the words stand as `prepare` left them, but for the abort word that ends a start from now on.

        The program writes its number first of all; what is sent for another program clears the words, so this batch
        must be the newest. The marker, written with it, shows that the control has not lost its words since.
        """
        if self._dialogue.newest != batch[0].transaction:
            return False
        seen = await self._dialogue.look()
        marked = seen.word(Word.MARKER) == batch[0].transaction
        cleared = not any(seen.word(word) for word in (Word.TRANSACTION, Word.PHASE, Word.COUNTER))
        return seen.channel is ChannelStatus.RESET and marked and cleared and seen.word(Word.ABORT) == 1.0

    async def saved(self, batch: PushBatch, timeout_s: float, configuration: Configuration) -> tuple[LiveSet, ...]:
        """What the program found before it, once it stands after its back-up; nothing is switched or written yet.

        Raises as `loaded`, and as `fetch_live_tables`.
        """
        await self._until_saved(batch, timeout_s)
        return await self.backup(batch, configuration)

    async def _until_saved(self, batch: PushBatch, timeout_s: float) -> None:
        def is_saved(before: StatusSnapshot | None, seen: StatusSnapshot) -> bool | None:
            self._goes_on(batch, before, seen)
            return True if seen.phase == Phase.SAVED and seen.channel is not ChannelStatus.RESET else None

        await self.until(batch[0].transaction, timeout_s, is_saved)

    async def backup(self, batch: PushBatch, configuration: Configuration) -> tuple[LiveSet, ...]:
        """What stood before the batch, from the files that its own first half wrote; raises as `fetch_live_tables`."""
        found: list[LiveSet] = []
        for order in batch:
            memory = await self._reader.memory(configuration, order.table.output_axis, order.saved_encoder)
            saving = push_program.backup_file_of("BACK", order, memory)
            found.append(await fetch_live_tables(self._transfer, saving, configuration, order_sense(order)))
        return tuple(found)

    async def until(
        self,
        transaction: int,
        timeout_s: float,
        reached: Callable[[StatusSnapshot | None, StatusSnapshot], T | None],
        *,
        activated: bool = False,
    ) -> T:
        """Look until ``reached(before, seen)`` says something other than None of the program with this number.

        Once tables are ``activated`` a restart may end the session too, which is then opened again.
        """
        look = self._dialogue.look_after_activation if activated else self._dialogue.look_through_restart
        end = self._clock.now() + timeout_s
        before: StatusSnapshot | None = None
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

    def _is_loaded(self, batch: PushBatch, before: StatusSnapshot | None, seen: StatusSnapshot) -> int | None:
        """Which tables the program found as sent, bit by bit, once it waits."""
        ended = seen.channel is not ChannelStatus.ACTIVE
        if seen.phase == Phase.WAITING and (ended or not self._settings.two_programs):
            return round(seen.word(Word.GOOD))
        self._goes_on(batch, before, seen)
        return None

    def _goes_on(self, batch: PushBatch, before: StatusSnapshot | None, seen: StatusSnapshot) -> None:
        """Raises for a first half that has ended otherwise than by waiting."""
        self._dialogue.check_places(seen)
        mismatches = round(seen.word(Word.MISMATCHES))
        names, axes = _named(batch), ", ".join(dict.fromkeys(order.table.output_axis for order in batch))
        if seen.phase == Phase.ENDED_DISABLED and mismatches:
            raise PointsDiffer("E-NC-MISMATCH", self._where, count=mismatches, table=names)
        if seen.phase == Phase.LEFT and not seen.word(Word.ABORT):
            raise DeviceRefused("E-NC-LEVEL", self._where, table=names)
        if seen.phase == Phase.FILE_FAILED:
            raise file_error(seen, self._where, axes)
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
        found = [push_program.backup_file_of("READ", of[one], self._memories[one[0]]) for one in asked.items()]
        return tuple([await fetch_live_tables(self._transfer, one, configuration) for one in found])

    @staticmethod
    def _is_as_left(batch: PushBatch, seen: StatusSnapshot) -> bool:
        words = {Word.TRANSACTION: batch[0].transaction, Word.MISMATCHES: 0, Word.GOOD: (1 << len(batch)) - 1}
        ended = seen.channel is ChannelStatus.RESET and seen.phase == Phase.ENDED_DISABLED
        return ended and all(seen.word(word) == value for word, value in words.items())

    async def _switched(self, order: PushOrder, configuration: Configuration) -> bool:
        names = switches(order.table)
        return all([await self._reader.switch(name, configuration) is not False for name in names])

    def _is_decided(self, before: StatusSnapshot | None, seen: StatusSnapshot) -> bool | None:
        self._dialogue.check_places(seen)
        if seen.phase == Phase.ENABLED:
            return True
        if seen.phase in (Phase.ENDED_DISABLED, Phase.LEFT):
            return False
        waits_for_second = self._settings.two_programs and seen.phase == Phase.WAITING
        stopped = before is not None and before.channel is seen.channel is ChannelStatus.RESET
        return False if stopped and not waits_for_second else None

    async def restarted(self, passed: PushBatch, timeout_s: float) -> None:
        """Wait through one NCK reset and the reference run of every input axis. Raises as `wait_for_activation`."""
        shown, axes = any(order.enable for order in passed), ", ".join(order.table.output_axis for order in passed)
        look_s, where = 0.4 * self._settings.poll_s, self._where
        await wait_for_activation(
            self._dialogue, self._clock, axis=axes, timeout_s=timeout_s, look_s=look_s, where=where, shown=shown
        )


def _named(batch: PushBatch) -> str:
    return ", ".join(order.table.name for order in batch)


async def wait_for_activation(
    dialogue: ProgramDialogue,
    clock: Clock,
    axis: str,
    timeout_s: float,
    look_s: float,
    where: str,
    *,
    shown: bool = True,
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


def _is_back(seen: StatusSnapshot) -> bool:
    asks = seen.message.startswith(push_program.ACTIVATE)
    return seen.referenced and seen.channel is ChannelStatus.RESET and not asks


# Switching one table off, by a program of its own.


class Disabling:
    """The disable-only order; it shares dialogue, reader and transfer with all else the driver does."""

    def __init__(
        self, dialogue: ProgramDialogue, reader: MachineReader, transfer: Transfer, pushing: Pushing, where: str
    ) -> None:
        self._dialogue = dialogue
        self._reader = reader
        self._transfer = transfer
        self._pushing = pushing
        self._where = where

    async def prepare(self, order: DisableOrder, setting: MachineSetting) -> None:
        """Send, read back and select the program; nothing in the control changes until NC START.

        Raises DeviceRefused (E-NC-NOT-RESET) with nothing written while a program runs or waits, and as
        `check_program`.
        """
        path = program_path("OFF", order.axis)
        passed = check_program(path, switching.build_disable_program(order, setting), setting.memory.axes)
        await self._dialogue.begin(setting.axis_number, order.transaction, path)
        await self._transfer.send(passed)
        await self._transfer.select(path)

    async def disabled(self, order: DisableOrder, timeout_s: float, configuration: Configuration) -> SwitchReading:
        """Wait for the program's end, then read back. Where this user may not read a switch, the program has.

        Raises DeadlineExceeded (E-NC-NO-START), DeviceRefused (E-NC-STOPPED, E-NC-ALARM).
        """
        said_off = await self._pushing.until(order.transaction, timeout_s, self._is_over)
        found = await self.reading(order, configuration)
        return replace(found, enabled=False) if said_off and found.enabled is None else found

    def _is_over(self, before: StatusSnapshot | None, seen: StatusSnapshot) -> bool | None:
        if seen.channel is not ChannelStatus.RESET:
            return None
        if seen.phase in (Phase.SWITCHED_OFF, Phase.STILL_ON):
            return bool(seen.phase == Phase.SWITCHED_OFF)
        if seen.phase == Phase.LEFT or (before is not None and before.channel is ChannelStatus.RESET):
            raise DeviceRefused("E-NC-STOPPED", self._where, phase=seen.phase, table=Message.of("W-UA-DISABLE-ORDER"))
        return None

    async def reading(self, order: DisableOrder, configuration: Configuration) -> SwitchReading:
        """Every switch of the table, as far as this user may read it, and what acts; one request each."""
        found = {await self._reader.switch(name, configuration) for name in switching.order_switches(order)}
        axis = (await self._reader.state(configuration)).axes[order.axis]
        acts = {"axis": axis.encoder_compensation, "cross": axis.cross_compensation, "reversal": 0.0}
        return SwitchReading(found.pop() if len(found) == 1 else None, acts[order.kind])


# Self-test: its report is read whatever stopped it.

_NOTHING = SelfTestReport("", 0, passed=(), failed=(), whole=False)


class SelfTesting:
    """The self-test of one axis at a time; it shares dialogue and transfer with all else the driver does."""

    def __init__(self, dialogue: ProgramDialogue, transfer: Transfer, pushing: Pushing, where: str) -> None:
        self._dialogue = dialogue
        self._transfer = transfer
        self._pushing = pushing
        self._where = where
        self._number = 0
        self._words: tuple[str, ...] = ()
        self._alarms: set[int] = set()
        self._memory = ReservedPoints(0)

    async def prepare(self, order: SelfTest, setting: MachineSetting) -> None:
        """Send, read back and select the program.

        Raises DeviceRefused (E-NC-NOT-RESET) with nothing written while a program runs or waits, and as
        `check_program`.
        """
        path = program_path("SELF", order.axis)
        number = self._dialogue.fresh_number()
        text = selftest.build_self_test_program(order.axis, order.encoder, number=number, setting=setting)
        passed = check_program(path, text, setting.memory.axes)
        self._number, self._words = (
            number,
            tuple(word for word in selftest.trial_words(order.axis, order.encoder, setting) if word != selftest.LOOPS),
        )
        self._alarms, self._memory = set(), setting.memory
        await self._dialogue.begin(setting.axis_number, number, path)
        await self._transfer.send(passed)
        await self._transfer.select(path)

    async def tested(self, order: SelfTest, timeout_s: float, machine: MachineIdentity, utc: str) -> SelfTested:
        """Wait for the program's end and read what it wrote.

        An alarm, a RESET or a report that is not whole ends it as not passed, with the trial it stopped at. Raises
        DeadlineExceeded (E-NC-NO-START) and what the wire raises.
        """
        stopped = ""
        try:
            await self._pushing.until(self._number, timeout_s, lambda before, seen: self._is_over(order, before, seen))
        except DeviceRefused as error:
            stopped = str(error)
        report = await self._report(order)
        passed, failed = (
            tuple(word for word in tried if word != selftest.LOOPS) for tried in (report.passed, report.failed)
        )
        untried = self._untried(report)
        whole = report.whole or (selftest.LOOPS not in report.passed and not untried)
        if whole:  # what stopped it then is the word that programs do without
            stopped = ""
        if self._alarms & HARMLESS and not stopped:
            # The program went on with the old value, which is what it had written: only the alarm tells.
            stopped = words("W-NC-SELF-ALARM", axis=order.axis, numbers=", ".join(map(str, sorted(self._alarms))))
        if not whole or untried:
            stopped = stopped or words("W-NC-SELF-CUT", axis=order.axis)
            failed += untried[:1]
        return SelfTested(
            machine,
            order.axis,
            encoder=order.encoder,
            utc=utc,
            control_date=report.date,
            passed=passed,
            failed=failed,
            stopped=stopped,
            without=() if selftest.LOOPS in report.passed else (selftest.LOOPS,),
            own_points=self._memory.eec_points,
            cross_points=self._memory.cec_points,
            file_kb=self._memory.file_kb,
        )

    async def _report(self, order: SelfTest) -> SelfTestReport:
        """What the program of this very number wrote; nothing where it could not."""
        text = await self._transfer.found(file_path("SELF", order.axis))
        report = None if text is None else selftest.read_self_test_report(text, order.axis)
        return report if report is not None and report.number == self._number else _NOTHING

    def _untried(self, report: SelfTestReport) -> tuple[str, ...]:
        """Trials that the report does not name, in order: the program stopped at the first."""
        return tuple(word for word in self._words if word not in (*report.passed, *report.failed))

    def _is_over(self, order: SelfTest, before: StatusSnapshot | None, seen: StatusSnapshot) -> bool | None:
        self._alarms |= self._dialogue.fresh_alarms(seen)
        if seen.phase == Phase.FILE_FAILED:
            raise file_error(seen, self._where, order.axis)
        if seen.channel is not ChannelStatus.RESET:
            return None
        if seen.phase == Phase.FINISHED:
            return True
        if seen.phase == Phase.LEFT or (before is not None and before.channel is ChannelStatus.RESET):
            trial = round(seen.word(Word.COUNTER))
            raise DeviceRefused("E-NC-SELF-STOPPED", self._where, axis=order.axis, trial=trial)
        return None
