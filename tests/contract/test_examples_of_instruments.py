"""What others build on: the package of a new instrument and the skeleton of a bridge, both as they are delivered."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import aclosing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.bridge.device import BridgeInstrument
from drivers.clock import LoopClock
from drivers.errors import ConfigError, DeviceRefused, NotReferenced
from drivers.types.sensing import SampleBlock
from gateway.cli.setup.init import check_name, write_package

EXAMPLES = Path(__file__).parents[2] / "examples"

# Runs where the package is installed: the registry finds the driver by its entry point alone, its settings too.
GUEST = """
from drivers import registry
from drivers.clock import LoopClock, run_virtual
from drivers.ports.instruments import Instrument
from laser_gauge.simulator import SimulatedLaserGauge

async def main():
    clock = LoopClock()
    listener = await SimulatedLaserGauge(clock, lambda _time_s: 2.0125).start("memory://gauge")
    spec = registry.known("instrument")["laser_gauge"]
    device = spec.load()("gauge", listener.url, {"rate_hz": 50.0}, clock)
    assert isinstance(device, Instrument)
    who = await device.open(5.0)
    stream = device.blocks()
    block = await anext(stream)
    await stream.aclose()
    await device.close()
    await listener.close()
    print(who.serial, block.values[:, 0].tolist(), spec.target, spec.load_settings().__name__)

run_virtual(main)
"""


def _python(code: list[str], *paths: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (*paths, Path(__file__).parents[2])))}
    ran = subprocess.run(
        [sys.executable, *code], cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `trueflank init instrument laser_gauge` writes."""
    folder = tmp_path_factory.mktemp("new")
    _python(["-m", "gateway.cli", "init", "instrument", "laser_gauge"], folder=folder)
    return folder / "trueflank-laser_gauge"


def test_a_new_instrument_is_installed_and_found_by_its_entry_point(package: Path, tmp_path: Path) -> None:
    install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
    target = tmp_path / "target"
    _python([*install, "--no-build-isolation", "--target", str(target), str(package)], folder=tmp_path)
    ran = _python(["-c", GUEST], target, folder=tmp_path)
    assert ran.stdout.strip() == f"DG-17 {[2.0125] * 5} laser_gauge.device:LaserGauge LaserGaugeSettings"


def test_the_tests_of_a_new_instrument_are_green_and_judge_its_driver(package: Path, tmp_path: Path) -> None:
    run = ["-m", "pytest", "-q", "-p", "no:cacheprovider", str(package)]
    assert "7 passed" in _python(run, folder=tmp_path).stdout
    spoiled = tmp_path / "spoiled"
    shutil.copytree(package, spoiled)
    codec = spoiled / "src" / "laser_gauge" / "codec.py"
    value = "float(found.group(2))"
    codec.write_text(codec.read_text("utf-8").replace(value, f"1.001 * {value}"), "utf-8")
    with pytest.raises(AssertionError, match="test_readings_follow_the_truth"):
        _python([*run[:-1], str(spoiled)], folder=tmp_path)


@pytest.mark.parametrize("name", ["1x", "class", "numpy", "umd", "Gauge", "g", "a-b"])
def test_a_name_that_no_driver_can_have_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as raised:
        check_name(name)
    assert raised.value.code == "E-INIT-PACKAGE-NAME"
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "kept.txt").write_text("mine")
    with pytest.raises(ConfigError) as raised:
        write_package("laser_gauge", tmp_path)
    assert raised.value.code == "E-INIT-PACKAGE-EXISTS"
    assert [path.name for path in tmp_path.iterdir()] == ["kept.txt"]


# The skeleton with another kit in its marked place: two channels, a beam that breaks and comes back, a skip.
FAKE_KIT = """
import sys
sys.path.insert(0, sys.argv[1])
import shim

class Kit(shim.YourKit):
    KIND = "angle"
    CHANNELS = ("pitch_arcsec", "yaw_arcsec")
    RATE_HZ = 200.0
    started = 0

    def open(self):
        return {"maker": "Fake", "model": "A-2", "serial": "77", "firmware": "3"}

    def start(self):
        Kit.started += 1
        if Kit.started > 2:
            raise shim.Refused(shim.NOT_REFERENCED, "turn it once")
        self.calls = 0
        self.number = 0

    def read(self):
        self.calls += 1
        lost = 4 if self.calls == 2 else 0
        self.number += lost
        first = self.number
        rows = [(float(first + at), -float(first + at)) for at in range(10)]
        self.number += 10
        events = [("beam_obstructed", first / 200.0)] if self.calls == 3 else []
        return rows, first / 200.0, self.calls != 3, lost, events

    def environment(self):
        return {"air_degc": 21.5, "pressure_hpa": None, "humidity_pct": None, "material_degc": [], "age_s": 1.0}

shim.serve(Kit(), 0)
"""


@contextmanager
def shim(code: list[str]) -> Iterator[str]:
    process = subprocess.Popen([sys.executable, *code], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().decode().strip()
    finally:
        process.kill()
        process.communicate()


async def five(device: BridgeInstrument) -> list[SampleBlock]:
    found = []
    async with aclosing(device.blocks()) as stream:  # type: ignore[type-var]
        async for block in stream:
            found.append(block)
            if sum(map(len, found)) >= 50:
                break
    return found


def check_stream(blocks: list[SampleBlock]) -> None:
    time_s = np.concatenate([block.time_s for block in blocks])
    values = np.concatenate([block.values for block in blocks])
    numbers = np.rint(time_s * 200.0)
    assert np.array_equal(values[:, 0], numbers)
    assert np.array_equal(values[:, 1], -numbers)
    assert sum(block.lost for block in blocks) == 4
    valid = np.concatenate([block.valid for block in blocks])
    assert np.flatnonzero(~valid).tolist() == list(range(20, 30))
    assert any("beam_obstructed" in str(event) for block in blocks for event in block.events)


def test_the_skeleton_of_a_bridge_serves_a_kit_in_both_forms() -> None:
    async def main(url: str) -> None:
        for framing in ("json", "binary"):
            device = BridgeInstrument("autocollimator", url, {"framing": framing}, LoopClock())
            who = await device.open(10.0)
            assert (who.model, who.serial) == ("Fake A-2", "77")
            assert device.channels == ("pitch_arcsec", "yaw_arcsec")
            check_stream(await five(device))
            assert (await device.ambient()).air_degc == 21.5
            assert (await device.optics()).kind == "unknown"
            with pytest.raises(DeviceRefused):
                await device.hold()
            await device.close()
        device = BridgeInstrument("autocollimator", url, {}, LoopClock())
        await device.open(10.0)
        with pytest.raises(NotReferenced, match="turn it once"):
            await five(device)
        await device.close()

    with shim(["-c", FAKE_KIT, str(EXAMPLES / "bridge-shim")]) as url:
        asyncio.run(main(url))


def test_the_skeleton_runs_as_it_is() -> None:
    async def main(url: str) -> Any:
        device = BridgeInstrument("laser", url, {}, LoopClock())
        await device.open(10.0)
        blocks = await five(device)
        ambient = await device.ambient()
        await device.close()
        assert ambient.air_degc is None
        assert "pretended" in device.notices[0]
        assert set(np.concatenate([block.values for block in blocks]).ravel().tolist()) == {0.0}

    with shim([str(EXAMPLES / "bridge-shim" / "shim.py"), "--port", "0"]) as url:
        asyncio.run(main(url))
