"""Sessions that answer by identifier, and the core of asyncua's server with our accounts, name space and quirks.

A request is counted, delayed and refused as the quirks say, then each node is looked up: a standard node by asyncua, a
node of ours by its identifier, without a stored node.
"""

from __future__ import annotations

import asyncio
import copy
import math
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession, SessionState
from asyncua.server.user_managers import UserManager

from drivers.clock import Clock, LoopClock
from drivers.sinumerik.opcua.session import nodes
from simulators.opcua.address_space import (
    ANONYMOUS,
    Account,
    NodeLayer,
    StatusRefused,
    VariableSpace,
    made_up_attributes,
    standard_nodes,
    status_code,
)
from simulators.opcua.methods import RESULTS, Methods, ServedFiles
from simulators.opcua.quirks import RequestCounters
from simulators.opcua.subscriptions import REFRESH, AlarmEvents, SampleBudget, SampledItems, revise_publishing

_GOOD = ua.StatusCode()


class SinumerikSession(InternalSession):
    """A session whose reads, writes and calls in our name space go to the NCK."""

    _limit_s = 0.0

    @property
    def _home(self) -> Any:
        """The server core, which makes its sessions itself."""
        return self.iserver

    async def _serve(self, service: str, asked: int = 0, most: int = 0) -> None:
        """Count a request, take the server's time over it, and refuse what is too much at once."""
        quirks = self._home.quirks
        self._home.requests.services[service] += 1
        quirks.on_request(service)
        if quirks.answer_s:
            await self._home.clock.sleep(quirks.answer_s)
        if most and asked > most:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)

    async def read(self, params: ua.ReadParameters) -> list[ua.DataValue]:
        """Values by identifier; everything else from the standard address space."""
        home = self._home
        await self._serve("read", len(params.NodesToRead), home.quirks.most_read)
        if home.quirks.starting == "session" and home.files.nck.booting:
            raise ServiceError(getattr(ua.StatusCodes, home.quirks.draw_starting_status()))
        other = [item for item in params.NodesToRead if not home.is_own(item.NodeId)]
        rest: Iterator[ua.DataValue] = iter(())
        if other:
            theirs = copy.copy(params)
            theirs.NodesToRead = other
            rest = iter(await super().read(theirs))
        now = home.clock.utc()
        account = home.accounts.account(self.user)
        return [
            self._value(item, account, now) if home.is_own(item.NodeId) else home.with_time_stamp(item, next(rest), now)
            for item in params.NodesToRead
        ]

    def _value(self, item: ua.ReadValueId, account: Account, now: datetime) -> ua.DataValue:
        if item.AttributeId != ua.AttributeIds.Value:
            return self._home.attribute(item, account)
        quirks = self._home.quirks
        path = item.NodeId.Identifier
        try:
            if path in quirks.read_status:
                raise StatusRefused(quirks.read_status[path])
            kind, value = self._home.value(path, account)
        except StatusRefused as refused:
            return ua.DataValue(StatusCode=status_code(refused.status), ServerTimestamp=now)
        if kind == "String" and self._home.null_strings:
            value = [one or None for one in value] if isinstance(value, list) else value or None
        variant = ua.Variant(value, ua.VariantType[kind], is_array=isinstance(value, list))
        known = now - timedelta(seconds=quirks.stale_s)
        return ua.DataValue(variant, StatusCode=_GOOD, SourceTimestamp=known, ServerTimestamp=known)

    async def write(self, params: ua.WriteParameters) -> list[ua.StatusCode]:
        """Write by identifier; everything else is not writable for a client."""
        quirks = self._home.quirks
        await self._serve("write", len(params.NodesToWrite), quirks.most_write)
        if quirks.late_write_s:
            await self._home.clock.sleep(quirks.late_write_s)
        account = self._home.accounts.account(self.user)
        return [self._store(item, account) for item in params.NodesToWrite]

    def _store(self, item: ua.WriteValue, account: Account) -> ua.StatusCode:
        home = self._home
        if not home.is_own(item.NodeId):
            return status_code("BadUserAccessDenied")
        path = item.NodeId.Identifier
        given = home.quirks.write_status.get(path, "")
        if given and not given.startswith("Good"):
            return status_code(given)
        if item.AttributeId != ua.AttributeIds.Value or item.Value.Value is None:
            return status_code("BadNotWritable")
        if item.Value.SourceTimestamp is not None or item.Value.ServerTimestamp is not None:
            return status_code("BadWriteNotSupported")
        variant = item.Value.Value
        values = list(variant.Value) if isinstance(variant.Value, list) else [variant.Value]
        if variant.VariantType.name != home.kind(path):
            return status_code("BadTypeMismatch")
        if home.quirks.quantise is not None:
            values = [home.quirks.quantise(value) if isinstance(value, float) else value for value in values]
        try:
            home.space.write(path, values, account)
        except StatusRefused as refused:
            return status_code(refused.status)
        home.requests.written[path] += 1
        return status_code(given) if given else _GOOD

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Methods in our name space and ConditionRefresh; everything else from the standard address space."""
        await self._serve("call")
        account = self._home.accounts.account(self.user)
        results = []
        for request in params:
            if self._home.is_own(request.MethodId):
                results.append(self._call(request, account))
            elif request.MethodId == REFRESH:
                results.append(await self._refresh(request, account))
            else:
                results += await super().call([request])
        return results

    async def _refresh(self, request: ua.CallMethodRequest, account: Account) -> ua.CallMethodResult:
        self._home.requests.called["ConditionRefresh"] += 1
        result = ua.CallMethodResult()
        (number, *_) = (argument.Value for argument in request.InputArguments or [ua.Variant(0)])
        own = self.subscription_service.subscriptions.get(number)
        if not account.may("AlarmRead") and not account.may("StateRead"):
            result.StatusCode = status_code("BadUserAccessDenied")
        elif own is None or own.session_id != self.session_id:
            result.StatusCode = status_code("BadSubscriptionIdInvalid")
        else:
            await self._home.alarms.refresh(number)
        return result

    def _call(self, request: ua.CallMethodRequest, account: Account) -> ua.CallMethodResult:
        arguments = request.InputArguments or []
        result = ua.CallMethodResult()
        try:
            answer = self._home.answer(request, account, self)
        except StatusRefused as refused:
            result.StatusCode = status_code(refused.status)
            result.InputArgumentResults = [status_code(name) for name in refused.arguments]
            return result
        result.InputArgumentResults = [_GOOD for _ in arguments]
        result.OutputArguments = answer
        return result

    # ---- subscriptions ------------------------------------------------------------------------------

    async def create_subscription(
        self, params: Any, callback: Callable[..., Any], request_callback: Callable[..., Any] | None = None
    ) -> ua.CreateSubscriptionResult:
        """A subscription with one of the publishing intervals the control offers."""
        made = await super().create_subscription(revise_publishing(params), callback, request_callback)
        subscription: Any = self.subscription_service.subscriptions[made.SubscriptionId]
        home = self._home
        subscription.monitored_item_srv = SampledItems(
            (subscription, self.aspace), self._sample, home.is_own, clock=home.clock, samples=home.samples
        )
        return made

    def _sample(self, item: ua.ReadValueId) -> ua.DataValue:
        return self._value(item, self._home.accounts.account(self.user), self._home.clock.utc())

    async def create_monitored_items(self, params: Any) -> list[ua.MonitoredItemCreateResult]:
        """Events of the alarm source, and data changes of variables."""
        account = self._home.accounts.account(self.user)
        results: list[ua.MonitoredItemCreateResult] = []
        for item in params.ItemsToCreate:
            refused = self._home.refuses_item(item.ItemToMonitor, account)
            if refused:
                results.append(ua.MonitoredItemCreateResult(StatusCode=status_code(refused)))
                continue
            one = copy.copy(params)
            one.ItemsToCreate = [item]
            results += await super().create_monitored_items(one)
            if item.ItemToMonitor.AttributeId == ua.AttributeIds.EventNotifier:
                self._home.alarms.start_watching()
        return results

    # ---- the session's own life, by the time of those who call: a fast cell makes no client faster ------

    @cached_property
    def _callers(self) -> LoopClock:
        return LoopClock()

    async def create_session(
        self, params: ua.CreateSessionParameters, sockname: tuple[str, int] | None = None
    ) -> ua.CreateSessionResult:
        """As asyncua, whose connections watch their session too, by the wall's clock: they are given no limit."""
        made = await super().create_session(params, sockname)
        self._limit_s, self.session_timeout = made.RevisedSessionTimeout / 1000.0, math.inf
        return made

    def touch(self) -> None:
        """A request has come."""
        self._last_activity = self._callers.now()

    async def _timeout_loop(self) -> None:
        limit_s = self._limit_s
        while self.state is not SessionState.Closed:
            left_s = limit_s - (self._callers.now() - self._last_activity)
            if left_s <= 0:
                await self.close_session(True)
                return
            await self._callers.sleep(left_s)

    async def close_session(self, delete_subs: bool = True) -> None:
        """End; files left open are closed without being stored."""
        self._home.files.forget(self)
        await super().close_session(delete_subs)


