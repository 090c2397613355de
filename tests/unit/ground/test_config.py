"""Site files: what is accepted, and what each mistake is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from gateway.config import load_site, schema

GOOD = """
[site]
name = "grinder-7"

[controller]
url = "opc.tcp://127.0.0.1:4840"
serial = "YK-0007"

[[instruments]]
name = "laser"
driver = "umd"
url = "socket://127.0.0.1:5001"

[[axes]]
name = "X1"
letter = "X"
kind = "linear"
travel = [-400.0, 20.0]

[axes.measure]
instrument = "laser"
component = "EXX"
targets = { first = -400.0, last = 0.0, count = 21, offset_fraction = 0.2 }
feed = 6000.0
stable = 0.5

[axes.table]
minimum = -400.0
maximum = 0.0
step = 20.0
"""


def _site(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "site.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_good_site_file_is_read_with_its_defaults(tmp_path: Path) -> None:
    site = load_site(_site(tmp_path, GOOD))
    assert site.controller.driver == "sinumerik-opcua"
    assert site.axes[0].measure.repetitions == 5
    assert site.axes[0].unit == "mm"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('name = "grinder-7"', 'name = "grinder 7"', "site.name"),
        ('serial = "YK-0007"', 'serial = ""', "controller.serial"),
        ("step = 20.0", "step = 19.0", "step must divide"),
        ("step = 20.0", "step = -20.0", "axis X1: table.step = -20.0: must be above 0"),
        ("travel = [-400.0, 20.0]", "travel = [20.0, -400.0]", "must be [low, high]"),
        (
            'instrument = "laser"',
            'instrument = "lazer"',
            "of that name (known: laser; did you mean laser?)",
        ),
        ("feed = 6000.0", "feed = 6000.0\nsign = -1", "axis X1: measure.sign"),
        ("feed = 6000.0", "", "axis X1: measure.feed: is missing"),
        ("count = 21", "count = 1", "count must be 2 or more"),
        ("offset_fraction = 0.2", "offset_fraction = 0.5", "offset_fraction"),
        ("stable = 0.5", 'stable = 0.5\nfile = "x.rtl"', "no machine datum"),
        ("[site]", "[site", "E-CFG-TOML"),
    ],
)
def test_each_mistake_names_file_key_and_why(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert old in GOOD
    path = _site(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_site(path)
    assert told in str(caught.value)
    assert str(path) in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_missing_file_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="E-CFG-READ"):
        load_site(tmp_path / "none.toml")


def test_two_instruments_of_one_name_are_refused(tmp_path: Path) -> None:
    twice = GOOD.replace("[[axes]]", '[[instruments]]\nname = "laser"\ndriver = "umd"\nurl = "tcp://x:1"\n\n[[axes]]')
    with pytest.raises(ConfigError, match="number 1 already has this name"):
        load_site(_site(tmp_path, twice))


def test_the_schema_has_no_key_to_invert_anything() -> None:
    text = str(schema()).lower()
    assert "invert" not in text
    assert "'sign'" not in text
    assert "cec_sign" not in text
