"""A push of one table over OPC UA: the gateway's own processor time against as many bare requests, and its journal.

Own time is what the gateway's process works: requests, files both ways, comparisons, journal. The control and its
server stand in a process of their own, fifty times as fast as in life; pauses and answers waited for do not count.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from asyncua import Client, ua
from asyncua.client.ua_client import UASocketProtocol

from benchmarks.report import Report, main
from drivers.clock import LoopClock, run_virtual
from drivers.programs import SelfTested
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.types.moves import SafePlaces
from drivers.types.orders import SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable, LiveSet
from gateway.axes import AxisRecord
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.push import PushContext, journal, push_table
from simulators.cell.control import CellNck
from simulators.nck import AxisSpec, NckSpec
from simulators.opcua import SinumerikServer

RUNS = 3
SPEED = 50.0
AXIS = AxisRecord("X1", "X", "mm", False, False, (-400.0, 400.0), 0.0, 60_000.0, dwell_s=0.2)
PLACES = SafePlaces({"X1": (-440.0, 440.0)}, feed_mm=60_000.0, feed_deg=6000.0)
LOGIN = {"user": "trueflank", "password": "trueflank", "security": "None", "poll_s": 0.2}


class Folder:
    """A run folder."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def write_text(self, name: str, text: str) -> Path:
        """Keep a text."""
        (self._path / name).write_text(text, encoding="utf-8")
        return self._path / name


def table(size: float, points: int) -> CompensationTable:
    """Zero at the reference."""
    places = np.linspace(-400.0, 400.0, points)
    values = np.round(size * (20.0 * np.sin(places / 130.0) + np.sin(places / 7.0)), 3) + 0.0
    step = 800.0 / (points - 1)
    return CompensationTable("axis", "X1", "X1", -400.0, 400.0, step, tuple(map(float, values)))


class Counted:
    """A function replaced by one that counts its calls and their processor time."""

    def __init__(self, owner: type, name: str) -> None:
        self.calls, self.spent_s = 0, 0.0
        real: Callable[..., Any] = getattr(owner, name)

        def counted(*args: Any, **more: Any) -> Any:
            begun = process_time()
            try:
                return real(*args, **more)
            finally:
                self.spent_s += process_time() - begun
                self.calls += 1

        setattr(owner, name, counted)
        self.restore = lambda: setattr(owner, name, real)


async def saved(device: SinumerikOpcUa) -> LiveSet:
    """The live tables, saved by a program of ours."""
    await device.prepare_stops(StopPlan("T", "X1", "X", "mm", False, (Stop(0.0, -1),), 60_000.0, 5.0, 0.2))
    counter = 0
    while (stop := await device.wait_stop(counter, 600.0)) is not None:
        counter = stop.counter
        await device.release_stop(counter)
    return await device.saved_tables("X1")


async def one_push(url: str, size: float, folder: Path, points: int, speed: float) -> tuple[PushRecord, float]:
    """(record, processor seconds of the push)."""
    clock = LoopClock(speed)
    device = SinumerikOpcUa("840D", url, LOGIN, clock)
    device.keep_to(PLACES)
    await device.open(600.0)
    try:
        base, machine, new = await saved(device), await device.identify(), table(size, points)
        proof = SignProof(machine, "axis", "X1", -1.0, 0.01, 1, "2026-01-01T00:00:00+00:00")
        nothing = np.zeros(0)
        old = base.own
        change = TableChange("X1", old.table, new, old.enabled, base.digest, nothing, nothing, nothing, base=base)
        tested = SelfTested(machine, "X1", 0, "2026-01-01T00:00:00+00:00", "2026-01-01", passed=("READ",), failed=())
        context = PushContext(
            device, clock, Folder(folder), folder / "journal", AXIS, machine, "mill", "mill", proof,
            approvals_needed=1, risk_taken=True, self_test=tested,
        )  # fmt: skip
        begun = process_time()
        record = await push_table(change, context)
        return record, process_time() - begun
    finally:
        await device.close()


