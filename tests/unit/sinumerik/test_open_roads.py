"""A road without protection is named wherever people look: line, panel, page, plan, report, audit; on both roads."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from drivers.clock import LoopClock
from drivers.errors import words
from drivers.sinumerik.mailbox.device import SinumerikModbus
from drivers.sinumerik.opcua.device import SinumerikOpcUa
from gateway import audit
from gateway.approve import UNPROTECTED, is_risk_taken, take_risk
from gateway.audience import Audience, kind_of
from gateway.cli.progress import LivePanel, progress
from gateway.cli.progress_state import ProgressState
from gateway.config import load_site, unprotected_connection
from gateway.report import render
from gateway.report.document.whole import document
from gateway.workflow.run import audit_trail
from tests.unit.approve.test_approve import CHANGE
from tests.unit.approve.test_consents import At
from tests.unit.programs.sites import site_file
from tests.unit.push.double import bench
from tests.unit.report.synthetic import material
from tests.unit.web.pictures import status

PINNED = {"security": "best", "server_certificate": "control.der"}
OPCUA, MAILBOX = (SinumerikOpcUa, "opc.tcp://192.168.214.1:4840"), (SinumerikModbus, "tcp://192.168.214.1:502")
ROADS: dict[str, tuple[Any, str, dict[str, Any], str]] = {
    "OPC UA": (*OPCUA, {"security": "None"}, "OPC UA with security None"),
    "Modbus TCP": (*MAILBOX, {}, "Modbus without TLS"),
    "Modbus RTU over a network": (SinumerikModbus, "socket://192.168.214.1:502", {}, "Modbus without TLS"),
}


@pytest.mark.parametrize("road", ROADS)
def test_the_driver_says_that_its_road_is_open(road: str) -> None:
    driver, url, settings, said = ROADS[road]
    assert str(driver("840D", url, settings, LoopClock()).capabilities.unprotected).startswith(said)


@pytest.mark.parametrize(
    ("driver", "url", "settings"), [(*OPCUA, PINNED), (SinumerikModbus, "COM5", {}), (SinumerikModbus, "usb://A7", {})]
)
def test_a_protected_road_and_a_cable_of_its_own_are_not_called_open(
    driver: Any, url: str, settings: dict[str, Any]
) -> None:
    assert driver("840D", url, settings, LoopClock()).capabilities.unprotected is None


def test_a_site_file_tells_it_before_anything_is_opened(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo", plan=False)
    assert str(unprotected_connection(load_site(path))).startswith("OPC UA with security None")
    plain = path.read_text(encoding="utf-8")
    path.write_text(plain.replace('security = "None"', 'security = "best", server_certificate = "c.der"'))
    assert unprotected_connection(load_site(path)) is None
    mailbox = plain.replace("sinumerik-opcua", "sinumerik-modbus").replace("opc.tcp://", "tcp://")
    path.write_text(mailbox.replace('security = "None"', "unit = 1"), encoding="utf-8")
    assert str(unprotected_connection(load_site(path))).startswith("Modbus without TLS")


@pytest.mark.parametrize("code", ["W-UA-UNPROTECTED", "W-MBX-UNPROTECTED"])
def test_line_panel_and_page_name_it(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    road = words(code)
    assert kind_of("P-UNPROTECTED") is Audience.LOUD
    with progress(quiet=False) as say:
        say("P-UNPROTECTED", road=road)
    assert f"UNPROTECTED: {road}" in capsys.readouterr().err
    drawn = io.StringIO()
    console = Console(file=drawn, width=160)
    with LivePanel("trueflank: mill", ProgressState(began=0.0), lambda: 0.0, Console(file=io.StringIO())) as panel:
        panel.told("P-UNPROTECTED", {"road": road})
        panel.told("P-SETUP-PLAN", {"number": 1, "total": 2, "setup": "EXX-X1"})
        panel.told("P-START", {"axis": "X1", "program": "TFMEASX"})
        console.print(panel.drawn())
    assert f"! the connection to the control is UNPROTECTED: {road}" in " ".join(drawn.getvalue().split())
    assert road in page_of(unprotected=road)
    assert "unprotected" not in page_of().lower()


def page_of(**changes: object) -> str:
    from gateway.web.app import _page  # the page without scripts, as the route renders it

    return str(_page("status.html.j2").render(status=status(**changes)))


@pytest.mark.parametrize("code", ["W-UA-UNPROTECTED", "W-MBX-UNPROTECTED"])
def test_the_report_names_it_first(code: str) -> None:
    made = material()
    told = replace(made, unprotected=words(code))
    assert f"The connection to the control was unprotected: {words(code)}." in render(told)
    assert "unprotected" not in render(made)
    first = document(told).blocks[0]
    assert "UNPROTECTED" in getattr(first, "text", "")


def test_the_audit_names_it_with_plan_and_push_and_who_took_the_risk(tmp_path: Path) -> None:
    at: Any = At.of(tmp_path, open_road=words("W-MBX-UNPROTECTED"))
    context = replace(bench(tmp_path / "control").context, risk_taken=True)
    audit_trail.record_start(at, CHANGE, context)
    audit_trail.record_start(replace(at, open_road=""), CHANGE, context)
    first, second = (entry["details"] for entry in audit.read_entries(at.store.root))
    assert (first["unprotected"], first["risk"]) == (at.open_road, "typed")
    assert {"unprotected", "risk"} & set(second) == set()


def test_the_risk_is_taken_word_for_word_and_for_one_command() -> None:
    for typed, taken in ((UNPROTECTED, True), (f" {UNPROTECTED} ", True), ("yes", False), ("", False)):
        with take_risk(typed):
            assert is_risk_taken() is taken
        assert not is_risk_taken()
