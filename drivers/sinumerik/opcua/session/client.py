"""One OPC UA session with the control; with `login` and `requests` the one place that knows asyncua.

asyncua's own reconnecting, watching and trusting are not used: a request that failed or was interrupted
leaves the session broken and the next call says so, because what the server did meanwhile is unknown; the
server's certificate must be the pinned one; values are written typed and without time stamps.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
from collections.abc import Awaitable, Callable, Sequence
from datetime import datetime
from typing import Any, TypeVar

from asyncua import ua

from drivers.clock import Clock
from drivers.errors import DeviceRefused, LinkBroken, RemoteProtocolError, TrueflankError, UnsupportedDevice
from drivers.sinumerik.opcua.secrets import Secrets
from drivers.sinumerik.opcua.session import login, nodes, requests
from drivers.sinumerik.opcua.session import values as typed_values
from drivers.sinumerik.opcua.session.login import CHANNEL_S, SESSION_S, Offer
from drivers.sinumerik.opcua.session.requests import AlarmEvent, Reading, ServerLimits
from drivers.sinumerik.opcua.session.status import Stage, check_numbers, check_written, foreign, is_lost, refusal

__all__ = ["CHANNEL_S", "SESSION_S", "Reading", "UaSession"]

T = TypeVar("T")
Arguments = Sequence[tuple[Any, str]]

CLOSE_S = 2.0
SHORTEST_S = 0.5  # how often a server may make us show a sign of life, or renew its channel
_TOO_MANY = "BadTooManyOperations"
_NO_CHANNEL = ("E-UA-TRUST-US", "E-UA-CONNECT")

logging.getLogger("asyncua").addHandler(logging.NullHandler())


class UaSession:
    """Login, batch reads, writes and method calls, one request at a time."""

    def __init__(self, url: str, clock: Clock, where: str) -> None:
        self._url = url
        self._clock = clock
        self._where = where
        self._lock = asyncio.Lock()
        self._client: Any = None
        self._index = 0
        self._limits = ServerLimits()
        self._spaces: tuple[int, ...] = (0,)
        self._methods: dict[str, tuple[Any, Any]] = {}
        self._secrets: Secrets | None = None
        self._alive: asyncio.Task[None] | None = None
        self._renew_at, self._sign_s = 0.0, SESSION_S
        self._why = "it was never opened"
        self._policy = ""

    @property
    def is_open(self) -> bool:
        """Whether requests can be made."""
        return self._client is not None

    @property
    def policy(self) -> str:
        """The security policy of an open session; "" without."""
        return self._policy if self.is_open else ""

    @property
    def name_space(self) -> int:
        """Index of the control's name space in this session, found by its URI."""
        return self._index

    @property
    def methods(self) -> frozenset[str]:
        """Methods found under either parent."""
        return frozenset(self._methods)

    # ---- opening and closing ------------------------------------------------------------------------

    async def offer(self, timeout_s: float) -> Offer:
        """What the server shows before a login. Raises TransportError (E-UA-CONNECT), RemoteProtocolError."""
        async with self._clock.deadline(timeout_s, self._where):
            return await self._asked()

    async def open(self, secrets: Secrets, timeout_s: float) -> None:
        """Log in and find name space, limits and methods. An older session is closed first.

        Raises TransportError (E-UA-CONNECT), DeadlineExceeded, DeviceRefused (E-UA-LOGIN, E-UA-SESSIONS, and as
        `login.check_trust`), UnsupportedDevice (E-UA-NAMESPACE), RemoteProtocolError.
        """
        await self.close()
        self._secrets = secrets
        async with self._clock.deadline(timeout_s, self._where), self._lock:
            policies = await login.check_trust(secrets, self._asked, self._clock.utc(), self._where)
            client, opened_at = await self._logged_in(secrets, policies)
            await self._translated("read", "the name space", self._look_around(client, opened_at))
        self._alive = asyncio.get_running_loop().create_task(self._keep_alive(), name=f"keep-alive of {self._where}")

    async def _logged_in(self, secrets: Secrets, policies: Sequence[str]) -> tuple[Any, float]:
        """A client that is logged in, and since when; another policy is tried only where the first got no channel."""
        for place, policy in enumerate(policies, start=1):
            self._policy = policy
            self._client = client = login.new_client(self._url, secrets)
            opened_at = self._clock.now()
            try:
                await self._translated("login", secrets.user, login.log_in(client, secrets, policy))
            except TrueflankError as error:
                if place == len(policies) or error.code not in _NO_CHANNEL:
                    raise
            else:
                return client, opened_at
        raise LinkBroken("E-UA-BROKEN", self._where, why="no policy to log in with")

    async def beside(self, timeout_s: float) -> UaSession:
        """A second session with the same login, for what must not disturb this one. Raises as `open`."""
        if self._secrets is None:
            raise LinkBroken("E-UA-BROKEN", self._where, why=self._why)
        made = UaSession(self._url, self._clock, self._where)
        await made.open(self._secrets, timeout_s)
        return made

    async def _asked(self) -> Offer:
        return await self._translated("read", "the end points", login.ask(self._url, self._where))

    async def _look_around(self, client: Any, opened_at: float) -> None:
        """Resolve the name space by its URI, now and at every login, and find methods under either parent."""
        self._note_lifetimes(client, opened_at)
        uris = await client.get_namespace_array()
        if nodes.NAMESPACE_URI not in uris:
            raise UnsupportedDevice("E-UA-NAMESPACE", self._where, wanted=nodes.NAMESPACE_URI, found=", ".join(uris))
        self._index = uris.index(nodes.NAMESPACE_URI)
        self._spaces = (0, *(place for place, uri in enumerate(uris) if uri in nodes.ALARM_SPACES))
        self._limits = await requests.limits(client)
        self._methods = {}
        for parent in nodes.METHODS:
            owner = ua.NodeId(parent, self._index)
            found = await requests.methods(client, owner)
            self._methods |= {name: (owner, node) for name, node in found.items()}

    def _note_lifetimes(self, client: Any, since: float) -> None:
        channel_s = typed_values.lasting_s(client.secure_channel_timeout, "the secure channel's lifetime", self._where)
        session_s = typed_values.lasting_s(client.session_timeout, "the session's timeout", self._where)
        self._renew_at = since + max(0.6 * channel_s, SHORTEST_S)
        self._sign_s = max(0.25 * session_s, SHORTEST_S)

    async def close(self) -> None:
        """Log out if the server still listens, and let go of the wire. Never raises, may be called twice."""
        client, self._client = self._client, None
        alive, self._alive = self._alive, None
        try:
            if alive is not None:
                alive.cancel()
                await asyncio.gather(alive, return_exceptions=True)
            if client is not None:
                with contextlib.suppress(TrueflankError):
                    async with self._clock.deadline(CLOSE_S, self._where):
                        await self._translated("call", "the log-out", login.log_out(client))
        finally:
            self._why = "it was closed"
            if client is not None:
                client.disconnect_socket()
        await self._clock.sleep(0)
        await self._clock.sleep(0)

    def _break(self, why: str) -> None:
        client, self._client, self._why = self._client, None, why
        if client is not None:
            client.disconnect_socket()

    async def _keep_alive(self) -> None:
        """Ask for a sign of life often enough that the server keeps the session; ends with the session."""
        with contextlib.suppress(TrueflankError):
            while self.is_open:
                await self._clock.sleep(self._sign_s)
                await self._request(self._sign_s, "read", "the server's state", requests.sign_of_life)

    # ---- requests -----------------------------------------------------------------------------------

    async def read(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """Values of many variables in one batch; what could not be read carries its status name.

        Raises RemoteProtocolError (E-UA-VALUE) for a good value that is not what `values` asks of its variable.
        """
        return requests.judged(await self.survey(paths, timeout_s), self._where)

    async def survey(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """As `read`, values as they came: for who judges them himself."""
        found = await self._read([self._node(path) for path in paths], paths[0], timeout_s, timed=False)
        return requests.readings(paths, found, self._where)

    async def read_aged(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """As `read`, each with its age by the server's own clock, which is asked for in the same batch."""
        wanted = [*(self._node(path) for path in paths), requests.CURRENT_TIME]
        *found, clock = await self._read(wanted, paths[0], timeout_s, timed=True)
        now = requests.time_of(clock, self._where)
        return requests.judged(requests.readings(paths, found, self._where, now), self._where)

    async def server_time(self, timeout_s: float) -> datetime | None:
        """The server's clock (UTC, naive as the library gives it); None when it has none."""
        (found,) = await self._read([requests.CURRENT_TIME], requests.CLOCK, timeout_s, timed=False)
        return requests.time_of(found, self._where)

    async def _read(self, wanted: list[Any], what: str, timeout_s: float, *, timed: bool) -> list[Any]:
        """Reads may be repeated: a server that finds a batch too long gets it in halves."""
        while True:
            most = min(self._limits.read, len(wanted))
            try:
                ask = functools.partial(requests.values, wanted=wanted, most=most, timed=timed)
                found = await self._request(timeout_s, "read", what, ask)
                break
            except DeviceRefused as error:
                if error.fields.get("status") != _TOO_MANY or most == 1:
                    raise
                self._limits = ServerLimits(max(most // 2, 1), self._limits.write)
        self._check_count(len(wanted), len(found))
        return found

    def _check_count(self, asked: int, got: int) -> None:
        if asked != got:
            self._break("an answer of the wrong length")
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
        items = [requests.typed(self._node(path), value, nodes.kind_of(path)) for path, value in values]
        most = self._limits.write
        found = await self._request(timeout_s, "write", values[0][0], lambda it: requests.write(it, items, most))
        self._check_count(len(items), len(found))
        names = [requests.status_name(status) for status in found]
        if any(is_lost(name) for name in names):
            self._break("the session is gone")
        check_written([path for path, _ in values], names, self._where)

    async def call(self, method: str, arguments: Arguments, timeout_s: float) -> Any:
        """Call a method found at login; its one result, None if it has none. Never retried."""
        if method not in self._methods:
            raise UnsupportedDevice("E-UA-ABSENT", self._where, status="not offered", what=method)
        results = await self._call(*self._methods[method], method, arguments, timeout_s)
        return results[0] if results else None

    async def invoke(self, owner: str, method: str, arguments: Arguments, timeout_s: float) -> list[Any]:
        """Call the method ``owner.method`` of a file or folder node; all its results. Never retried."""
        there = self._node(owner), self._node(f"{owner}.{method}")
        return await self._call(*there, f"{owner}.{method}", arguments, timeout_s)

    async def _call(self, owner: Any, node: Any, name: str, arguments: Arguments, timeout_s: float) -> list[Any]:
        result = await self._request(timeout_s, "call", name, lambda it: requests.call(it, owner, node, arguments))
        if result.StatusCode.value != ua.StatusCodes.Good:
            what = f"{name} {requests.shown(arguments)}{requests.refused_arguments(result)}".strip()
            raise refusal(result.StatusCode.name, self._where, "call", what)
        return [output.Value for output in result.OutputArguments or []]

    async def alarm_events(self, timeout_s: float) -> list[AlarmEvent] | None:
        """Standing alarms by events and ConditionRefresh; None when the server does not finish telling them.

        Raises DeviceRefused or UnsupportedDevice where it has no such events or the user may not see them.
        """
        ask = functools.partial(requests.standing_alarms, source=self._node(nodes.ALARM_SOURCE), spaces=self._spaces)
        return await self._request(timeout_s, "call", "ConditionRefresh", ask)

    def _node(self, path: str) -> Any:
        return ua.NodeId(path, self._index)

    async def _request(self, timeout_s: float, stage: Stage, what: str, act: Callable[[Any], Awaitable[T]]) -> T:
        async with self._clock.deadline(timeout_s, self._where), self._lock:
            client = self._client
            if client is None:
                raise LinkBroken("E-UA-BROKEN", self._where, why=self._why)
            if self._clock.now() >= self._renew_at:
                await self._translated(stage, "the secure channel", self._renew(client))
            return await self._translated(stage, what, act(client))

    async def _renew(self, client: Any) -> None:
        await client.open_secure_channel(renew=True)
        client.uaclient.revolve_security_token()
        self._note_lifetimes(client, self._clock.now())

    async def _translated(self, stage: Stage, what: str, work: Awaitable[T]) -> T:
        """Await the library; turn its errors into ours; break the session where its state became unknown."""
        task = asyncio.current_task()
        before = task.cancelling() if task else 0
        try:
            result = await work
        except ua.UaStatusCodeError as error:
            name = ua.StatusCode(error.code).name
            if stage == "login" or is_lost(name):
                self._break(name)
            raise refusal(name, self._where, stage, what) from error
        except TrueflankError:
            self._break("login was refused" if stage == "login" else "the server is not as expected")
            raise
        except asyncio.CancelledError:
            self._break("a request was interrupted")
            raise
        except Exception as error:  # what the library makes of a peer's bytes is no list of types
            self._break(str(error) or type(error).__name__)
            raise foreign(error, stage, self._where, self._url) from error
        if task is not None and task.cancelling() > before:  # 3.11's wait_for can swallow a cancel
            self._break("a request was interrupted")
            raise asyncio.CancelledError
        return result
