"""Whose machine is behind an address: one fact that is another is asked, several are refused; by the commands."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from drivers import registry
from drivers.checks import Wanted
from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from drivers.offline_exchange import PieceOfWork, ToCarry, exchange_files_for
from drivers.sinumerik.offline.device import OfflineDoctor, SinumerikOffline
from drivers.types.identity import KnownAs, MachineIdentity, likeness
from gateway.audit.chain import read_entries
from gateway.cli import app
from gateway.config import load_site
from gateway.domain.identity import KnownFact, known_machine
from gateway.report.document.whole import document
from gateway.report.particulars import Particulars
from gateway.supervisor import Supervisor
from gateway.workflow.run.folder import known_of
from gateway.workflow.run.identity import IdentityCheck
from simulators.faults import named_faults
from simulators.nck import AxisSpec, Nck, NckSpec
from simulators.opcua import SinumerikServer
from tests.offline.world import offline_world
from tests.unit.report.synthetic import material

AXES = (AxisSpec("X1", "X", eec_points=(73, 0)), AxisSpec("C1", "C", rotary=True, modulo=True, eec_points=(80, 0)))
SPEC = NckSpec(AXES, serial="CARD-1", nck_version="V4.8", access_level=2)
SITE = """
[site]
name = "mill"
[controller]
url = "{url}"
serial = "CARD-1"
[controller.identity]
version = "V4.8"
axes = "X1 C1"
[controller.settings]
user = "trueflank"
password_file = "password.txt"
security = "None"
{settings}
[[instruments]]
name = "typed"
driver = "manual"
url = "terminal://"
[[axes]]
name = "X1"
letter = "X"
kind = "linear"
travel = [0.0, 360.0]
[axes.measure]
instrument = "typed"
component = "EXX"
targets = {{ first = 0.0, last = 360.0, count = 5 }}
repetitions = 2
overrun = 2.0
feed = 3000.0
stable = 1.0
[axes.table]
minimum = 0.0
maximum = 360.0
step = 5.0
"""
MARKED = 'type_node = "/Nck/Configuration/nckType"\nr_marker = 900'


@dataclass
class Scene:
    """A control of these facts, a site of the first ones, and the commands at a terminal."""

    site: Path
    nck: Nck
    server: SinumerikServer

    async def typed(self, *words: str, answers: str = "") -> Result:
        return await asyncio.to_thread(CliRunner().invoke, app, [*words], input=answers)

    async def json(self, *words: str) -> dict[str, Any]:
        done = await self.typed(*words, "--json")
        return dict(json.loads(done.stdout))


@asynccontextmanager
async def control(folder: Path, settings: str = "", marker: float = 0.0, **faults: Any) -> AsyncIterator[Scene]:
    clock = LoopClock()
    nck = Nck(replace(SPEC, **faults), clock)
    await nck.start()
    nck.set("R[900]", marker, 0)
    server = SinumerikServer(nck, clock, {"users": {"trueflank": "secret"}, "folder": str(folder / "control")})
    await server.start()
    site = folder / "site.toml"
    site.write_text(SITE.format(url=server.url, settings=settings), encoding="utf-8")
    (folder / "password.txt").write_text("secret\n")
    try:
        yield Scene(site, nck, server)
    finally:
        await server.stop()
        await nck.stop()


@pytest.mark.wall_time
async def test_a_card_that_was_moved_is_asked_kept_and_told(tmp_path: Path) -> None:
    async with control(tmp_path, card_exchanged="CARD-2") as at:
        site = str(at.site)
        refused = await at.typed("doctor", "devices", site, answers="")
        assert isinstance(refused.exception, TrueflankError), refused.output
        assert refused.exception.code == "E-SUP-IDENTITY"
        for told in ("serial", "CARD-1", "CARD-2", f"doctor identity {site} --accept-identity serial="):
            assert told in str(refused.exception)
        doctor = await at.json("doctor", site)
        (line,) = [one for one in doctor["lines"] if one["code"] == "E-DOC-IDENTITY"]
        assert line["fields"] == {"fact": "serial", "was": "CARD-1", "now": "CARD-2", "same": "version, axes"}
        answered = await at.typed("doctor", "devices", site, answers="y\ncard exchanged at service\n")
        assert answered.exit_code == 0, answered.output
        tree, clock = load_site(at.site), LoopClock()
        supervisor = Supervisor(tree, clock, recognise=IdentityCheck(tree, at.site, tmp_path / "runs", clock))
        try:
            opened = await supervisor.open_all()
            assert (opened.serial, opened.differences(await supervisor.controller.identify())) == ("CARD-1", ())
            at.nck.spec = replace(at.nck.spec, card_exchanged="CARD-3")
            assert opened.differences(await supervisor.controller.identify()) == ("serial",)
            at.nck.spec = replace(at.nck.spec, card_exchanged="")
            assert opened.differences(await supervisor.controller.identify()) == ("serial",), "the old card, elsewhere"
            at.nck.spec = replace(at.nck.spec, card_exchanged="CARD-2")
        finally:
            await supervisor.close_all()
        doctor = await at.json("doctor", site)
        (line,) = [one for one in doctor["lines"] if one["code"] == "W-DOC-ACCEPTED"]
        assert "card exchanged at service" in line["what"]
        assert not [one for one in doctor["lines"] if one["check"] in ("identity", "serial number") and one["fix"]]
        (kept,) = [one for one in read_entries(tmp_path / "runs") if one["action"] == "identity-accept"]
        assert (kept["serial"], kept["details"]["now"]) == ("CARD-1", "CARD-2")
        sheet = tmp_path / "sheet.html"
        accepted = await at.typed("doctor", "accept", site, "--sheet", str(sheet))
        lines = accepted.output.splitlines()
        wrong = [line for line in lines if line.startswith("WRONG")]
        assert any("security None" in line for line in wrong), "this scene has no secure channel"
        assert not [line for line in wrong if "CARD-" in line]
        assert len([line for line in lines if "devices open" in line]) <= 1
        for told in ("CARD-1", "CARD-2", "card exchanged at service"):
            assert told in sheet.read_text(encoding="utf-8")
        assert at.server.requests.services["write"] == 0


@pytest.mark.wall_time
async def test_card_and_axes_at_once_are_another_machine(tmp_path: Path) -> None:
    async with control(tmp_path, card_exchanged="CARD-2", axes_swapped=True) as at:
        site = str(at.site)
        refused = await at.typed("doctor", "devices", site, answers="y\nsurely\n")
        assert isinstance(refused.exception, TrueflankError)
        assert refused.exception.code == "E-SUP-MACHINE"
        assert "axes: X1 C1 -> C1 X1" in str(refused.exception)
        given = await at.typed("doctor", "identity", site, "--accept-identity", "serial=surely")
        assert isinstance(given.exception, TrueflankError)
        assert given.exception.code == "E-SUP-MACHINE"
        shown = await at.json("doctor", "identity", site)
        assert (shown["ok"], shown["accepted"]) == (False, [])
        assert not (tmp_path / "runs" / "identity").exists()
        doctor = await at.json("doctor", site)
        assert [one["code"] for one in doctor["lines"] if one["check"] == "identity"] == ["E-DOC-MACHINE"]


@pytest.mark.wall_time
async def test_a_marker_is_noted_first_and_asked_when_it_is_another(tmp_path: Path) -> None:
    async with control(tmp_path, MARKED, marker=4711.0) as at:
        site = str(at.site)
        tree = load_site(at.site)
        looked = await at.json("doctor", "identity", site)
        now = {"serial": "CARD-1", "version": "V4.8", "axes": "X1 C1", "type": "10000", "marker": "4711"}
        assert looked["now"] == now
        assert looked["known"] == {"serial": "CARD-1", "version": "V4.8", "axes": "X1 C1"}
        clock = LoopClock()
        IdentityCheck(tree, at.site, tmp_path / "runs", clock)(identity(now))
        assert known_of(tree, tmp_path / "runs").facts == now
        at.nck.set("R[900]", 4712.0, 0)
        for wrong in ("marker=", "marker", "colour=red"):
            given = await at.typed("doctor", "identity", site, "--accept-identity", wrong)
            assert isinstance(given.exception, TrueflankError)
            assert given.exception.code == "E-IDENTITY-ACCEPT"
        other = await at.typed("doctor", "identity", site, "--accept-identity", "version=updated")
        assert isinstance(other.exception, TrueflankError)
        assert other.exception.code == "E-IDENTITY-SAME"
        asked = await at.typed("doctor", "identity", site, "--no-ask")
        assert asked.exit_code == 5
        assert "4711" in asked.output
        done = await at.typed("doctor", "identity", site, "--accept-identity", "marker=R parameters were set up anew")
        assert done.exit_code == 0, done.output
        assert known_of(tree, tmp_path / "runs").facts == {**now, "marker": "4712"}
        assert at.server.requests.services["write"] == 0


@pytest.mark.wall_time
async def test_the_marker_may_be_any_node_that_the_server_shows(tmp_path: Path) -> None:
    """As a GUD is: here another variable stands for it, whose value is the machine's own number."""
    async with control(tmp_path, 'marker_node = "/Nck/Configuration/nckType"') as at:
        looked = await at.json("doctor", "identity", str(at.site))
        assert looked["now"]["marker"] == "10000"
        text = at.site.read_text()
        at.site.write_text(text.replace("marker_node", "r_marker = 900\nmarker_node"))
        twice = await at.typed("check", str(at.site))
        assert (twice.exit_code, "r_marker and marker_node" in " ".join(twice.output.split())) == (2, True)


