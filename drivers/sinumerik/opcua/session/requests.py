"""OPC UA services one by one, with the library's own types: what `client` asks and how answers are read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from asyncua import ua
from asyncua.ua.ua_binary import struct_from_binary

from drivers.message import Message
from drivers.sinumerik.opcua.session import nodes as typed_values

CURRENT_TIME = ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime)
CLOCK = Message.of("W-UA-CLOCK")
SOFTWARE_VERSION = ua.NodeId(ua.ObjectIds.Server_ServerStatus_BuildInfo_SoftwareVersion)
VERSION = Message.of("W-UA-VERSION")
SERVER_STATE = ua.NodeId(ua.ObjectIds.Server_ServerStatus_State)
_LIMITS = (
    ua.NodeId(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerRead),
    ua.NodeId(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerWrite),
)
_REFRESH = (ua.NodeId(ua.ObjectIds.ConditionType), ua.NodeId(ua.ObjectIds.ConditionType_ConditionRefresh))
_CONDITION = ua.NodeId(ua.ObjectIds.ConditionType)
_EVENT = ua.NodeId(ua.ObjectIds.BaseEventType)
_REFRESH_END = ua.NodeId(ua.ObjectIds.RefreshEndEventType)
_MARKS = (ua.NodeId(ua.ObjectIds.RefreshStartEventType), ua.NodeId(ua.ObjectIds.RefreshRequiredEventType))
_FIELDS = ("EventType", "Message", "Severity", "Retain", "ConditionName")
_INTERVAL_MS = 100.0
_MOST_ANSWERS = 40
ANY = 65535


@dataclass(frozen=True, slots=True)
class Reading:
    """One value read: ``status`` is "" when it is good; ``kind`` its wire type; ``age_s`` by the server's clock.

    The age is how long ago the server last knew the value to be so; None where it gives no time stamp.
    """

    path: str
    value: Any
    status: str = ""
    kind: str = ""
    age_s: float | None = None


@dataclass(frozen=True, slots=True)
class ServerLimits:
    """How many nodes one request may name."""

    read: int = ANY
    write: int = ANY

    def within(self, most: int) -> ServerLimits:
        """Neither more than these nor than ``most``."""
        return ServerLimits(min(self.read, most), min(self.write, most))


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """An alarm as the server reports it by an event."""

    number: int
    text: str
    severity: int
    standing: bool


async def read_values(client: Any, wanted: Sequence[Any], most: int, *, timed: bool = False) -> list[Any]:
    """Data values of nodes, in as many requests as the server's limit asks for; never from its cache."""
    found: list[Any] = []
    for start in range(0, len(wanted), most):
        parameters = ua.ReadParameters()
        parameters.MaxAge = 0.0
        parameters.TimestampsToReturn = ua.TimestampsToReturn.Server if timed else ua.TimestampsToReturn.Neither
        parameters.NodesToRead = [attribute(node) for node in wanted[start : start + most]]
        found += await client.uaclient.session.read(parameters)
    return found


async def keep_alive(client: Any) -> list[Any]:
    """The server's state, asked for so that it keeps the session."""
    return await read_values(client, [SERVER_STATE], 1)


def attribute(node: Any, number: ua.AttributeIds = ua.AttributeIds.Value) -> Any:
    """The question for one attribute of a node."""
    item = ua.ReadValueId()
    item.NodeId = node
    item.AttributeId = number
    return item


async def user_may_write(client: Any, node: Any) -> bool | None:
    """By the node's UserAccessLevel; None when it has none."""
    parameters = ua.ReadParameters()
    parameters.NodesToRead = [attribute(node, ua.AttributeIds.UserAccessLevel)]
    (found,) = await client.uaclient.session.read(parameters)
    if not _good(found) or found.Value is None or found.Value.Value is None:
        return None
    return bool(int(found.Value.Value) & ua.AccessLevel.CurrentWrite.mask)


async def write_values(client: Any, items: Sequence[Any], most: int) -> list[Any]:
    """A status for each item. A later part that is refused as a whole counts as refused one by one."""
    found: list[Any] = []
    for start in range(0, len(items), most):
        parameters = ua.WriteParameters()
        parameters.NodesToWrite = list(items[start : start + most])
        try:
            found += await client.uaclient.session.write(parameters)
        except ua.UaStatusCodeError as error:
            if not start:
                raise
            return [*found, *(ua.StatusCode(error.code) for _ in items[start:])]
    return found


