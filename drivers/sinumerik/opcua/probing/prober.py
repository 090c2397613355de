"""Asks a control behind OPC UA the written questions, one at a time, and says what came of each."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeviceRefused, LinkBroken, TransportError, TrueflankError
from drivers.probes import NOT_ASKED, Allowance, Answer, Probe, ProbedSession, ProbeTold, allows
from drivers.sinumerik.ncprogram.words import COUNT, MARKED
from drivers.sinumerik.opcua.machine import MachineReader
from drivers.sinumerik.opcua.probing.lists import OURS, written_probes
from drivers.sinumerik.opcua.probing.roles import Roles, found_roles
from drivers.sinumerik.opcua.probing.running import Runs
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.sinumerik.opcua.session.secrets import secrets_of, writing_of
from drivers.sinumerik.opcua.settings import UaSettings

_ROLE = "a role this control has not: "


class UaProber:
    """Role "prober"; settings as the controller's."""

    def __init__(self, name: str, url: str, settings: Mapping[str, Any], clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._settings = UaSettings.read(settings, name)
        self._session = UaSession(url, clock, name)
        self._timeout_s = 5.0

    def probes(self, allow: Allowance) -> tuple[Probe, ...]:
        """The written list within an allowance."""
        return tuple(probe for probe in written_probes() if allows(allow, probe.allow))

    async def ask(self, probes: Sequence[Probe], told: ProbeTold, timeout_s: float, start_s: float) -> ProbedSession:
        """Log in, ask, give the R parameters back, log out.

        Raises DeviceRefused (E-NC-NOT-RESET) with nothing asked while a program runs or an alarm stands,
        DeadlineExceeded when nobody starts a program, and what the wire raises.
        """
        self._timeout_s = timeout_s
        secrets = await asyncio.to_thread(secrets_of, self._settings, self.name)
        writing = await asyncio.to_thread(writing_of, self._settings, secrets, self.name)
        await self._session.open(secrets, timeout_s, writing)
        try:
            reader = MachineReader(self._session, self._settings, self.name)
            reader.timeout_s = timeout_s
            roles = await found_roles(reader, self._settings)
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
        runs = Runs(
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

    async def _group(self, group: str, probes: list[Probe], runs: Runs, roles: Roles) -> dict[str, str]:
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
            single = path.replace(f",{roles_end(path)}]", "]") if path.count(",") > 1 else path
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


def roles_end(path: str) -> str:
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
