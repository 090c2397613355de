"""Commands that open devices by themselves ask the service that has them first."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from gateway.broker import Broker, Lease
from gateway.cli.setup.check import ask_devices
from gateway.say import silence
from gateway.workflow.axes.dynamic import RecordingOptions, capture_dynamic
from gateway.workflow.run.folder import store_of
from tests.unit.web.test_daemon import SITE

SOON = {"timeout_s": 0.5}
AWAY = SITE.model_copy(
    update={
        "controller": SITE.controller.model_copy(update=SOON),
        "instruments": [one.model_copy(update=SOON) for one in SITE.instruments],
    }
)


async def check(path: Path) -> None:
    await ask_devices(AWAY, path)


async def dynamic(path: Path) -> None:
    await capture_dynamic(AWAY, path, RecordingOptions("laser", 1.0), LoopClock(), silence)


@pytest.mark.wall_time
@pytest.mark.parametrize("command", [check, dynamic])
async def test_devices_are_asked_of_the_service_before_they_are_opened(
    tmp_path: Path, command: Callable[[Path], Awaitable[None]]
) -> None:
    lent: list[str] = []

    async def lend(lease: Lease) -> None:
        lent.append(lease.run)

    path = tmp_path / "site.toml"
    root = store_of(AWAY, path).root
    root.mkdir()
    path.write_text("", encoding="ascii")  # a run keeps a copy
    async with Broker(lend, LoopClock()).open((root,)):
        with pytest.raises(TrueflankError) as caught:
            await command(path)  # nobody listens where the devices should be
    assert not caught.value.code.startswith("E-BROKER")
    assert len(lent) == 1
