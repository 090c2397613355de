"""`explain` knows every code, and says more about those that people meet most."""

from __future__ import annotations

import json
import re

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError, catalogue, explained
from gateway.cli import app
from gateway.cli.files.reference import explanation

MET = 60


def test_every_code_is_explained_by_its_texts() -> None:
    for code, texts in catalogue().items():
        found = explanation(code)
        assert found["what"], code
        assert found.get("do", "") or not texts["do"], code
        assert "{" not in found["what"] + found.get("do", ""), code


def test_what_people_meet_most_has_a_way_in_and_a_way_out() -> None:
    told = [code for code in catalogue() if explained(code)]
    assert len(told) >= MET
    for code in told:
        assert set(explained(code)) == {"how", "out"}, code
        for sentence in re.split(r"(?<=[.:])\s", " ".join(explained(code).values())):
            assert len(sentence.split()) <= 32, (code, sentence)


def test_nothing_is_explained_that_does_not_exist() -> None:
    from importlib import resources
    from tomllib import loads

    file = resources.files("drivers").joinpath("messages", "explained", "en.toml")
    assert set(loads(file.read_text(encoding="utf-8"))) <= set(catalogue())


def test_a_slip_is_answered_with_what_is_spelt_alike() -> None:
    with pytest.raises(ConfigError, match="E-INT-WARMTH"):
        explanation("E-INT-WARMT")


def test_it_is_printed_and_given_as_data() -> None:
    told = CliRunner().invoke(app, ["explain", "e-int-warmth"])
    assert told.exit_code == 0
    assert "how to get out of it: Bring it to its working temperature" in told.stdout
    data = json.loads(CliRunner().invoke(app, ["explain", "E-INT-WARMTH", "--json"]).stdout)
    assert data["code"] == "E-INT-WARMTH"
    assert data["how"] == explained("E-INT-WARMTH")["how"]
