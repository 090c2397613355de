"""Straightness, angle and gear bridges of a whole cell, asked by the drivers."""

from __future__ import annotations

import asyncio
import contextlib
import tomllib
from typing import Any

import numpy as np
import pytest

from drivers.bridge.device import BridgeInstrument
from drivers.bridge.gear import BridgeGear
from drivers.errors import DeviceRefused
from drivers.types.gears import GearPlan, InspectedGear
from drivers.types.sensing import SampleBlock
from gateway.config import load_site
from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from simulators.cellfile import load_cell, with_plan
from simulators.grinding import WorkPiece
from simulators.pytest_plugin import CellStarter
from tests.unit.simulators.planned_run import PlannedRun

PLAN = GearPlan(
    39,
    tuple(range(39)),
    profile_points=5,
    profile_z_mm=5.0,
    lead_points=3,
    lead_z_mm=(1.0, 9.0),
    pitch=True,
    runout_ball_mm=8.0,
)


def address(cell: Cell, name: str) -> tuple[str, dict[str, Any]]:
    found = next(one for one in load_site(cell.site_path).instruments if one.name == name)
    return found.url, dict(found.settings)


async def some(cell: Cell, name: str, count: int) -> list[SampleBlock]:
    url, settings = address(cell, name)
    device = BridgeInstrument(name, url, settings, cell.clock)
    blocks: list[SampleBlock] = []
    await device.open(5.0)
    try:
        async with contextlib.aclosing(device.blocks()) as stream:
            async for block in stream:
                blocks.append(block)
                if len(blocks) == count:
                    break
    finally:
        await device.close()
    return blocks


def grind(cell: Cell) -> WorkPiece:
    """A part ground by a planned run beside the control, put where the cell keeps its last one."""
    part = cell.file.part
    assert part is not None
    run = PlannedRun(cell.file, part, start_s=cell.clock.now())
    grinder = cell.shop._grinder
    assert grinder is not None
    grinder._bench.machine, kept = run, grinder._bench.machine
    work = grinder.load(run.start_s)
    grinder.follow(run.end_s, whole=True)
    grinder._bench.machine = kept
    grinder.last, grinder.work = work, None
    return work


