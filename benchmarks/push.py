"""The gateway's own time in a push over OPC UA: `python benchmarks/push.py`.

One 801-point table is pushed whole, to a control and its server in a process of their own, fifty times as fast as in
life. Own time is what the gateway's process works: requests, files both ways, comparisons, journal. The rest of the
whole is pauses, in which it waits for the program and for people, and answers it waits for from the double.
"""

from __future__ import annotations

import asyncio
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from drivers.clock import LoopClock
from drivers.programs import SelfTested
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.types.orders import SignProof
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable, LiveSet
from gateway.axes import AxisRecord
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.push import PushContext, push_table
from gateway.push.records import journal
from simulators.cell.control import CellNck
from simulators.nck.control import AxisSpec
from simulators.nck.spec import NckSpec
from simulators.opcua import SinumerikServer

POINTS = 801
RUNS = 3
SPEED = 50.0
OWN_S, JOURNAL_S, FAILS = 0.5, 0.020, 3.0
AXIS = AxisRecord("X1", "X", "mm", False, False, (-400.0, 400.0), 0.0, 60_000.0, dwell_s=0.2)
LOGIN = {"user": "trueflank", "password": "trueflank", "security": "None", "poll_s": 0.2}


def say(text: str, value: float, limit: str = "") -> None:
    """One line of the report."""
    sys.stdout.write(f"{text:<72} {value:10.4g}  {limit}\n")
    sys.stdout.flush()


class PausingClock(LoopClock):
    """A clock that knows how long one task slept on it, in s of the wall."""

    paused_s = 0.0
    watched: asyncio.Task[Any] | None = None

    async def sleep(self, seconds: float) -> None:
        """Wait, and remember."""
        begun = perf_counter()
        await super().sleep(seconds)
        if asyncio.current_task() is self.watched:
            self.paused_s += perf_counter() - begun


class Folder:
    """A run folder."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def write_text(self, name: str, text: str) -> Path:
        """Keep a text."""
        (self._path / name).write_text(text, encoding="utf-8")
        return self._path / name


def table(size: float) -> CompensationTable:
    """Zero at the reference."""
    places = np.linspace(-400.0, 400.0, POINTS)
    values = np.round(size * (20.0 * np.sin(places / 130.0) + np.sin(places / 7.0)), 3) + 0.0
    return CompensationTable("axis", "X1", "X1", -400.0, 400.0, 1.0, tuple(map(float, values)))


class Timed:
    """Seconds spent inside a function, and how often it was called."""

    def __init__(self, real: Callable[..., Any]) -> None:
        self._real = real
        self.spent_s, self.calls = 0.0, 0

    def method(self) -> Callable[..., Any]:
        """The function, timed."""

        def timed(*args: Any, **more: Any) -> Any:
            begun = perf_counter()
            try:
                return self._real(*args, **more)
            finally:
                self.spent_s += perf_counter() - begun
                self.calls += 1

        return timed


async def saved(device: SinumerikOpcUa) -> LiveSet:
    """The live tables, saved by a program of ours."""
    await device.prepare_stops(StopPlan("T", "X1", "X", "mm", False, (Stop(0.0, -1),), 60_000.0, 5.0, 0.2))
    counter = 0
    while (stop := await device.wait_stop(counter, 600.0)) is not None:
        counter = stop.counter
        await device.release_stop(counter)
    return await device.saved_tables("X1")


async def one_push(url: str, size: float, folder: Path) -> tuple[PushRecord, float, float, float]:
    """(record, whole s, s of it paused, s of it at work)."""
    clock = PausingClock(SPEED)
    device = SinumerikOpcUa("840D", url, LOGIN, clock)
    await device.open(600.0)
    try:
        base, machine, new = await saved(device), await device.identify(), table(size)
        proof = SignProof(machine, "axis", "X1", -1.0, 0.01, 1, "2026-01-01T00:00:00+00:00")
        nothing = np.zeros(0)
        old = base.own
        change = TableChange("X1", old.table, new, old.enabled, base.digest, nothing, nothing, nothing, base=base)
        tested = SelfTested(machine, "X1", 0, "2026-01-01T00:00:00+00:00", "2026-01-01", passed=("READ",), failed=())
        context = PushContext(
            device, clock, Folder(folder), folder / "journal", AXIS, machine, "mill", "mill", proof,
            approvals_needed=1, risk_taken=True, self_test=tested,
        )  # fmt: skip
        begun, worked, clock.watched = perf_counter(), process_time(), asyncio.current_task()
        record = await push_table(change, context)
        return record, perf_counter() - begun, clock.paused_s, process_time() - worked
    finally:
        await device.close()


async def serve() -> None:
    """A control, its server, and a person who does what MSG says, until standard input ends."""
    clock = LoopClock(SPEED)
    nck = CellNck(NckSpec((AxisSpec("X1", "X", travel=(-450.0, 450.0), eec_points=(900, 0)),), access_level=2), clock)
    await nck.start()
    server = SinumerikServer(nck, clock, {"security": ("None",)})
    await server.start()
    person = asyncio.ensure_future(_person(nck, clock))
    sys.stdout.write(server.url + "\n")
    sys.stdout.flush()
    await asyncio.to_thread(sys.stdin.read)
    person.cancel()
    await server.stop()
    await nck.stop()


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


def main() -> int:
    """Print the figures; fails only at three times what is asked."""
    append = Timed(journal.Journal.append)
    journal.Journal.append = append.method()  # type: ignore[method-assign]
    machine = subprocess.Popen(  # noqa: S603 - this very file
        [sys.executable, __file__, "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    own: list[float] = []
    written: list[float] = []
    try:
        url = machine.stdout.readline().strip() if machine.stdout is not None else ""
        for run in range(RUNS):
            with tempfile.TemporaryDirectory() as folder:
                before, calls = append.spent_s, append.calls
                record, whole, paused, alone = asyncio.run(one_push(url, 0.5 + 0.1 * run, Path(folder)))
                if record.outcome != "committed":
                    sys.stdout.write("\n".join(record.steps) + "\n")
                    return 1
                own.append(alone)
                written.append(append.spent_s - before)
                say(f"push {run + 1}: the whole at {SPEED:g} x life, s", whole)
                say(f"push {run + 1}: pauses for program and people, s", paused)
                say(f"push {run + 1}: waiting for answers, s", max(whole - paused - alone, 0.0))
                say(f"push {run + 1}: the gateway's own time, s", alone)
                say(f"push {run + 1}: journal, {append.calls - calls} records, s", written[-1])
    finally:
        if machine.stdin is not None:
            machine.stdin.close()
        machine.wait()
    say("gateway's own time, s", statistics.median(own), f"<= {OWN_S}")
    say("journal, s", statistics.median(written), f"<= {JOURNAL_S}")
    return int(statistics.median(own) > FAILS * OWN_S or statistics.median(written) > FAILS * JOURNAL_S)


if __name__ == "__main__":
    if "--serve" in sys.argv:
        asyncio.run(serve())
    else:
        sys.exit(main())
