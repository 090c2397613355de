"""Subscriptions: sampled variables within the server's budget of samples, and alarms as events.

Intervals are revised to those that the control offers. Alarms follow the alarm type of the CNC companion specification.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from asyncua import ua
from asyncua.common.events import Event
from asyncua.server.monitored_item_service import MonitoredItemService
from asyncua.server.subscription_service import SubscriptionService

from drivers.clock import Clock
from drivers.sinumerik.opcua.session import nodes
from simulators.nck import POWER_ON_LOCK, STOPPING, Alarm, Nck
from simulators.opcua.address_space import status_code
from simulators.opcua.quirks import ServerQuirks

OFFERED_MS = (100.0, 250.0, 500.0, 1000.0, 2500.0, 5000.0)
MOST_A_SECOND = 1000.0
_NEVER_MONITORED = frozenset({"BadNodeIdUnknown", "BadUserAccessDenied", "BadAttributeIdInvalid"})
_NUMBERS = frozenset({"Double", "Float", "Int16", "Int32", "UInt16", "UInt32", "Byte"})

Sample = Callable[[ua.ReadValueId], ua.DataValue]


def revised_interval_ms(wanted: float) -> float:
    """The interval the control offers next above the one asked for; its largest if there is none."""
    return next((one for one in OFFERED_MS if one >= wanted), OFFERED_MS[-1])


class SampleBudget:
    """How many samples a second all subscriptions of the server take together."""

    def __init__(self) -> None:
        self._taken: dict[tuple[int, int], float] = {}

    def take(self, item: tuple[int, int], interval_ms: float) -> bool:
        """Whether there is room for one more."""
        if sum(self._taken.values()) + 1000.0 / interval_ms > MOST_A_SECOND:
            return False
        self._taken[item] = 1000.0 / interval_ms
        return True

    def leave(self, item: tuple[int, int]) -> None:
        """An item is gone."""
        self._taken.pop(item, None)


class SampledItems(MonitoredItemService):
    """The items of one subscription; those of our name space are sampled, all others are as asyncua has them.

    ``where``: asyncua's subscription and address space. ``sample`` reads a variable as the session's user sees it now.
    """

    def __init__(
        self,
        where: tuple[Any, Any],
        sample: Sample,
        own: Callable[[ua.NodeId], bool],
        *,
        clock: Clock,
        samples: SampleBudget,
    ) -> None:
        super().__init__(*where)
        self._sample = sample
        self._own = own
        self._clock = clock
        self._samples = samples
        self._due: dict[int, tuple[float, float]] = {}
        self._task: asyncio.Task[None] | None = None

    async def _create_data_change_monitored_item(self, params: Any) -> ua.MonitoredItemCreateResult:
        item = params.ItemToMonitor
        if not self._own(item.NodeId) or item.AttributeId != ua.AttributeIds.Value:
            return await super()._create_data_change_monitored_item(params)
        result, data = self._make_monitored_item_common(params)
        if type(data.filter) is ua.ExtensionObject:
            data.filter = None  # a client that asks for none sends an empty one
        interval_ms = revised_interval_ms(params.RequestedParameters.SamplingInterval)
        result.RevisedSamplingInterval = interval_ms
        number = result.MonitoredItemId
        refused = self._refusal(item, data.filter) or self._no_room(number, interval_ms)
        if refused:
            return ua.MonitoredItemCreateResult(StatusCode=status_code(refused))
        data.callback_handle = handle = -number  # asyncua's own count from 0 upwards
        self._commit_monitored_item(result, data)
        self._monitored_datachange[handle] = number
        self._due[number] = (self._clock.now() + interval_ms / 1000.0, interval_ms / 1000.0)
        await self.trigger_datachange(handle, item.NodeId, item.AttributeId)
        self._watched()
        return result

    def _refusal(self, item: ua.ReadValueId, wanted: Any) -> str:
        now = self._sample(item)
        name = now.StatusCode.name if now.StatusCode is not None else ""
        if name in _NEVER_MONITORED:
            return name
        kind = now.Value.VariantType.name if now.Value is not None else ""
        bounded = wanted is not None and wanted.DeadbandType != ua.DeadbandType.None_
        return "BadFilterNotAllowed" if bounded and kind not in _NUMBERS else ""

    def _no_room(self, number: int, interval_ms: float) -> str:
        room = self._samples.take((self.isub.data.SubscriptionId, number), interval_ms)
        return "" if room else "BadTooManyMonitoredItems"

    async def trigger_datachange(self, handle: int, nodeid: Any, attr: Any) -> None:
        """Look at a variable now and tell what changed."""
        if handle >= 0:
            await super().trigger_datachange(handle, nodeid, attr)
        else:
            await self.datachange_callback(handle, self._sample(ua.ReadValueId(nodeid, attr)))

    def _watched(self) -> None:
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._watch(), name="data changes")

    async def _watch(self) -> None:
        while self._due:
            await self._clock.sleep(max(min(when for when, _ in self._due.values()) - self._clock.now(), 0.0))
            now = self._clock.now()
            for number, (when, every_s) in list(self._due.items()):
                if when > now or number not in self._due:
                    continue
                self._due[number] = (now + every_s, every_s)
                asked = self._monitored_items[number].read_value_id
                if asked is not None:
                    await self.trigger_datachange(-number, asked.NodeId, asked.AttributeId)

    def delete_monitored_items(self, ids: list[int]) -> list[ua.StatusCode]:
        """Forget items; without any, nothing is sampled."""
        for number in ids:
            if self._due.pop(number, None) is not None:
                self._samples.leave((self.isub.data.SubscriptionId, number))
        task = self._task
        if not self._due and task is not None:
            self._task = None
            task.cancel()
        return super().delete_monitored_items(ids)


# Alarms as events of the `Sinumerik` node.

REFRESH = ua.NodeId(ua.ObjectIds.ConditionType_ConditionRefresh)
_LOOK_S = 0.2
_SERVER = ua.NodeId(ua.ObjectIds.Server)


class AlarmEvents:
    """Tells subscribers of alarms that come and go while anybody listens, and of all standing ones on request."""

    def __init__(self, nck: Nck, clock: Clock, subscriptions: SubscriptionService, quirks: ServerQuirks) -> None:
        self._nck = nck
        self._clock = clock
        self._subscriptions = subscriptions
        self._quirks = quirks
        self._task: asyncio.Task[None] | None = None
        self._reported: tuple[Alarm, ...] = ()
        self.name_space = 2

    def start_watching(self) -> None:
        """Somebody has subscribed: watch the alarms from now on."""
        if self._task is None or self._task.done():
            self._reported = self._nck.alarms
            self._task = asyncio.get_running_loop().create_task(self._watch(), name="alarm events")

    async def stop(self) -> None:
        """End the watching."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def refresh(self, subscription: int) -> None:
        """Tell one subscription all alarms standing, between a start and an end event."""
        if self._quirks.mute_events:
            return
        await self._report(self._mark(ua.ObjectIds.RefreshStartEventType), subscription)
        for alarm in self._nck.alarms:
            await self._report(self._event(alarm, standing=True), subscription)
        await self._report(self._mark(ua.ObjectIds.RefreshEndEventType), subscription)

    async def _watch(self) -> None:
        while self._subscriptions.subscriptions:
            await self._clock.sleep(_LOOK_S)
            now, before = self._nck.alarms, self._reported
            self._reported = now
            changes = [(alarm, True) for alarm in now if alarm not in before]
            changes += [(alarm, False) for alarm in before if alarm not in now]
            for alarm, standing in changes:
                if not self._quirks.mute_events:
                    await self._report(self._event(alarm, standing=standing), None)

    async def _report(self, event: Event, subscription: int | None) -> None:
        for node in (ua.NodeId(nodes.ALARM_SOURCE, self.name_space), _SERVER):
            event.emitting_node = node
            await self._subscriptions.trigger_event(event, subscription)

    def _event(self, alarm: Alarm, *, standing: bool) -> Event:
        event = self._bare(ua.NodeId("CncAlarmType", self.name_space), alarm.text, _severity(alarm))
        source = ua.NodeId(nodes.ALARM_SOURCE, self.name_space)
        event.add_property("SourceNode", source, ua.VariantType.NodeId)
        event.add_property("SourceName", nodes.ALARM_SOURCE, ua.VariantType.String)
        event.add_property("NodeId", ua.NodeId(f"Alarm{alarm.number}", self.name_space), ua.VariantType.NodeId)
        event.add_property("ConditionName", str(alarm.number), ua.VariantType.String)
        event.add_property("AlarmIdentifier", str(alarm.number), ua.VariantType.String)
        event.add_property("Retain", standing, ua.VariantType.Boolean)
        event.add_property("ActiveState/Id", standing, ua.VariantType.Boolean)
        return event

    def _mark(self, kind: int) -> Event:
        event = self._bare(ua.NodeId(kind), "", 1)
        event.add_property("SourceNode", _SERVER, ua.VariantType.NodeId)
        event.add_property("SourceName", "Server", ua.VariantType.String)
        return event

    def _bare(self, kind: ua.NodeId, text: str, severity: int) -> Event:
        event = Event()
        now = self._clock.utc()
        for name, value, variant in (
            ("EventId", str(id(event)).encode(), ua.VariantType.ByteString),
            ("EventType", kind, ua.VariantType.NodeId),
            ("Time", now, ua.VariantType.DateTime),
            ("ReceiveTime", now, ua.VariantType.DateTime),
            ("Message", ua.LocalizedText(text), ua.VariantType.LocalizedText),
            ("Severity", severity, ua.VariantType.UInt16),
        ):
            event.add_property(name, value, variant)
        return event


def _severity(alarm: Alarm) -> int:
    """Notice, warning or error."""
    if alarm.clear in STOPPING or alarm.number == POWER_ON_LOCK:
        return 1000
    return 500 if alarm.clear == "cancel" else 1


def revise_publishing(parameters: Any) -> Any:
    """Subscription parameters with the publishing interval the control offers next above the one asked for."""
    return replace(
        parameters, RequestedPublishingInterval=revised_interval_ms(float(parameters.RequestedPublishingInterval))
    )
