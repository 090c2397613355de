"""The answerers on memory wires in virtual time: lines, requests, faults, and instruments seen through them."""

from __future__ import annotations

import contextlib
import json
from collections.abc import AsyncIterator
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import TransportError
from drivers.transport import ByteTransport, open_transport
from drivers.umd.codec import CODE, DATA, DISPLACEMENT, SEQUENCE, VELOCITY, UmdCodec
from simulators.bridge import BridgeServer
from simulators.cellfile import CellFile
from simulators.faults import FaultPlan
from simulators.optics import LaserCounter, OpticsBench, RotaryReader
from simulators.truth import Truth
from simulators.umd import UmdServer
from tests.unit.simulators.motion import Motion, plain_cell

JOG = Motion(X1=[(0.0, 0.0), (2.0, 0.0), (3.0, 10.0)], C1=[(0.0, 0.0), (2.0, 0.0), (3.0, 0.1)])
CLIMATE = {"air_degc": {"start": 22.34}, "pressure_hpa": {"start": 991.5}, "material_degc": {"start": 21.7}}


def bench_of(motion: Motion = JOG) -> OpticsBench:
    bench = OpticsBench(Truth(CellFile.model_validate(plain_cell(climate=CLIMATE))), motion)
    for component in ("EXX", "ECC"):
        setup = bench.setup_for(component, component[2])
        assert setup is not None
        bench.mount(setup)
    return bench


@contextlib.asynccontextmanager
async def umd(plan: FaultPlan | None = None) -> AsyncIterator[tuple[UmdServer, ByteTransport, LoopClock]]:
    bench, clock = bench_of(), LoopClock()
    counter = LaserCounter(bench.cell.instruments[0], bench)
    answerer = UmdServer(counter, bench, clock, 0.1, plan.around if plan else None)
    wire = await open_transport(await answerer.start("memory://umd-test"), clock, 1.0)
    try:
        yield answerer, wire, clock
    finally:
        await wire.close()
        await answerer.stop()


async def rows_until(wire: ByteTransport, count: int) -> np.ndarray:
    codec, rows = UmdCodec("client"), np.empty((0, 8), np.int64)
    while len(rows) < count:
        for lines in codec.receive(await wire.read(65536)):
            rows = np.concatenate((rows, lines.rows))
    return rows


async def test_the_counter_streams_every_sample_once() -> None:
    async with umd() as (answerer, wire, _clock):
        rows = await rows_until(wire, 4000)
        assert np.all(np.diff(rows[:, SEQUENCE]) == 1)
        column = rows[:, DISPLACEMENT[0]]
        np.testing.assert_array_equal(np.diff(column), rows[1:, VELOCITY[0]])
        assert column[-1] * answerer.counter.count_mm == pytest.approx(10.0 * 1.00026, abs=1e-3)


async def test_the_slow_values_say_what_the_counter_is() -> None:
    async with umd() as (_answerer, wire, _clock):
        rows = await rows_until(wire, 64)
        slow = dict(zip(rows[:, CODE].tolist(), rows[:, DATA].tolist(), strict=True))
        assert slow[8] == 100_000
        assert slow[20] == 16 * 256 + 1
        assert (slow[3], slow[4], slow[5]) == (2234, 2170, 99150)


async def test_a_pulled_line_ends_the_stream_and_can_be_put_back() -> None:
    async with umd() as (answerer, wire, clock):
        await rows_until(wire, 10)
        await answerer.pull()
        with pytest.raises(TransportError):
            await rows_until(wire, 100_000)
        with pytest.raises(TransportError):
            await open_transport("memory://umd-test", clock, 1.0)
        again = await open_transport(await answerer.plug("memory://umd-test"), clock, 1.0)
        assert len(await rows_until(again, 10)) >= 10
        await again.close()


def test_a_fault_plan_is_the_same_for_the_same_seed() -> None:
    async def bytes_of(seed: int) -> bytes:
        plan = FaultPlan(seed=seed, split=0.5, flip=0.3, lose=0.2, garbage=0.2)
        async with umd(plan) as (_answerer, wire, _clock):
            received = b""
            while len(received) < 100_000:
                received += await wire.read(65536)
            return received[:100_000]

    received = [run_virtual(lambda seed=seed: bytes_of(seed)) for seed in (1, 1, 2)]
    assert received[0] == received[1] != received[2]


async def test_a_fault_plan_can_cut_the_wire() -> None:
    async with umd(FaultPlan(cut_after=50_000)) as (_answerer, wire, _clock):
        with pytest.raises(TransportError):
            await rows_until(wire, 1_000_000)


