"""The questions of `init` for the page: gone through again with every answer, and a file that is never written over."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path

import pytest

from drivers.checks import ControlAxis, ControlFacts
from drivers.errors import ConfigError
from drivers.languages import page_texts
from gateway.cli.setup import wizard
from gateway.cli.setup.check import check_site
from gateway.cli.setup.init import SiteMaker
from gateway.cli.setup.wizard import ROADS

FILES = {"road": "files", "name": "old-1", "axes": "C1", "travel": "C1 0 360"}
SILENT = {"road": "opcua", "name": "g", "url": "opc.tcp://127.0.0.1:9", "user": "u"}


def test_each_answer_leads_to_the_next_question_and_a_wrong_one_stays_open(tmp_path: Path) -> None:
    maker = SiteMaker(tmp_path / "site.toml")
    assert maker.ask({}, "anna")["question"]["key"] == "road"
    wrong = maker.ask({"road": "files", "name": "a b"}, "anna")["question"]
    assert (wrong["key"], wrong["answer"], wrong["wrong"]["code"]) == ("name", "a b", "W-CFG-SITE-NAME")
    done = maker.ask(FILES, "anna")
    assert done["question"] is None
    assert [one["key"] for one in done["asked"]] == list(FILES)


def test_the_file_is_the_one_that_init_writes_and_none_is_written_over(tmp_path: Path) -> None:
    maker = SiteMaker(tmp_path / "site.toml")
    with pytest.raises(ConfigError, match="E-INIT-ENDED"):
        maker.write({"road": "files"}, "anna")
    assert maker.write(FILES, "anna")["made"]
    assert [axis.name for axis in check_site(tmp_path / "site.toml").site.axes] == ["C1"]
    with pytest.raises(ConfigError, match="E-INIT-EXISTS"):
        maker.write(FILES, "anna")


def test_a_password_can_be_given_anew_is_never_told_back_and_one_that_was_there_is_kept(tmp_path: Path) -> None:
    maker = SiteMaker(tmp_path / "site.toml")
    told = [maker.ask({**SILENT, "password": one}, "anna") for one in ("first", "second")]
    assert (tmp_path / "password.txt").read_text() == "second\n"
    assert "first" not in str(told)
    assert "second" not in str(told)
    assert [one["code"] for one in told[1]["told"]] == ["P-INIT-NO-CONTROL"]
    later = SiteMaker(tmp_path / "site.toml").ask({**SILENT, "password": "third"}, "anna")
    assert "password" not in [one["key"] for one in later["asked"]]
    assert (tmp_path / "password.txt").read_text() == "second\n"


def test_where_axes_may_stand_is_asked_for_a_control_that_programs_move(tmp_path: Path) -> None:
    answers = {
        **SILENT,
        "password": "p",
        "serial": "S7",
        "axes": "C1",
        "travel": "C1 0 360",
        "calibrator": "manual terminal://",
    }
    maker = SiteMaker(tmp_path / "site.toml")
    wrong = maker.ask({**answers, "calibrator": "bridge 127.0.0.1:7001"}, "anna")["question"]
    assert (wrong["key"], wrong["wrong"]["code"]) == ("calibrator", "W-CFG-ADDRESS")
    assert maker.ask({**answers, "safe": "C1 20 10"}, "anna")["question"]["wrong"]["code"] == "W-INIT-SAFE"
    assert maker.ask({**answers, "safe": "X9 any"}, "anna")["question"]["key"] == "safe"
    assert maker.write({**answers, "safe": "C1 -5 5.5"}, "anna")["made"]
    assert check_site(tmp_path / "site.toml").site.moves.safe == {"C1": (-5.0, 5.5)}


def test_a_place_is_asked_for_every_axis_that_the_control_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A push is refused while an axis has no place, also one that nobody measures: the page has no other way to it."""
    axes = (ControlAxis("X1", "mm", False, (0.0, 400.0)), ControlAxis("Y1", "mm"), ControlAxis("C1", "deg", True))
    monkeypatch.setattr(wizard, "_read_control", lambda *_given: ControlFacts("S7", "V", "metric", axes))
    answers = {**SILENT, "password": "p", "axes": "C1", "calibrator": "manual terminal://"}
    maker = SiteMaker(tmp_path / "site.toml")
    asked = maker.ask(answers, "anna")["question"]
    assert (asked["key"], asked["fields"]) == ("safe", {"axes": "C1, X1, Y1"})
    assert maker.write({**answers, "safe": "C1 any, X1 0 400, Y1 -60 60", "gear": "none"}, "anna")["made"]
    assert set(check_site(tmp_path / "site.toml").site.moves.safe) == {"C1", "X1", "Y1"}


def test_what_is_doubtful_in_a_written_file_is_told_and_no_reason_against_it(tmp_path: Path) -> None:
    answers = {**SILENT, "password": "p", "serial": "S7", "axes": "C1", "travel": "C1 0 360", "safe": "C1 any"}
    made = SiteMaker(tmp_path / "site.toml").write({**answers, "calibrator": "manual terminal://"}, "anna")
    found = check_site(tmp_path / "site.toml")
    assert made["made"]
    assert [one["code"] for one in made["faults"]] == [one.code for one in (*found.faults, *found.doubts)] != []
    assert made["remarks"] == [one.as_data() for one in found.remarks]


def test_a_user_is_not_left_empty(tmp_path: Path) -> None:
    asked = SiteMaker(tmp_path / "site.toml").ask({**SILENT, "user": " "}, "anna")["question"]
    assert (asked["key"], asked["wrong"]["code"]) == ("user", "W-CFG-MISSING")


def test_the_page_has_a_key_for_each_road() -> None:
    script = resources.files("gateway.web").joinpath("page", "setup.js").read_text(encoding="utf-8")
    shown = re.search(r"const ROADS = (\[[^]]*\]);", script)
    assert shown is not None
    assert json.loads(shown[1]) == list(ROADS)
    assert {f"setup.{road}" for road in ROADS} - set(page_texts("en")) == set()
