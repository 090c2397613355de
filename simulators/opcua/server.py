"""The control's OPC UA server on loopback: end points, certificate, users and the visible part of its tree."""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import functools
import logging
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.server import Server

from drivers.clock import Clock
from drivers.errors import ConfigError
from drivers.sinumerik.opcua.session import nodes
from drivers.sinumerik.opcua.session.certificates import KeyPair, load_certificate, load_private_key, own_key_pair
from simulators.nck import Nck
from simulators.opcua.address_space import VariableSpace, make_accounts
from simulators.opcua.methods import (
    COPY_METHODS,
    FILE_METHODS,
    MAX_FILE,
    SIGNATURES,
    Methods,
    MethodSignature,
    ServedFiles,
)
from simulators.opcua.quirks import RequestCounters, ServerQuirks
from simulators.opcua.sessions import Accounts, SinumerikInternalServer

APPLICATION_URI = "urn:sinumerik:opcua:server"
_POLICIES = {
    "None": ua.SecurityPolicyType.NoSecurity,
    "Basic256Sha256": ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    "Aes256_Sha256_RsaPss": ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
}


@functools.cache
def _temporary_folder() -> Path:
    """Where servers without a folder of their own have their certificate, one for all of this process."""
    made = tempfile.TemporaryDirectory(prefix="sinumerik-")
    atexit.register(made.cleanup)
    return Path(made.name)


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """How the server is set up. ``folder`` holds its certificate and outlives the server if given.

    ``users`` name -> password or {password, rights}; ``trusted`` lists client certificates (all if None);
    ``method_folder`` "/Methods" or "/Methods/Filehandling" as newer servers have it; ``file_write_level`` is
    the protection level that writing a file needs; ``name_space`` the index the URI gets (2 or more).
    ``copy_methods`` and ``file_nodes``: which of the two ways to files this server has, ``copy_refusal`` a
    status its copying methods always answer with, ``largest_copy`` bytes they take. ``alarm_events``: whether
    alarms are events. ``session_timeout_s`` what it gives at most. ``rights_method``: GetMyAccessRights exists.
    ``null_strings``: an empty text is a null String on the wire, as other stacks have it. ``discovery``: a server
    without policy None opens a channel without security for the end points alone; if not, it refuses that channel.
    ``software_version`` is what it calls itself, ``select_right`` what selecting a program asks for ("" for servers
    that know no such right).
    """

    users: Mapping[str, Any] = field(default_factory=lambda: {"trueflank": "trueflank"})
    security: tuple[str, ...] = ("None", "Basic256Sha256", "Aes256_Sha256_RsaPss")
    folder: str = ""
    trusted: tuple[str, ...] | None = None
    session_limit: int = 10
    file_write_level: int = 4
    method_folder: str = nodes.METHODS[1]
    port: int = 0
    name_space: int = 2
    copy_methods: bool = True
    copy_refusal: str = ""
    largest_copy: int = MAX_FILE
    file_nodes: bool = True
    alarm_events: bool = True
    session_timeout_s: float = 60.0
    rights_method: bool = True
    null_strings: bool = False
    discovery: bool = True
    software_version: str = "3.1"
    select_right: str = "ApWrite"

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> ServerSettings:
        """Settings from a cell file. Raises ConfigError (E-CFG-SETTING)."""
        known = [entry.name for entry in fields(cls)]
        for key in given:
            if key not in known:
                raise ConfigError("E-CFG-SETTING", "opcua", key=key, known=", ".join(known))
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in given.items()
        }
        return cls(**values)


class _Rejected(ua.uaerrors.BadRequestTooLarge):
    """The one error that asyncua's server tells its peer before there is a channel, with the status of a policy."""

    code = ua.StatusCodes.BadSecurityPolicyRejected


class _NoDiscovery:
    """Asked first which policy fits a new channel: none but those that are offered."""

    def __init__(self, offered: Sequence[str]) -> None:
        self._offered = offered

    def matches(self, uri: str, _mode: Any = None) -> bool:
        """Raises the refusal for any other policy; leaves those that are offered to asyncua's own."""
        if uri.rpartition("#")[2] not in self._offered:
            raise _Rejected
        return False


