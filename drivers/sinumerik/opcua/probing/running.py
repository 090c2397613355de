"""Has a person start one probing program after another, and says how each ended."""

from __future__ import annotations

import itertools
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, TrueflankError
from drivers.probes import NOT_ASKED, Probe, ProbeTold
from drivers.sinumerik.ncprogram.words import Word
from drivers.sinumerik.opcua.machine import ALARM_PLACES, MachineReader, channel_status
from drivers.sinumerik.opcua.probing.lists import OURS
from drivers.sinumerik.opcua.probing.roles import FIRST_NUMBER, Roles
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.files import FileNodes
from drivers.sinumerik.opcua.session.status import refusal
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.machine import ChannelStatus

LISTING = "/_N_SPF_DIR/_N_TFPROBE_SPF"
WHERE = "probing"
LONGEST_S = 60.0
NOT_FREE = -1.0  # what a program leaves that found no table to ask with
GIVES_UP = 100  # quarters of a second that a program waits for its release


@dataclass(frozen=True, slots=True)
class _Seen:
    channel: ChannelStatus
    phase: float
    echo: float
    alarms: tuple[int, ...]


@dataclass(slots=True)
class Runs:
    """Programs through one session; ``start_s`` bounds the wait for a person."""

    session: UaSession
    reader: MachineReader
    settings: UaSettings
    clock: Clock
    roles: Roles
    told: ProbeTold
    start_s: float
    _numbers: itertools.count[int] = field(default_factory=lambda: itertools.count(FIRST_NUMBER))
    _standing: frozenset[int] = frozenset()

    async def ready(self) -> None:
        """Raises DeviceRefused (E-NC-NOT-RESET) unless nothing runs; alarms that stand now count for none of ours."""
        seen = await self._look()
        if seen.channel is not ChannelStatus.RESET:
            raise DeviceRefused("E-NC-NOT-RESET", WHERE, status=seen.channel.value)
        self._standing = frozenset(seen.alarms)
        number = self.settings.words.number(Word.PHASE)
        last = int((await self.reader.values([nodes.r_parameter(number, self.settings.channel)]))[0])
        self._numbers = itertools.count(last + 1 if last >= FIRST_NUMBER else FIRST_NUMBER)

    async def program(self, probe: Probe) -> str:
        """How a program ends: refused at the start, stopped by an alarm, run to its end, and what it left."""
        number = next(self._numbers)
        try:
            text = self.roles.filled(str(probe.ask[0]), number=str(number))
        except KeyError as error:
            return f"{NOT_ASKED}a role this control has not: {error.args[0]}"
        try:
            await self._send(text)
        except TrueflankError as error:
            return f"sending refused: {error.fields.get('status', error.code)}"
        before = self._standing
        seen = await self._over(number, probe.what)
        return _ending(seen, number, before, echo="{echo}" in str(probe.ask[0]))

    async def listed(self, probes: Sequence[Probe]) -> dict[str, str]:
        """All values by one program, which writes one line for each."""
        number = next(self._numbers)
        await self._send(self.roles.filled(_listing(probes), number=str(number), file=LISTING))
        before = self._standing
        seen = await self._over(number, "values and files")
        ended = _ending(seen, number, before, echo=False)
        found: dict[str, str] = {}
        text = await self._fetched()
        lines = text.splitlines()
        if lines and lines[0].strip() == f";{number}":
            found = {name: value for line in lines[1:] for name, _, value in [line.strip(" ;\r").partition("=")]}
        return {probe.name: found.get(probe.name, f"no answer: {ended}") for probe in probes}

    async def while_running(self, meanwhile: Callable[[str], Awaitable[None]]) -> None:
        """Ask while a program runs that a word of ours, or its own patience, ends."""
        number = next(self._numbers)
        text = self.roles.filled(_waiting(), number=str(number))
        await self._send(text)
        self.told("P-PROBE-START", what="a program that waits")
        await self._until(lambda seen: int(seen.phase) == number or bool(self._fresh(seen)), self.start_s)
        try:
            await meanwhile(text)
        finally:
            word = nodes.r_parameter(self.settings.words.number(Word.RELEASE), self.settings.channel)
            await self.session.try_write(word, float(number), "Double", self.reader.timeout_s)
        await self._cleared(await self._until(self._ended(number), LONGEST_S))

    # ---- steps -------------------------------------------------------------------------------------

    async def _send(self, text: str) -> None:
        """As it is: what a control must refuse cannot pass the gate for programs of the gateway."""
        content, timeout_s = text.encode("ascii"), self.reader.timeout_s
        if "CopyFileToServer" in self.session.methods:
            arguments = [(OURS, "String"), (content, "ByteString"), (True, "Boolean")]
            await self.session.call("CopyFileToServer", arguments, timeout_s)
        else:
            await FileNodes(self.session, WHERE).write(OURS, content, timeout_s)
        answer = await self.session.call(
            "Select", [(OURS, "String"), (self.settings.channel, "Int32")], self.reader.timeout_s
        )
        if answer != 0:
            raise DeviceRefused("E-NC-SELECT", WHERE, path=OURS, answer=answer, status=f"Select answers {answer}")

    async def _fetched(self) -> str:
        path = nodes.to_file(LISTING) or ""
        try:
            if "CopyFileFromServer" in self.session.methods:
                content = await self.session.call("CopyFileFromServer", [(path, "String")], self.reader.timeout_s)
            else:
                content = await FileNodes(self.session, WHERE).read(path, self.reader.timeout_s)
        except TrueflankError:
            return ""
        return bytes(content or b"").decode("latin-1")

    async def _over(self, number: int, what: str) -> _Seen:
        self.told("P-PROBE-START", what=what)
        seen = await self._until(self._ended(number), self.start_s)
        await self._cleared(seen)
        return seen

    def _ended(self, number: int) -> Callable[[_Seen], bool]:
        def over(seen: _Seen) -> bool:
            if seen.channel is ChannelStatus.INTERRUPTED and self._fresh(seen):
                return True
            return seen.channel is ChannelStatus.RESET and (seen.phase >= number or bool(self._fresh(seen)))

        return over

    def _fresh(self, seen: _Seen) -> tuple[int, ...]:
        return tuple(alarm for alarm in seen.alarms if alarm not in self._standing)

    async def _cleared(self, seen: _Seen) -> None:
        """Wait for a person to press RESET where an alarm stopped the program; one that only reports may stay."""
        if seen.channel is ChannelStatus.RESET:
            self._standing |= frozenset(seen.alarms)
            return
        self.told("P-PROBE-RESET", numbers=", ".join(map(str, self._fresh(seen))))
        gone = await self._until(lambda now: now.channel is ChannelStatus.RESET, self.start_s)
        self._standing = frozenset(gone.alarms)

    async def _until(self, over: Callable[[_Seen], bool], longest_s: float) -> _Seen:
        end = self.clock.now() + longest_s
        pause = self.settings.fast_poll_s
        while not over(seen := await self._look()):
            if self.clock.now() >= end:
                raise DeadlineExceeded("E-NC-NO-START", WHERE, timeout_s=longest_s, phase=round(seen.phase))
            await self.clock.sleep(pause)
            pause = min(pause * 1.5, self.settings.poll_s)
        return seen

    async def _look(self) -> _Seen:
        """One request, so that an alarm cannot go between its count and its number."""
        words, channel = self.settings.words, self.settings.channel
        paths = [nodes.in_channel("chanStatus", channel)]
        paths += [nodes.r_parameter(words.number(word), channel) for word in (Word.PHASE, Word.ECHO)]
        places = [nodes.alarm_number(place) for place in range(1, ALARM_PLACES + 1)]
        found = await self.session.survey([*paths, *places], self.reader.timeout_s)
        for one in found[: len(paths)]:
            if one.status:
                raise refusal(one.status, WHERE, "read", one.path)
        status, phase, echo = (one.value for one in found[: len(paths)])
        alarms = tuple(int(one.value) for one in found[len(paths) :] if not one.status and one.value)
        return _Seen(channel_status(status, WHERE), float(phase), float(echo), alarms)


