"""Alarms of the control as events of the `Sinumerik` node, in the manner of the CNC companion's alarm type."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from typing import Any

from asyncua import ua
from asyncua.common.events import Event
from asyncua.server.subscription_service import SubscriptionService

from drivers.clock import Clock
from drivers.sinumerik.opcua.session import nodes
from simulators.nck.control import Nck
from simulators.nck.machine.alarms import POWER_ON_LOCK, STOPPING, Alarm
from simulators.opcua.manners import Manners
from simulators.opcua.samples import offered_ms

REFRESH = ua.NodeId(ua.ObjectIds.ConditionType_ConditionRefresh)
_LOOK_S = 0.2
_SERVER = ua.NodeId(ua.ObjectIds.Server)


class AlarmEvents:
    """Tells subscribers of alarms that come and go while anybody listens, and of all standing ones on request."""

    def __init__(self, nck: Nck, clock: Clock, subscriptions: SubscriptionService, manners: Manners) -> None:
        self._nck = nck
        self._clock = clock
        self._subscriptions = subscriptions
        self._manners = manners
        self._task: asyncio.Task[None] | None = None
        self._told: tuple[Alarm, ...] = ()
        self.name_space = 2

    def listened(self) -> None:
        """Somebody has subscribed: watch the alarms from now on."""
        if self._task is None or self._task.done():
            self._told = self._nck.alarms
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
        if self._manners.mute_events:
            return
        await self._tell(self._mark(ua.ObjectIds.RefreshStartEventType), subscription)
        for alarm in self._nck.alarms:
            await self._tell(self._event(alarm, standing=True), subscription)
        await self._tell(self._mark(ua.ObjectIds.RefreshEndEventType), subscription)

    async def _watch(self) -> None:
        while self._subscriptions.subscriptions:
            await self._clock.sleep(_LOOK_S)
            now, before = self._nck.alarms, self._told
            self._told = now
            changes = [(alarm, True) for alarm in now if alarm not in before]
            changes += [(alarm, False) for alarm in before if alarm not in now]
            for alarm, standing in changes:
                if not self._manners.mute_events:
                    await self._tell(self._event(alarm, standing=standing), None)

    async def _tell(self, event: Event, subscription: int | None) -> None:
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


def snapped(parameters: Any) -> Any:
    """Subscription parameters with the publishing interval the control offers next above the one asked for."""
    return replace(parameters, RequestedPublishingInterval=offered_ms(float(parameters.RequestedPublishingInterval)))
