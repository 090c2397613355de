"""A push over the double of LinuxCNC, and somebody who restarts when asked to and presses Cycle Start."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import numpy as np

from drivers.types.moves import SafePlaces
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable, LiveSet
from gateway.axes import AxisRecord
from gateway.domain.proposals import TableChange
from gateway.push import PushContext
from tests.contract.linuxcnc_stage import Stage

X_AXIS = AxisRecord("X", "X", "mm", False, False, (-90.0, 490.0), 0.0, 6000.0, dwell_s=0.2)
FORWARD, BACK = (-0.2, 3.0, 7.0, 2.0, 1.0), (0.2, 3.5, 7.5, 2.4, 1.5)
BENT = CompensationTable("axis", "X", "X", 0.0, 400.0, 100.0, FORWARD, reverse=BACK)
NOTHING = np.zeros(0)


class Folder:
    def __init__(self, path: Path) -> None:
        self.path = path

    def write_text(self, name: str, text: str) -> Path:
        (self.path / name).write_text(text)
        return self.path / name


@contextlib.asynccontextmanager
async def person(on: Stage, root: Path, heard: list[str]) -> AsyncIterator[PushContext]:
    """A context with somebody who restarts when asked to, selects automatic, and presses Cycle Start."""

    def say(code: str, /, **_fields: Any) -> None:
        heard.append(code)

    async def work() -> None:
        done = 0
        while True:
            await on.clock.sleep(0.5)
            if "away" in heard:
                continue
            if {"P-PUSH-NEXT-START", "P-PUSH-DISABLE-START"} & set(heard[done:]):
                done = len(heard)
                await on.restart()
            on.machine.cycle_start()

    machine = await on.device.identify()
    on.device.keep_to(SafePlaces(dict.fromkeys("XYA", (-9999.0, 9999.0)), feed_mm=6000.0, feed_deg=6000.0))
    proof = SignProof(machine, "axis", "X", -1.0, 0.02, 1, "2026-11-21T09:00:00+00:00")
    task = asyncio.get_running_loop().create_task(work())
    try:
        yield PushContext(
            on.device, on.clock, Folder(root), root / "journal", X_AXIS, machine, "mill", "mill", proof,
            start_timeout_s=60.0, say=say, approvals_needed=1, risk_taken=True,
        )  # fmt: skip
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


def change_of(live: LiveSet, new: CompensationTable) -> TableChange:
    own = live.own
    return TableChange("X", own.table, new, own.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)
