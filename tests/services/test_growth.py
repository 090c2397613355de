"""Months of reconnecting and pushing leave nothing behind in memory: by `make services`."""

from __future__ import annotations

import functools
import gc
import os
from pathlib import Path

import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.push import push_table
from tests.push.world import Scene, change_of, context_for, world

pytestmark = [pytest.mark.services, pytest.mark.timeout(1800)]
RECONNECTS, PUSHES, WARM = 500, 200, 40
MOST_MB = 5.0


def held_mb() -> float:
    """Memory that this process holds now, MB."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


async def test_reconnects_leave_nothing() -> None:
    async with world(Scene(), LoopClock()) as at:
        device, begun = at.driver(), 0.0
        for number in range(RECONNECTS + WARM):
            if number == WARM:
                begun = held_mb()
            await device.open(5.0)
            await device.identify()
            await device.close()
        grown = held_mb() - begun
    print(f"{RECONNECTS} reconnects: {grown:.1f} MB")
    assert grown < MOST_MB


async def pushed(root: Path) -> str:
    """One whole push at a machine of its own."""
    async with world(Scene(), LoopClock()) as at:
        device = at.driver()
        await device.open(5.0)
        base = await device.saved_tables("X1")
        machine = await device.identify()

        def say(code: str, /, **fields: object) -> None:
            at.person.hear(code, fields)

        context = context_for(at.scene, device, at.clock, root, machine, say=say)
        record = await push_table(change_of(at.scene, base), context)
        await device.close()
        return str(record.outcome)


def test_pushes_leave_nothing(tmp_path: Path) -> None:
    begun = 0.0
    for number in range(PUSHES + WARM):
        if number == WARM:
            begun = held_mb()
        root = tmp_path / str(number)
        root.mkdir()
        assert run_virtual(functools.partial(pushed, root)) == "committed"
    grown = held_mb() - begun
    print(f"{PUSHES} pushes: {grown:.1f} MB")
    assert grown < MOST_MB
