"""The asyncua side of the server: sessions that answer by identifier, without a node for each element."""

from __future__ import annotations

import asyncio
import copy
import functools
from collections.abc import Iterator, MutableMapping
from datetime import datetime
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.address_space import AddressSpace, NodeData, NodeManagementService
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.standard_address_space import standard_address_space
from asyncua.server.user_managers import UserManager

from drivers.clock import Clock
from drivers.sinumerik import nodes
from simulators.opcua.methods import Methods
from simulators.opcua.space import Refused, Space
from simulators.opcua.users import ANONYMOUS, Account

_CURRENT_TIME = ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime)
_GOOD = ua.StatusCode()


def status(name: str) -> ua.StatusCode:
    """An OPC UA status by its name."""
    return ua.StatusCode(getattr(ua.StatusCodes, name))


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


class SinumerikSession(InternalSession):
    """A session whose reads, writes and calls in our name space go to the NCK."""

    @property
    def _home(self) -> SinumerikInternalServer:
        return self.iserver

    async def read(self, params: ua.ReadParameters) -> list[ua.DataValue]:
        """Values by identifier; everything else from the standard address space."""
        home = self._home
        other = [item for item in params.NodesToRead if not home.is_own(item.NodeId)]
        rest: Iterator[ua.DataValue] = iter(())
        if other:
            theirs = copy.copy(params)
            theirs.NodesToRead = other
            rest = iter(await super().read(theirs))
        now = home.clock.utc()
        account = home.accounts.account(self.user)
        return [
            self._value(item, account, now) if home.is_own(item.NodeId) else home.timed(item, next(rest), now)
            for item in params.NodesToRead
        ]

    def _value(self, item: ua.ReadValueId, account: Account, now: datetime) -> ua.DataValue:
        if item.AttributeId != ua.AttributeIds.Value:
            return self._home.attribute(item, account)
        try:
            kind, value = self._home.space.read(item.NodeId.Identifier, account)
        except Refused as refused:
            return ua.DataValue(StatusCode=status(refused.status), ServerTimestamp=now)
        variant = ua.Variant(value, ua.VariantType[kind], is_array=isinstance(value, list))
        return ua.DataValue(variant, StatusCode=_GOOD, SourceTimestamp=now, ServerTimestamp=now)

    async def write(self, params: ua.WriteParameters) -> list[ua.StatusCode]:
        """Write by identifier; everything else is not writable for a client."""
        account = self._home.accounts.account(self.user)
        return [self._store(item, account) for item in params.NodesToWrite]

    def _store(self, item: ua.WriteValue, account: Account) -> ua.StatusCode:
        if not self._home.is_own(item.NodeId):
            return status("BadUserAccessDenied")
        if item.AttributeId != ua.AttributeIds.Value or item.Value.Value is None:
            return status("BadNotWritable")
        if item.Value.SourceTimestamp is not None or item.Value.ServerTimestamp is not None:
            return status("BadWriteNotSupported")
        variant = item.Value.Value
        values = list(variant.Value) if isinstance(variant.Value, list) else [variant.Value]
        kind = self._home.kind(item.NodeId.Identifier)
        if variant.VariantType.name != kind:
            return status("BadTypeMismatch")
        try:
            self._home.space.write(item.NodeId.Identifier, values, account)
        except Refused as refused:
            return status(refused.status)
        return _GOOD

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Methods in our name space; everything else from the standard address space."""
        account = self._home.accounts.account(self.user)
        results = []
        for request in params:
            if self._home.is_own(request.MethodId):
                results.append(self._call(request, account))
            else:
                results += await super().call([request])
        return results

    def _call(self, request: ua.CallMethodRequest, account: Account) -> ua.CallMethodResult:
        arguments = request.InputArguments or []
        result = ua.CallMethodResult()
        name = self._home.method_name(request.ObjectId, request.MethodId)
        try:
            if name is None:
                raise Refused("BadMethodInvalid")
            values = [argument.Value for argument in arguments]
            types = [argument.VariantType.name for argument in arguments]
            answer = self._home.methods.call(name, values, types, account)
        except Refused as refused:
            result.StatusCode = status(refused.status)
            return result
        result.InputArgumentResults = [_GOOD for _ in arguments]
        if answer is not None:
            kind = "Int32" if isinstance(answer, int) else "ByteString" if isinstance(answer, bytes) else "String"
            result.OutputArguments = [ua.Variant(answer, ua.VariantType[kind])]
        return result


class SinumerikInternalServer(InternalServer):
    """asyncua's server core with our sessions, limits and a shared standard address space."""

    def __init__(self, accounts: Accounts, space: Space, methods: Methods, clock: Clock, session_limit: int) -> None:
        self.accounts = accounts
        self.space = space
        self.methods = methods
        self.clock = clock
        self.name_space = 2
        self._method_nodes: dict[tuple[str, str], str] = {}
        self._session_limit = session_limit
        super().__init__(user_manager=accounts)
        self.disabled_clock = True
        self.max_session_timeout_ms = 60_000

    async def load_standard_address_space(self, _shelf_file: Path | None = None) -> None:
        """Lay a writable layer over the standard nodes, which are built once for the process."""
        pristine = await asyncio.to_thread(_standard_nodes)
        self.aspace.__dict__["_nodes"] = _Layer(pristine)  # asyncua itself offers only a shelf on disk for this

    def create_session(self, name: str, user: User | None = None, external: bool = False) -> InternalSession:
        """A new session, within the server's limit."""
        if external and len(self._external_sessions) >= self._session_limit:
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

    def kind(self, path: str) -> str:
        """Wire type of a variable."""
        return nodes.kind_of(path)

    @property
    def open_sessions(self) -> int:
        """Sessions of clients open now."""
        return len(self._external_sessions)

    def timed(self, item: ua.ReadValueId, value: ua.DataValue, now: datetime) -> ua.DataValue:
        """The server's clock is read, not kept in a node."""
        if item.NodeId == _CURRENT_TIME and item.AttributeId == ua.AttributeIds.Value:
            return ua.DataValue(ua.Variant(now, ua.VariantType.DateTime), SourceTimestamp=now)
        return value

    def attribute(self, item: ua.ReadValueId, account: Account) -> ua.DataValue:
        """Attributes other than the value: from a browsable node, or made up for an element without one."""
        known = self.aspace.read_attribute_value(item.NodeId, item.AttributeId)
        if known.StatusCode is None or known.StatusCode.is_good():
            return known
        try:
            self.space.read(item.NodeId.Identifier, account)
        except Refused as refused:
            return ua.DataValue(StatusCode=status(refused.status))
        made = _attributes(item.NodeId, self.kind(item.NodeId.Identifier)).get(item.AttributeId)
        return ua.DataValue(made) if made is not None else ua.DataValue(StatusCode=status("BadAttributeIdInvalid"))


