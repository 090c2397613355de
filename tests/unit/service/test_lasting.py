"""What goes on beside the page: drivers loaded in their own time, work that a fault ended begun again and told."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock
from drivers.errors import ConfigError
from gateway.daemon import LazyDevices
from gateway.daemon.job_runner import AGAIN_S, supervise_task
from gateway.daemon.site_service import figures_to_publish
from gateway.store import Store
from tests.unit.report.synthetic import MACHINE, axis_material
from tests.unit.web.pictures import Seen
from tests.unit.web.test_daemon import Devices


async def test_work_that_a_fault_ended_begins_again_and_the_fault_is_known(caplog: pytest.LogCaptureFixture) -> None:
    clock, begun, told = LoopClock(), [], []

    async def work() -> None:
        begun.append(clock.now())
        if len(begun) < 3:
            raise ValueError("no secret of ours")

    def tell(kind: str, data: Mapping[str, object]) -> None:
        told.append((kind, data))

    with caplog.at_level(logging.ERROR):
        await supervise_task("the index", work, clock, tell)
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

    task = asyncio.create_task(supervise_task("the index", work, LoopClock()))
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
    told = figures_to_publish(store, run.run_id)
    assert told["serial"] == MACHINE.serial
    assert {one["parameter"] for one in told["figures"]} >= {"E", "A"}


@pytest.mark.wall_time
async def test_devices_are_made_once_and_shown_as_closed_until_then() -> None:
    go_on, made = threading.Event(), []

    def make() -> Devices:
        assert go_on.wait(60.0)
        made.append(Devices())
        return made[-1]

    late = LazyDevices(make, (Seen("laser", "umd", "closed"),))
    opening = asyncio.create_task(late.open_all())
    await LoopClock().sleep(0.01)  # the loop turns while they are loaded
    assert [one.state for one in late.picture()] == ["closed"]
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    await late.close_all()
    go_on.set()
    await late.open_all()
    assert [one.state for one in late.picture()] == ["open"]
    stop = asyncio.Event()
    stop.set()
    await late.watch(stop)
    await late.close_all()
    assert made[0].calls == ["open", "watch", "close"]
    assert made == [late.made]


@pytest.mark.wall_time
async def test_devices_that_cannot_be_made_are_trouble_and_the_watch_waits_for_the_end() -> None:
    def make() -> Devices:
        raise ConfigError("E-CFG-DRIVER", "nonsense", role="controller", known="none")

    late, stop = LazyDevices(make, ()), asyncio.Event()
    for _try in range(2):
        with pytest.raises(ConfigError):
            await late.open_all()
    watch = asyncio.create_task(late.watch(stop))
    await LoopClock().sleep(0.01)
    assert not watch.done()
    stop.set()
    await watch
    await late.close_all()
