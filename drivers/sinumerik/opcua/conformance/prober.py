"""Asks a control behind OPC UA the written questions, one at a time, and reports each answer.

The lists are the TOML files next to this module. Roles stand in for names ("{AXIS}"): the first axis with a table, a
free cross table, the R parameters of the site. For a question that needs a running program a person starts it.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import tomllib
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeadlineExceeded, DeviceRefused, LinkBroken, TransportError, TrueflankError
from drivers.probes import NOT_ASKED, Answer, Level, Probe, ProbedSession, ProbeTold, allows
from drivers.sinumerik.ncprogram.words import COUNT, MARKED, Word
from drivers.sinumerik.opcua.machine import ALARM_PLACES, Configuration, MachineReader, channel_status
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import FileNodes, UaSession
from drivers.sinumerik.opcua.session.connection import read_secrets, read_writing_secrets
from drivers.sinumerik.opcua.session.status import status_error
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.types.machine import ChannelStatus

# The written lists.

OURS = f"{nodes.FILE_SYSTEM}/Part Program/TFPROBE.MPF"
LISTS = ("server", "programs", "values")


@cache
def load_probes() -> tuple[Probe, ...]:
    """All questions in the order in which they are asked."""
    folder = resources.files("drivers.sinumerik.opcua.conformance")
    found: list[Probe] = []
    for name in LISTS:
        tree = tomllib.loads(folder.joinpath(f"{name}.toml").read_text(encoding="utf-8"))
        found += [_probe(key, entry) for key, entry in tree.items()]
    return tuple(found)


def _probe(name: str, entry: dict[str, Any]) -> Probe:
    return Probe(**{**entry, "name": name, "ask": tuple(entry["ask"])})


# Whose names stand for the roles of a question: the first axis with a table, a free cross table, the R words.

FIRST_NUMBER = 100_000


@dataclass(frozen=True, slots=True)
class Roles:
    """Role to name; ``places`` the axis names by number, ``encoders`` what acts by axis, ``cross_on`` tables on."""

    names: Mapping[str, str]
    places: tuple[str, ...]
    encoder: int | None
    cross_on: tuple[int, ...]

    def filled(self, text: str, **more: str) -> str:
        """A question with its roles filled in. Raises KeyError naming the role that this control has not."""
        return text.format_map({**self.names, **more})


async def find_roles(reader: MachineReader, settings: UaSettings) -> Roles:
    """Read the machine's configuration and choose; raises what the reader raises."""
    configuration = await reader.configuration()
    words, channel = settings.words, settings.channel
    echo = words.number(Word.ECHO)
    names = {"channel": str(channel), "r_echo": str(echo), "r_next": str(echo + 1), "echo": words.name(Word.ECHO)}
    names |= {"phase": words.name(Word.PHASE), "release": words.name(Word.RELEASE)}
    acting: int | None = None
    for axis in configuration.names:
        encoders = await reader.encoders(configuration, axis)
        reserved = [index for index in encoders.acting if encoders.reserved[index]]
        off = [index for index in encoders.there if encoders.reserved[index] and encoders.enabled[index] is False]
        if off and "free_axis" not in names:
            names |= {"free_axis": axis, "free_encoder": str(off[0]), "free_points": str(encoders.reserved[off[0]])}
        if reserved and "axis" not in names:
            acting = reserved[0]
            names |= {"axis": axis, "axis_number": str(configuration.places.index(axis) + 1), "encoder": str(acting)}
            names["points"] = str(encoders.reserved[acting])
    names.setdefault("axis_number", str(configuration.places.index(configuration.names[0]) + 1))
    points = (await reader.memory(configuration, configuration.names[0], 0)).cec_points
    tables = [number for number, count in enumerate(points) if count]
    switched = [
        table
        for table in tables
        if await reader.figure(f"$SN_CEC_TABLE_ENABLE[{table}]", configuration) not in (0.0, None)
    ]
    free = [table for table in tables if table not in switched]
    if free:
        names |= {"table": str(free[-1]), "table_points": str(points[free[-1]])}
    names["tables"] = str(await _tables(reader, configuration))
    return Roles(names, configuration.places, acting, tuple(switched))


