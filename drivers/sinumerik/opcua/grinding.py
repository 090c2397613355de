"""A test part on the control, step by step: set-up values placed, program sent, spaces counted, its end told.

`HeldNumbers` reads and writes the numbers from which the builder's own cycle takes its set-up values.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from drivers.clock import Clock
from drivers.errors import ConfigError, DeadlineExceeded, DeviceRefused
from drivers.programs import NOBODY
from drivers.sinumerik.ncprogram import grinding as grinding_program
from drivers.sinumerik.ncprogram.backup import BackupFile, ReservedPoints
from drivers.sinumerik.ncprogram.checks import Guard, check_program
from drivers.sinumerik.ncprogram.grinding import GrindSetting
from drivers.sinumerik.ncprogram.words import Phase, Word, program_path
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.program_dialogue import ProgramDialogue, StatusSnapshot, Transfer, file_error
from drivers.sinumerik.opcua.pushing import fetch_live_tables
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.machine import ChannelStatus
from drivers.types.tables import LiveSet
from drivers.workpiece import GrindPlan, check_plan

# Nothing waits for an echo here: looks are this many polls apart, a second at most.
CALM, LONGEST_LOOK_S = 4.0, 1.0
_BEGUN = (Phase.GRINDING, Phase.FINISHED, Phase.LEFT)


def preview_program(plan: GrindPlan, settings: Mapping[str, Any], where: str) -> str:
    """The program that would be sent, without a control. Raises as that does, and ConfigError."""
    return grinding_program.preview_program(plan, UaSettings.read(settings, where).words)


class PartGrinding:
    """The grinding part of the driver; it shares dialogue, reader and transfer with the others."""

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
        self._token = 0
        self._memory: Mapping[str, ReservedPoints] = {}
        self._saved = False
        self._ended = False
        self._placed: dict[int, float] = {}
        self.plan: GrindPlan | None = None
        self.origin = NOBODY
        self.guards: tuple[Guard, ...] = ()
        self.loops = True

    async def prepare(self, plan: GrindPlan, configuration: Configuration) -> str:
        """Place the set-up values, send the program, read both back and select it; returns its text.

        Raises as `check_plan` and `check_program`, UnsupportedDevice (E-NC-AXIS), DeviceRefused (E-NC-NOT-RESET)
        before all writing; E-GRIND-NOT-HELD, and what sending and selecting raise, before anything was selected.
        """
        check_plan(plan)
        numbers = [configuration.number(axis.name, self._where) for axis in plan.named]
        setting = await self._setting(plan, configuration)
        token = self._dialogue.fresh_number()
        path = program_path("GRIND", plan.index.name)
        text = grinding_program.build_grinding_program(plan, token, setting)
        passed = check_program(path, text, configuration.names, still=grinding_program.fixed_axes(plan))
        await self._dialogue.begin(numbers[0], token, path)
        self.plan, self._token, self._saved, self._ended = plan, token, False, False
        self._memory = setting.memory
        self._placed = grinding_program.set_up_parameters(plan, setting.words)
        await self._dialogue.place(self._placed)
        await self._dialogue.write({Word.RELEASE: float(token)})
        await self._transfer.send(passed)
        await self._transfer.select(path)
        return passed.program.text

    async def _setting(self, plan: GrindPlan, configuration: Configuration) -> GrindSetting:
        memory = {
            axis.name: await self._reader.memory(configuration, axis.name, axis.encoder) for axis in plan.compensated
        }
        modulo = configuration.is_modulo(plan.index.name, rotary=True)
        return GrindSetting(
            self._settings.words, memory, modulo, origin=self.origin, guards=self.guards, loops=self.loops
        )

    async def ground(self, after: int, timeout_s: float) -> int | None:
        """Spaces done, once they are more than ``after`` (-1: once the program has begun); None when it has ended.

        Raises DeadlineExceeded (E-GRIND-NO-START, E-GRIND-NO-PROGRESS), DeviceRefused (E-NC-ALARM, E-NC-FILE,
        E-GRIND-SETUP-REFUSED, E-GRIND-LEFT, E-GRIND-STOPPED, E-GRIND-SETUP-CHANGED), and what the wire raises.
        """
        end = self._clock.now() + timeout_s
        look_s = min(CALM * self._settings.poll_s, LONGEST_LOOK_S)
        before: StatusSnapshot | None = None
        while not self._ended:
            seen = await self._dialogue.look()
            await self._dialogue.check_alarms(seen)
            ours = seen.word(Word.TRANSACTION) == self._token
            if ours:
                done = self._note(seen)
                if self._saved and done > after:
                    return done
                await self._check_end(before, seen, done)
            before = seen if ours else None
            if self._clock.now() >= end and not self._ended:
                raise self._late(seen, timeout_s, ours=ours)
            await self._clock.sleep(0.0 if self._ended else look_s)
        return None

    def _note(self, seen: StatusSnapshot) -> int:
        self._dialogue.check_places(seen)
        if seen.phase == Phase.FILE_FAILED:
            names = ", ".join(axis.name for axis in self.plan.compensated) if self.plan else ""
            raise file_error(seen, self._where, names)
        if seen.phase == Phase.SETUP_REFUSED:
            raise DeviceRefused("E-GRIND-SETUP-REFUSED", self._where, first=self._settings.words.setup)
        self._saved = self._saved or seen.phase in _BEGUN
        return round(seen.word(Word.COUNTER))

    async def _check_end(self, before: StatusSnapshot | None, seen: StatusSnapshot, done: int) -> None:
        """By its own word, or because the channel is in reset at two looks after the program had begun."""
        total = self.plan.spaces if self.plan else 0
        if seen.channel is not ChannelStatus.RESET:
            return
        if seen.phase == Phase.LEFT:
            raise DeviceRefused("E-GRIND-LEFT", self._where, done=done, total=total)
        if seen.phase == Phase.FINISHED:
            await self._check_placed()
            self._ended = True
        elif before is not None and before.channel is ChannelStatus.RESET:
            raise DeviceRefused("E-GRIND-STOPPED", self._where, done=done, total=total)

    async def _check_placed(self) -> None:
        """The set-up values must still be those that were asked for: they are what this part was ground with."""
        for number, held in (await self._dialogue.numbered(self._placed)).items():
            if held != self._placed[number]:
                wanted = self._placed[number]
                raise DeviceRefused("E-GRIND-SETUP-CHANGED", self._where, number=number, value=wanted, held=held)

    def _late(self, seen: StatusSnapshot, timeout_s: float, *, ours: bool) -> DeadlineExceeded:
        if not ours:
            return DeadlineExceeded("E-GRIND-NO-START", self._where, timeout_s=timeout_s)
        shown = seen.message or "no message"
        done = round(seen.word(Word.COUNTER))
        return DeadlineExceeded("E-GRIND-NO-PROGRESS", self._where, timeout_s=timeout_s, done=done, message=shown)

    async def saved_tables(self, axis: str, configuration: Configuration) -> LiveSet:
        """The live tables that the program wrote before its first move. Raises DeviceRefused (E-NC-NOT-SAVED...)."""
        wanted = () if self.plan is None else self.plan.compensated
        found = next((one for one in wanted if one.name == axis), None)
        if self.plan is None or found is None or not (self._saved and self.plan.save_tables):
            raise DeviceRefused("E-NC-NOT-SAVED", self._where, axis=axis)
        saving = BackupFile(
            section="LIVE", number=self._token, axis=axis, encoder=found.encoder, memory=self._memory[axis]
        )
        return await fetch_live_tables(self._transfer, saving, configuration)


_R = re.compile(r"R(\d{1,5})")


class HeldNumbers:
    """Numbers of the builder's cycle: R parameters ("R210"), or a node that is one number (GUD, offset)."""

    def __init__(
        self, session: UaSession, reader: MachineReader, settings: UaSettings, dialogue: ProgramDialogue, where: str
    ) -> None:
        self._session, self._reader, self._settings = session, reader, settings
        self._dialogue, self._where = dialogue, where

    def path(self, place: str) -> str:
        """The node of a place. Raises ConfigError: E-HELD-PLACE (no such name), E-HELD-OURS (of our programs)."""
        found = _R.fullmatch(place)
        address = nodes.parse(nodes.r_parameter(int(found[1]), self._settings.channel) if found else place)
        plain = address is not None and address.last is None and nodes.kind_of(address.path) == "Double"
        if address is None or not plain or address.name.startswith("$"):  # machine and setting data are never written
            raise ConfigError("E-HELD-PLACE", self._where, place=place)
        if (address.area, address.name) == (nodes.CHANNEL_AREA, "R"):
            number = address.first
            if number is None or number > nodes.R_LAST:
                raise ConfigError("E-HELD-PLACE", self._where, place=place)
            if self._settings.words.holds(number) or number == self._settings.r_marker:
                raise ConfigError("E-HELD-OURS", self._where, place=place)
        return address.path

    async def read(self, places: Sequence[str]) -> tuple[float, ...]:
        """Read afresh. Raises as `path`, and what the session raises (absent, no right, no number)."""
        return tuple(await self._reader.values([self.path(place) for place in places]))

    async def write(self, values: Mapping[str, float]) -> None:
        """One request while the channel is in reset. Raises as `path`, DeviceRefused (E-NC-NOT-RESET), the session's.

        After DeadlineExceeded nobody knows what was written.
        """
        told = [(self.path(place), float(value)) for place, value in values.items()]
        seen = await self._dialogue.look()
        if seen.channel is not ChannelStatus.RESET:
            raise DeviceRefused("E-NC-NOT-RESET", self._where, status=seen.channel.name)
        await self._session.write(told, self._reader.timeout_s)
