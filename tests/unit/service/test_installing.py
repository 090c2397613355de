"""The unit of the service manager: written, told to the manager, taken away; what a manager hears."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.clock import LoopClock
from gateway.cli import app
from gateway.cli.service import unit_text
from gateway.daemon.service_manager import Notifier, keep_telling
from tests.unit.ground.test_check import WHOLE


def test_the_unit_is_ready_when_the_page_is_watched_and_has_time_to_stop() -> None:
    text = unit_text([Path("/srv/hall 3/50%.toml"), Path("/srv/b.toml")], host="127.0.0.1", port=8617, user="grind")
    for wanted in ("Type=notify", "WatchdogSec=60", "Restart=on-failure", "KillMode=mixed", "User=grind"):
        assert wanted in text
    assert "serve '/srv/hall 3/50%%.toml' /srv/b.toml --host 127.0.0.1 --port 8617" in text
    whole = unit_text([Path("/srv/50%/a%.toml")], host="127.0.0.1", port=8617, user="")
    assert "WorkingDirectory=/srv/50%%\n" in whole, "a lone % is a word of the manager's"
    assert "for a%%\n" in whole
    stop_s = int(text.partition("TimeoutStopSec=")[2].split("\n")[0])
    assert stop_s > 30


@pytest.mark.skipif(os.name != "posix", reason="systemd")
def test_install_status_and_remove(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = tmp_path / "told"
    tool = tmp_path / "bin" / "systemctl"
    tool.parent.mkdir()
    tool.write_text(f'#!/bin/sh\necho "$@" >> {told}\n', encoding="ascii")
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", str(tool.parent), prepend=os.pathsep)
    site, units = tmp_path / "site.toml", tmp_path / "units"
    site.write_text(WHOLE, encoding="utf-8")

    def call(*words: str) -> tuple[int, str]:
        found = CliRunner().invoke(app, ["service", *words, "--user", "--folder", str(units)])
        return found.exit_code, found.output

    assert call("status")[0] == 3
    code, output = call("install", str(site))
    assert (code, "written" in output) == (0, True), output
    assert str(site) in (units / "trueflank.service").read_text(encoding="utf-8")
    assert call("status")[0] == 0
    good = tool.read_text(encoding="ascii")
    tool.write_text(good + "exit 1\n", encoding="ascii")
    code, output = call("install", str(site))
    assert (code, "does not run" in output, "journalctl --user -u trueflank" in output) == (3, True, True), output
    assert call("status")[0] == 3
    tool.write_text(good, encoding="ascii")
    assert call("remove")[0] == 0
    assert not (units / "trueflank.service").exists()
    assert site.exists()
    lines = told.read_text(encoding="ascii").splitlines()
    assert lines[:2] == ["--user daemon-reload", "--user enable --now trueflank"]
    assert lines[-2:] == ["--user disable --now trueflank", "--user daemon-reload"]


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="systemd")
async def test_the_manager_hears_ready_alive_and_stopping(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "60000000"})
        assert notifier.every_s == 30.0
        notifier.ready("hall-3")
        clock = LoopClock()
        import asyncio

        alive = asyncio.create_task(keep_telling(notifier, clock))
        await clock.sleep(70.0)
        alive.cancel()
        notifier.stopping()
        heard = []
        while len(heard) < 5:
            heard.append(manager.recv(400).decode("ascii"))
    assert heard[0].startswith("READY=1")
    assert heard[1:4] == ["WATCHDOG=1"] * 3
    assert heard[4] == "STOPPING=1\nEXTEND_TIMEOUT_USEC=60000000"


async def test_without_a_manager_nothing_is_told() -> None:
    notifier = Notifier({})
    notifier.ready("x")
    notifier.stopping()
    await keep_telling(notifier, LoopClock())
    assert Notifier({"WATCHDOG_USEC": "60000000", "WATCHDOG_PID": "1"}).every_s == 0.0