async def _tables(reader: MachineReader, configuration: Configuration) -> int:
    """How many cross tables the control has: twice its axes, or as far as their memory can be read."""
    count = 0
    while count < 2 * len(configuration.places):
        if await reader.figure(f"$MN_MM_CEC_MAX_POINTS[{count}]", configuration) is None:
            break
        count += 1
    return count


# Has a person start one probing program after another, and says how each ended.

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
class ProbePrograms:
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
                raise status_error(one.status, WHERE, "read", one.path)
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


# The prober.

_ROLE = "a role this control has not: "


class UaProber:
    """Role "prober"; settings as the controller's."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._settings = UaSettings.read(settings, name)
        self._session = UaSession(url, clock, name)
        self._timeout_s = 5.0

    def probes(self, allow: Level) -> tuple[Probe, ...]:
        """The written list within an allowance."""
        return tuple(probe for probe in load_probes() if allows(allow, probe.allow))

    async def ask(self, probes: Sequence[Probe], told: ProbeTold, timeout_s: float, start_s: float) -> ProbedSession:
        """Log in, ask, give the R parameters back, log out.

        Raises DeviceRefused (E-NC-NOT-RESET) with nothing asked while a program runs or an alarm stands,
        DeadlineExceeded when nobody starts a program, and what the wire raises.
        """
        self._timeout_s = timeout_s
        secrets = await asyncio.to_thread(read_secrets, self._settings, self.name)
        writing = await asyncio.to_thread(read_writing_secrets, self._settings, secrets, self.name)
        await self._session.open(secrets, timeout_s, writing)
        try:
            reader = MachineReader(self._session, self._settings, self.name)
            reader.timeout_s = timeout_s
            roles = await find_roles(reader, self._settings)
            identity = await reader.identity(tuple(name for name in roles.places if name))
            about = {"driver": "sinumerik-opcua", "version": identity.version}
            about["access_level"] = str((await reader.values([nodes.ACCESS_LEVEL]))[0])
            return ProbedSession(about, await self._all(probes, roles, reader, told, start_s))
        finally:
            await self._session.close()

    async def _all(
        self, probes: Sequence[Probe], roles: Roles, reader: MachineReader, told: ProbeTold, start_s: float
    ) -> tuple[Answer, ...]:
        programs = any(probe.act in ("program", "listed") or probe.running for probe in probes)
        runs = ProbePrograms(
            session=self._session,
            reader=reader,
            settings=self._settings,
            clock=self._clock,
            roles=roles,
            told=told,
            start_s=start_s,
        )
        before = await self._words() if programs else ()
        said: dict[str, str] = {}
        try:
            if programs:
                await runs.ready()
            for act in ("program", "listed", "running", "rest"):
                said |= await self._group(act, [probe for probe in probes if _group_of(probe) == act], runs, roles)
        finally:
            if before and self._session.is_open:
                await self._restore(before)
        return tuple(Answer(probe, said[probe.name]) for probe in probes)

    async def _group(self, group: str, probes: list[Probe], runs: ProbePrograms, roles: Roles) -> dict[str, str]:
        if not probes:
            return {}
        if group == "listed":
            return await runs.listed(probes)
        if group == "running":
            found: dict[str, str] = {}

            async def meanwhile(text: str) -> None:
                for probe in probes:
                    found[probe.name] = await self._one(probe, roles, program=text)

            await runs.while_running(meanwhile)
            return found
        one = runs.program if group == "program" else lambda probe: self._one(probe, roles)
        return {probe.name: await one(probe) for probe in probes}

    async def _words(self) -> tuple[float, ...]:
        path = nodes.r_block(self._settings.r_first, COUNT, self._settings.channel)
        (found,) = await self._session.read([path], self._timeout_s)
        return tuple(float(value) for value in found.value)

    async def _restore(self, before: Sequence[float]) -> None:
        first, channel = self._settings.r_first, self._settings.channel
        old = [(nodes.r_parameter(first + place, channel), value) for place, value in enumerate(before)]
        with contextlib.suppress(
            DeviceRefused
        ):  # a control whose R parameters are not writable keeps what programs left
            await self._session.write([one for place, one in enumerate(old) if place not in MARKED], self._timeout_s)

    # ---- one question ------------------------------------------------------------------------------

    async def _one(self, probe: Probe, roles: Roles, **more: str) -> str:
        """What the control says; raises only where the wire is lost."""
        try:
            ask = [roles.filled(part, **more) if isinstance(part, str) else part for part in probe.ask]
        except KeyError as error:
            return f"{NOT_ASKED}{_ROLE}{error.args[0]}"
        try:
            return await self._answered(probe.act, ask, roles)
        except (TransportError, LinkBroken) as error:
            if not self._session.is_open:
                raise
            return str(error.fields.get("status", error.code))
        except TrueflankError as error:
            return str(error.fields.get("status", error.code))

    async def _answered(self, act: str, ask: list[Any], roles: Roles) -> str:
        if act in ("kind", "kinds", "value"):
            found = await self._session.survey([str(path) for path in ask], self._timeout_s)
            return ", ".join(one.status or _kind(one, valued=act == "value") for one in found)
        if act == "right":
            told = await self._session.user_may_write(ask[0], self._timeout_s)
            return "the server does not say" if told is None else "yes" if told else "no"
        if act == "call":
            result = await self._session.call(ask[0], _arguments(ask[1:]), self._timeout_s)
            return f"Good {result}" if isinstance(result, int) else "Good"
        if act == "invoke":
            await self._session.invoke(ask[0], ask[1], _arguments(ask[2:]), self._timeout_s)
            return "Good"
        if act == "write":
            return await self._written(*ask)
        return await self._told(act, roles)

    async def _written(self, path: str, value: Any, kind: str, more: str) -> str:
        if value == "own":
            single = path.replace(f",{last_element(path)}]", "]") if path.count(",") > 1 else path
            (found,) = await self._session.survey([single], self._timeout_s)
            if found.status:
                return f"{NOT_ASKED}it cannot be read: {found.status}"
            value = int(found.value) if kind.startswith(("Int", "UInt")) else found.value
        return await self._session.try_write(path, value, kind, self._timeout_s, stamped=more == "stamped")

    async def _replaced(self) -> str:
        """Whether a file that is sent twice is fetched as it was sent last."""
        last = b""
        for last in (b";FIRST\nM30\n", b";SECOND\nM30\n"):
            arguments = [(OURS, "String"), (last, "ByteString"), (True, "Boolean")]
            await self._session.call("CopyFileToServer", arguments, self._timeout_s)
            found = await self._session.call("CopyFileFromServer", [(OURS, "String")], self._timeout_s)
        return "as sent last" if bytes(found or b"").split() == last.split() else "not as sent last"

    async def _told(self, act: str, roles: Roles) -> str:
        if act == "replaced":
            return await self._replaced()
        if act == "rights":
            found = await self._session.call("GetMyAccessRights", (), self._timeout_s)
            return "; ".join(sorted(str(found).replace(",", ";").split(";")))
        if act == "methods":
            return ", ".join(sorted(self._session.methods))
        if act == "events":
            return "no end of the refresh" if await self._session.alarm_events(self._timeout_s) is None else "yes"
        if act == "in-sequence":
            return "yes" if all(roles.places) else "no: a number is left out"
        if act == "encoder":
            return "none" if roles.encoder is None else str(roles.encoder + 1)
        if act == "cross-on":
            return "yes" if roles.cross_on else "no"
        raise DeviceRefused("E-PROBE-ACT", self.name, act=act, status=f"{NOT_ASKED}this release cannot ask {act}")


def last_element(path: str) -> str:
    """The last element of a block."""
    return path.rpartition(",")[2].rstrip("]")


def _group_of(probe: Probe) -> str:
    if probe.running:
        return "running"
    return probe.act if probe.act in ("program", "listed") else "rest"


def _kind(reading: Any, *, valued: bool) -> str:
    if reading.value is None:
        return f"Good {reading.kind} null".replace("  ", " ")
    return f"Good {reading.kind} {reading.value}" if valued else f"Good {reading.kind}"


def _arguments(flat: Sequence[Any]) -> list[tuple[Any, str]]:
    """Values and their types, which stand in turn."""
    pairs = list(zip(flat[::2], flat[1::2], strict=True))
    return [(value.encode("ascii") if kind == "ByteString" else value, str(kind)) for value, kind in pairs]
