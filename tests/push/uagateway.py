"""A gateway in a fresh process that pushes over OPC UA and is killed -9 at one of its steps.

``python -m tests.push.uagateway URL FOLDER SPEED STEP``: STEP counts the steps that leave a trace, -1 lets it live and
prints their names. The base it pushes on is read first, by a program as a measurement does. A URL of tcp:// is a
PLC mailbox's. What it says to people, and "begun" once the push begins, goes line by line to who started it, who may
kill it at any moment.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

from drivers.clock import Clock, LoopClock
from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from drivers.sinumerik.opcua.session.client import UaSession
from drivers.types.stops import Stop, StopPlan
from gateway.push import journal
from gateway.push.transaction import push_table
from tests.placed import placed
from tests.push.uaworld import SETTINGS, ua_change, ua_context
from tests.push.world import NEW, Scene, change_of, context_for, driver_settings

BEGUN, ENDED = "begun", "ended"
STEPS: list[str] = []
AT = -1


def due(name: str) -> bool:
    """One more step; whether it is the one to die at."""
    STEPS.append(name)
    return len(STEPS) - 1 == AT


def tick(name: str) -> None:
    """One more step; dies here if it is the one."""
    if due(name):
        os.kill(os.getpid(), signal.SIGKILL)


def watch() -> None:
    """Every journal entry, every file set aside, every write and method call to the control."""
    append, replace = journal.Journal.append, os.replace

    def appending(self: journal.Journal, kind: str, **facts: object) -> None:
        tick(f"journal< {kind}")
        if due(f"journal/ {kind}"):
            line, _sha = journal._line(self._sequence, self._previous, {"kind": kind, **facts})
            self._file.write(line[: len(line) // 2])
            self._file.flush()
            os.kill(os.getpid(), signal.SIGKILL)
        append(self, kind, **facts)
        tick(f"journal> {kind}")

    def replacing(source: Any, target: Any) -> None:
        tick("replace<")
        replace(source, target)
        tick("replace>")

    journal.Journal.append = appending  # type: ignore[method-assign]
    os.replace = replacing  # type: ignore[assignment]
    for name in ("write", "call"):
        _watch_session(name)


def _watch_session(name: str) -> None:
    real = getattr(UaSession, name)

    async def watched(self: UaSession, *args: Any, **more: Any) -> Any:
        tick(f"{name}<")
        found = await real(self, *args, **more)
        tick(f"{name}>")
        return found

    setattr(UaSession, name, watched)


def say(code: str, /, **fields: object) -> None:
    """Tell who started this process."""
    print(json.dumps({"say": code, "fields": {name: str(value) for name, value in fields.items()}}), flush=True)


async def over_opcua(url: str, folder: Path, clock: Clock) -> str:
    """The push, on a base that a program saved."""
    device = SinumerikOpcUa("840D", url, dict(SETTINGS), clock)
    await device.open(900.0)
    try:
        await device.prepare_stops(StopPlan("T", "X1", "X", "mm", False, (Stop(0.0, -1),), 3900.0, 5.0, 0.2))
        counter = 0
        while (stop := await device.wait_stop(counter, 900.0)) is not None:
            counter = stop.counter
            await device.release_stop(counter)
        base = await device.saved_tables("X1")
        watch()
        context = ua_context(device, clock, folder, await device.identify(), start_timeout_s=900.0, say=say)
        print(BEGUN, flush=True)
        ended = await push_table(ua_change(base, NEW), context)
        print(ENDED, flush=True)
        return ended.outcome
    finally:
        await device.close()


async def over_modbus(url: str, folder: Path, clock: Clock) -> str:
    """The push through a mailbox."""
    settings = {**driver_settings(Scene()), "reply_s": 30.0, "command_s": 600.0}
    device = placed(SinumerikModbus("grinder", url, settings, clock))
    await device.open(900.0)
    try:
        base = await device.saved_tables("X1")
        watch()
        more = {"start_timeout_s": 900.0, "stop_timeout_s": 900.0, "say": say}
        context = context_for(Scene(), device, clock, folder, await device.identify(), **more)
        print(BEGUN, flush=True)
        ended = await push_table(change_of(Scene(), base), context)
        print(ENDED, flush=True)
        return ended.outcome
    finally:
        await device.close()


async def main(url: str, folder: Path, speed: float) -> str:
    """The push."""
    over = over_modbus if url.startswith("tcp:") else over_opcua
    return await over(url, folder, LoopClock(speed))


if __name__ == "__main__":
    AT = int(sys.argv[4])
    outcome = asyncio.run(main(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3])))
    print(json.dumps({"outcome": outcome, "steps": STEPS}))
