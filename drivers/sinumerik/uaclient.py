"""One OPC UA session with the control: the one place that knows asyncua.

asyncua's own reconnecting, watching and trusting are not used: a request that failed or was interrupted
leaves the session broken and the next call says so, because what the server did meanwhile is unknown; the
server's certificate must be the pinned one; values are written typed and without time stamps.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import struct
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.serialization import Encoding

from drivers.clock import Clock
from drivers.errors import (
    DeviceRefused,
    LinkBroken,
    RemoteProtocolError,
    TransportError,
    TrueflankError,
    UnsupportedDevice,
)
from drivers.sinumerik import nodes
from drivers.sinumerik.certificates import fingerprint, load
from drivers.sinumerik.uasettings import APPLICATION_URI, Secrets
from drivers.sinumerik.uastatus import Stage, is_lost, refusal

T = TypeVar("T")

SESSION_S = 60.0
CHANNEL_S = 3600.0
CLOSE_S = 2.0
_LIBRARY_TIMEOUT_S = 86400.0  # the caller's deadline rules, never the library's own
_GARBLED = (struct.error, ValueError, LookupError, TypeError, AttributeError)
_FOREIGN = (ua.UaError, OSError, TimeoutError, InvalidSignature, *_GARBLED)

logging.getLogger("asyncua").addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True)
class Reading:
    """One value read: ``status`` is "" when it is good."""

    path: str
    value: Any
    status: str = ""


class UaSession:
    """Login, batch reads, writes and method calls, one request at a time."""

    def __init__(self, url: str, clock: Clock, where: str) -> None:
        self._url = url
        self._clock = clock
        self._where = where
        self._lock = asyncio.Lock()
        self._client: Any = None
        self._index = 2
        self._methods: dict[str, tuple[Any, Any]] = {}
        self._alive: asyncio.Task[None] | None = None
        self._renew_at = 0.0
        self._why = "it was never opened"

    @property
    def is_open(self) -> bool:
        """Whether requests can be made."""
        return self._client is not None

    # ---- opening and closing ------------------------------------------------------------------------

    async def open(self, secrets: Secrets, timeout_s: float) -> None:
        """Log in and find name space and methods. An older session is closed first.

        Raises TransportError (E-UA-CONNECT), DeadlineExceeded, DeviceRefused (E-UA-LOGIN, E-UA-TRUST,
        E-UA-TRUST-US, E-UA-POLICY, E-UA-SESSIONS), UnsupportedDevice (E-UA-NAMESPACE), RemoteProtocolError.
        """
        await self.close()
        async with self._clock.deadline(timeout_s, self._where), self._lock:
            if secrets.pinned is not None:
                await self._translated("login", secrets.user, self._check_server(secrets.pinned))
            self._client = client = self._new_client(secrets)
            await self._translated("login", secrets.user, self._log_in(client, secrets))
            await self._translated("read", "the name space", self._look_around(client))
        self._alive = asyncio.get_running_loop().create_task(
            self._keep_alive(client.session_timeout / 3000.0), name=f"keep-alive of {self._where}"
        )

    def _new_client(self, secrets: Secrets) -> Any:
        client = Client(self._url, timeout=_LIBRARY_TIMEOUT_S)
        client.name = client.description = "trueflank"
        client.application_uri = APPLICATION_URI
        client.session_timeout = SESSION_S * 1000.0
        client.secure_channel_timeout = int(CHANNEL_S * 1000)
        client.set_max_concurrent_requests(1)
        if secrets.user:
            client.set_user(secrets.user)
            client.set_password(secrets.password)
        return client

    async def _check_server(self, pinned: x509.Certificate) -> None:
        """Compare the certificate the server shows with the pinned one before anything is entrusted to it."""
        probe = Client(self._url, timeout=_LIBRARY_TIMEOUT_S)
        try:
            endpoints = await probe.connect_and_get_server_endpoints()
        finally:
            probe.disconnect_socket()
        secured = [
            end
            for end in endpoints
            if end.SecurityPolicyUri == SecurityPolicyBasic256Sha256.URI
            and end.SecurityMode == ua.MessageSecurityMode.SignAndEncrypt
        ]
        if not secured:
            raise DeviceRefused("E-UA-POLICY", self._where)
        shown = load(bytes(secured[0].ServerCertificate))
        if shown != pinned:
            raise DeviceRefused("E-UA-TRUST", self._where, found=fingerprint(shown), pinned=fingerprint(pinned))
        now = self._clock.utc()
        if not pinned.not_valid_before_utc <= now <= pinned.not_valid_after_utc:
            until = pinned.not_valid_after_utc.isoformat()
            raise DeviceRefused("E-UA-EXPIRED", self._where, since=pinned.not_valid_before_utc, until=until)

    async def _log_in(self, client: Any, secrets: Secrets) -> None:
        if secrets.pinned is not None and secrets.own is not None:
            await client.set_security(
                SecurityPolicyBasic256Sha256,
                certificate=str(secrets.own.certificate),
                private_key=str(secrets.own.key),
                server_certificate=secrets.pinned.public_bytes(Encoding.DER),
                mode=ua.MessageSecurityMode.SignAndEncrypt,
            )
        await client.connect_socket()
        await client.send_hello()
        await client.open_secure_channel()
        self._renew_at = self._clock.now() + 0.6 * client.secure_channel_timeout / 1000.0
        await client.create_session()
        await client.activate_session(username=secrets.user or None, password=secrets.password or None)

    async def _look_around(self, client: Any) -> None:
        """Resolve the name space by its URI, now and at every login, and find methods under either parent."""
        uris = await client.get_namespace_array()
        if nodes.NAMESPACE_URI not in uris:
            raise UnsupportedDevice("E-UA-NAMESPACE", self._where, wanted=nodes.NAMESPACE_URI, found=", ".join(uris))
        self._index = uris.index(nodes.NAMESPACE_URI)
        self._methods = {}
        for parent in nodes.METHODS:
            owner = ua.NodeId(parent, self._index)
            for found in await self._children(client, owner):
                self._methods[found.BrowseName.Name] = (owner, found.NodeId)

    async def _children(self, client: Any, parent: Any) -> list[Any]:
        wanted = ua.BrowseDescription()
        wanted.NodeId = parent
        wanted.BrowseDirection = ua.BrowseDirection.Forward
        wanted.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HierarchicalReferences)
        wanted.IncludeSubtypes = True
        wanted.NodeClassMask = int(ua.NodeClass.Method)
        wanted.ResultMask = int(ua.BrowseResultMask.All)
        parameters = ua.BrowseParameters()
        parameters.NodesToBrowse = [wanted]
        results = await client.uaclient.session.browse(parameters)
        return list(results[0].References or []) if results[0].StatusCode.is_good() else []

    async def close(self) -> None:
        """Log out if the server still listens, and let go of the wire. Never raises, may be called twice."""
        client, self._client, self._why = self._client, None, "it was closed"
        alive, self._alive = self._alive, None
        if alive is not None:
            alive.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await alive
        if client is None:
            return
        try:
            with contextlib.suppress(TrueflankError, *_FOREIGN):
                async with self._clock.deadline(CLOSE_S, self._where):
                    await client.close_session()
                    await client.close_secure_channel()
        finally:
            client.disconnect_socket()
        await self._clock.sleep(0)
        await self._clock.sleep(0)

    def _break(self, why: str) -> None:
        client, self._client, self._why = self._client, None, why
        if client is not None:
            client.disconnect_socket()

    async def _keep_alive(self, period_s: float) -> None:
        """Ask for a sign of life often enough that the server keeps the session; ends with the session."""
        server_state = ua.NodeId(ua.ObjectIds.Server_ServerStatus_State)
        with contextlib.suppress(TrueflankError):
            while self.is_open:
                await self._clock.sleep(period_s)
                await self._request(
                    period_s, "read", "the server's state", lambda client: _values(client, [server_state])
                )

    # ---- requests -----------------------------------------------------------------------------------

    async def read(self, paths: Sequence[str], timeout_s: float) -> list[Reading]:
        """Values of many variables by one request; what could not be read carries its status name."""
        wanted = [self._node(path) for path in paths]
        found = await self._request(timeout_s, "read", paths[0], lambda client: _values(client, wanted))
        if len(found) != len(paths):
            self._break("an answer of the wrong length")
            raise RemoteProtocolError("E-UA-COUNT", self._where, asked=len(paths), got=len(found))
        return [_reading(path, value) for path, value in zip(paths, found, strict=True)]

    async def write(self, values: Sequence[tuple[str, Any]], timeout_s: float) -> None:
        """Write variables by one request, each typed, without time stamps. Never retried.

        Raises the refusal of the first variable that was not confirmed; others may have been written then.
        """
        items = [self._typed(path, value) for path, value in values]
        statuses = await self._request(timeout_s, "write", values[0][0], lambda client: _write(client, items))
        if len(statuses) != len(items):
            self._break("an answer of the wrong length")
            raise RemoteProtocolError("E-UA-COUNT", self._where, asked=len(items), got=len(statuses))
        for (path, _), status in zip(values, statuses, strict=True):
            if status.value != ua.StatusCodes.Good:  # "completes asynchronously" and "uncertain" are not done
                raise refusal(status.name, self._where, "write", path)

    async def call(self, method: str, arguments: Sequence[tuple[Any, str]], timeout_s: float) -> Any:
        """Call a method found at login; its one result, None if it has none. Never retried."""
        if method not in self._methods:
            raise UnsupportedDevice("E-UA-ABSENT", self._where, status="not offered", what=method)
        request = ua.CallMethodRequest()
        request.ObjectId, request.MethodId = self._methods[method]
        request.InputArguments = [ua.Variant(value, ua.VariantType[kind]) for value, kind in arguments]
        results = await self._request(timeout_s, "call", method, lambda client: client.uaclient.session.call([request]))
        result = results[0]
        if result.StatusCode.value != ua.StatusCodes.Good:
            raise refusal(result.StatusCode.name, self._where, "call", f"{method} {_shown(arguments)}".strip())
        return result.OutputArguments[0].Value if result.OutputArguments else None

    def _node(self, path: str) -> Any:
        return ua.NodeId(path, self._index)

    def _typed(self, path: str, value: Any) -> Any:
        item = ua.WriteValue()
        item.NodeId = self._node(path)
        item.AttributeId = ua.AttributeIds.Value
        item.Value = ua.DataValue(ua.Variant(value, ua.VariantType[nodes.kind_of(path)]))
        return item

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
        self._renew_at = self._clock.now() + 0.6 * client.secure_channel_timeout / 1000.0

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
        except _FOREIGN as error:
            self._break(str(error) or type(error).__name__)
            raise self._foreign(error, stage) from error
        except asyncio.CancelledError:
            self._break("a request was interrupted")
            raise
        if task is not None and task.cancelling() > before:  # 3.11's wait_for can swallow a cancel
            self._break("a request was interrupted")
            raise asyncio.CancelledError
        return result

    def _foreign(self, error: Exception, stage: Stage) -> TrueflankError:
        if isinstance(error, InvalidSignature):
            return DeviceRefused("E-UA-TRUST-US", self._where, status="invalid signature")
        if isinstance(error, OSError | TimeoutError):
            why = str(error) or type(error).__name__
            return TransportError("E-UA-CONNECT", self._where, retryable=stage == "read", url=self._url, why=why)
        return RemoteProtocolError("E-UA-PROTOCOL", self._where, why=f"{type(error).__name__}: {error}")


async def _values(client: Any, wanted: list[Any]) -> list[Any]:
    parameters = ua.ReadParameters()
    parameters.TimestampsToReturn = ua.TimestampsToReturn.Neither
    for node in wanted:
        item = ua.ReadValueId()
        item.NodeId = node
        item.AttributeId = ua.AttributeIds.Value
        parameters.NodesToRead.append(item)
    return list(await client.uaclient.session.read(parameters))


async def _write(client: Any, items: list[Any]) -> list[Any]:
    parameters = ua.WriteParameters()
    parameters.NodesToWrite = items
    return list(await client.uaclient.session.write(parameters))


def _reading(path: str, value: Any) -> Reading:
    status = value.StatusCode
    if status is not None and status.value != ua.StatusCodes.Good:
        return Reading(path, None, str(status.name))
    return Reading(path, value.Value.Value if value.Value is not None else None)


def _shown(arguments: Sequence[tuple[Any, str]]) -> str:
    return " ".join(str(value) for value, kind in arguments if kind in ("String", "Int32"))
