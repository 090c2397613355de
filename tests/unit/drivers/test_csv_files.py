"""Tables of readings: columns by name, directions by sign, every reading once."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import registry
from drivers.errors import ConfigError, FileFormatError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import CsvFormat, parse_csv
from drivers.types.results import MeasuredSet

PLAIN = """target_mm,direction,repetition,deviation_um
-10,+,1,0.5
0,+,1,1.25
0,-,1,-1.5
-10,-,1,0.25
-10,+,2,0.75
0,+,2,1.0
0,-,2,-1.0
-10,-,2,0.0
"""
WANTED = [[[0.5, 0.25], [0.75, 0.0]], [[1.25, -1.5], [1.0, -1.0]]]


def check(found: MeasuredSet) -> None:
    assert found.targets.tolist() == [-10, 0]
    assert found.deviations.tolist() == WANTED


@pytest.mark.parametrize("change", [
    lambda text: text,
    lambda text: text.replace("\n", "\r\n"),
    lambda text: text.replace(",", ";"),
    lambda text: text.replace(",", "\t"),
    lambda text: text.replace(",", ";").replace(".", ","),
    lambda text: text.replace(",+,", ",up,").replace(",-,", ",down,"),
    lambda text: text.replace(",+,", ",1,").replace(",-,", ",-1,"),
    lambda text: text.replace(",+,", ", +1 ,").replace("target_mm,", "Target_MM , "),
    lambda text: text.replace("deviation_um", "Deviation [µm]"),
    lambda text: "# measured by hand\n\n" + text,
    lambda text: text.replace(",1,", ",4,").replace(",2,", ",7,"),
    lambda text: "\n".join([text.splitlines()[0], *reversed(text.splitlines()[1:])]),
])  # fmt: skip
def test_tables_that_mean_the_same(tmp_path: Path, change: object) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(change(PLAIN).encode("utf-8-sig"))  # type: ignore[operator]
    found = CsvFormat().read(path)
    check(found)
    assert found.axis_unit == "mm"


def test_columns_in_any_order_with_others_between() -> None:
    rows = [line.split(",") for line in PLAIN.splitlines()]
    text = "\n".join(f"{row[3]},note,{row[1]},{row[0]},{row[2]}" for row in rows)
    check(parse_csv(text, ColumnMap(), "x"))


@pytest.mark.parametrize(("unit", "axis_unit", "factor"), [
    ("um", "mm", 1.0), ("mm", "mm", 1000.0), ("arcsec", "deg", 1.0), ("deg", "deg", 3600.0),
    ("mrad", "deg", 206.26480625), ("urad", "deg", 0.20626480625),
])  # fmt: skip
def test_units(unit: str, axis_unit: str, factor: float) -> None:
    bare = PLAIN.replace("_um", "").replace("target_mm", f"target_{axis_unit}")
    told = ColumnMap(reading_unit=unit)
    for found in (
        parse_csv(bare, told, "x"),
        parse_csv(bare.replace("deviation", f"deviation_{unit}"), ColumnMap(), "x"),
    ):
        assert found.axis_unit == axis_unit
        assert found.deviations == pytest.approx(np.array(WANTED) * factor, rel=1e-9)


def test_a_unit_that_is_unknown_or_contradicts_the_header() -> None:
    with pytest.raises(ConfigError, match="E-FILE-UNIT"):
        CsvFormat(unit="furlong")
    with pytest.raises(FileFormatError, match=r"E-FILE-CSV-CONTRADICTS.*line 1"):
        parse_csv(PLAIN.replace("deviation_um", "deviation_arcsec"), ColumnMap(reading_unit="um"), "x")
    with pytest.raises(FileFormatError, match="line 1"):
        parse_csv(PLAIN.replace("deviation_um", "deviation_furlong"), ColumnMap(), "x")


@pytest.mark.parametrize("heading", ["target,direction,repetition,deviation_um", "target_mm,direction,run,deviation"])
def test_a_unit_that_nobody_named_is_asked_for(heading: str) -> None:
    with pytest.raises(FileFormatError, match="E-FILE-CSV-UNIT"):
        parse_csv(heading + PLAIN[PLAIN.index("\n") :], ColumnMap(), "x")


@pytest.mark.parametrize(("old", "new", "code", "said"), [
    ("target_mm,direction", "where,direction", "E-FILE-CSV-HEADER", "target, direction"),
    ("target_mm,direction", "target_mm,target_mm", "E-FILE-CSV-HEADER", "direction"),
    ("0,+,1,1.25", "0,+,1,1.25x", "E-FILE-LINE", "line 3"),
    ("0,+,1,1.25", "0,+,1,inf", "E-FILE-LINE", "line 3"),
    ("0,+,1,1.25", "0,+,1,1,25", "E-FILE-LINE", "5 columns"),
    ("0,+,1,1.25", "0,+,1", "E-FILE-LINE", "3 columns"),
    ("0,+,1,1.25", "0,sideways,1,1.25", "E-FILE-LINE", "direction"),
    ("0,+,1,1.25", "0,+,first,1.25", "E-FILE-LINE", "repetition"),
    ("0,+,1,1.25", "-10,+,1,1.25", "E-FILE-LINE", "twice"),
    ("0,+,1,1.25", "0,+,1,1e400", "E-FILE-LINE", "deviation"),
])  # fmt: skip
def test_what_is_wrong_is_refused_by_its_line(old: str, new: str, code: str, said: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        parse_csv(PLAIN.replace(old, new, 1), ColumnMap(), "x")
    assert caught.value.code == code
    assert said in str(caught.value)


def test_positions_beside_deviations_must_say_the_same() -> None:
    text = "target_mm,position_mm,direction,run,deviation_um\n0,0.0012,+,1,1.2\n10,9.998,+,1,-2\n"
    assert parse_csv(text, ColumnMap(), "x").deviations[:, 0, 0].tolist() == [1.2, -2.0]
    with pytest.raises(FileFormatError, match=r"line 3: the deviation is 2 .*position - target is -2"):
        parse_csv(text.replace("-2\n", "2\n"), ColumnMap(), "x")


@pytest.mark.parametrize("text", ["", "\n\n", PLAIN.splitlines()[0]])
def test_empty_tables(text: str) -> None:
    with pytest.raises(FileFormatError):
        parse_csv(text, ColumnMap(), "x")


def test_a_mixture_of_point_and_comma_is_refused() -> None:
    with pytest.raises(FileFormatError, match="line 4"):
        parse_csv(PLAIN.replace(",", ";").replace("-1.5", "-1,5"), ColumnMap(), "x")


def test_missing_readings_and_one_direction_are_said() -> None:
    found = parse_csv(PLAIN.replace("0,-,2,-1.0\n", ""), ColumnMap(), "x")
    assert np.isnan(found.deviations).sum() == 1
    assert tuple(map(str, found.warnings)) == ("readings missing: 1",)
    empty = parse_csv(PLAIN.replace("0,-,2,-1.0\n", "0,-,2,\n"), ColumnMap(), "x")
    np.testing.assert_array_equal(empty.deviations, found.deviations)
    assert [(one.code, one.names["stops"]) for one in empty.doubts] == [("S-READ-MISSING", "line 8 (0)")]
    one_way = "".join(line + "\n" for line in PLAIN.splitlines() if ",-," not in line)
    assert tuple(map(str, parse_csv(one_way, ColumnMap(), "x").warnings)) == ("measured in one direction only",)


@given(st.randoms(use_true_random=False))
@settings(max_examples=300, deadline=None)
def test_mutated_tables_are_read_or_refused(chance: random.Random) -> None:
    data = list(PLAIN)
    for _ in range(chance.randrange(1, 6)):
        at = chance.randrange(len(data))
        data[at : at + chance.randrange(2)] = chance.choice([",", '"', "\n", "\x00", "1", "-", "e", ";", "é", "\r"])
    try:
        found = parse_csv("".join(data), ColumnMap(), "x")
    except FileFormatError:
        return
    assert np.isfinite(found.targets).all()
    assert not np.isinf(found.deviations).any()


@pytest.mark.parametrize("name", ["a.csv", "a.rtl", "a.rta", "a.pos"])
@pytest.mark.parametrize("data", [b"", b"\r\n \r\n", b"\xef\xbb\xbf", b"\xff\xfe"])
def test_an_empty_file_is_called_empty(name: str, data: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileFormatError, match="E-FILE-EMPTY"):
        registry.load(name[2:], "file")(**({"unit": "mrad"} if name == "a.rta" else {})).read(tmp_path / name)


def test_columns_changed_about_are_doubted(tmp_path: Path) -> None:
    """Places under the heading of deviations, and deviations under that of targets."""
    rows = [
        f"{at},{way},{turn},{0.01 * at + 0.1 * turn}" for turn in (1, 2) for way in "+-" for at in range(0, 401, 50)
    ]
    for heading, doubts in (("deviation_um,direction,repetition,target_mm", 1), (PLAIN.splitlines()[0], 0)):
        (tmp_path / "a.csv").write_text("\n".join([heading, *rows, ""]))
        found = CsvFormat().read(tmp_path / "a.csv")
        assert [one.blocking for one in found.doubts if one.code == "S-READ-SIZE"] == [True] * doubts
