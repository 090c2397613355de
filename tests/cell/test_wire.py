"""Separate processes on loopback sockets: the command line against a cell, and a gateway killed half way."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simulators.cellfile import load_cell
from tests.cell.bench import short
from tests.selftested import keep

MACHINE = "demo-grinder"
TRIES = 2400


def _command(*words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "gateway.cli", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _ended(*words: str) -> tuple[int, str, str]:
    with _command(*words) as process:
        out, err = process.communicate(timeout=240)
        return process.returncode, out, err


def _short_site(cell: Any) -> Path:
    text = cell.site.read_text(encoding="utf-8")
    cell.site.write_text(short(("C1",), 12, 4)(text), encoding="utf-8")
    return Path(cell.site)


def _until(cell: Any, process: subprocess.Popen[str], good: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    for _ in range(TRIES):
        status: dict[str, Any] = cell.ask("status")
        if good(status):
            return status
        try:
            process.wait(0.05)  # a pause that the process' own end cuts short
        except subprocess.TimeoutExpired:
            continue
        if not good(cell.ask("status")):
            continue
    raise AssertionError(f"the cell never came to that state: {cell.ask('status')}")


@pytest.mark.long
def test_a_run_over_the_wires_makes_the_axis_better(trueflank_cell: Any) -> None:
    cell = trueflank_cell("demo", speed=300.0, seed=4)
    site = _short_site(cell)
    code, out, _err = _ended("doctor", "devices", str(site), "--json")
    assert code == 0
    assert {device["device"] for device in json.loads(out)["devices"]} >= {"controller", "laser", "calibrator"}
    before = cell.ask("figures", axis="C1")["live"]
    code, out, _err = _ended("doctor", "self-test", str(site), "--json")
    assert (code, list(json.loads(out)["axes"])) == (0, ["C1"])
    code, out, err = _ended("run", str(site), "--apply", "--machine", MACHINE, "--json")
    assert code == 0, err
    told = json.loads(out)
    after = cell.ask("figures", axis="C1")["live"]
    assert told["outcome"] == "better"
    assert after["M"] < 0.5 * before["M"]
    assert abs(told["axes"]["C1"]["before"]["M"] - before["M"]) < 2.0
    assert Path(told["report"]["html"]).exists()


@pytest.mark.long  # kills in a process of its own stay in tests/push/test_kill_opcua.py
def test_the_gateway_killed_in_the_middle_of_a_push(trueflank_cell: Any) -> None:
    cell = trueflank_cell("demo", speed=300.0, seed=6)
    site = _short_site(cell)
    keep(site, load_cell("demo"))
    first = cell.ask("tables")
    cell.set("operator", options={"activate_delay_s": 900.0})  # long enough to die before the control is restarted
    with _command("run", str(site), "--apply", "--machine", MACHINE, "--json") as gateway:
        _until(cell, gateway, lambda status: status["message"].startswith("TRUEFLANK ACTIVATE"))
        gateway.kill()
        gateway.communicate()
        cell.set("channel_reset")
        status = _until(cell, gateway, lambda seen: seen["channel"] == 0)
    assert cell.ask("tables")["tables"]["C1"]["enabled"] == 0.0
    assert status["alarms"] == []

    code, _out, err = _ended("run", str(site), "--apply", "--machine", MACHINE, "--json")
    assert code != 0, "a push was left unfinished, so nothing more may be written"
    code, out, _err = _ended("recover", str(site), "--json")
    assert code == 0
    found = json.loads(out)
    # Trials of a table and of the reversal were in one transaction; of the one value nothing had been written yet.
    assert [finding["axis"] for finding in found] == ["C1", "C1"]
    assert sorted(finding["action"] for finding in found) == ["close", "restore"]
    code, _out, err = _ended("recover", str(site), "--apply", "--machine", MACHINE)
    assert code == 0, err
    assert cell.ask("tables") == first
    code, out, _err = _ended("recover", str(site), "--json")
    assert (code, json.loads(out)) == (0, [])
