"""`trueflank init` against a control: certificate by thumbprint, axes and limits read, a file that check accepts."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.clock import LoopClock
from drivers.sinumerik.opcua.session import certificates
from gateway.cli import app
from gateway.cli.setup.check import check_site, compare_with_control
from gateway.cli.setup.wizard import survey_control
from simulators.nck import AxisSpec, Nck, NckSpec
from simulators.opcua import SinumerikServer

PASSWORD = "fivefold-77"
FIVE = NckSpec(
    (
        AxisSpec("X1", "X", travel=(-650.0, 650.0), eec_points=(131, 0)),
        AxisSpec("Y1", "Y", travel=(-300.0, 450.0), eec_points=(0, 80)),
        AxisSpec("Z1", "Z", travel=(-500.0, 50.0), eec_points=(60, 0)),
        AxisSpec("B1", "B", rotary=True, travel=(-110.0, 110.0), eec_points=(50, 0)),
        AxisSpec("C1", "C", rotary=True, modulo=True, eec_points=(80, 0)),
    ),
    serial="FIVE-1",
    access_level=2,
)


@pytest.mark.wall_time
async def test_a_five_axis_machine_from_an_empty_folder(tmp_path: Path) -> None:
    clock = LoopClock()
    nck = Nck(FIVE, clock)
    await nck.start()
    users = {"users": {"trueflank": PASSWORD}, "folder": str(tmp_path / "control")}
    server = SinumerikServer(nck, clock, users)
    await server.start()
    try:
        shown = certificates.load_certificate(await asyncio.to_thread(Path(server.certificate).read_bytes))
        thumbprint = certificates.short_fingerprint(shown).lower()
        typed = ["opcua", "five", server.url, "trueflank", PASSWORD, "00:11", thumbprint, "", "", "", "", ""]
        (tmp_path / "mine").mkdir()
        path = tmp_path / "mine" / "site.toml"
        done = await asyncio.to_thread(CliRunner().invoke, app, ["init", str(path)], input="\n".join(typed) + "\n")
        assert done.exit_code == 0, done.output
        assert "this is not the thumbprint" in done.output
        assert len(typed) - 1 + 2 <= 13, "questions, and the commands init and check"
        found = check_site(path)
        assert found.faults == ()
        assert [one.path for one in found.doubts] == [("moves", "safe")]
        site = found.site
        assert site.controller.serial == "FIVE-1"
        assert site.controller.identity.facts == {"version": FIVE.nck_version, "axes": "X1 Y1 Z1 B1 C1"}
        assert [(axis.name, axis.kind, axis.modulo, axis.encoder) for axis in site.axes] == [
            ("X1", "linear", False, 0),
            ("Y1", "linear", False, 1),
            ("Z1", "linear", False, 0),
            ("B1", "rotary", False, 0),
            ("C1", "rotary", True, 0),
        ]
        assert [axis.travel for axis in site.axes[:4]] == [axis.travel for axis in FIVE.axes[:4]]
        assert PASSWORD not in path.read_text()
        control = site.controller
        facts = await survey_control(control.driver, control.url, control.settings, clock=clock, timeout_s=5.0)
        assert list(compare_with_control(site, facts)) == []
        assert server.requests.services["write"] == 0
    finally:
        await server.stop()
        await nck.stop()
