"""The asyncua side of the server: its core with our accounts, name space and switches."""

from __future__ import annotations

import asyncio
from datetime import datetime
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.user_managers import UserManager

from drivers.clock import Clock
from drivers.sinumerik.opcua.session import nodes
from simulators.opcua.alarms import AlarmEvents
from simulators.opcua.filenodes import RESULTS, ServedFiles
from simulators.opcua.manners import Requests
from simulators.opcua.methods import Methods
from simulators.opcua.samples import Samples
from simulators.opcua.sessions import SinumerikSession
from simulators.opcua.space import Refused, Space
from simulators.opcua.standard import Layer, attributes, standard_nodes, status
from simulators.opcua.users import ANONYMOUS, Account

_CURRENT_TIME = ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime)
_MOST_READ = ua.NodeId(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerRead)
_MOST_WRITE = ua.NodeId(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerWrite)


class Accounts(UserManager):
    """Names and passwords. A wrong one is refused; anonymous may come in and finds nothing usable."""

    def __init__(self, accounts: dict[str, Account]) -> None:
        self._accounts = accounts

    def get_user(
        self, _iserver: Any, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> User | None:
        """The session's user, None to refuse."""
        if username is None:
            return User(UserRole.Anonymous, "") if certificate is None else User(UserRole.User, "")
        account = self._accounts.get(username)
        if account is None or account.password != password:
            return None
        return User(UserRole.User, username)

    def account(self, user: User | None) -> Account:
        """The account of a session's user."""
        return self._accounts.get((user.name if user else "") or "", ANONYMOUS)


class SinumerikInternalServer(InternalServer):
    """asyncua's server core with our sessions, limits and a shared standard address space."""

    def __init__(self, accounts: Accounts, space: Space, methods: Methods, files: ServedFiles, clock: Clock) -> None:
        self.accounts = accounts
        self.space = space
        self.methods = methods
        self.files = files
        self.clock = clock
        self.manners = files.manners
        self.requests = Requests()
        self.name_space = 2
        self.file_nodes = True
        self.event_source = True
        self.session_limit = 10
        self.null_strings = False
        self._method_nodes: dict[tuple[str, str], str] = {}
        super().__init__(user_manager=accounts)
        self.samples = Samples()
        self.alarms = AlarmEvents(files.nck, clock, self.subscription_service, self.manners)
        self.disabled_clock = True
        self.min_session_timeout_ms, self.max_session_timeout_ms = 1000, 60_000

    async def load_standard_address_space(self, _shelf_file: Path | None = None) -> None:
        """Lay a writable layer over the standard nodes, which are built once for the process."""
        pristine = await asyncio.to_thread(standard_nodes)
        self.aspace.__dict__["_nodes"] = Layer(pristine)  # asyncua itself offers only a shelf on disk for this

    def create_session(self, name: str, user: User | None = None, external: bool = False) -> InternalSession:
        """A new session, within the server's limit."""
        if external and len(self._external_sessions) >= self.session_limit:
            raise ServiceError(ua.StatusCodes.BadTooManySessions)
        return SinumerikSession(
            self, self.aspace, self.subscription_service, name, user or User(UserRole.Anonymous), external
        )

    def add_method(self, parent: str, node: str, name: str) -> None:
        """Make a method callable under an object."""
        self._method_nodes[parent, node] = name

    def method_name(self, parent: ua.NodeId, method: ua.NodeId) -> str | None:
        """The method behind a node under an object, None if there is no such pair."""
        return self._method_nodes.get((str(parent.Identifier), str(method.Identifier)))

    def is_own(self, node: ua.NodeId) -> bool:
        """Whether a node is ours and answered by identifier."""
        return node.NamespaceIndex == self.name_space and isinstance(node.Identifier, str)

    def value(self, path: str, account: Account) -> tuple[str, Any]:
        """Kind and value of a variable or of a file's property. Raises Refused."""
        if self.file_nodes and self.files.is_one(path):
            return self.files.read(path, account)
        return self.space.read(path, account)

    def kind(self, path: str) -> str:
        """Wire type of a variable."""
        return nodes.kind_of(path)

    @property
    def open_sessions(self) -> int:
        """Sessions of clients open now."""
        return len(self._external_sessions)

    def timed(self, item: ua.ReadValueId, value: ua.DataValue, now: datetime) -> ua.DataValue:
        """The server's clock and limits are read, not kept in nodes."""
        if item.AttributeId != ua.AttributeIds.Value:
            return value
        if item.NodeId == _CURRENT_TIME:
            return ua.DataValue(ua.Variant(now, ua.VariantType.DateTime), SourceTimestamp=now)
        limits = {_MOST_READ: self.manners.most_read, _MOST_WRITE: self.manners.most_write}
        if item.NodeId in limits:
            said = limits[item.NodeId] if self.manners.tells_limits else 0
            return ua.DataValue(ua.Variant(said, ua.VariantType.UInt32), SourceTimestamp=now)
        return value

    def refuses_item(self, item: ua.ReadValueId, account: Account) -> str:
        """Why an item cannot be monitored, "" when it can."""
        if item.AttributeId == ua.AttributeIds.EventNotifier:
            allowed = account.may("AlarmRead") or account.may("StateRead")
            if not self.event_source:
                return "BadNodeIdUnknown"
            return "" if allowed else "BadUserAccessDenied"
        return ""

    def answer(self, request: ua.CallMethodRequest, account: Account, session: object) -> list[ua.Variant]:
        """Output arguments of a method of ours. Raises Refused with the status the server gives."""
        owner, node = str(request.ObjectId.Identifier), str(request.MethodId.Identifier)
        arguments = request.InputArguments or []
        values = [argument.Value for argument in arguments]
        types = [argument.VariantType.name for argument in arguments]
        if self.file_nodes and self.files.is_one(owner):
            name = node.rpartition(".")[2]
            self.requests.called["Open" if name == "Open" and values[:1] == [1] else f"Open/{name}"] += 1
            results = self.files.call(owner, node, arguments=values, types=types, account=account, session=session)
            return [self._variant(kind, value) for kind, value in zip(RESULTS.get(name, ()), results, strict=True)]
        name_ = self.method_name(request.ObjectId, request.MethodId)
        if name_ is None:
            raise Refused("BadMethodInvalid")
        self.requests.called[name_] += 1
        result = self.methods.call(name_, values, types, account)
        if result is None:
            return []
        kind = "Int32" if isinstance(result, int) else "ByteString" if isinstance(result, bytes) else "String"
        return [ua.Variant(result, ua.VariantType[kind])]

    def _variant(self, kind: str, value: Any) -> ua.Variant:
        if kind == "NodeId":
            value = ua.NodeId(value, self.name_space)
        return ua.Variant(value, ua.VariantType[kind])

    def attribute(self, item: ua.ReadValueId, account: Account) -> ua.DataValue:
        """Attributes other than the value: from a browsable node, or made up for an element without one."""
        path = item.NodeId.Identifier
        rights = item.AttributeId == ua.AttributeIds.UserAccessLevel
        known = self.aspace.read_attribute_value(item.NodeId, item.AttributeId)
        if (known.StatusCode is None or known.StatusCode.is_good()) and not rights:
            return known
        try:
            kind = self.value(path, account)[0]
        except Refused as refused:
            return ua.DataValue(StatusCode=status(refused.status))
        made = attributes(item.NodeId, kind).get(item.AttributeId)
        if rights and self.space.may_write(path, account):
            made = ua.Variant(3, ua.VariantType.Byte)
        return ua.DataValue(made) if made is not None else ua.DataValue(StatusCode=status("BadAttributeIdInvalid"))
