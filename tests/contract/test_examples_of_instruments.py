"""What others build on: a driver package from outside and the skeleton of a bridge, both as they are delivered."""

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
from drivers.errors import DeviceRefused, NotReferenced
from drivers.types.sensing import SampleBlock

EXAMPLES = Path(__file__).parents[2] / "examples"

# Runs where the package is installed: the registry finds the driver by its entry point alone.
GUEST = """
import asyncio
from drivers import registry
from drivers.clock import LoopClock, run_virtual
from drivers.ports.instruments import Instrument
from drivers.transport import serve

async def gauge(wire):
    number = 0
    while True:
        await wire.read(100)
        number += 1
        await wire.write(b"DG-17 +%d.0125\\r\\n" % number)

async def main():
    clock = LoopClock()
    listener = await serve("memory://gauge", gauge, clock)
    spec = registry.known("instrument")["dialgauge"]
    device = spec.load()("gauge", listener.url, {"rate_hz": 50.0}, clock)
    assert isinstance(device, Instrument)
    who = await device.open(5.0)
    stream = device.blocks()
    block = await anext(stream)
    await stream.aclose()
    await device.close()
    await listener.close()
    print(who.serial, block.values[:, 0].tolist(), spec.target)

run_virtual(main)
"""


def test_a_driver_from_outside_is_installed_and_found_by_its_entry_point(tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "target"
    shutil.copytree(EXAMPLES / "third-party-instrument", source)
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-index",
        "--no-deps",
    ]
    subprocess.run([*install, "--no-build-isolation", "--target", str(target), str(source)], check=True, timeout=120)
    paths = os.pathsep.join((str(target), str(Path(__file__).parents[2])))
    environment = {**os.environ, "PYTHONPATH": paths}
    guest = [sys.executable, "-c", GUEST]
    ran = subprocess.run(guest, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip() == "DG-17 [2.0125, 3.0125, 4.0125, 5.0125, 6.0125] dialgauge:DialGauge"


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
    assert any("beam_obstructed" in event for block in blocks for event in block.events)


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