def _ending(seen: _Seen, number: int, standing: frozenset[int], *, echo: bool) -> str:
    fresh = [str(alarm) for alarm in seen.alarms if alarm not in standing]
    alarm = f"alarm {', '.join(fresh)}" if fresh else ""
    if int(seen.phase) != number:
        return f"refused at NC START, {alarm or 'no alarm'}"
    if seen.phase == number:
        return f"stopped by {alarm}" if alarm else "ended before its last block"
    if echo and seen.echo == NOT_FREE:
        return f"{NOT_ASKED}no table is empty and off"
    left = f", leaves {seen.echo:g}" if echo else ""
    return f"runs to its end{left}" + (f", {alarm}" if alarm else "")


def _listing(probes: Sequence[Probe]) -> str:
    out = [";TRUEFLANK PROBE", "DEF INT UERR", "DEF STRING[200] ULINE[2]", "DEF REAL USPAN"]
    out += ["{phase}={number}", "STOPRE"]
    out += ['DELETE(UERR,"{file}")', 'WRITE(UERR,"{file}",";{number}")']
    for probe in probes:
        *blocks, value = map(str, probe.ask)
        out += [*blocks, f'WRITE(UERR,"{{file}}",";{probe.name}="<<({value}))']
    return "\n".join((*out, "STOPRE", "{phase}={number}.5", "M30", ""))


def _waiting() -> str:
    out = [";TRUEFLANK PROBE", "DEF INT ULEFT", "{phase}={number}", "STOPRE", f"ULEFT={GIVES_UP}"]
    out += ["WHILE (ULEFT>0) AND ({release}<>{number})", "G4 F0.25", "STOPRE", "ULEFT=ULEFT-1", "ENDWHILE"]
    return "\n".join((*out, "STOPRE", "{phase}={number}.5", "M30", ""))