def test_a_straightness_instrument_streams_what_its_set_up_shows(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        dark = await some(cell, "straightness", 2)
        assert not any(block.valid.any() for block in dark)
        cell.bench.mount(cell.bench.setup_for("EYX", "X"))
        blocks = await some(cell, "straightness", 8)
        assert all(block.valid.all() for block in blocks)
        values = np.concatenate([block.values[:, 0] for block in blocks])
        assert len(values) >= 80
        assert np.std(values) == pytest.approx(0.15, rel=0.4)

    trueflank_cell.in_memory(main)


def test_an_angle_instrument_streams_arcsec_and_tells_its_optics(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        setup = cell.bench.setup_for("EBX", "X")
        cell.bench.mount(setup)
        url, settings = address(cell, "angular")
        device = BridgeInstrument("angular", url, settings, cell.clock)
        await device.open(5.0)
        assert device.channels == ("angle_arcsec",)
        assert (await device.optics()).kind == "angular"
        assert (await device.ambient()).air_degc is not None
        await device.close()
        values = np.concatenate([b.values[:, 0] for b in await some(cell, "angular", 4)])
        assert np.ptp(values) < 1.0
        cell.bench.mount(setup, "linear")
        assert not any(block.valid.any() for block in await some(cell, "angular", 2))

    trueflank_cell.in_memory(main)


async def inspected(cell: Cell, plan: GearPlan = PLAN) -> InspectedGear:
    url, settings = address(cell, "gear")
    device = BridgeGear("gear", url, settings, cell.clock)
    await device.open(5.0)
    try:
        return await device.inspect(plan, lambda *_: None)
    finally:
        await device.close()


def test_a_ground_part_is_inspected_line_by_line(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        with pytest.raises(DeviceRefused) as none:
            await inspected(cell)
        assert none.value.code == "E-GEAR-CLAMP"
        work = grind(cell)
        got = await inspected(cell)
        inspection = got.inspection
        assert got.part.part == f"RV-40E-like {work.number}"
        assert inspection.probe_u_um == 0.2
        assert len(inspection) == 39 * 2 * (5 + 3) + 39 * 2
        assert got.balls_mm.shape == (39, 3)
        assert inspection.deviation_um is None
        assert set(np.round(inspection.points_mm[:, 2], 6)) == {1.0, 5.0, 9.0}
        profile = np.asarray([trace == "profile" for trace in got.trace])
        left = profile & (inspection.flank == 1) & (inspection.space == 7)
        t = work.lobes.even(10)
        t = t[t > 0.0]
        rays = work.lobes.rays(7, t, np.zeros(1))
        off = np.sum((inspection.points_mm[left] - [0.0, 0.0, 5.0] - rays.points) * rays.directions, axis=1) * 1e3
        off -= work.surplus_um(np.asarray([7.0]), t, np.zeros(1))[0, :, 0]
        # Probe noise 0.2 um, 0.3 um off the axis, and up to 40 arcsec of rotation in the machine's own clamping.
        lever = rays.points[:, 0] * rays.directions[:, 1] - rays.points[:, 1] * rays.directions[:, 0]
        turned = float(off @ lever / (lever @ lever))
        assert np.max(np.abs(off - turned * lever)) < 1.5
        assert abs(turned) * 1e-3 <= np.deg2rad(40.0 / 3600.0) * 1.2
        await BackDoor(cell).answer({"set": "gear_machine", "options": {"deviations": True}})
        await BackDoor(cell).answer({"set": "reclamp"})
        nominal = (await inspected(cell)).inspection
        assert nominal.deviation_um is not None
        np.testing.assert_allclose(nominal.points_mm[left] - [0.0, 0.0, 5.0], rays.points, atol=1e-6)
        assert np.std(nominal.deviation_um) > 1.0

    trueflank_cell.in_memory(main)


def test_a_plan_is_stopped_refused_or_fails_as_machines_do(trueflank_cell: CellStarter) -> None:
    async def main(cell: Cell) -> None:
        grind(cell)
        judge = BackDoor(cell)
        assert await judge.answer({"set": "gear_machine", "options": {"wrong_spaces": -1}}) == {"done": True}
        with pytest.raises(DeviceRefused) as counted:
            await inspected(cell)
        assert counted.value.code == "E-GEAR-ENDED"
        assert "38 spaces" in str(counted.value.fields)
        assert await judge.answer({"set": "gear_machine", "options": {"wrong_spaces": 0}}) == {"done": True}
        assert await judge.answer({"set": "reclamp"}) == {"done": True}
        with pytest.raises(DeviceRefused) as ball:
            await inspected(cell, GearPlan(39, (), pitch=True, runout_ball_mm=1.0))
        assert "no rest" in str(ball.value.fields)
        slow = asyncio.ensure_future(inspected(cell))
        await cell.clock.sleep(5.0)
        slow.cancel()
        await asyncio.gather(slow, return_exceptions=True)
        assert (await inspected(cell, GearPlan(39, (3,), profile_points=4))).inspection.space.tolist() == [3] * 8

    trueflank_cell.in_memory(main)


def test_a_site_file_with_the_plan_names_every_set_up_and_the_work(trueflank_cell: CellStarter) -> None:
    demo = load_cell("demo")

    async def main(cell: Cell) -> None:
        site = load_site(cell.site_path)
        have = {(setup.component, setup.axis) for setup in site.setups}
        axes = {axis.letter: axis.name for axis in site.axes}
        measured = {(axis.measure.component, axis.letter) for axis in site.axes}
        wanted = [s for s in demo.setups if (s.component, s.axis) not in measured or any(s.offset_mm)]
        assert have == {(s.component, axes[s.axis]) for s in wanted}
        assert {s.component: s.offset_mm for s in site.setups}["EZZ"] == (15.0, -10.0, 0.0)
        assert [s.park for s in site.setups if s.component == "B0C"] == [{"C1": 0.0}, {"C1": 180.0}]
        assert site.work is not None
        assert site.work.height_mm == 150.0
        gear = tomllib.loads((cell.site_path.parent / site.work.gear).read_text())
        assert gear["gear"] == {"rp": 64.0, "rrp": 3.0, "a": 1.3, "zp": 40, "zc": 39, "b": 10.0}
        assert gear["grinding"] == {"centre_distance_mm": 160.0}

    trueflank_cell.in_memory(main, with_plan(demo))
