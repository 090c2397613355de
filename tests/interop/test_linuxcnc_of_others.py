"""The LinuxCNC road before the real kernel: what it does with screw files, and what the driver makes of it."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Coroutine, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.contract import CHECKS, OperatorMoment, Subject
from drivers.errors import DeviceRefused, TooManyPoints
from drivers.linuxcnc.device import LinuxCnc
from drivers.types.orders import PushOrder
from drivers.types.stops import Stop, StopPlan
from drivers.types.tables import CompensationTable
from tests.contract.fileroad import curve
from tests.interop.linuxcnc_host import SCREWS, Host, running

pytestmark = [pytest.mark.interop, pytest.mark.wall_time]


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="tf-mill-") as made:
        yield Path(made)


async def test_the_kernel_takes_screw_files_as_the_driver_says(folder: Path) -> None:
    """Type 0 and 1, both directions, clamped outside, BACKLASH without rows; the 257th row is cut and it runs on."""
    files = {
        "x.comp": "0 -0.010 -0.020\n100 -0.010 -0.020\n200 0.0 0.0\n",
        "y.comp": "0 0.010 0.020\n100 100.010 100.020\n200 200.0 200.0\n",
        "a.comp": "\n".join(f"{place} {-1e-4 * place} 0" for place in range(258)),
    }
    async with running(folder, files) as host:
        seen = await host.person("mdi", "G0 X150 Y150 A250")
        assert seen["trim"] == pytest.approx([-0.005, -0.005, 0.0, -0.025], abs=1e-6)
        seen = await host.person("mdi", "G0 X50 Y50 A100")
        assert seen["trim"] == pytest.approx([-0.020, -0.020, 0.0, 0.0], abs=1e-6)
        seen = await host.person("mdi", "G0 X250 Y250 A280")
        assert seen["trim"] == pytest.approx([0.0, 0.0, 0.0, -0.0255], abs=1e-6)
        assert await host.person("errors") == ["joint 3: too many compensation entries"] * 2


async def test_the_kernel_leaves_out_a_jump_between_one_and_two_steps_of_its_ramp(folder: Path) -> None:
    """A trim that jumps by 0.25 to 0.5 MAX_ACCELERATION T^2 (here 0.75 to 1.5 um) waits until the table changes."""
    jumps, taken = np.array([0.0007, 0.001, 0.0014, 0.0016]), np.array([True, False, False, True])
    rows = [f"0 {jump} {2 * jump}\n300 {jump} {2 * jump}\n" for jump in jumps]
    rows[1] = f"0 {jumps[1]} {2 * jumps[1]}\n300 {300 + jumps[1]} {300 + 2 * jumps[1]}\n"  # type 0: places
    async with running(folder, dict(zip(SCREWS, rows, strict=True))) as host:
        seen = await host.person("mdi", "G0 X100 Y100 Z100 A100")
        assert seen["trim"] == pytest.approx(np.where(taken, jumps, 0.0), abs=1e-9)


async def _person(host: Host) -> Any:
    async def person(moment: OperatorMoment, work: Coroutine[Any, Any, Any]) -> Any:
        if moment in ("read", "start"):
            return await work
        task = asyncio.ensure_future(work)
        await host.restart()
        return await task

    return person


async def test_the_contract_of_the_port_holds_on_the_kernel(folder: Path) -> None:
    async with running(folder) as host:
        for check in CHECKS:
            left = [one for name in SCREWS if (one := host.folder / name).stat().st_size]
            for one in left:
                one.write_text("")
            if left:
                await host.restart()
            async with host.device() as device:
                await check(Subject(device, curve(), "X", False, 0.0, await _person(host)))


async def test_a_table_makes_the_slide_true_in_both_directions_and_one_row_too_many_is_refused(folder: Path) -> None:
    """What the plant does at 16 stops from each side becomes the file; at the nodes it is gone to 0.01 um."""
    async with running(folder) as host, host.device() as device:
        plan = _plan("X", np.linspace(0.0, 300.0, 16))
        before = await _walk(host, device, plan)
        assert np.ptp(before[1]) > 15.0
        table = CompensationTable(
            "axis",
            "X",
            "X",
            minimum=0.0,
            maximum=300.0,
            step=20.0,
            deviations=tuple(before[1]),
            reverse=tuple(before[-1]),
        )
        person = await _person(host)
        too_many = replace(table, step=1.0, maximum=256.0, deviations=(0.0,) * 257, reverse=(0.0,) * 257)
        with pytest.raises(TooManyPoints):
            await device.stage((_order(too_many),))
        order = _order(table)
        await device.stage((order,))
        (read,) = await device.read_back((order,), 10.0)
        assert read.agreed
        assert read.found.own.table.deviations == pytest.approx(table.deviations, abs=1e-6)
        await device.activate((order,), (order,))
        with pytest.raises(DeviceRefused) as caught:  # the old one acts until the restart, and it is said
            await device.saved_tables("X")
        assert caught.value.code == "E-LCNC-PENDING"
        assert (await host.person("mdi", "G0 X150"))["trim"][0] == 0.0
        await person("restart", device.restarted((order,), 30.0))
        assert (await device.saved_tables("X")).own.enabled
        await device.finish_push((order,), "committed")
        after = await _walk(host, device, plan)
        for side in (1, -1):
            assert np.abs(after[side]).max() < 0.01


async def test_an_agent_killed_between_staging_and_commit_leaves_the_old_file(folder: Path) -> None:
    """kill -9 after the new file is staged; LinuxCNC is restarted: the old file acts, and the way back is known."""
    old = {"x.comp": "0 0.002 0.004\n300 0.002 0.004\n"}
    async with running(folder, old) as host, host.device() as device:
        order = _order(curve())
        await device.stage((order,))
        await device.read_back((order,), 10.0)
        await host.kill_agent()
        await host.restart()
        await host.start_agent()
        assert (await device.saved_tables("X")).own.table.deviations == (-2.0, -2.0)
        seen = await host.person("mdi", "G0 X100")
        assert seen["trim"][0] == pytest.approx(0.002, abs=1e-9)
        marker = await device.marker()
        assert marker is not None
        assert (marker.transaction, marker.state) == (order.transaction, "in-progress")
        (backup,) = await device.backup_of((order,))
        assert backup.own.table.reverse == (-4.0, -4.0)


# ---- what the tests share --------------------------------------------------------------------------------


def _order(table: CompensationTable) -> PushOrder:
    return PushOrder(9, table, "X", rotary=False, enable=True, agreeing_position=0.0, purpose="sign-proof")


def _plan(axis: str, targets: np.ndarray) -> StopPlan:
    """Every target from below, then from above."""
    up = [Stop(float(target), 1, label=label) for label, target in enumerate(targets)]
    down = [Stop(one.target, -1, label=one.label) for one in reversed(up)]
    return StopPlan(
        "TFMEAS" + axis, axis, axis, "mm", axis == "A", (*up, *down), feed=12000.0, overrun=2.0, dwell_s=0.05
    )


async def _walk(host: Host, device: LinuxCnc, plan: StopPlan) -> dict[int, np.ndarray]:
    """Deviations (um) of the plant by direction, in rising order of the targets; the program ends by itself."""
    joint, counter = "XYZA".index(plan.axis), 0
    found: dict[int, list[float]] = {1: [], -1: []}
    await device.prepare_stops(plan)
    await host.person("start")
    for stop in plan.stops:
        reached = await device.wait_stop(counter, 20.0)
        assert reached is not None
        assert (reached.counter, reached.target) == (counter + 1, stop.target)
        true = (await host.person("true"))["true"][joint]
        found[stop.approach].append((true - stop.target) * 1000.0)
        counter = reached.counter
        await device.release_stop(counter)
    assert await device.wait_stop(counter, 20.0) is None
    return {1: np.array(found[1]), -1: np.array(found[-1][::-1])}