def typed_value(node: Any, value: Any, kind: str, stamp: datetime | None = None) -> Any:
    """A value to write: typed, without time stamps unless one is given."""
    item = ua.WriteValue()
    item.NodeId = node
    item.AttributeId = ua.AttributeIds.Value
    item.Value = ua.DataValue(ua.Variant(value, ua.VariantType[kind]), SourceTimestamp=stamp)
    return item


async def call_method(client: Any, owner: Any, method: Any, arguments: Sequence[tuple[Any, str]]) -> Any:
    """The answer to one method call."""
    request = ua.CallMethodRequest()
    request.ObjectId, request.MethodId = owner, method
    request.InputArguments = [ua.Variant(value, ua.VariantType[kind]) for value, kind in arguments]
    return (await client.uaclient.session.call([request]))[0]


def shown_arguments(arguments: Sequence[tuple[Any, str]]) -> str:
    """Arguments as an error may name them: texts and numbers, no contents."""
    return " ".join(str(value) for value, kind in arguments if kind in ("String", "Int32"))


def refused_arguments(result: Any) -> str:
    """Which arguments of a call the server names as wrong, and why; "" where it names none."""
    statuses = [status_name(status) for status in result.InputArgumentResults or []]
    told = [f"argument {place}: {name}" for place, name in enumerate(statuses, start=1) if name != "Good"]
    return f" ({', '.join(told)})" if told else ""


async def browse_methods(client: Any, parent: Any) -> dict[str, Any]:
    """Methods directly under an object, by browse name; empty when there is no such object."""
    wanted = ua.BrowseDescription()
    wanted.NodeId = parent
    wanted.BrowseDirection = ua.BrowseDirection.Forward
    wanted.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HierarchicalReferences)
    wanted.IncludeSubtypes = True
    wanted.NodeClassMask = int(ua.NodeClass.Method)
    wanted.ResultMask = int(ua.BrowseResultMask.All)
    parameters = ua.BrowseParameters()
    parameters.NodesToBrowse = [wanted]
    result = (await client.uaclient.session.browse(parameters))[0]
    found = list(result.References or []) if result.StatusCode.is_good() else []
    return {one.BrowseName.Name: one.NodeId for one in found}


async def read_limits(client: Any) -> ServerLimits:
    """What the server says it takes in one request; no limit where it says nothing."""
    found = await read_values(client, _LIMITS, 1)
    read, write_ = (int(one.Value.Value or 0) if _good(one) and one.Value is not None else 0 for one in found)
    return ServerLimits(read or ANY, write_ or ANY)


def to_readings(paths: Sequence[str], found: Sequence[Any], where: str, now: datetime | None = None) -> list[Reading]:
    """Data values as records, the values as they came. Raises RemoteProtocolError (E-UA-VALUE) for a wrong time."""
    return [_reading(path, value, where, now) for path, value in zip(paths, found, strict=True)]


def _reading(path: str, value: Any, where: str, now: datetime | None) -> Reading:
    """Anything but plain "good" is a status: uncertain values do not count."""
    status = value.StatusCode
    if status is not None and status.value != ua.StatusCodes.Good:
        return Reading(path, None, status_name(status))
    known = typed_values.check_time(value.ServerTimestamp, Message.of("W-UA-TIME-OF", path=path), where)
    age = max((now - known).total_seconds(), 0.0) if now is not None and known is not None else None
    if value.Value is None:
        return Reading(path, None, age_s=age)
    return Reading(path=path, value=value.Value.Value, status="", kind=value.Value.VariantType.name, age_s=age)


def status_name(status: Any) -> str:
    """A status by its name; the library calls "Good" what it does not know of the good ones."""
    known = status.name != "Good" or status.value == ua.StatusCodes.Good
    return code_name(status.value) if known else f"Good {status.value:#010x}"


def code_name(code: int) -> str:
    """The name of a status code; the low half tells more about a value and is no part of the name."""
    return str(ua.StatusCode(code & 0xFFFF0000).name)


def checked_readings(found: Sequence[Reading], where: str) -> list[Reading]:
    """Readings whose good values are what their variables can hold. Raises RemoteProtocolError (E-UA-VALUE)."""
    return [
        one if one.status else replace(one, value=typed_values.check_value(one.path, one.value, where)) for one in found
    ]


def time_of(value: Any, where: str) -> datetime | None:
    """The server's clock, UTC and naive; None when it has none. Raises RemoteProtocolError (E-UA-VALUE)."""
    return typed_values.check_time(value.Value.Value if value.Value is not None else None, CLOCK, where)