class Client:
    """A bridge client of a few lines: requests by name, notifications kept."""

    def __init__(self, wire: ByteTransport) -> None:
        self.wire = wire
        self.pending = b""
        self.samples: list[dict[str, Any]] = []
        self.number = 0

    async def objects(self) -> list[dict[str, Any]]:
        *lines, self.pending = (self.pending + await self.wire.read(65536)).split(b"\n")
        return [json.loads(line) for line in lines]

    async def ask(self, method: str, **params: Any) -> dict[str, Any]:
        self.number += 1
        question = {"jsonrpc": "2.0", "id": self.number, "method": method, "params": params}
        await self.wire.write(json.dumps(question).encode() + b"\n")
        while True:
            for found in await self.objects():
                if found.get("id") == self.number:
                    return found
                self.samples.append(found["params"])

    async def listen(self, until_s: float) -> None:
        while not self.samples or self.samples[-1]["t0_s"] < until_s:
            self.samples += [found["params"] for found in await self.objects()]

    def last(self, channel: str) -> float:
        return float(self.samples[-1]["values"][channel][-1])


@contextlib.asynccontextmanager
async def bridge(motion: Motion = JOG) -> AsyncIterator[tuple[BridgeServer, Client, LoopClock]]:
    bench, clock = bench_of(motion), LoopClock()
    reader = RotaryReader(bench.cell.instruments[1], bench)
    answerer = BridgeServer(reader, bench, clock, 0.1)
    wire = await open_transport(await answerer.start("memory://bridge-test"), clock, 1.0)
    try:
        yield answerer, Client(wire), clock
    finally:
        await wire.close()
        await answerer.stop()


async def test_the_calibrator_proves_its_sense_over_the_bridge() -> None:
    async with bridge() as (_answerer, client, clock):
        identity = (await client.ask("bridge.identify"))["result"]
        assert identity["channels"] == ["device_deg", "laser_deg"]
        await client.ask("stream.start")
        await client.ask("calibrator.hold")
        await client.listen(clock.now() + 4.0)
        assert client.last("laser_deg") == pytest.approx(0.1, abs=1e-8)
        assert client.last("device_deg") == 0.0
        assert (await client.ask("calibrator.turn", by_deg=-0.1))["result"] == {}
        await client.listen(clock.now())
        assert client.last("laser_deg") == pytest.approx(0.0, abs=1e-8)
        assert client.last("device_deg") == pytest.approx(-0.1, abs=1e-8)
        numbers = [sample["sequence"] for sample in client.samples]
        lengths = [len(sample["values"]["laser_deg"]) for sample in client.samples]
        assert numbers == [int(n) for n in np.cumsum([0, *lengths[:-1]])]


@pytest.mark.parametrize(
    ("method", "params", "code"),
    [
        ("calibrator.jump", {}, -32601),
        ("calibrator.turn", {}, -32602),
        ("calibrator.turn", {"by_deg": "x"}, -32602),
        ("calibrator.turn", {"by_deg": 1e9}, -32602),
    ],
)
async def test_the_calibrator_refuses_what_it_does_not_know(method: str, params: dict[str, Any], code: int) -> None:
    async with bridge() as (_answerer, client, _clock):
        assert (await client.ask(method, **params))["error"]["code"] == code


async def test_a_second_client_is_told_that_the_calibrator_is_busy() -> None:
    async with bridge() as (_answerer, client, clock):
        await client.ask("bridge.identify")
        wire = await open_transport("memory://bridge-test", clock, 1.0)
        assert (await Client(wire).ask("bridge.identify"))["error"]["code"] == -32001
        await wire.close()


async def test_a_lost_beam_is_marked_until_the_next_datum() -> None:
    async with bridge() as (answerer, client, clock):
        await client.ask("stream.start")
        answerer._bench.broken.add("calibrator")
        await client.listen(clock.now() + 0.5)
        assert client.samples[-1]["valid"][-1] is False
        kinds = [event["kind"] for sample in client.samples for event in sample.get("events", [])]
        assert kinds == ["beam_obstructed"]
        assert (await client.ask("stream.datum"))["error"]["code"] == -32002
        answerer._bench.broken.clear()
        await client.listen(clock.now() + 0.5)
        assert client.samples[-1]["valid"][-1] is False
        await client.ask("stream.datum")
        await client.listen(clock.now() + 0.5)
        assert "valid" not in client.samples[-1]


async def test_no_reference_no_stream() -> None:
    async with bridge() as (answerer, client, _clock):
        answerer.referenced = False
        assert (await client.ask("stream.start"))["error"]["code"] == -32003
        answerer.referenced, answerer.battery_pct = True, 3.0
        assert (await client.ask("stream.start"))["error"]["code"] == -32005
