"""One OPC UA session with the control: variables and methods by their paths, files as nodes, alarm texts.

Values are written typed and without time stamps, and never twice.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import secrets as random_source
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from drivers.clock import Clock
from drivers.errors import DeviceRefused, LinkBroken, RemoteProtocolError, TrueflankError, UnsupportedDevice
from drivers.message import Message
from drivers.sinumerik.opcua.session import connection, nodes, requests
from drivers.sinumerik.opcua.session.certificates import uri_of
from drivers.sinumerik.opcua.session.connection import CHANNEL_S, SESSION_S, Secrets, UaConnection, node_id
from drivers.sinumerik.opcua.session.requests import AlarmEvent, Reading, ServerLimits
from drivers.sinumerik.opcua.session.status import check_numbers, check_written, is_lost, status_error

__all__ = ["CHANNEL_S", "SESSION_S", "Reading", "UaSession"]

Arguments = Sequence[tuple[Any, str]]

_TOO_MANY = "BadTooManyOperations"
_GOOD = 0
_TELLING = ("GetMyAccessRights",)
"""Methods that only tell something of the user himself."""


class UaSession(UaConnection):
    """Login, batch reads, writes and method calls, one request at a time."""

    def __init__(self, url: str, clock: Clock, where: str) -> None:
        super().__init__(url, clock, where)
        self._index = 0
        self._limits = ServerLimits()
        self._found = requests.ANY
        self._spaces: tuple[int, ...] = (0,)
        self._methods: dict[str, tuple[Any, Any]] = {}
        self._writing: Secrets | None = None

    @property
    def name_space(self) -> int:
        """Index of the control's name space in this session, found by its URI."""
        return self._index

    @property
    def methods(self) -> frozenset[str]:
        """Methods found under either parent."""
        return frozenset(self._methods)

    @property
    def found_limit(self) -> int | None:
        """How many nodes a request may name, as found by refusals; None where the server refused none for that."""
        return self._found if self._found < requests.ANY else None

    # ---- opening and closing ------------------------------------------------------------------------

    async def open(self, secrets: Secrets, timeout_s: float, writing: Secrets | None = None) -> None:
        """Log in and find name space, limits and methods. An older session is closed first.

        ``writing`` is another account: it is logged in instead before the first write or call, and with the session it
        is gone. Raises TransportError (E-UA-CONNECT), DeadlineExceeded, DeviceRefused (E-UA-LOGIN, E-UA-SESSIONS, and
        as `connection.check_trust`), UnsupportedDevice (E-UA-NAMESPACE), RemoteProtocolError.
        """
        await self.close()
        self._writing = writing
        async with self._clock.deadline(timeout_s, self._where), self._lock:
            await self._enter(secrets)

    async def _enter(self, secrets: Secrets) -> None:
        self._secrets = secrets
        self._own_uri = await asyncio.to_thread(uri_of, secrets.own)
        policies = await connection.check_trust(secrets, self._asked, self._clock.utc, self._where)
        client, opened_at = await self._logged_in(secrets, policies)
        await self._translated("read", "the namespace", self._look_around(client, opened_at))
        self._alive = asyncio.get_running_loop().create_task(self._keep_alive(), name=f"keep-alive of {self._where}")

    async def _arm(self, timeout_s: float) -> None:
        """The account that may write takes the place of the one that reads; whoever asks meanwhile waits."""
        if self._writing is None:
            return
        async with self._clock.deadline(timeout_s, self._where), self._lock:
            writing, self._writing = self._writing, None
            if writing is not None and self.is_open:
                await self.close()
                await self._enter(writing)

    async def beside(self, timeout_s: float) -> UaSession:
        """A second session with the same login, for what must not disturb this one. Raises as `open`."""
        if self._secrets is None:
            raise LinkBroken("E-UA-BROKEN", self._where, why=self._why)
        made = UaSession(self._url, self._clock, self._where)
        await made.open(self._secrets, timeout_s)
        return made

    async def _look_around(self, client: Any, opened_at: float) -> None:
        """Resolve the name space by its URI, now and at every login, and find methods under either parent."""
        self._note_lifetimes(client, opened_at)
        uris = await client.get_namespace_array()
        if nodes.NAMESPACE_URI not in uris:
            raise UnsupportedDevice("E-UA-NAMESPACE", self._where, wanted=nodes.NAMESPACE_URI, found=", ".join(uris))
        self._index = uris.index(nodes.NAMESPACE_URI)
        self._spaces = (0, *(place for place, uri in enumerate(uris) if uri in nodes.ALARM_SPACES))
        self._limits = (await requests.read_limits(client)).within(self._found)
        self._methods = {}
        for parent in nodes.METHODS:
            owner = node_id(parent, self._index)
            found = await requests.browse_methods(client, owner)
            self._methods |= {name: (owner, node) for name, node in found.items()}

    # ---- time and chance: another road has its own ----------------------------------------------------

    async def rest(self, seconds: float) -> None:
        """Let time pass until the control is looked at again."""
        await self._clock.sleep(seconds)

    def fresh_number(self) -> int:
        """Six digits that name a program, so that an older one's words and files are never taken for its own."""
        return random_source.randbelow(899_999) + 100_000

    # ---- requests -----------------------------------------------------------------------------------

    async def read(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """Values of many variables in one batch; what could not be read carries its status name.

        Raises RemoteProtocolError (E-UA-VALUE) for a good value that is not what `read_values` asks of its variable.
        """
        return requests.checked_readings(await self.survey(paths, timeout_s), self._where)

    async def survey(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """As `read`, values as they came: for who judges them himself."""
        found = await self._read([self._node(path) for path in paths], paths[0], timeout_s, timed=False)
        return requests.to_readings(paths, found, self._where)

    async def read_aged(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """As `read`, each with its age by the server's own clock, which is asked for in the same batch."""
        wanted = [*(self._node(path) for path in paths), requests.CURRENT_TIME]
        *found, clock = await self._read(wanted, paths[0], timeout_s, timed=True)
        now = requests.time_of(clock, self._where)
        return requests.checked_readings(requests.to_readings(paths, found, self._where, now), self._where)

    async def server_time(self, timeout_s: float) -> datetime | None:
        """The server's clock (UTC, naive as the library gives it); None when it has none."""
        (found,) = await self._read([requests.CURRENT_TIME], requests.CLOCK, timeout_s, timed=False)
        return requests.time_of(found, self._where)

    async def software_version(self, timeout_s: float) -> str:
        """The version that the server gives of itself; "" where it gives none."""
        (found,) = await self._read([requests.SOFTWARE_VERSION], requests.VERSION, timeout_s, timed=False)
        return requests.text_of(found)

    async def _read(self, wanted: list[Any], what: str | Message, timeout_s: float, *, timed: bool) -> list[Any]:
        """Reads may be repeated: a server that finds a batch too long gets it in halves.

        What it took then is remembered, over logins too, and holds for writes, which must not be tried.
        """
        while True:
            most = min(self._limits.read, len(wanted))
            try:
                ask = functools.partial(requests.read_values, wanted=wanted, most=most, timed=timed)
                found = await self._request(timeout_s, "read", what, ask)
                break
            except DeviceRefused as error:
                if error.fields.get("status") != _TOO_MANY or most == 1:
                    raise
                self._found = max(most // 2, 1)
                self._limits = self._limits.within(self._found)
        self._check_count(len(wanted), len(found))
        return found

    def _check_count(self, asked: int, got: int) -> None:
        if asked != got:
            self._break(Message.of("W-UA-ANSWER-LENGTH"))
            raise RemoteProtocolError("E-UA-COUNT", self._where, asked=asked, got=got)

    async def user_may_write(self, path: str, timeout_s: float) -> bool | None:
        """Whether the server says this user may write a variable; None when it does not say."""
        node = self._node(path)
        return await self._request(timeout_s, "read", path, lambda it: requests.user_may_write(it, node))

    async def write(self, values: Sequence[tuple[str, Any]], timeout_s: float) -> None:
        """Write variables in one batch, each typed, without time stamps. Never retried.

        Raises LocalProtocolError (E-UA-NUMBER) before anything is sent; the refusal of the first variable when
        none was written; DeviceRefused (E-UA-PARTIAL) naming every one that was not when others were.
        """
        check_numbers(values, self._where)
        await self._arm(timeout_s)
        items = [requests.typed_value(self._node(path), value, nodes.kind_of(path)) for path, value in values]
        most = self._limits.write
        found = await self._request(timeout_s, "write", values[0][0], lambda it: requests.write_values(it, items, most))
        self._check_count(len(items), len(found))
        names = [requests.status_name(status) for status in found]
        if any(is_lost(name) for name in names):
            self._break(Message.of("W-UA-SESSION-GONE"))
        check_written([path for path, _ in values], names, self._where)

    async def try_write(self, path: str, value: Any, kind: str, timeout_s: float, *, stamped: bool = False) -> str:
        """Write one variable as another type, or with a time stamp, and say by which status: for who asks what a

        server refuses. Never retried.
        """
        await self._arm(timeout_s)
        item = requests.typed_value(self._node(path), value, kind, self._clock.utc() if stamped else None)
        (found,) = await self._request(timeout_s, "write", path, lambda it: requests.write_values(it, [item], 1))
        return requests.status_name(found)

    async def call(self, method: str, arguments: Arguments, timeout_s: float) -> Any:
        """Call a method found at login; its one result, None if it has none. Never retried."""
        if method not in _TELLING:
            await self._arm(timeout_s)
        if method not in self._methods:
            raise UnsupportedDevice("E-UA-ABSENT", self._where, status="not offered", what=method)
        results = await self._call(*self._methods[method], method, arguments, timeout_s)
        return results[0] if results else None

    async def invoke(self, owner: str, method: str, arguments: Arguments, timeout_s: float) -> list[Any]:
        """Call the method ``owner.method`` of a file or folder node; all its results. Never retried."""
        await self._arm(timeout_s)
        there = self._node(owner), self._node(f"{owner}.{method}")
        return await self._call(*there, f"{owner}.{method}", arguments, timeout_s)

    async def _call(self, owner: Any, node: Any, name: str, arguments: Arguments, timeout_s: float) -> list[Any]:
        result = await self._request(
            timeout_s, "call", name, lambda it: requests.call_method(it, owner, node, arguments)
        )
        if result.StatusCode.value != _GOOD:
            refused = requests.refused_arguments(result)
            # OPC 10000-4 tells a wrong type beside its argument, under a status of the call that says less.
            status = "BadTypeMismatch" if "BadTypeMismatch" in refused else result.StatusCode.name
            raise status_error(
                status, self._where, "call", f"{name} {requests.shown_arguments(arguments)}{refused}".strip()
            )
        return [output.Value for output in result.OutputArguments or []]

    async def alarm_events(self, timeout_s: float) -> list[AlarmEvent] | None:
        """Standing alarms by events and ConditionRefresh; None when the server does not finish telling them.

        Raises DeviceRefused or UnsupportedDevice where it has no such events or the user may not see them.
        """
        ask = functools.partial(
            requests.subscribe_standing_alarms, source=self._node(nodes.ALARM_SOURCE), spaces=self._spaces
        )
        return await self._request(timeout_s, "call", "ConditionRefresh", ask)

    def _node(self, path: str) -> Any:
        return node_id(path, self._index)


# The control's files as nodes: open, read, write and close piece by piece, where copying methods do not serve.

PIECE = 64 * 1024
MOST_PARTS = 64 * 1024  # a server that never ends, at a byte for each part
_READ, _REWRITE = 1, 6  # modes of Open: read; write after erasing (OPC 10000-20, 4.2.2)
_NOT_THERE = ("E-UA-FILE", "E-UA-ABSENT")


class FileNodes:
    """Files by their path in the server's file system, ``Sinumerik/FileSystem/Part Program/NAME.MPF``."""

    def __init__(self, session: UaSession, where: str) -> None:
        self._session = session
        self._where = where

    async def writable(self, path: str, timeout_s: float) -> bool | None:
        """What the file says of this user's right to write it; None when it is not there or does not say."""
        (found,) = await self._session.read([f"{_node(path)}.UserWritable"], timeout_s)
        return None if found.status else bool(found.value)

    async def read(self, path: str, timeout_s: float) -> bytes:
        """The whole file; the limit is for each call. Raises DeviceRefused, UnsupportedDevice (E-UA-ABSENT)."""
        node = _node(path)
        handle = await self._open(node, _READ, timeout_s)
        parts: list[bytes] = []
        try:
            while part := await self._part(node, handle, timeout_s):
                parts.append(part)
                if len(parts) > MOST_PARTS:
                    raise nodes.value_error(
                        f"{node}.Read", part, Message.of("W-UA-PARTS", most_parts=MOST_PARTS), self._where
                    )
        finally:
            await self._let_go(node, handle, timeout_s)
        return b"".join(parts)

    async def _part(self, node: str, handle: int, timeout_s: float) -> bytes:
        results = await self._session.invoke(node, "Read", [(handle, "UInt32"), (PIECE, "Int32")], timeout_s)
        part = nodes.method_output(results, 0, f"{node}.Read", self._where)
        return b"" if part is None else nodes.check_content(part, f"{node}.Read", self._where)

    async def write(self, path: str, content: bytes, timeout_s: float) -> None:
        """Replace or create a file. Each call once; what arrived must be read back by the caller.

        Raises DeviceRefused (E-UA-LEVEL before anything is changed where the file says that it may not be
        written), UnsupportedDevice (E-UA-ABSENT) when the server has no such nodes.
        """
        node = _node(path)
        if await self.writable(path, timeout_s) is False:
            raise DeviceRefused("E-UA-LEVEL", self._where, status="UserWritable is false", what=path)
        handle = await self._open_new(node, timeout_s)
        try:
            for start in range(0, len(content), PIECE):
                piece = [(handle, "UInt32"), (content[start : start + PIECE], "ByteString")]
                await self._session.invoke(node, "Write", piece, timeout_s)
        except TrueflankError:
            await self._let_go(node, handle, timeout_s)
            raise
        await self._session.invoke(node, "Close", [(handle, "UInt32")], timeout_s)

    async def _open_new(self, node: str, timeout_s: float) -> int:
        try:
            return await self._open(node, _REWRITE, timeout_s)
        except (DeviceRefused, UnsupportedDevice) as error:
            if error.code not in _NOT_THERE:
                raise
        folder, _, name = node.rpartition("/")
        results = await self._session.invoke(folder, "CreateFile", [(name, "String"), (True, "Boolean")], timeout_s)
        return self._handle(results, 1, f"{folder}.CreateFile")

    async def _open(self, node: str, mode: int, timeout_s: float) -> int:
        results = await self._session.invoke(node, "Open", [(mode, "Byte")], timeout_s)
        return self._handle(results, 0, f"{node}.Open")

    def _handle(self, results: list[Any], place: int, what: str) -> int:
        return nodes.check_whole(nodes.method_output(results, place, what, self._where), what, self._where)

    async def _let_go(self, node: str, handle: int, timeout_s: float) -> None:
        """Close a file that is not needed any more; the server does so itself when the session ends."""
        if self._session.is_open:
            with contextlib.suppress(TrueflankError):
                await self._session.invoke(node, "Close", [(handle, "UInt32")], timeout_s)


def _node(path: str) -> str:
    """File names stand in upper case in node identifiers; folders do not."""
    folder, _, name = path.rpartition("/")
    return f"{folder}/{name.upper()}"


# Alarm texts by OPC UA events, asked for beside the main session so that nothing there can be disturbed.


async def read_standing_alarms(session: UaSession, timeout_s: float) -> tuple[AlarmEvent, ...] | None:
    """All standing alarms as events, by a session of their own that ends with the answer.

    None when they cannot be had (no right, no events, too slow): the alarm variables say then what they can.
    """
    beside: UaSession | None = None
    try:
        beside = await session.beside(timeout_s)
        told = await beside.alarm_events(timeout_s)
    except TrueflankError:
        return None
    finally:
        if beside is not None:
            await beside.close()
    return None if told is None else tuple(alarm for alarm in told if alarm.standing)


def alarm_texts(alarms: tuple[AlarmEvent, ...] | None) -> str:
    """Their texts, the gravest first; "" when there are none."""
    ordered = sorted(alarms or (), key=lambda alarm: -alarm.severity)
    return "; ".join(f"{alarm.number} {alarm.text}".strip() for alarm in ordered if alarm.text)
