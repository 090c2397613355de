"""Whose machine is behind a mailbox and behind an agent: asked, refused, accepted, told; by the commands."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from gateway.cli import app
from gateway.config import load_site
from gateway.report.document.whole import document
from gateway.workflow.run.folder import known_of
from simulators.modbus import running_station
from simulators.nck import AxisSpec, Nck, NckSpec
from tests.contract.linuxcnc_stage import on_stage
from tests.unit.report.synthetic import material

AXES = (AxisSpec("X1", "X", eec_points=(73, 0)), AxisSpec("C1", "C", rotary=True, modulo=True, eec_points=(80, 0)))
SITE = """
[site]
name = "mill"
[controller]
driver = "{driver}"
url = "{url}"
serial = "{serial}"
[controller.identity]
version = "{version}"
axes = "{axes}"
[controller.settings]
{settings}
[[instruments]]
name = "typed"
driver = "manual"
url = "terminal://"
[[axes]]
name = "{axis}"
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


@dataclass
class Scene:
    """A control, a site of it, and how it becomes another by one fact, then by a second one too."""

    site: Path
    facts: dict[str, str]
    one: Callable[[], tuple[str, str]]
    two: Callable[[], None]

    async def typed(self, *words: str, answers: str = "") -> Result:
        return await asyncio.to_thread(CliRunner().invoke, app, [*words], input=answers)

    async def refused(self, *words: str, answers: str = "") -> TrueflankError:
        error = (await self.typed(*words, answers=answers)).exception
        assert isinstance(error, TrueflankError)
        return error

    async def lines(self) -> list[dict[str, Any]]:
        done = await self.typed("doctor", str(self.site), "--json")
        return [one for one in json.loads(done.stdout)["lines"] if one["check"] == "identity"]


def site_at(folder: Path, url: str, facts: dict[str, str], **given: str) -> Path:
    path = folder / "site.toml"
    text = SITE.format(url=url, serial=facts["serial"], version=facts["version"], axes=facts["axes"], **given)
    path.write_text(text, encoding="utf-8")
    return path


@asynccontextmanager
async def mailbox(folder: Path) -> AsyncIterator[Scene]:
    """The memory card is exchanged; then the NCK has another version too."""
    clock, facts = LoopClock(), {"serial": "CARD-1", "version": "V4.8", "axes": "X1 C1"}
    nck = Nck(NckSpec(AXES, serial="CARD-1", nck_version="V4.8", access_level=2), clock)
    await nck.start()

    def one() -> tuple[str, str]:
        nck.spec = replace(nck.spec, card_exchanged="CARD-2")
        return "serial", "CARD-2"

    def two() -> None:
        nck.spec = replace(nck.spec, software_updated="V4.95")

    try:
        async with running_station(nck, clock) as station:
            site = site_at(folder, station.home, facts, driver="sinumerik-modbus", settings="", axis="X1")
            yield Scene(site, facts, one, two)
    finally:
        await nck.stop()


@asynccontextmanager
async def agent(folder: Path) -> AsyncIterator[Scene]:
    """LinuxCNC is updated; then the INI file names the machine otherwise too."""
    async with on_stage(folder, "tcp://127.0.0.1:0") as on:
        seen = await on.device.identify()
        facts = {"serial": seen.serial, "version": seen.version, "axes": " ".join(seen.axis_names)}

        def one() -> tuple[str, str]:
            on.machine.version = "2.9.4"
            return "version", "2.9.4"

        def two() -> None:
            ini = on.machine.ini_path
            ini.write_text(ini.read_text().replace("MACHINE = mill", "MACHINE = lathe"))
            on.machine.restart()

        settings = f'token_file = "{on.token.name}"'
        yield Scene(
            site_at(folder, on.url, facts, driver="linuxcnc-agent", settings=settings, axis="X"), facts, one, two
        )


@pytest.mark.wall_time
@pytest.mark.parametrize("control", [mailbox, agent])
async def test_one_fact_is_asked_kept_and_told_and_two_are_refused(
    tmp_path: Path, control: Callable[[Path], Any]
) -> None:
    async with control(tmp_path) as at:
        site = str(at.site)
        fact, now = at.one()
        asked = await at.refused("doctor", "identity", site, answers="")
        assert asked.code == "E-SUP-IDENTITY"
        for told in (fact, at.facts[fact], now, f"--accept-identity {fact}="):
            assert told in str(asked)
        (line,) = await at.lines()
        assert (line["code"], line["fields"]["fact"], line["fields"]["now"]) == ("E-DOC-IDENTITY", fact, now)
        no_reason = await at.refused("doctor", "identity", site, answers="y\n\n")
        assert no_reason.code == "E-SUP-IDENTITY"
        assert not (tmp_path / "runs" / "identity").exists()

        done = await at.typed("doctor", "identity", site, answers="y\nchanged at service\n")
        assert done.exit_code == 0, done.output
        lines = await at.lines()
        assert (lines[-1]["code"], {one["outcome"] for one in lines}) == ("W-DOC-ACCEPTED", {"ok"})
        known = known_of(load_site(at.site), tmp_path / "runs")
        said = str(document(replace(material(), accepted=known.accepted, axes=())).blocks[:2])
        for told in (fact, at.facts[fact], now, "changed at service"):
            assert told in said

        at.two()
        if fact == "version":  # it was accepted as it is now: the other fact alone is another
            assert (await at.refused("doctor", "identity", site, answers="")).fields["fact"] == "serial"
        else:
            assert (await at.refused("doctor", "identity", site, answers="")).fields["fact"] == "version"


@pytest.mark.wall_time
@pytest.mark.parametrize("control", [mailbox, agent])
async def test_two_facts_at_once_are_another_machine(tmp_path: Path, control: Callable[[Path], Any]) -> None:
    async with control(tmp_path) as at:
        site = str(at.site)
        fact, _now = at.one()
        at.two()
        refused = await at.typed("doctor", "identity", site, answers="y\nsurely\n")
        assert refused.exit_code == 5
        assert "that you have checked at the machine" in refused.output
        given = await at.refused("doctor", "identity", site, "--accept-identity", f"{fact}=surely")
        assert given.code == "E-SUP-MACHINE"
        assert not (tmp_path / "runs" / "identity").exists()
        assert [one["code"] for one in await at.lines()] == ["E-DOC-MACHINE"]
