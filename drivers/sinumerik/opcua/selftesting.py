"""The self-test through OPC UA: sent, followed to its end, and its report read, whatever stopped it."""

from __future__ import annotations

from drivers.errors import DeviceRefused, words
from drivers.programs import SelfTest, SelfTested
from drivers.sinumerik.ncprogram import selftest as program
from drivers.sinumerik.ncprogram.backup import Memory
from drivers.sinumerik.ncprogram.legal import legal
from drivers.sinumerik.ncprogram.measuring import Setting
from drivers.sinumerik.ncprogram.selftest import Report
from drivers.sinumerik.ncprogram.words import Phase, Word, file_path, program_path
from drivers.sinumerik.opcua.dialogue import HARMLESS, Dialogue, Glance, file_refused
from drivers.sinumerik.opcua.pushing import Pushing
from drivers.sinumerik.opcua.transfer import Transfer
from drivers.types.identity import MachineIdentity
from drivers.types.machine import ChannelStatus

_NOTHING = Report("", 0, passed=(), failed=(), whole=False)


class SelfTesting:
    """The self-test of one axis at a time; it shares dialogue and transfer with all else the driver does."""

    def __init__(self, dialogue: Dialogue, transfer: Transfer, pushing: Pushing, where: str) -> None:
        self._dialogue = dialogue
        self._transfer = transfer
        self._pushing = pushing
        self._where = where
        self._number = 0
        self._words: tuple[str, ...] = ()
        self._alarms: set[int] = set()
        self._memory = Memory(0)

    async def prepare(self, order: SelfTest, setting: Setting) -> None:
        """Send, read back and select the program.

        Raises DeviceRefused (E-NC-NOT-RESET) with nothing written while a program runs or waits, and as `legal`.
        """
        path = program_path("SELF", order.axis)
        number = self._dialogue.fresh_number()
        text = program.self_test(order.axis, order.encoder, number=number, setting=setting)
        passed = legal(path, text, setting.memory.axes)
        self._number, self._words = (
            number,
            tuple(word for word in program.words_of(order.axis, order.encoder, setting) if word != program.LOOPS),
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
            tuple(word for word in tried if word != program.LOOPS) for tried in (report.passed, report.failed)
        )
        untried = self._untried(report)
        whole = report.whole or (program.LOOPS not in report.passed and not untried)
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
            without=() if program.LOOPS in report.passed else (program.LOOPS,),
            own_points=self._memory.eec_points,
            cross_points=self._memory.cec_points,
            file_kb=self._memory.file_kb,
        )

    async def _report(self, order: SelfTest) -> Report:
        """What the program of this very number wrote; nothing where it could not."""
        text = await self._transfer.found(file_path("SELF", order.axis))
        report = None if text is None else program.read_report(text, order.axis)
        return report if report is not None and report.number == self._number else _NOTHING

    def _untried(self, report: Report) -> tuple[str, ...]:
        """Trials that the report does not name, in order: the program stopped at the first."""
        return tuple(word for word in self._words if word not in (*report.passed, *report.failed))

    def _is_over(self, order: SelfTest, before: Glance | None, seen: Glance) -> bool | None:
        self._alarms |= self._dialogue.fresh_alarms(seen)
        if seen.phase == Phase.FILE_FAILED:
            raise file_refused(seen, self._where, order.axis)
        if seen.channel is not ChannelStatus.RESET:
            return None
        if seen.phase == Phase.FINISHED:
            return True
        if seen.phase == Phase.LEFT or (before is not None and before.channel is ChannelStatus.RESET):
            trial = round(seen.word(Word.COUNTER))
            raise DeviceRefused("E-NC-SELF-STOPPED", self._where, axis=order.axis, trial=trial)
        return None
