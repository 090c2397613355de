"""Sessions that answer by identifier, without a node for each element, in the manners of this server."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from functools import cached_property
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.internal_session import InternalSession, SessionState

from drivers.clock import LoopClock
from simulators.opcua.alarms import REFRESH, snapped
from simulators.opcua.samples import SampledItems
from simulators.opcua.space import Refused
from simulators.opcua.standard import status
from simulators.opcua.users import Account

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
        manners = self._home.manners
        self._home.requests.services[service] += 1
        manners.on_request(service)
        if manners.answer_s:
            await self._home.clock.sleep(manners.answer_s)
        if most and asked > most:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)

    async def read(self, params: ua.ReadParameters) -> list[ua.DataValue]:
        """Values by identifier; everything else from the standard address space."""
        home = self._home
        await self._serve("read", len(params.NodesToRead), home.manners.most_read)
        if home.manners.starting == "session" and home.files.nck.booting:
            raise ServiceError(getattr(ua.StatusCodes, home.manners.starts()))
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
        manners = self._home.manners
        path = item.NodeId.Identifier
        try:
            if path in manners.read_status:
                raise Refused(manners.read_status[path])
            kind, value = self._home.value(path, account)
        except Refused as refused:
            return ua.DataValue(StatusCode=status(refused.status), ServerTimestamp=now)
        if kind == "String" and self._home.null_strings:
            value = [one or None for one in value] if isinstance(value, list) else value or None
        variant = ua.Variant(value, ua.VariantType[kind], is_array=isinstance(value, list))
        known = now - timedelta(seconds=manners.stale_s)
        return ua.DataValue(variant, StatusCode=_GOOD, SourceTimestamp=known, ServerTimestamp=known)

    async def write(self, params: ua.WriteParameters) -> list[ua.StatusCode]:
        """Write by identifier; everything else is not writable for a client."""
        manners = self._home.manners
        await self._serve("write", len(params.NodesToWrite), manners.most_write)
        if manners.late_write_s:
            await self._home.clock.sleep(manners.late_write_s)
        account = self._home.accounts.account(self.user)
        return [self._store(item, account) for item in params.NodesToWrite]

    def _store(self, item: ua.WriteValue, account: Account) -> ua.StatusCode:
        home = self._home
        if not home.is_own(item.NodeId):
            return status("BadUserAccessDenied")
        path = item.NodeId.Identifier
        given = home.manners.write_status.get(path, "")
        if given and not given.startswith("Good"):
            return status(given)
        if item.AttributeId != ua.AttributeIds.Value or item.Value.Value is None:
            return status("BadNotWritable")
        if item.Value.SourceTimestamp is not None or item.Value.ServerTimestamp is not None:
            return status("BadWriteNotSupported")
        variant = item.Value.Value
        values = list(variant.Value) if isinstance(variant.Value, list) else [variant.Value]
        if variant.VariantType.name != home.kind(path):
            return status("BadTypeMismatch")
        if home.manners.quantise is not None:
            values = [home.manners.quantise(value) if isinstance(value, float) else value for value in values]
        try:
            home.space.write(path, values, account)
        except Refused as refused:
            return status(refused.status)
        home.requests.written[path] += 1
        return status(given) if given else _GOOD

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
            result.StatusCode = status("BadUserAccessDenied")
        elif own is None or own.session_id != self.session_id:
            result.StatusCode = status("BadSubscriptionIdInvalid")
        else:
            await self._home.alarms.refresh(number)
        return result

    def _call(self, request: ua.CallMethodRequest, account: Account) -> ua.CallMethodResult:
        arguments = request.InputArguments or []
        result = ua.CallMethodResult()
        try:
            answer = self._home.answer(request, account, self)
        except Refused as refused:
            result.StatusCode = status(refused.status)
            result.InputArgumentResults = [status(name) for name in refused.arguments]
            return result
        result.InputArgumentResults = [_GOOD for _ in arguments]
        result.OutputArguments = answer
        return result

    # ---- subscriptions ------------------------------------------------------------------------------

    async def create_subscription(
        self, params: Any, callback: Callable[..., Any], request_callback: Callable[..., Any] | None = None
    ) -> ua.CreateSubscriptionResult:
        """A subscription with one of the publishing intervals the control offers."""
        made = await super().create_subscription(snapped(params), callback, request_callback)
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
                results.append(ua.MonitoredItemCreateResult(StatusCode=status(refused)))
                continue
            one = copy.copy(params)
            one.ItemsToCreate = [item]
            results += await super().create_monitored_items(one)
            if item.ItemToMonitor.AttributeId == ua.AttributeIds.EventNotifier:
                self._home.alarms.listened()
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
