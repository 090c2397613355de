"""One rule for every name: site files, cells, gears, command line, web, wires, and records read back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from drivers.clock import LoopClock
from drivers.errors import ConfigError, TrueflankError
from drivers.local.names import MOST, is_file_name, is_name, shown, stem
from drivers.replay.recorder import TraceRecorder
from drivers.types.sensing import Ambient
from gateway.cli import app
from gateway.config import load_site
from gateway.errors import CorruptRecord, StoreError
from gateway.push.journal import machine_folder
from gateway.store import Store, records
from gateway.study.inputs import load_gear
from gateway.web import reading
from simulators.cellfile import load_cell
from tests.unit.ground.test_config import GOOD
from tests.unit.web.client import Client
from tests.unit.web.services import TOKEN, offered
from tests.unit.web.test_daemon import SITE

EVIL = "../../../../../evil"
BAD = [EVIL, "a/b", "a\\b", ".hidden", "", " a", "a ", "a.", "CON", "nul.txt", "Com1", "LPT9.trace", "-x", "a\x1b[2J"]
BAD += ["a\n", "a\0b", "x\u202e", "\u00fc", "a:b", "a*", "x" * (MOST + 1), "conin$", "a|b", "~"]
GOOD_ONES = ["X1", "laser", "11-lobe disc", "RV-40E.2", "a_b", "7", "CONE", "x" * MOST, "com10", "a+b"]


def site(folder: Path, text: str) -> Path:
    path = folder / "site.toml"
    path.write_text(text, encoding="utf-8")
    return path


def refused(folder: Path, text: str) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        load_site(site(folder, text))
    return caught.value


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_name(name: str) -> None:
    assert not is_name(name)


@pytest.mark.parametrize("name", GOOD_ONES)
def test_what_is_a_name(name: str) -> None:
    assert is_name(name)
    assert is_file_name(name) == (" " not in name)


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=80))
def test_any_text_gives_a_stem_that_stays_in_its_folder(text: str) -> None:
    made = stem(text, unique=True)
    assert Path("a", made).parent == Path("a")
    assert is_file_name(f"p-{made}.json")
    assert (made == text) == (stem(text) == text)
    assert machine_folder(Path("a"), text).parent == Path("a")


def test_stems_of_different_texts_differ_where_they_must() -> None:
    assert stem("a/b", unique=True) != stem("a_b", unique=True) == "a_b"
    assert stem("CON") == "_CON"
    assert len(stem("x" * 500, unique=True)) < 80


NAMED = [
    ("site.name", 'name = "grinder-7"', 'name = "{}"'),
    (f"instrument {EVIL}: name", 'name = "laser"', 'name = "{}"'),
    (f"axis {EVIL}: name", 'name = "X1"', 'name = "{}"'),
    ("axis X1: measure.component", 'component = "EXX"', 'component = "{}"'),
]


@pytest.mark.parametrize(("key", "old", "new"), NAMED, ids=["site", "instrument", "axis", "component"])
def test_a_site_file_names_nothing_that_leaves_a_folder(tmp_path: Path, key: str, old: str, new: str) -> None:
    error = refused(tmp_path, GOOD.replace(old, new.format(EVIL)))
    assert error.code == "E-CFG-VALUE"
    assert error.where.startswith(f"{tmp_path / 'site.toml'}:")
    assert (error.fields["key"], error.fields["value"]) == (key, f' = "{EVIL}"')
    assert "letter" in error.what or "pattern" in error.what


def test_set_ups_work_and_parks_name_by_the_same_rule(tmp_path: Path) -> None:
    setup = '\n[[setups]]\naxis = "X1"\ncomponent = "EXX"\nsource = "none"\nassumed = 1.0\n'
    for extra in (
        setup + 'park = { "../C1" = 0.0 }',
        setup.replace("X1", "../X1"),
        '\n[work]\ngear = "g"\nheight_mm = 0.0\ndresser = "a/b"',
    ):
        assert "device name" in refused(tmp_path, GOOD + extra).what


def test_the_refused_value_is_shown_so_that_nothing_steers_a_terminal(tmp_path: Path) -> None:
    error = refused(tmp_path, GOOD.replace('name = "laser"', r'name = "la\u001b]0;x\u0007\u202eser"'))
    assert r"la\x1b]0;x\x07\u202eser" in error.what
    assert not set("\x1b\x07\u202e") & set(str(error))


def test_cells_and_gears_have_names_by_the_same_rule(tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "simulators/cells/zero.toml").read_text()
    cell = tmp_path / "cell.toml"
    cell.write_text(text.replace('name = "laser"', f'name = "{EVIL}"'))
    with pytest.raises(ConfigError, match="E-CELL-VALUE"):
        load_cell(cell)
    gear = tmp_path / "gear.toml"
    text = (Path(__file__).parents[3] / "examples/gears/rv-20e-like.toml").read_text()
    gear.write_text(text.replace("RV-20E-like", EVIL))
    with pytest.raises(ConfigError, match="device name"):
        load_gear(gear)


def test_a_trace_never_leaves_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "1" / "2" / "3" / "4" / "5"

    for name in (EVIL, "CON", "a\x1bb"):
        with pytest.raises(ConfigError, match="E-NAME"):
            TraceRecorder(folder, name, LoopClock(), {})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ["grind", "SITE", "--part", EVIL],
        ["inspect", "SITE", "--part", "a/b"],
        ["guard", "SITE", "--gear", "--run", "x", "--part", ".x"],
        ["correct", "SITE", "--gear", "x", "--part", "a\x1b"],
    ],
)
def test_a_part_on_the_command_line_is_a_name(tmp_path: Path, words: list[str]) -> None:
    path = site(tmp_path, GOOD)
    told = CliRunner().invoke(app, [str(path) if word == "SITE" else word for word in words])
    assert isinstance(told.exception, TrueflankError), told.output
    assert told.exception.code == "E-NAME"
    assert [one.name for one in tmp_path.iterdir()] == ["site.toml"]


def test_a_run_by_a_name_that_leaves_the_store_is_none(tmp_path: Path) -> None:
    store = Store(tmp_path / "a" / "runs")
    outside = Store(tmp_path / "a").create("other")
    store.create("one")
    for word in (f"../{outside.run_id}", "..", "\x1b[2J", "con"):
        with pytest.raises(StoreError) as caught:
            store.open(word)
        assert caught.value.code == "E-STORE-RUN"
        assert "\x1b" not in str(caught.value)


def test_the_page_asks_for_reports_of_runs_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def report(_store: Store, run_id: str) -> str | None:
        asked.append(run_id)
        return "<p>r</p>"

    monkeypatch.setattr(reading, "stored_report", report)
    client = Client(offered(tmp_path, SITE).app, headers={"Authorization": f"Bearer {TOKEN}"})
    for name in ("%2e%2e", "a%5cb", "CON", "a%1b", ".x", "x" * 121):
        assert client.get(f"/api/v1/sites/hall-3/runs/{name}/report").status_code == 404
    assert asked == []
    assert client.get("/api/v1/sites/hall-3/runs/20261121T-a.b/report").status_code == 200


def test_a_record_that_names_a_file_elsewhere_is_not_believed(tmp_path: Path) -> None:
    folder = Store(tmp_path / "runs").create("s")
    folder.put("capture", Ambient(20.0))
    folder.write_text("notes.txt", "x")
    (tmp_path / "secret.json").write_bytes((folder.path / "capture.json").read_bytes())
    facts: dict[str, Any] = json.loads((folder.path / "run.json").read_text())
    facts["stages"]["capture"]["file"] = "../../secret.json"
    facts["files"]["../../secret.json"] = records.sha256((tmp_path / "secret.json").read_bytes())
    body = {key: value for key, value in facts.items() if key != "sha256"}
    facts["sha256"] = records.sha256(records.canonical(body))
    (folder.path / "run.json").write_text(json.dumps(facts))
    for read in (lambda: folder.get("capture", Ambient), lambda: folder.read_bytes("../../secret.json")):
        with pytest.raises(CorruptRecord) as caught:
            read()
        assert caught.value.code == "E-STORE-PLACE"


def test_long_values_are_cut_where_they_are_shown() -> None:
    assert len(shown("x" * 10_000)) < 100
    assert shown("a\nb\u2028") == r"a\x0ab\u2028"