async def test_carried_reports_tell_the_marker_and_the_card(tmp_path: Path) -> None:
    async with offline_world(LoopClock(), tmp_path, card_exchanged="CARD-2") as world:
        world.nck.set("R[900]", 4711.0, 0)
        axes = " ".join(axis.name for axis in world.nck.spec.axes)
        settings = {"folder": str(world.folder), "axes": axes, "r_marker": 900}
        for _ in range(2):
            device = SinumerikOffline("840D", "carried://stick", settings, world.clock)
            with exchange_files_for(PieceOfWork("look", "go-on", ends=True)), suppress(ToCarry):
                await device.open(60.0)
                break
            await world.porter.work_through_sheet()
        found = await device.identify()
        assert (found.serial, found.axis_names, found.marker) == ("CARD-2", tuple(axes.split()), "4711")
        wanted = Wanted("CARD-1", facts={"axes": axes, "marker": "4711"})
        lines = await OfflineDoctor("840D", "carried://stick", settings, world.clock).examine(wanted, 1.0)
        assert [line.code for line in lines] == ["E-DOC-IDENTITY", "W-OFF-ROAD"]
        device.known_as = {"CARD-2": "CARD-1"}
        assert (await device.identify()).serial == "CARD-1"


@pytest.mark.parametrize("driver", ["sinumerik-opcua", "sinumerik-modbus", "sinumerik-offline", "linuxcnc-agent"])
def test_every_control_can_be_called_by_the_name_that_is_kept(driver: str) -> None:
    assert issubclass(registry.load(driver, "controller"), KnownAs)