def text_of(value: Any) -> str:
    """A text as a server gives it; "" where it gives none."""
    known = _good(value) and value.Value is not None and isinstance(value.Value.Value, str)
    return str(value.Value.Value) if known else ""


def _good(value: Any) -> bool:
    return value.StatusCode is None or value.StatusCode.is_good()


# ---- alarms by events ---------------------------------------------------------------------------------


async def subscribe_standing_alarms(client: Any, source: Any, spaces: Sequence[int]) -> list[AlarmEvent] | None:
    """Subscribe to a source's events, ask for all standing conditions, unsubscribe.

    ``spaces`` are the name spaces in which an alarm's identifier is looked for.

    None when the server did not end the refresh in time. Nothing is left subscribed: a subscription that
    dies in silence cannot deceive anybody. Raises the library's errors.
    """
    number = await _subscribe(client)
    try:
        result = (await client.uaclient.session.create_monitored_items(_event_items(number, source, spaces)))[0]
        result.StatusCode.check()
        answer = await call_method(client, *_REFRESH, [(number, "UInt32")])
        answer.StatusCode.check()
        return await _until_refreshed(client, number)
    finally:
        await client.uaclient.session.delete_subscriptions([number])


async def _subscribe(client: Any) -> int:
    request = ua.CreateSubscriptionRequest()
    request.Parameters.RequestedPublishingInterval = _INTERVAL_MS
    request.Parameters.RequestedLifetimeCount = 600
    request.Parameters.RequestedMaxKeepAliveCount = 2  # so that every question to publish is answered soon
    request.Parameters.MaxNotificationsPerPublish = 0
    request.Parameters.PublishingEnabled = True
    # The library's own call would start asking to publish in the background, beside our one request at a time.
    data = await client.uaclient.protocol.send_request(request)
    response = struct_from_binary(ua.CreateSubscriptionResponse, data)
    response.ResponseHeader.ServiceResult.check()
    return int(response.Parameters.SubscriptionId)


def _clause(name: str, space: int) -> Any:
    clause = ua.SimpleAttributeOperand()
    clause.TypeDefinitionId = _CONDITION if name in _FIELDS[3:] else _EVENT
    clause.BrowsePath = [ua.QualifiedName(name, space)]
    clause.AttributeId = ua.AttributeIds.Value
    return clause


def _event_items(subscription: int, source: Any, spaces: Sequence[int]) -> Any:
    events = ua.EventFilter()
    events.SelectClauses = [_clause(name, 0) for name in _FIELDS]
    events.SelectClauses += [_clause("AlarmIdentifier", space) for space in spaces]
    item = ua.MonitoredItemCreateRequest()
    item.ItemToMonitor = attribute(source, ua.AttributeIds.EventNotifier)
    item.MonitoringMode = ua.MonitoringMode.Reporting
    item.RequestedParameters.ClientHandle = 1
    item.RequestedParameters.QueueSize = 1000
    item.RequestedParameters.Filter = events
    parameters = ua.CreateMonitoredItemsParameters()
    parameters.SubscriptionId = subscription
    parameters.TimestampsToReturn = ua.TimestampsToReturn.Neither
    parameters.ItemsToCreate = [item]
    return parameters


async def _until_refreshed(client: Any, subscription: int) -> list[AlarmEvent] | None:
    found: list[AlarmEvent] = []
    acknowledge: list[Any] = []
    for _ in range(_MOST_ANSWERS):
        published = (await client.uaclient.session.publish(acknowledge)).Parameters
        acknowledge = []
        for data in published.NotificationMessage.NotificationData or []:
            acknowledge = [_acknowledgement(subscription, published.NotificationMessage.SequenceNumber)]
            for event in getattr(data, "Events", None) or []:
                kind, *rest = (field.Value for field in event.EventFields)
                if kind == _REFRESH_END:
                    return found
                if kind not in _MARKS:
                    found.append(_alarm(rest))
    return None


def _acknowledgement(subscription: int, number: int) -> Any:
    made = ua.SubscriptionAcknowledgement()
    made.SubscriptionId, made.SequenceNumber = subscription, number
    return made


def _alarm(fields: list[Any]) -> AlarmEvent:
    message, severity, retain, *names = fields
    text = getattr(message, "Text", message) or ""
    digits = next((str(name) for name in reversed(names) if str(name or "").isdigit()), "")
    return AlarmEvent(int(digits or 0), str(text), int(severity or 0), bool(retain))