# asyncua's internal server.

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

    def __init__(
        self, accounts: Accounts, space: VariableSpace, methods: Methods, files: ServedFiles, clock: Clock
    ) -> None:
        self.accounts = accounts
        self.space = space
        self.methods = methods
        self.files = files
        self.clock = clock
        self.quirks = files.quirks
        self.requests = RequestCounters()
        self.name_space = 2
        self.file_nodes = True
        self.event_source = True
        self.session_limit = 10
        self.null_strings = False
        self._method_nodes: dict[tuple[str, str], str] = {}
        super().__init__(user_manager=accounts)
        self.samples = SampleBudget()
        self.alarms = AlarmEvents(files.nck, clock, self.subscription_service, self.quirks)
        self.disabled_clock = True
        self.min_session_timeout_ms, self.max_session_timeout_ms = 1000, 60_000

    async def load_standard_address_space(self, _shelf_file: Path | None = None) -> None:
        """Lay a writable layer over the standard nodes, which are built once for the process."""
        pristine = await asyncio.to_thread(standard_nodes)
        self.aspace.__dict__["_nodes"] = NodeLayer(pristine)  # asyncua itself offers only a shelf on disk for this

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

    def with_time_stamp(self, item: ua.ReadValueId, value: ua.DataValue, now: datetime) -> ua.DataValue:
        """The server's clock and limits are read, not kept in nodes."""
        if item.AttributeId != ua.AttributeIds.Value:
            return value
        if item.NodeId == _CURRENT_TIME:
            return ua.DataValue(ua.Variant(now, ua.VariantType.DateTime), SourceTimestamp=now)
        limits = {_MOST_READ: self.quirks.most_read, _MOST_WRITE: self.quirks.most_write}
        if item.NodeId in limits:
            said = limits[item.NodeId] if self.quirks.tells_limits else 0
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
            raise StatusRefused("BadMethodInvalid")
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
        except StatusRefused as refused:
            return ua.DataValue(StatusCode=status_code(refused.status))
        made = made_up_attributes(item.NodeId, kind).get(item.AttributeId)
        if rights and self.space.may_write(path, account):
            made = ua.Variant(3, ua.VariantType.Byte)
        return ua.DataValue(made) if made is not None else ua.DataValue(StatusCode=status_code("BadAttributeIdInvalid"))
