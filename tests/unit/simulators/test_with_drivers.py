"""The product's own drivers meet the simulated instruments and files: readings in units, end to end."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from drivers.bridge.device import BridgeInstrument
from drivers.clock import LoopClock
from drivers.files.rtl import RtaFormat, RtlFormat
from drivers.umd.device import UmdCounter
from simulators.bridge import BridgeServer
from simulators.optics import LaserCounter, RotaryReader
from simulators.result_files import FileContent, write_result
from simulators.truth import Weather
from simulators.umd import UmdServer
from tests.unit.simulators.test_wires import bench_of


async def test_the_laser_driver_reads_the_path_and_the_air() -> None:
    bench, clock = bench_of(), LoopClock()
    answerer = UmdServer(LaserCounter(bench.cell.instruments[0], bench), bench, clock, 0.25)
    driver = UmdCounter("laser", await answerer.start("memory://laser-drv"), {}, clock)
    await driver.open(5.0)
    ambient = await driver.ambient()
    assert (ambient.air_degc, ambient.pressure_hpa, ambient.material_degc) == (22.34, 991.5, (21.7,))
    last = np.nan
    async for block in driver.blocks():
        assert block.lost == 0
        assert block.valid.all()
        last = float(block.values[-1, 0])
        if block.time_s[-1] > 5.0:
            break
    assert last == pytest.approx(10.0 * 1.00026, abs=1e-3)
    await driver.close()
    await answerer.stop()


async def test_the_calibrator_driver_follows_the_house_rule_of_senses() -> None:
    bench, clock = bench_of(), LoopClock()
    answerer = BridgeServer(RotaryReader(bench.cell.instruments[1], bench), bench, clock, 0.1)
    driver = BridgeInstrument("calibrator", await answerer.start("memory://cal-drv"), {}, clock)
    identity = await driver.open(5.0)
    assert identity.serial == "XR-0001"
    await driver.hold()
    seen, turned = np.zeros(2), False
    async for block in driver.blocks():
        seen = block.values[-1]
        if clock.now() > 4.0 and not turned:
            np.testing.assert_allclose(seen, [0.0, 0.1], atol=1e-8)
            await driver.turn(-0.1)
            turned = True
        elif clock.now() > 6.0:
            break
    np.testing.assert_allclose(seen, [-0.1, 0.0], atol=1e-8)
    await driver.close()
    await answerer.stop()


@pytest.mark.parametrize("rotary", [False, True])
def test_the_file_drivers_read_what_the_capture_pc_wrote(rotary: bool, tmp_path: Path) -> None:
    rng, moment = np.random.default_rng(4), datetime(2024, 5, 3, 10, 46, tzinfo=UTC)
    targets, deviations = np.linspace(0.0, 345.0, 24), rng.normal(0.0, 5.0, (24, 5, 2))
    weather = Weather(21.25, 991.5, 48.0, 20.75)
    path = tmp_path / ("axis.rta" if rotary else "axis.rtl")
    factors = (0.3164109, 0.3164108)
    write_result(path, FileContent(targets, deviations, rotary, weather, weather, moment, moment, 11.5, factors))
    found = (RtaFormat(unit="mrad") if rotary else RtlFormat()).read(path)
    np.testing.assert_allclose(found.targets, targets, atol=1e-6)
    np.testing.assert_allclose(found.deviations, deviations, atol=2e-4 if rotary else 1e-3)
    assert found.ambient_start.air_degc == pytest.approx(21.25)
    assert found.ambient_start.pressure_hpa == pytest.approx(991.5)
    assert found.ambient_end.material_degc == pytest.approx((20.75,))
