"""Every count that a file, a wire or an option claims has an upper bound, and is refused before memory is asked for."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from drivers.bridge.records import Fields
from drivers.errors import ConfigError, FileFormatError, RemoteProtocolError, TableError
from drivers.files.csvmap import CsvFormat
from drivers.files.numbers import MOST_READINGS, no_readings
from drivers.local.textfile import MOST_BYTES, parse_toml, read_toml
from drivers.sinumerik.opcua.machine import Configuration, MachineReader
from drivers.sinumerik.opcua.session.requests import Reading
from drivers.sinumerik.opcua.settings import UaSettings
from drivers.sinumerik.tablefile.listing import read_listing
from drivers.sinumerik.tablefile.reader import TableReader, group_assignments
from gateway.config import load_site
from gateway.study.inputs import load_errors, load_gear
from simulators.cellfile import load_cell
from tests.unit.ground.test_config import GOOD

ROOT = Path(__file__).parents[3]
TARGETS = "targets = { first = -400.0, last = 0.0, count = 21, offset_fraction = 0.2 }"
HUGE = [
    ("count = 21", "count = 1000000000", "2000"),
    (
        TARGETS,
        "targets = { first = -400.0, last = 0.0, count = 21, window = { first = 0.0, last = 1.0, step = 1e-9 } }",
        "2000",
    ),
    (TARGETS, f"targets = {{ positions = [{'1.0,' * 2001}] }}", "2000"),
    ("feed = 6000.0", "feed = 6000.0\nrepetitions = 1000000000", "50"),
    ("step = 20.0", "step = 4e-7", "4999 intervals"),
    ("count = 21", "count = 21, seed = -1", "0"),
    ('component = "EXX"', f'component = "{"E" * 5000}"', "1000 characters"),
    ("step = 20.0", "step = 20.0\n[guard]\ntargets = 1000000000", "2000"),
]


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("old", "new", "limit"), HUGE)
def test_counts_of_a_site_file(tmp_path: Path, old: str, new: str, limit: str) -> None:
    with pytest.raises(ConfigError, match="E-CFG-VALUE") as caught:
        load_site(written(tmp_path, "site.toml", GOOD.replace(old, new)))
    assert limit in caught.value.what


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e999", "9223372036854775808", "9" * 400])
def test_no_number_of_a_file_is_infinite(tmp_path: Path, number: str) -> None:
    for text in (GOOD.replace("feed = 6000.0", f"feed = {number}"), f"{GOOD}\n[operator]\nstart_timeout_s = {number}"):
        with pytest.raises(ConfigError) as caught:
            load_site(written(tmp_path, "site.toml", text))
        assert caught.value.code in ("E-CFG-TOML", "E-CFG-VALUE")
    settings = GOOD.replace("[[instruments]]", f"[controller.settings]\npoll_s = {number}\n[[instruments]]", 1)
    with pytest.raises(ConfigError, match=r"controller\.settings\.poll_s"):
        load_site(written(tmp_path, "site.toml", settings))


def test_a_file_that_is_too_large_or_too_deep_is_a_message(tmp_path: Path) -> None:
    deep = "a = " + "[" * 100_000
    with pytest.raises(ValueError, match="nested"):
        parse_toml(deep)
    for name, text in (("deep", deep), ("large", "#" * (MOST_BYTES + 1)), ("digits", "a = " + "9" * 9000)):
        path = written(tmp_path, name, text)
        for load in (load_site, load_gear, load_errors, load_cell):
            with pytest.raises(ConfigError):
                load(path)
    with pytest.raises(OSError, match="1048576"):
        read_toml(tmp_path / "large")


def test_counts_of_gears_and_cells(tmp_path: Path) -> None:
    gear = (ROOT / "examples/gears/rv-20e-like.toml").read_text()
    for old, new in (("zc = 39", "zc = 1000000000"), ("b = 8.0", "b = 8.0\n[flank]\nprofile = 1000000000")):
        with pytest.raises(ConfigError, match="E-STUDY-VALUE"):
            load_gear(written(tmp_path, "gear.toml", gear.replace(old, new)))
    cell = (ROOT / "simulators/cells/zero.toml").read_text()
    for old, new in (
        ("[[axes]]", "[[axes]]\neec_points = [1000000000, 0]"),
        ('name = "zero"', 'name = "zero"\nseed = -1'),
    ):
        with pytest.raises(ConfigError, match="E-CELL-"):
            load_cell(written(tmp_path, "cell.toml", cell.replace(old, new, 1)))


def test_a_result_file_gets_no_more_room_than_a_measurement_needs(tmp_path: Path) -> None:
    assert no_readings(100, 10, "f").shape == (100, 10, 2)
    with pytest.raises(FileFormatError, match=str(MOST_READINGS)):
        no_readings(100_000, 5_000, "f")
    lines = [f"{target},+,0,3.1" for target in range(2001)] + [f"0,+,{number},3.1" for number in range(1, 1001)]
    path = written(tmp_path, "a.csv", "\n".join(["target_mm,direction,repetition,deviation_um", *lines, ""]))
    with pytest.raises(FileFormatError, match="E-FILE-SIZE"):
        CsvFormat().read(path)


def test_a_table_with_a_point_beyond_all_controls(tmp_path: Path) -> None:
    lines = ["$AA_ENC_COMP_STEP[0,X1]=0.000001", "$AA_ENC_COMP_MIN[0,X1]=0", "$AA_ENC_COMP_MAX[0,X1]=100000"]
    text = "\n".join([*lines, "$AA_ENC_COMP[0,0,X1]=0", "$AA_ENC_COMP[0,30000,X1]=0", "M17"])
    (group,) = group_assignments(read_listing(text, "f")).values()
    reader = TableReader("f", {}, 1)
    for read, code in ((reader.live, "E-TABLE-SIZE"), (reader.whole, "E-TABLE-GAP")):
        with pytest.raises((FileFormatError, TableError)) as caught:
            read(group)
        assert caught.value.code == code


@pytest.mark.parametrize("value", [10**9, -1, True, 5000.5, float("nan"), "5000", None, [1]])
def test_memory_figures_of_a_control_are_counts(value: object) -> None:
    class Answers:
        async def read(self, paths: list[str], timeout_s: float) -> list[Reading]:
            return [Reading(path, value, "") for path in paths]

    reader = MachineReader(Answers(), UaSettings(security="None"), "840D")  # type: ignore[arg-type]
    with pytest.raises(RemoteProtocolError) as caught:
        asyncio.run(reader.memory(Configuration(("X1",), (False,), (False,)), "X1", 0))
    assert (caught.value.code, str(caught.value.fields["wanted"])) == ("E-UA-VALUE", "a whole number from 0 to 20000")


@pytest.mark.parametrize("value", [-1, True, 1.5, 1 << 54, 10**400, None, "7"])
def test_whole_numbers_of_a_bridge(value: object) -> None:
    with pytest.raises(RemoteProtocolError, match="E-BRIDGE-FIELD"):
        Fields({"lost": value}, "bridge").integer("lost")
