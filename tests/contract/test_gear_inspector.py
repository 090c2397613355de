"""A gear inspection machine behind the bridge: every point of a plan comes back once, or the plan is stopped."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from drivers import registry
from drivers.bridge import gear, records
from drivers.bridge.codec import BridgeCodec, BridgeMessage, BridgeRefusal, Notification, Reply, Request
from drivers.bridge.gear import PointChunk, expected_points
from drivers.bridge.records import BridgeIdentity
from drivers.clock import LoopClock
from drivers.errors import DeviceRefused, RemoteProtocolError, TransportError, TrueflankError, UnsupportedDevice
from drivers.ports.instruments import AmbientSensor, GearInspector
from drivers.transport import ByteTransport, serve
from drivers.types.gears import GearPlan

PLAN = GearPlan(9, (0, 4), ("left", "right"), 5, 12.0, 4, (2.0, 20.0), pitch=True, runout_ball_mm=3.0)
CHUNK = 3


class ScriptedMachine:
    """Answers with points whose place says which they are; what is sent can be bent."""

    def __init__(self) -> None:
        self.kind = "gear"
        self.clamped = True
        self.asked: list[tuple[str, Any]] = []
        self.deviations = False
        self.stop_after = 10**9
        self.outcome = "complete"
        self.bend: Callable[[dict[str, Any]], dict[str, Any] | None] = lambda chunk: chunk
        self.plans = 0

    async def converse(self, wire: ByteTransport) -> None:
        codec, work = BridgeCodec("server"), set()
        try:
            while True:
                for message in codec.receive(await wire.read(4096)):
                    assert isinstance(message, Request)
                    self.asked.append((message.method, dict(message.params)))
                    await wire.write(codec.send(self.answer(message)))
                    if message.method == gear.MEASURE:
                        work.add(asyncio.create_task(self.measure(wire, codec, message.params)))
                    elif message.method == gear.ABORT:
                        for task in work:
                            task.cancel()
        finally:
            for task in work:
                task.cancel()
            await asyncio.gather(*work, return_exceptions=True)

    def answer(self, message: Request) -> BridgeMessage:
        match message.method:
            case records.IDENTIFY:
                who = BridgeIdentity(self.kind, "Example", "GM-1", "G7", "1.0", (), 0.0)  # type: ignore[arg-type]
                return Reply(message.id, who.as_object())
            case gear.PART:
                return Reply(message.id, {"clamped": self.clamped, "part": "D-17", "clamping": "arbor 12 mm"})
            case gear.MEASURE:
                self.plans += 1
                return Reply(message.id, {"plan": self.plans})
            case gear.ABORT:
                return Reply(message.id, {})
        return BridgeRefusal(message.id, records.METHOD_NOT_FOUND, "no")

    def lines(self, asked: Any) -> list[tuple[str, int, str, int]]:
        found = []
        for space in asked["spaces"]:
            for flank in asked["flanks"]:
                found.append(("profile", space, flank, asked["profile"]["points"]))
                found.append(("lead", space, flank, asked["lead"]["points"]))
        found += [("pitch", space, flank, 1) for space in range(asked["space_count"]) for flank in ("left", "right")]
        return found + [("runout", space, "", 1) for space in range(asked["space_count"])]

    async def measure(self, wire: ByteTransport, codec: BridgeCodec, asked: Any) -> None:
        number, first = self.plans, 0
        for trace, space, flank, count in self.lines(asked):
            for start in range(0, count, CHUNK):
                if first >= self.stop_after:
                    return
                size = min(CHUNK, count - start)
                at = [float(first + step) for step in range(size)]
                chunk: dict[str, Any] = {"plan": number, "first": first, "trace": trace, "space": space}
                chunk |= {"x_mm": at, "y_mm": [space * 1.0] * size, "z_mm": [0.5] * size}
                chunk |= {"flank": flank} if flank else {}
                chunk |= {"deviation_um": [-2.0] * size} if self.deviations else {}
                bent = self.bend(chunk)
                if bent is not None:
                    await wire.write(codec.send(Notification(gear.POINTS, bent)))
                first += size
        ending = {"plan": number, "outcome": self.outcome, "points": first, "said": "door opened", "probe_u_um": 0.4}
        await wire.write(codec.send(Notification(gear.DONE, ending)))


@asynccontextmanager
async def bench(**settings: Any) -> AsyncIterator[tuple[ScriptedMachine, Any]]:
    clock, machine = LoopClock(), ScriptedMachine()
    listener = await serve("memory://gear", machine.converse, clock)
    device = registry.load("bridge-gear", "gear-inspector")("inspector", listener.url, settings, clock)
    try:
        yield machine, device
    finally:
        await device.close()
        await listener.close()


def quiet(_trace: str, _done: int, _total: int) -> None:
    return None


async def test_every_point_comes_once_with_its_space_flank_and_line() -> None:
    async with bench() as (machine, device):
        assert isinstance(device, GearInspector)
        assert isinstance(device, AmbientSensor)
        assert (await device.open(5.0)).serial == "G7"
        heard: list[tuple[str, int, int]] = []
        found = await device.inspect(PLAN, lambda *told: heard.append(told))
        flanks = found.inspection
        assert expected_points(PLAN) == 2 * 2 * 9 + 18 + 9
        assert len(flanks) == 54
        assert flanks.points_mm[:, 0].tolist() == list(range(54))
        assert flanks.space.tolist() == flanks.points_mm[:, 1].tolist()
        assert set(flanks.flank.tolist()) == {1, -1}
        assert [found.trace.count(name) for name in ("profile", "lead", "pitch", "runout")] == [20, 16, 18, 0]
        assert found.ball_space.tolist() == list(range(9))
        assert found.balls_mm.shape == (9, 3)
        assert (found.part.clamping, flanks.probe_u_um, flanks.deviation_um) == ("arbor 12 mm", 0.4, None)
        assert heard[-1] == ("runout", 63, 63)
        assert [done for _trace, done, _total in heard] == sorted(done for _trace, done, _total in heard)
        assert (await device.ambient()).air_degc is None
        assert machine.asked[2] == (gear.MEASURE, gear.plan_as_object(PLAN))


async def test_deviations_come_beside_their_nominal_points() -> None:
    async with bench() as (machine, device):
        machine.deviations = True
        await device.open(5.0)
        found = (await device.inspect(PLAN, quiet)).inspection
        assert found.deviation_um is not None
        assert np.array_equal(found.deviation_um, np.full(54, -2.0))


async def test_without_a_part_nothing_starts() -> None:
    async with bench() as (machine, device):
        machine.clamped = False
        await device.open(5.0)
        with pytest.raises(DeviceRefused, match="E-GEAR-CLAMP"):
            await device.inspect(PLAN, quiet)
        assert machine.plans == 0


@pytest.mark.parametrize("outcome", ["aborted", "failed"])
async def test_a_plan_that_was_stopped_gives_no_points(outcome: str) -> None:
    async with bench() as (machine, device):
        machine.outcome = outcome
        await device.open(5.0)
        with pytest.raises(DeviceRefused, match="door opened") as caught:
            await device.inspect(PLAN, quiet)
        assert caught.value.code == "E-GEAR-ENDED"
        machine.outcome = "complete"
        assert len((await device.inspect(PLAN, quiet)).inspection) == 54


def changed(**members: Any) -> Callable[[dict[str, Any]], dict[str, Any] | None]:
    return lambda chunk: {**chunk, **members} if chunk["first"] == 5 else chunk


@pytest.mark.parametrize(
    ("bend", "field"),
    [
        (lambda chunk: None if chunk["first"] == 5 else chunk, "first"),
        (changed(first=3), "first"),
        (changed(space=9), "space"),
        (changed(flank="up"), "flank"),
        (changed(flank=""), "flank"),
        (changed(trace="tip"), "trace"),
        (changed(x_mm=[1.0]), "x_mm"),
        (changed(z_mm=["a", "b", "c"]), "z_mm"),
        (changed(deviation_um=[1.0, 1.0, 1.0]), "deviation_um"),
        (changed(x_mm=[], y_mm=[], z_mm=[]), "x_mm"),
    ],
)
async def test_points_that_are_missing_or_wrong_end_the_plan_at_the_machine(bend: Any, field: str) -> None:
    async with bench() as (machine, device):
        machine.bend = bend
        await device.open(5.0)
        with pytest.raises(RemoteProtocolError) as caught:
            await device.inspect(PLAN, quiet)
        assert caught.value.fields["field"] == field


async def test_who_gives_up_stops_the_machine() -> None:
    async with bench() as (machine, device):
        machine.stop_after = 12
        await device.open(5.0)
        measuring = asyncio.create_task(device.inspect(PLAN, quiet))
        await LoopClock().sleep(1.0)
        measuring.cancel()
        with pytest.raises(asyncio.CancelledError):
            await measuring
        assert machine.asked[-1][0] == gear.ABORT


async def test_a_machine_that_falls_silent_is_not_waited_for() -> None:
    async with bench(gear_quiet_s=30.0) as (machine, device):
        machine.stop_after = 12
        await device.open(5.0)
        with pytest.raises(TransportError, match="E-LINK-STALE"):
            await device.inspect(PLAN, quiet)
        assert machine.asked[-1][0] == gear.ABORT
        machine.stop_after = 10**9
        assert len((await device.inspect(PLAN, quiet)).inspection) == 54


async def test_another_kind_is_refused() -> None:
    async with bench() as (machine, device):
        machine.kind = "environment"
        with pytest.raises(UnsupportedDevice, match="E-BRIDGE-KIND"):
            await device.open(5.0)


def test_a_chunk_that_names_nothing_is_refused() -> None:
    with pytest.raises(TrueflankError):
        PointChunk.read({}, "x")
