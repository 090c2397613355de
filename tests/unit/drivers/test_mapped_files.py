"""Tables with declared columns and API .pos files: nothing guessed, nothing lost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import registry
from drivers.errors import ConfigError, FileFormatError, TrueflankError
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import parse_csv
from drivers.files.pos import parse_pos

TABLE = """No;Soll [mm];Ist [mm];Lauf;Richtung
1;-10,000;-9,9990;1;+
2;0,000;0,0010;1;+
3;10,000;10,0030;1;+
4;10,000;10,0020;2;-
5;0,000;0,0005;2;-
6;-10,000;-9,9985;2;-
7;-10,000;-9,9991;3;+
8;0,000;0,0012;3;+
9;10,000;10,0031;3;+
10;10,000;10,0022;4;-
11;0,000;0,0006;4;-
12;-10,000;-9,9986;4;-
"""
BASE: dict[str, Any] = {"target": 2, "measured": 3, "separator": ";", "decimal_comma": True, "reading_unit": "mm"}
WANTED_UM = np.array([[[1.0, 1.5], [0.9, 1.4]], [[1.0, 0.5], [1.2, 0.6]], [[3.0, 2.0], [3.1, 2.2]]])


@pytest.mark.parametrize(
    "more",
    [
        {"direction": "column", "direction_column": 5},
        {"direction": "column", "direction_column": 5, "run": 4},
        {"direction": "runs", "run": 4},
        {"direction": "order"},
    ],
)
def test_a_foreign_table_is_read_as_declared(tmp_path: Path, more: dict[str, Any]) -> None:
    path = tmp_path / "a.csv"
    path.write_text(TABLE, encoding="cp1252")
    found = registry.load("csv", "file")(columns=BASE | more).read(path)
    assert found.targets.tolist() == [-10.0, 0.0, 10.0]
    np.testing.assert_allclose(found.deviations, WANTED_UM, atol=1e-9)
    assert found.axis_unit == "mm"
    assert "measured=3" in found.header["Columns"]


def test_sense_and_units_are_applied_once() -> None:
    text = "t d\n0 0.1\n36 -0.2\n"
    said = {
        "target": 1,
        "deviation": 2,
        "direction": "up",
        "sense": -1,
        "target_unit": "arcsec",
        "reading_unit": "mrad",
    }
    found = parse_csv(text, ColumnMap.read(said, "x"), "x")
    assert found.axis_unit == "deg"
    assert found.targets.tolist() == [0.0, 0.01]
    assert found.deviations[:, 0, 0] == pytest.approx([-20.62648, 41.25296], abs=1e-5)
    assert np.isnan(found.deviations[:, 0, 1]).all()


def test_inches_become_millimetres() -> None:
    said = {"target": 1, "measured": 2, "direction": "up", "target_unit": "inch", "reading_unit": "inch", "skip": 0}
    found = parse_csv("1 1.0001\n2 2.0003\n", ColumnMap.read(said, "x"), "x")
    assert found.targets.tolist() == [25.4, 50.8]
    assert found.deviations[:, 0, 0] == pytest.approx([2.54, 7.62])


@pytest.mark.parametrize(
    "wrong",
    [
        {"target": -1},
        {"measured": -3},
        {"deviation": 3},
        {"direction": "sideways"},
        {"direction": "column"},
        {"direction": "runs"},
        {"target_unit": "parsec"},
        {"reading_unit": "arcsec", "target_unit": "mm"},
        {"sense": 0},
        {"separator": ";;"},
        {"colour": 3},
        {"target": "2"},
    ],
)
def test_a_map_that_makes_no_sense_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError) as caught:
        ColumnMap.read(BASE | wrong, "map")
    assert caught.value.code == "E-FILE-MAP"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (("3;10,000;10,0030;1;+", "3;10,000"), 4),
        (("3;10,000;10,0030;1;+", "3;10,000;1O,0030;1;+"), 4),
        (("3;10,000;10,0030;1;+", "3;10.00;10.0030;1;+"), 4),
        (("3;10,000;10,0030;1;+", "3;0,000;10,0030;1;+"), 4),
        (("5;0,000;0,0005;2;-", "5;0,000;0,0005;x;-"), 6),
        (("5;0,000;0,0005;2;-", "5;0,000;0,0005;2;?"), 6),
    ],
)
def test_a_line_that_does_not_fit_is_refused_by_its_number(change: tuple[str, str], line: int) -> None:
    columns = ColumnMap.read(BASE | {"direction": "column", "direction_column": 5, "run": 4}, "x")
    with pytest.raises(FileFormatError) as caught:
        parse_csv(TABLE.replace(*change), columns, "x")
    assert (caught.value.code, caught.value.fields["line"]) == ("E-FILE-LINE", line)


def test_nothing_but_a_header_is_no_reading() -> None:
    with pytest.raises(FileFormatError) as caught:
        parse_csv("a b\n", ColumnMap.read(BASE, "x"), "x")
    assert caught.value.code == "E-FILE-ROWS"


POS = (
    "Machine\tX\r\n\r\nPosition   \tBidirectional Avg Error\r\n0\t0.0000\r\n100\t0.0015\r\n200\t0.0030\r\n\r\n"
    "Position   \tForward Directional Avg Error\r\n0\t0.0000\r\n100\t0.0010\r\n200\t0.0020\r\n\r\n"
    "Position   \tBackward Directional Avg Error\r\n0\t0.0000\r\n100\t0.0020\r\n200\t0.0040\r\n"
)


def test_a_pos_file_gives_both_means_and_says_that_they_are_means() -> None:
    found = parse_pos(POS, "x.pos")
    assert found.targets.tolist() == [0.0, 100.0, 200.0]
    assert found.deviations[:, 0, 0].tolist() == [0.0, 1.0, 2.0]
    assert found.deviations[:, 0, 1].tolist() == [0.0, 2.0, 4.0]
    assert "means only" in str(found.warnings[0])


def test_a_pos_file_with_the_mean_of_both_only_is_one_way_and_says_so() -> None:
    found = parse_pos(POS.split("Position   \tForward", maxsplit=1)[0], "x.pos")
    assert found.deviations[:, 0, 0].tolist() == [0.0, 1.5, 3.0]
    assert np.isnan(found.deviations[:, 0, 1]).all()
    assert len(found.warnings) == 2


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (("Position", "Pos"), "E-FILE-POS"),
        (("100\t0.0010", "100\tx"), "E-FILE-LINE"),
        (("100\t0.0010", "0\t0.0010"), "E-FILE-LINE"),
        (("Backward", "Forward"), "E-FILE-LINE"),
        (("200\t0.0040\r\n", ""), "E-FILE-COUNT"),
    ],
)
def test_a_damaged_pos_file_is_refused(change: tuple[str, str], code: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        parse_pos(POS.replace(*change), "x.pos")
    assert caught.value.code == code


@settings(max_examples=300)
@given(st.data())
def test_mutated_tables_are_read_or_refused_in_our_words(data: st.DataObject) -> None:
    source, read = data.draw(
        st.sampled_from(
            [
                (
                    TABLE,
                    lambda text: parse_csv(text, ColumnMap.read(BASE | {"direction": "runs", "run": 4}, "x"), "x"),
                ),
                (POS, lambda text: parse_pos(text, "x")),
            ]
        )
    )
    at, length = data.draw(st.integers(0, len(source))), data.draw(st.integers(0, 6))
    noise = data.draw(st.text(alphabet=";,.\t\r\n +-0123456789eEnaif", max_size=6))
    try:
        found = read(source[:at] + noise + source[at + length :])
    except TrueflankError:
        return
    assert np.isfinite(found.targets).all()
    assert not np.isinf(found.deviations).any()


def test_a_pos_file_with_a_backward_block_alone_is_no_forward_measurement() -> None:
    found = parse_pos("Position\tBackward Directional Avg Error\n0\t0.001\n10\t0.002\n", "x")
    assert np.isnan(found.deviations[:, 0, 0]).all()
    assert found.deviations[:, 0, 1].tolist() == pytest.approx([1.0, 2.0])
    assert any("one direction" in warning for warning in map(str, found.warnings))


def test_numbers_of_a_pos_file_behind_a_damaged_line_are_not_lost_in_silence() -> None:
    text = "Position\tForward Directional Avg Error\n0\t0.001\nx5\t0.1\n10\t0.002\n"
    with pytest.raises(FileFormatError, match="line 4"):
        parse_pos(text, "x")


@pytest.mark.parametrize("mark", [";", "\t", " "])
def test_marks_that_nobody_declared_are_those_of_the_lines(mark: str) -> None:
    rows = [
        ("Pos", "Run", "Err"),
        ("-400,5", "1", "-0,8"),
        ("0,0", "1", "1,25"),
        ("0,0", "2", "1,5"),
        ("-400,5", "2", "0"),
    ]
    text = "\n".join(mark.join(row) for row in rows) + "\n"
    found = parse_csv(text, ColumnMap(target=1, run=2, deviation=3, target_unit="mm", reading_unit="um"), "export.csv")
    assert found.targets.tolist() == [-400.5, 0.0]
    assert found.deviations[:, 0, 0].tolist() == [-0.8, 1.25]