class SinumerikServer:
    """Serves one NCK. `url` and `certificate` are known after `start`."""

    def __init__(self, nck: Nck, clock: Clock, settings: ServerSettings | Mapping[str, Any] | None = None) -> None:
        self.settings = settings if isinstance(settings, ServerSettings) else ServerSettings.of(settings or {})
        self.url = ""
        self.certificate = Path()
        self._server: Server | None = None
        self.quirks = ServerQuirks()
        set_up = self.settings
        methods = Methods(
            nck, set_up.file_write_level, set_up.largest_copy, set_up.copy_refusal, select_right=set_up.select_right
        )
        files = ServedFiles(nck, set_up.file_write_level, self.quirks)
        self._core = SinumerikInternalServer(
            accounts=Accounts(make_accounts(set_up.users)),
            space=VariableSpace(nck, self.quirks.draw_starting_status),
            methods=methods,
            files=files,
            clock=clock,
        )
        self._core.session_limit = set_up.session_limit
        self._core.file_nodes, self._core.event_source = set_up.file_nodes, set_up.alarm_events
        self._core.null_strings = set_up.null_strings
        self._core.max_session_timeout_ms = round(set_up.session_timeout_s * 1000.0)

    @property
    def requests(self) -> RequestCounters:
        """What clients have asked for so far."""
        return self._core.requests

    @property
    def sessions(self) -> int:
        """Sessions open at this moment."""
        return self._core.open_sessions

    async def start(self) -> None:
        """Listen on 127.0.0.1, on a free port unless the settings name one."""
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # it reports every refusal as an error
        server = Server(iserver=self._core)
        await server.init()
        await server.set_application_uri(APPLICATION_URI)
        server.set_server_name("SINUMERIK OPC UA")
        server.set_endpoint(f"opc.tcp://127.0.0.1:{self.settings.port}")
        server.set_security_policy([_POLICIES[name] for name in self.settings.security])
        if not self.settings.discovery:
            policies: list[Any] = server.__dict__["_policies"]  # asyncua itself always lets anybody ask
            policies.insert(0, _NoDiscovery(self.settings.security))
        pair = await asyncio.to_thread(self._key_pair)
        self.certificate = pair.certificate
        await server.load_certificate(await asyncio.to_thread(pair.certificate.read_bytes), "der")
        self._core.private_key = load_private_key(await asyncio.to_thread(pair.key.read_bytes))
        if self.settings.trusted is not None:
            self._core.certificate_validator = self._validator()
        await self._fill(server)
        await server.start()
        self._server = server
        self.url = f"opc.tcp://127.0.0.1:{server.bserver.port}"

    async def stop(self) -> None:
        """Close every connection and the port; may be called twice."""
        server, self._server = self._server, None
        await self._core.alarms.stop()
        if server is not None:
            await server.stop()

    async def drop_connections(self) -> None:
        """Cut every client's connection, as a pulled network cable does."""
        for transport in list(self._core.asyncio_transports):
            transport.abort()

    def _key_pair(self) -> KeyPair:
        folder = Path(self.settings.folder) if self.settings.folder else _temporary_folder()
        return own_key_pair(folder, "server", APPLICATION_URI, "127.0.0.1", server=True)

    def _validator(self) -> Any:
        trusted = {load_certificate(Path(path).read_bytes()) for path in self.settings.trusted or ()}

        async def validate(certificate: Any, _description: Any) -> None:
            if certificate not in trusted:
                raise ServiceError(ua.StatusCodes.BadSecurityChecksFailed)

        return validate

    async def _fill(self, server: Server) -> None:
        """The visible tree: folders, methods, and the first element of each variable."""
        version = ua.NodeId(ua.ObjectIds.Server_ServerStatus_BuildInfo_SoftwareVersion)
        await server.get_node(version).write_value(self.settings.software_version)
        while len(await server.get_namespace_array()) < self.settings.name_space:
            await server.register_namespace(f"urn:filler:{len(await server.get_namespace_array())}")
        index = await server.register_namespace(nodes.NAMESPACE_URI)
        self._core.name_space = self._core.alarms.name_space = index
        root = await server.nodes.objects.add_object(ua.NodeId("Sinumerik", index), "Sinumerik")
        await self._add_methods(root, index)
        if self.settings.alarm_events:
            await root.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
            alarm_type = server.get_node(ua.NodeId(ua.ObjectIds.AlarmConditionType))
            await alarm_type.add_object_type(ua.NodeId("CncAlarmType", index), ua.QualifiedName("CncAlarmType", index))
        for path in self._core.space.first_elements():
            kind = ua.VariantType[nodes.kind_of(path)]
            name = ua.QualifiedName(path.rpartition("/")[2], index)
            await root.add_variable(ua.NodeId(path, index), name, ua.get_default_value(kind), kind)

    @property
    def _offered(self) -> list[MethodSignature]:
        hidden = set() if self.settings.copy_methods else set(COPY_METHODS)
        hidden |= set() if self.settings.rights_method else {"GetMyAccessRights"}
        return [method for method in SIGNATURES if method.name not in hidden]

    async def _add_methods(self, root: Any, index: int) -> None:
        folders = {"/Methods": await root.add_object(ua.NodeId("/Methods", index), "Methods")}
        if self.settings.method_folder != "/Methods":
            path = self.settings.method_folder
            name = ua.QualifiedName(path.rpartition("/")[2], index)
            folders[path] = await folders["/Methods"].add_object(ua.NodeId(path, index), name)
        for method in self._offered:
            folder = self.settings.method_folder if method.name in FILE_METHODS else "/Methods"
            inputs = [ua.VariantType[kind] for _, kind in method.arguments]
            outputs = [ua.VariantType[method.result]] if method.result else []
            node = ua.NodeId(f"{folder}/{method.name}", index)
            await folders[folder].add_method(node, ua.QualifiedName(method.name, index), None, inputs, outputs)
            self._core.add_method(folder, f"{folder}/{method.name}", method.name)


@contextlib.asynccontextmanager
async def running_server(nck: Nck, clock: Clock, settings: ServerSettings | Mapping[str, Any] | None = None) -> Any:
    """A server for the length of a block."""
    server = SinumerikServer(nck, clock, settings)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()
