"""`run --plan` and `close --plan`: the day from the site file alone, and what speaks against reckoning it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError
from gateway.cli import app
from gateway.config import load_site
from gateway.workflow.forecast import day_of_closing, day_of_run
from tests.unit.programs.sites import site_file

SETUPS = 28  # of the demo cell: 18 error motions, B0Z by four, A0C and B0C with the table at two places, X0C, Y0C


def edited(path: Path, change: Callable[[str], str]) -> Path:
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    return path


def test_every_setup_is_mounted_once_and_programs_hold_as_many_as_the_site_says(tmp_path: Path) -> None:
    """Two plans each, and four that park C: 60 plans are three programs of 24, or one of the usual size."""
    path = site_file(tmp_path, "demo", plans_per_program=24)
    day = day_of_closing(load_site(path), path, apply=False)
    assert len(day.mountings) == SETUPS
    assert [one.component for one in day.mountings][-3:] == ["ECC", "EXX", "EZZ"]
    assert (len(day.presses), day.resets, day.blanks) == (3, (), 0)
    path = site_file(tmp_path, "demo")
    assert len(day_of_closing(load_site(path), path, apply=False).presses) == 1


def test_what_is_measured_again_goes_on_in_the_program_that_proved_the_effect(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    day = day_of_closing(load_site(path), path, apply=True)
    acting = [piece for piece in day.pieces if piece.stage == "measure again" and piece.name == "C1"]
    assert [piece.asks.presses for piece in acting] == [(), ()]


def test_an_open_road_is_named_in_the_day(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    shown = CliRunner().invoke(app, ["run", str(path), "--plan"], catch_exceptions=False).output
    assert "UNPROTECTED" in shown
    assert day_of_run(load_site(path), apply=False).as_data()["unprotected"]
    path = site_file(tmp_path, "demo", security="best", server_certificate="control.der")
    assert "UNPROTECTED" not in CliRunner().invoke(app, ["run", str(path), "--plan"], catch_exceptions=False).output


def test_hours_follow_the_figures_of_the_site(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    day = day_of_closing(load_site(path), path, apply=True)
    slower = edited(path, lambda text: text.replace("mounting_min = 0.167", "mounting_min = 6.167"))
    after = day_of_closing(load_site(slower), slower, apply=True)
    assert after.hours - day.hours == pytest.approx(0.1 * len(day.mountings))
    colder = edited(path, lambda text: text.replace("restart_s = 10.0", "restart_s = 3610.0"))
    assert day_of_closing(load_site(colder), colder, apply=True).hours - after.hours == pytest.approx(len(day.resets))
    assert sum(day.by_stage().values()) == pytest.approx(day.hours)


def test_the_day_is_shown_and_nothing_is_opened_or_kept(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    shown = CliRunner().invoke(app, ["close", str(path), "--plan", "--apply"], catch_exceptions=False)
    assert shown.exit_code == 0, shown.output
    assert "rotary (calibrator) on C1" in shown.output
    assert "blanks: 3" in shown.output
    data = json.loads(CliRunner().invoke(app, ["run", str(path), "--plan", "--axis", "X1", "--json"]).stdout)
    assert [piece["stage"] for piece in data["pieces"]] == ["warm-up", "measure"]
    assert (data["mountings"], data["presses"], data["resets"]) == (1, 1, 0)
    assert data["pieces"][1]["mounting"]["optics"] == "linear"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["gear.toml", "site.toml"]


def test_a_day_that_cannot_be_reckoned_says_why(tmp_path: Path) -> None:
    path = site_file(tmp_path, "demo")
    with pytest.raises(ConfigError) as unknown:
        day_of_run(load_site(path), apply=False, axes=("Q9",))
    assert unknown.value.code == "E-RUN-AXIS"
    refused = CliRunner().invoke(app, ["close", str(path), "--plan", "--resume", "latest"])
    assert refused.exit_code == 2
    assert "--resume" in refused.output
    site = load_site(path)
    carried = site.controller.model_copy(update={"driver": "sinumerik-modbus", "settings": {}})
    with pytest.raises(ConfigError) as road:
        day_of_run(site.model_copy(update={"controller": carried}), apply=False)
    assert road.value.code == "E-DAY-ROAD"
    without = site.model_copy(update={"work": None})
    with pytest.raises(ConfigError) as work:
        day_of_closing(without, path, apply=False)
    assert work.value.code == "E-CLOSE-WORK"
