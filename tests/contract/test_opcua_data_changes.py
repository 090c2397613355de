"""Data-change subscriptions of the control's OPC UA server, as a client of asyncua meets them."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from asyncua import ua
from asyncua.client.client import Client

from drivers.sinumerik.opcua.session import nodes
from simulators.opcua.quirks import STARTING_STATUSES
from tests.contract.opcua_stage import AXES, SPEC, Stage, on_stage

X, Z, C = AXES
GAPS = replace(SPEC, axes=(X, replace(Z, number=4), replace(C, number=13)), cec_points=(0, 10))


class Heard:
    """What a subscription told, by variable."""

    def __init__(self) -> None:
        self.told: list[tuple[str, Any, str]] = []

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        found = data.monitored_item.Value
        self.told.append((node.nodeid.Identifier, value, found.StatusCode.name))

    def of(self, path: str) -> list[Any]:
        return [value for name, value, _ in self.told if name == path]


class Listener:
    """A client with one subscription."""

    def __init__(self, on: Stage, client: Client, subscription: Any, heard: Heard) -> None:
        self.on = on
        self.client = client
        self.subscription = subscription
        self.heard = heard

    async def listen(self, *paths: str, **how: Any) -> Any:
        """Subscribe to variables by identifier."""
        found = [self.client.get_node(ua.NodeId(path, self.on.server._core.name_space)) for path in paths]
        return await self.subscription.subscribe_data_change(found, **how)

    async def bounded(self, wanted: ua.DataChangeFilter, *paths: str) -> Any:
        """The server's answers to items with a filter."""
        params = ua.CreateMonitoredItemsParameters(SubscriptionId=self.subscription.subscription_id)
        for handle, path in enumerate(paths, start=5000):
            item = ua.ReadValueId(ua.NodeId(path, self.on.server._core.name_space), ua.AttributeIds.Value)
            how = ua.MonitoringParameters(ClientHandle=handle, SamplingInterval=100.0, Filter=wanted, QueueSize=1)
            params.ItemsToCreate.append(ua.MonitoredItemCreateRequest(item, ua.MonitoringMode.Reporting, how))
        return await self.client.uaclient.create_monitored_items(params)

    async def until(self, path: str, *values: Any) -> None:
        """Wait until these values were told, in this order and none else."""
        for _ in range(200):
            if len(self.heard.of(path)) >= len(values):
                break
            await self.on.clock.sleep(0.1)
        assert self.heard.of(path) == list(values)


@contextlib.asynccontextmanager
async def listening(**stage: Any) -> AsyncIterator[Listener]:
    """A listener beside a stage, for the length of a test."""
    async with on_stage(**stage) as on:
        client = Client(on.server.url)
        client.set_user("trueflank")
        client.set_password("trueflank")
        async with client:
            heard = Heard()
            subscription = await client.create_subscription(100, heard)
            try:
                yield Listener(on, client, subscription, heard)
            finally:
                await subscription.delete()


async def test_values_are_told_once_and_again_when_they_change(keys: Path) -> None:
    async with listening(folder=keys) as at:
        path, nck = nodes.r_parameter(10), at.on.nck
        await at.listen(path, "/Bag/State/opMode", nodes.axis_name(1))
        await at.until(path, 0.0)
        await at.until(nodes.axis_name(1), "X1")
        nck.set("R[10]", 4.5, 4)
        await at.until(path, 0.0, 4.5)
        await at.on.clock.sleep(3.0)
        await at.until(path, 0.0, 4.5)
        nck.set("R[10]", -1.0, 4)
        await at.until(path, 0.0, 4.5, -1.0)
        assert len(at.heard.of("/Bag/State/opMode")) == 1


@pytest.mark.parametrize(("null_strings", "empty"), [(False, ""), (True, None)])
async def test_both_kinds_of_empty_texts_are_told(keys: Path, null_strings: bool, empty: str | None) -> None:
    """Axis numbers that are left out have an empty name, and keep their place."""
    async with listening(folder=keys, spec=GAPS, server={"null_strings": null_strings}) as at:
        await at.listen(*(nodes.axis_name(place) for place in (1, 2, 4, 13, 14)))
        await at.until(nodes.axis_name(13), "C1")
        told = [at.heard.of(nodes.axis_name(place)) for place in (1, 2, 4, 13, 14)]
        assert told == [["X1"], [empty], ["Z1"], ["C1"], [empty]]


async def test_what_cannot_be_read_cannot_be_subscribed(keys: Path) -> None:
    async with listening(folder=keys) as at:
        refused = await at.listen("/Channel/MachineAxis/aaStat[u1, 9]", "nowhere")
        assert [one.name for one in refused] == ["BadAttributeIdInvalid", "BadNodeIdUnknown"]
        filtered = ua.DataChangeFilter(DeadbandType=ua.DeadbandType.Absolute, DeadbandValue=1.0)
        bounded = await at.bounded(filtered, nodes.axis_name(1), nodes.r_parameter(7))
        assert [one.StatusCode.name for one in bounded] == ["BadFilterNotAllowed", "Good"]


async def test_who_may_not_read_may_not_listen(keys: Path) -> None:
    users = {"trueflank": {"password": "trueflank", "rights": ["TeaRead", "SeaRead"]}}
    driver = {"users": {**users, "other": "other"}}
    own = {"user": "other", "password": "other"}
    async with listening(folder=keys, server=driver, settings=own) as at:
        refused = await at.listen(nodes.r_parameter(1))
        assert [one.name for one in refused] == ["BadUserAccessDenied"]


async def test_a_control_that_starts_again_tells_it_by_a_bad_status(keys: Path) -> None:
    async with listening(folder=keys) as at:
        path = nodes.r_parameter(3)
        await at.listen(path)
        await at.until(path, 0.0)
        at.on.nck.nck_reset()
        for _ in range(400):
            await at.on.clock.sleep(0.1)
            if len(at.heard.told) > 1 and at.heard.told[-1][2] == "Good":
                break
        first, *starting, last = [status for _, _, status in at.heard.told]
        assert (first, last) == ("Good", "Good")
        assert starting
        assert set(starting) <= set(STARTING_STATUSES["source"])


async def test_no_more_samples_a_second_than_the_control_has(keys: Path) -> None:
    async with listening(folder=keys) as at:
        paths = [nodes.r_parameter(number) for number in range(1, 102)]
        handles = await at.listen(*paths, sampling_interval=100.0)
        refused = [one for one in handles if isinstance(one, ua.StatusCode)]
        assert [one.name for one in refused] == ["BadTooManyMonitoredItems"]
        good = [one for one in handles if not isinstance(one, ua.StatusCode)]
        await at.subscription.unsubscribe(good[:1])
        assert isinstance((await at.listen(paths[-1], sampling_interval=100.0))[0], int)
