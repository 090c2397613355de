"""The mailbox driver: one table backed up, loaded and read back twice, against the same requests by plain pymodbus.

Each against a PLC double in a process of its own; what counts is the processor time of the asking process.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from time import process_time
from typing import Any

import numpy as np
from pymodbus.client import AsyncModbusTcpClient

from benchmarks.report import Report, main
from drivers.clock import LoopClock, run_virtual
from drivers.sinumerik.mailbox.conversation import Heartbeat
from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.sinumerik.mailbox.settings import ModbusSettings
from drivers.sinumerik.mailbox.wire import ModbusWire
from drivers.types.orders import PushOrder, SignProof
from drivers.types.tables import CompensationTable
from simulators.modbus import running_station
from simulators.nck import AxisSpec, Nck, NckSpec

POINTS = 801
RUNS = 3
PATIENCE_S = 1800.0  # what counts is processor time, however little of it a busy computer gives
NAME = "grinder"
Request = tuple[str, int, Any]


class Noted(ModbusWire):
    """The driver's wire, every request noted."""

    def __init__(self, url: str, clock: LoopClock) -> None:
        super().__init__(url, ModbusSettings(), clock, NAME)
        self.requests: list[Request] = []

    async def open(self, timeout_s: float) -> None:
        """Note and connect."""
        self.requests.append(("open", 0, None))
        await super().open(timeout_s)

    async def read(self, address: int, count: int) -> tuple[int, ...]:
        """Note and read."""
        self.requests.append(("read", address, count))
        return await super().read(address, count)

    async def write(self, address: int, values: Any) -> None:
        """Note and write."""
        self.requests.append(("write", address, list(values)))
        await super().write(address, values)

    async def write_one(self, address: int, value: int) -> None:
        """Note and write."""
        self.requests.append(("write", address, [value]))
        await super().write_one(address, value)


def table() -> CompensationTable:
    """Zero where the axis stands."""
    values = np.round(20.0 * np.sin(np.arange(POINTS) * np.pi / 100.0), 3)
    return CompensationTable("axis", "X1", "X1", -200.0, 600.0, 1.0, tuple(map(float, values)))


async def by_driver(url: str) -> tuple[float, list[Request]]:
    """Seconds of a push and its read-backs, and the requests it made."""
    clock = LoopClock()
    device = SinumerikModbus(NAME, url, {}, clock)
    wire = Noted(url, clock)
    device._talk._wire = wire  # noqa: SLF001 - to note the requests
    device._talk._heartbeat = Heartbeat(wire, clock, NAME)  # noqa: SLF001
    await device.open(5.0)
    proof = SignProof(await device.identify(), "axis", "X1", 1.0, 0.01, 1, "2026-01-01T00:00:00+00:00")
    order = PushOrder(17, table(), "X", False, True, 0.0, "table", proof)
    await clock.sleep(1.2)
    await device.state()  # the heartbeat has been seen to move: no waiting for it in what is timed
    before = len(wire.requests)
    start = process_time()
    await device.stage((order,))
    (loaded,) = await device.read_back((order,), PATIENCE_S)
    new = loaded.found
    seconds = process_time() - start
    if new.own.table != order.table:
        raise SystemExit("the table did not arrive")
    requests = wire.requests[before:]
    await device.close()
    return seconds, [("head", 0, wire.requests[:before]), *requests]


async def by_hand(url: str, requests: list[Request]) -> float:
    """Processor seconds of the same requests through pymodbus, in the same order, polls and all."""
    host, _, port = url.removeprefix("tcp://").partition(":")
    client = await _replayed(None, requests[0][2], host, int(port))
    start = process_time()
    client = await _replayed(client, requests[1:], host, int(port))
    seconds = process_time() - start
    client.close()
    return seconds


async def _replayed(client: Any, requests: list[Request], host: str, port: int) -> Any:
    for kind, address, what in requests:
        if kind == "open":
            if client is not None:
                client.close()
            client = AsyncModbusTcpClient(host, port=port, retries=0, reconnect_delay=0)
            await client.connect()
        elif kind == "write":
            await client.write_registers(address, what, device_id=1)
        else:
            await client.read_holding_registers(address, count=what, device_id=1)
    return client


@asynccontextmanager
async def plc(scan_s: float) -> AsyncIterator[str]:
    """The address of a PLC double."""
    clock = LoopClock()
    axes = (AxisSpec("X1", "X", travel=(-300.0, 700.0), eec_points=(POINTS, 0)),)
    nck = Nck(NckSpec(axes=axes), clock)
    await nck.start()
    nck.reference_axis("X1")
    while not nck.axis_state("X1").referenced:
        await clock.sleep(0.05)
    nck.set_mode("AUTO")
    async with running_station(nck, clock, {"scan_s": scan_s, "points_a_scan": POINTS}) as station:
        station.plc.on_session = station.plc.release.give  # a person at the panel
        yield station.url
    await nck.stop()


async def serve(scan_s: float) -> None:
    """A PLC double until standard input ends."""
    async with plc(scan_s) as url:
        sys.stdout.write(url + "\n")
        sys.stdout.flush()
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)


async def together() -> tuple[float, float, int]:
    """Driver, plain client and double in one process: whether it runs."""
    async with plc(0.0) as url:
        driver_s, requests = await by_driver(url)
        return driver_s, await by_hand(url, requests), len(requests) - 1


def once(scan_s: float) -> tuple[float, float, int]:
    """Processor seconds by the driver and by hand, number of requests; the double in a process of its own."""
    command, pipe = [sys.executable, "-m", "benchmarks.mailbox", "--serve", str(scan_s)], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as double:  # noqa: S603 - ourselves
        url = double.stdout.readline().strip() if double.stdout is not None else ""
        driver_s, requests = asyncio.run(by_driver(url))
        hand_s = asyncio.run(by_hand(url, requests))
        double.communicate("")
    return driver_s, hand_s, len(requests) - 1


def measure(report: Report) -> None:
    """All figures of this file."""
    if report.smoke:
        driver_s, hand_s, count = run_virtual(together)
        report.at_most(f"a PLC that answers at once: driver / the same {count} plain requests", driver_s / hand_s, 2.0)
        return
    for scan_s, words in ((0.0, "a PLC that answers at once"), (0.02, "a PLC with a cycle of 20 ms")):
        runs = [once(scan_s) for _ in range(RUNS)]
        driver_s, hand_s = min(run[0] for run in runs), min(run[1] for run in runs)
        report.say(f"{words}: back-up, load and both read-backs of {POINTS} points", driver_s, "s")
        report.at_most(f"{words}: driver / the same {runs[0][2]} plain requests", driver_s / hand_s, 2.0)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--serve"]:
        asyncio.run(serve(float(sys.argv[2])))
    else:
        sys.exit(main(measure, __doc__))
