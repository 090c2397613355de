"""What goes on beside the devices goes on after a fault, and the fault is kept and told."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from gateway.daemon.lasting import AGAIN_S, lasting
from gateway.daemon.telling import figures_told
from gateway.store import Store
from tests.unit.report.synthetic import MACHINE, axis_material


async def test_work_that_a_fault_ended_begins_again_and_the_fault_is_known(caplog: pytest.LogCaptureFixture) -> None:
    clock, begun, told = LoopClock(), [], []

    async def work() -> None:
        begun.append(clock.now())
        if len(begun) < 3:
            raise ValueError("no secret of ours")

    def tell(kind: str, data: Mapping[str, object]) -> None:
        told.append((kind, data))

    with caplog.at_level(logging.ERROR):
        await lasting("the index", work, clock, tell)
    assert [round(at - begun[0]) for at in begun] == [0, AGAIN_S, 2 * AGAIN_S]
    assert [one.levelname for one in caplog.records] == ["ERROR", "ERROR"]
    assert "the index" in caplog.text
    kind, data = told[0]
    assert (kind, data["code"]) == ("failure", "E-WEB-FAULT")
    assert "ValueError" in str(data)
    assert "secret" not in str(data)


async def test_a_stop_ends_it(caplog: pytest.LogCaptureFixture) -> None:
    async def work() -> None:
        await LoopClock().sleep(1e6)

    task = asyncio.create_task(lasting("the index", work, LoopClock()))
    await LoopClock().sleep(1.0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not caplog.records


def test_figures_for_other_systems_name_the_machine_by_its_serial_number(tmp_path: Path) -> None:
    store = Store(tmp_path)
    run = store.create("hall-3")
    material: Any = axis_material("X1", "mm")
    run.put("evaluation-X1-before", material.before)
    run.set_state("proposed", machine=MACHINE)
    told = figures_told(store, run.run_id)
    assert told["serial"] == MACHINE.serial
    assert {one["parameter"] for one in told["figures"]} >= {"E", "A"}