def test_the_double_can_be_another_machine_fact_by_fact() -> None:
    names = {f"control.{name}" for name in ("card_exchanged", "software_updated", "hardware_exchanged", "axes_swapped")}
    assert names <= set(named_faults())
    other = replace(SPEC, card_exchanged="CARD-2", software_updated="V5", hardware_exchanged=14000.0, axes_swapped=True)
    assert (other.identity, other.places) == (("CARD-2", "V5", 14000.0), ("C1", "X1"))


def test_every_report_tells_what_was_accepted() -> None:
    fact = KnownFact(1, "A", "serial", "CARD-2", "2026-02-03T00:00:00+00:00", was="CARD-1", who="ann", reason="service")
    run = material()
    for language in ("en", "de", "zh"):
        told = replace(run, accepted=(fact,), particulars=Particulars(language=language), axes=())
        said = str(document(told).blocks[:2])
        assert [word for word in ("CARD-1", "CARD-2", "ann", "2026-02-03", "service") if word not in said] == []


def identity(facts: dict[str, str]) -> MachineIdentity:
    rest = {name: facts[name] for name in ("type", "marker") if name in facts}
    return MachineIdentity(facts["serial"], facts["version"], tuple(facts["axes"].split()), **rest)  # type: ignore[arg-type]


MACHINE = MachineIdentity("A", "V1", ("X1", "C1"))
KNOWN = {"serial": "A", "version": "V1", "axes": "X1 C1", "marker": "7"}


@pytest.mark.parametrize(
    ("machine", "known", "asked", "refused"),
    [
        (MACHINE, KNOWN, False, False),
        (replace(MACHINE, serial="B"), KNOWN, True, True),
        (replace(MACHINE, version="V2"), KNOWN, True, True),
        (replace(MACHINE, axis_names=("C1", "X1")), KNOWN, True, True),
        (replace(MACHINE, marker="8"), KNOWN, True, True),
        (replace(MACHINE, marker="8", version="V2"), KNOWN, False, True),
        (replace(MACHINE, serial="B"), {"serial": "A"}, False, True),
        (replace(MACHINE, version="V2"), {"serial": "A"}, False, False),
    ],
)
def test_one_fact_is_asked_where_others_agree(
    machine: MachineIdentity, known: dict[str, str], asked: bool, refused: bool
) -> None:
    found = likeness(known, machine)
    assert (found.is_asked, not found.is_known) == (asked, refused)


def test_what_was_accepted_counts_while_it_begins_at_what_was_known() -> None:
    def kept(number: int, was: str, value: str) -> KnownFact:
        return KnownFact(
            number, "A", "version", value, "2026-01-01T00:00:00+00:00", was=was, who="ann", reason="update"
        )

    steps = (kept(2, "V2", "V3"), kept(1, "V1", "V2"))
    assert known_machine({"version": "V1"}, steps).facts == {"version": "V3"}
    corrected = known_machine({"version": "V4"}, steps)
    assert (corrected.facts, corrected.accepted) == ({"version": "V4"}, ())
    back = known_machine({"version": "V1"}, (*steps, kept(3, "V3", "V1")))
    assert (back.facts, len(back.accepted)) == ({"version": "V1"}, 3)
