"""Data changes of the control's variables: sampled at the intervals it offers, within the samples a second it has."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from asyncua import ua
from asyncua.server.monitored_item_service import MonitoredItemService

from drivers.clock import Clock
from simulators.opcua.standard import status

OFFERED_MS = (100.0, 250.0, 500.0, 1000.0, 2500.0, 5000.0)
MOST_A_SECOND = 1000.0
_NEVER_MONITORED = frozenset({"BadNodeIdUnknown", "BadUserAccessDenied", "BadAttributeIdInvalid"})
_NUMBERS = frozenset({"Double", "Float", "Int16", "Int32", "UInt16", "UInt32", "Byte"})

Sample = Callable[[ua.ReadValueId], ua.DataValue]


def offered_ms(wanted: float) -> float:
    """The interval the control offers next above the one asked for; its largest if there is none."""
    return next((one for one in OFFERED_MS if one >= wanted), OFFERED_MS[-1])


class Samples:
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
        samples: Samples,
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
        interval_ms = offered_ms(params.RequestedParameters.SamplingInterval)
        result.RevisedSamplingInterval = interval_ms
        number = result.MonitoredItemId
        refused = self._refusal(item, data.filter) or self._no_room(number, interval_ms)
        if refused:
            return ua.MonitoredItemCreateResult(StatusCode=status(refused))
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
