"""`trueflank grind` without consent: the program, its places and set-up values, and nothing is opened."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.clock import LoopClock
from drivers.errors import TrueflankError
from drivers.types.identity import MachineIdentity
from gateway.cli import app
from gateway.config import load_site
from gateway.store.machine_books import SetupBook
from gateway.tooth import SetupValues
from gateway.workflow.run.folder import store_of
from simulators.cell.site import gear_text, site_text
from simulators.cellfile import load_cell, with_plan


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """The demo cell's site file, with nothing behind it."""
    cell = with_plan(load_cell("demo"))
    assert cell.part is not None
    gear = tmp_path / "gear.toml"
    gear.write_text(gear_text(cell.part), encoding="utf-8")
    urls = {one.name: "tcp://127.0.0.1:1" for one in cell.instruments}
    control = {"url": "opc.tcp://127.0.0.1:1", "settings": {"security": "None"}}
    path = tmp_path / "site.toml"
    path.write_text(site_text(cell, cell.machine.serial, control, urls, str(gear)), encoding="utf-8")
    return path


def shown(site: Path, *options: str) -> str:
    result = CliRunner().invoke(app, ["grind", str(site), *options], catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


def test_what_is_kept_for_the_gear_is_shown_unless_told_otherwise(site: Path) -> None:
    tree = load_site(site)
    root = store_of(tree, site).root

    async def keep() -> None:
        machine = MachineIdentity(tree.controller.serial, "V", ("X1",))
        SetupBook(root).save(machine, "RV-40E-like", SetupValues(2.5, -7.2, 4.0), run="r", clock=LoopClock())

    asyncio.run(keep())
    data = json.loads(shown(site, "--json", "--dressing-um", "-1"))
    assert data["setup"] == {"x_um": 2.5, "c_arcsec": -7.2, "dressing_um": -1.0}
    places = {(one["axis"], one["place"]) for one in data["places"]}
    assert {("X1", -170.0), ("X1", -159.9975), ("Z1", 137.0), ("Z1", 163.0), ("C1", 4.998)} <= places
    assert "Y1" not in {axis for axis, _ in places}  # it carries the dresser
    assert "IF R200<>UWSET GOTOF TF_REFUSED" in data["program"]
    assert "FOR USPACE=0 TO 38" in data["program"]
    assert 180 < data["seconds"] < 480
    text = shown(site)
    assert "x +2.5 µm, C -7.2 arcsec, dressing +4.0 µm" in text
    assert "nothing was sent" in text
    assert "TRUEFLANK LOAD BLANK" not in text
    assert "-170.0000" in text
    assert "enter: x zero +2.5 µm" in " ".join(text.split())


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (("--x-um", "201"), "E-GRIND-VALUE"),
        (("--c-arcsec", "nan"), "E-GRIND-VALUE"),
        (("--machine", "demo"), "E-GRIND-NAME"),
    ],
)
def test_what_is_refused(site: Path, options: tuple[str, ...], code: str) -> None:
    with pytest.raises(TrueflankError) as caught:
        CliRunner().invoke(app, ["grind", str(site), *options], catch_exceptions=False)
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("[work]", "[nothing]\n[work]", "E-CFG-KEY"),
        ("height_mm = 150.0", 'height_mm = 150.0\ninfeed = "Q"', "E-GRIND-AXIS"),
        ("height_mm = 150.0", 'height_mm = 150.0\nindex = "Z"', "E-GRIND-AXIS"),
        ("height_mm = 150.0", "height_mm = 310.0", "E-GRIND-TRAVEL"),
        ("height_mm = 150.0", "height_mm = 150.0\noverrun_mm = 2", "E-GRIND-VALUE"),
    ],
)
def test_a_site_that_cannot_grind_is_told_where(site: Path, old: str, new: str, code: str) -> None:
    site.write_text(site.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(TrueflankError) as caught:
        CliRunner().invoke(app, ["grind", str(site)], catch_exceptions=False)
    assert caught.value.code == code
    assert "<" not in str(caught.value)


def test_a_site_without_work_and_one_whose_road_runs_no_programs(site: Path) -> None:
    text = site.read_text(encoding="utf-8")
    site.write_text(text.replace('driver = "sinumerik-opcua"', 'driver = "sinumerik-modbus"'), encoding="utf-8")
    assert "runs no programs" in shown(site)
    site.write_text(text.split("[work]")[0], encoding="utf-8")
    with pytest.raises(TrueflankError) as caught:
        CliRunner().invoke(app, ["grind", str(site)], catch_exceptions=False)
    assert caught.value.code == "E-GRIND-NO-WORK"