def _attributes(node: ua.NodeId, kind: str) -> dict[ua.AttributeIds, ua.Variant]:
    name = str(node.Identifier).rpartition("/")[2]
    readable = ua.Variant(1, ua.VariantType.Byte)
    return {
        ua.AttributeIds.NodeId: ua.Variant(node, ua.VariantType.NodeId),
        ua.AttributeIds.NodeClass: ua.Variant(int(ua.NodeClass.Variable), ua.VariantType.Int32),
        ua.AttributeIds.BrowseName: ua.Variant(
            ua.QualifiedName(name, node.NamespaceIndex), ua.VariantType.QualifiedName
        ),
        ua.AttributeIds.DisplayName: ua.Variant(ua.LocalizedText(name), ua.VariantType.LocalizedText),
        ua.AttributeIds.DataType: ua.Variant(ua.NodeId(getattr(ua.ObjectIds, kind)), ua.VariantType.NodeId),
        ua.AttributeIds.ValueRank: ua.Variant(-1, ua.VariantType.Int32),
        ua.AttributeIds.AccessLevel: readable,
        ua.AttributeIds.UserAccessLevel: readable,
    }


@functools.cache
def _standard_nodes() -> dict[ua.NodeId, NodeData]:
    space = AddressSpace()
    standard_address_space.fill_address_space(NodeManagementService(space))
    return {node: space[node] for node in space.keys()}  # noqa: SIM118 - not a mapping


class _Layer(MutableMapping[ua.NodeId, NodeData]):
    """Nodes copied from a pristine set at first touch, so that servers of one process do not share state."""

    def __init__(self, pristine: dict[ua.NodeId, NodeData]) -> None:
        self._pristine = pristine
        self._own: dict[ua.NodeId, NodeData] = {}
        self._gone: set[ua.NodeId] = set()

    def __getitem__(self, key: ua.NodeId) -> NodeData:
        if key not in self._own:
            if key in self._gone:
                raise KeyError(key)
            self._own[key] = copy.deepcopy(self._pristine[key])
        return self._own[key]

    def __setitem__(self, key: ua.NodeId, value: NodeData) -> None:
        self._gone.discard(key)
        self._own[key] = value

    def __delitem__(self, key: ua.NodeId) -> None:
        if key not in self:
            raise KeyError(key)
        self._own.pop(key, None)
        self._gone.add(key)

    def __contains__(self, key: object) -> bool:
        return key in self._own or (key in self._pristine and key not in self._gone)

    def __iter__(self) -> Iterator[ua.NodeId]:
        yield from self._own
        yield from (key for key in self._pristine if key not in self._own and key not in self._gone)

    def __len__(self) -> int:
        return sum(1 for _ in self)