async def bare(url: str, count: int) -> float:
    """Processor seconds of as many bare reads by asyncua."""
    client = Client(url)
    client.set_user(LOGIN["user"])
    client.set_password(LOGIN["password"])
    async with client:
        node = client.get_node(ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime))
        begun = process_time()
        for _ in range(count):
            await node.read_value()
        return process_time() - begun


@asynccontextmanager
async def control(speed: float, points: int) -> AsyncIterator[str]:
    """The address of a control, with a person who does what MSG says."""
    clock = LoopClock(speed)
    axes = (AxisSpec("X1", "X", travel=(-450.0, 450.0), eec_points=(points, 0)),)
    nck = CellNck(NckSpec(axes, access_level=2, files_max_bytes=2_000_000), clock)
    await nck.start()
    server = SinumerikServer(nck, clock, {"security": ("None",)})
    await server.start()
    person = asyncio.ensure_future(_person(nck, clock))
    yield server.url
    person.cancel()
    await server.stop()
    await nck.stop()


async def serve(points: int) -> None:
    """A control until standard input ends."""
    async with control(SPEED, points) as url:
        sys.stdout.write(url + "\n")
        sys.stdout.flush()
        await asyncio.to_thread(sys.stdin.read)


async def _person(nck: CellNck, clock: LoopClock) -> None:
    await _ready(nck, clock)
    started = 0
    while True:
        await clock.sleep(0.25)
        if nck.booting:
            continue
        if nck.channel_status == 0 and nck.selections > started:
            started = nck.selections
            nck.nc_start()
        elif nck.channel_status == 2 and " NC START WHEN R" in nck.message:
            number, value = nck.message.rpartition(" R")[2].split("=")
            if nck.get(f"R[{number}]") == float(value):
                nck.nc_start()
        elif nck.channel_status == 2 and nck.message.startswith("TRUEFLANK ACTIVATE"):
            nck.nck_reset()
            await _ready(nck, clock)


async def _ready(nck: CellNck, clock: LoopClock) -> None:
    while nck.booting:
        await clock.sleep(0.2)
    nck.reference_axis("X1")
    while not nck.axis_state("X1").referenced:
        await clock.sleep(0.2)
    nck.set_mode("AUTO")


def pushed(url: str, points: int, run: int) -> tuple[float, float, int, int]:
    """One push: its own time, the time of as many bare requests, the requests, the journal's records."""
    requests, written = Counted(UASocketProtocol, "send_request"), Counted(journal.Journal, "append")
    try:
        with tempfile.TemporaryDirectory() as folder:
            record, own = asyncio.run(one_push(url, 0.5 + 0.1 * run, Path(folder), points, SPEED))
    finally:
        requests.restore()
        written.restore()
    if record.outcome != "committed":
        raise SystemExit(f"the push ended {record.outcome}: {record}")
    return own, asyncio.run(bare(url, requests.calls)), requests.calls, written.calls


async def together() -> str:
    """A push of a small table with everything in one process: how it ends."""
    async with control(1.0, 41) as url:
        with tempfile.TemporaryDirectory() as folder:
            record, _own = await one_push(url, 0.5, Path(folder), 41, 1.0)
            return record.outcome


def measure(report: Report) -> None:
    """All figures of this file."""
    if report.smoke:
        outcome = run_virtual(together)
        if outcome != "committed":
            raise SystemExit(f"the push ended {outcome}")
        report.say("a push of 41 points in one process, committed", 1)
        return
    for points in (201, 801):
        command, pipe = [sys.executable, "-m", "benchmarks.push", "--serve", str(points)], subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as machine:  # noqa: S603 - ourselves
            url = machine.stdout.readline().strip() if machine.stdout is not None else ""
            runs = [pushed(url, points, run) for run in range(RUNS)]
            machine.communicate("")
        own, floor = min(run[0] for run in runs), min(run[1] for run in runs)
        report.say(f"{points} points: the gateway's own time, {runs[0][3]} journal records", own, "s")
        report.at_most(f"{points} points: own time / {runs[0][2]} bare requests by asyncua", own / floor, 6.0)


if __name__ == "__main__":
    if "--serve" in sys.argv:
        asyncio.run(serve(int(sys.argv[2])))
    else:
        sys.exit(main(measure, __doc__))
