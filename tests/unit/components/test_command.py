"""The commands `measure` and `guard` without a machine: the plan shown, and what is refused before it is opened."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError, TrueflankError
from gateway.cli import app
from gateway.workflow.errors21.setups import key_of
from simulators.cell.site import section
from tests.unit.components.site import site_data, site_of


def written(folder: Path, **more: Any) -> Path:
    data = site_data(**more)
    parts = [section(name, data[name]) for name in ("site", "controller")]
    parts += [section("[instruments]", one) for one in data["instruments"]]
    parts += [section("[axes]", one) for one in data["axes"]]
    parts += [section("[setups]", one) for one in data["setups"]]
    path = folder / "site.toml"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def test_the_plan_is_shown_in_its_order_and_nothing_is_opened(tmp_path: Path) -> None:
    path = written(tmp_path)
    told = CliRunner().invoke(app, ["measure", str(path), "--plan", "--json"])
    assert told.exit_code == 0, told.output
    plan = json.loads(told.output)
    assert len(plan["plan"]) == len(site_of().setups) + 3
    assert {key_of(one) for one in site_of().setups} <= {row["setup"] for row in plan["plan"]}
    assert plan["remountings"] >= 8
    shown = CliRunner().invoke(app, ["measure", str(path), "--plan"])
    assert "A0C-Z1-C1at180" in shown.output
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["measure", "--setups", "EYC"], "E-SETUP-UNKNOWN"),
        (["measure", "--resume", "nothing"], "E-STORE-EMPTY"),
        (["guard", "--axis", "C1", "--run", "nothing"], "E-STORE-EMPTY"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_opened(tmp_path: Path, arguments: list[str], code: str) -> None:
    path = written(tmp_path)
    told = CliRunner().invoke(app, [arguments[0], str(path), *arguments[1:]])
    assert isinstance(told.exception, TrueflankError)
    assert told.exception.code == code
    assert not (tmp_path / "runs").exists()


def test_a_site_without_set_ups_says_so(tmp_path: Path) -> None:
    path = written(tmp_path, setups=[])
    told = CliRunner().invoke(app, ["measure", str(path), "--plan"])
    assert isinstance(told.exception, ConfigError)
    assert told.exception.code == "E-SETUP-NONE"
