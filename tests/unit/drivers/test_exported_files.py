"""What is written is read again the same, unknown parts included, and a spreadsheet finds no formula in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from drivers.errors import ConfigError, FileFormatError
from drivers.files.assembly import across_zero
from drivers.files.columns import ColumnMap
from drivers.files.csvmap import CsvFormat, parse_csv
from drivers.files.csvtext import guarded
from drivers.files.rtl import RtaFormat, RtlFormat, measured_set
from drivers.files.rtltext import parse
from drivers.files.signature import heading, signature_of
from drivers.types.results import MeasuredSet
from drivers.types.sensing import Ambient
from drivers.units import AxisUnit

GOLDEN = Path(__file__).parents[2] / "golden/files"
FIELD = (
    "target_mm,direction,run,position_mm\n"
    "15.0,up,1,15.00067\n15.0,up,2,15.00169\n25.0,up,1,24.99964\n25.0,up,2,25.0\n"
    "25.0,down,1,25.001\n25.0,down,2,25.002\n15.0,down,1,14.999\n15.0,down,2,15.0\n"
)
UM = np.array([[[0.67, -1.0], [1.69, 0.0]], [[-0.36, 1.0], [0.0, 2.0]]])
VALUES = st.one_of(st.none(), st.floats(-4000, 4000).filter(lambda value: value == 0 or abs(value) > 1e-15))


@pytest.mark.parametrize("change", [
    lambda text: text,
    lambda text: text.replace(",up,", ",forward,").replace(",down,", ",backward,"),
    lambda text: text.replace(",up,", ",f,").replace(",down,", ",reverse,"),
    lambda text: text.replace("run", "cycle").replace("direction", "approach"),
    lambda text: text.replace("position_mm", "measured_mm"),
    lambda text: text.replace("position_mm", "position"),
    lambda text: text.replace("down,1", "down,2x").replace("down,2,", "down,4,").replace("down,2x", "down,3"),
])  # fmt: skip
def test_the_fields_own_names_and_positions_in_place_of_deviations(change: object) -> None:
    found = parse_csv(change(FIELD), ColumnMap(), "x")  # type: ignore[operator]
    assert found.targets.tolist() == [15.0, 25.0]
    np.testing.assert_allclose(found.deviations, UM, atol=1e-9)
    assert found.header["Reading"] == "position"
    assert found.warnings == ()


def test_angles_by_name_are_arcsec_and_mixtures_are_refused() -> None:
    angular = "target_deg,direction,run,deviation_arcsec\n0,up,1,1.5\n90,up,1,2\n"
    found = parse_csv(angular, ColumnMap(), "x")
    assert (found.axis_unit, found.deviations[0, 0, 0]) == ("deg", 1.5)
    place = parse_csv("target_deg,direction,run,position\n0,up,1,0\n90,up,1,90.001\n", ColumnMap(), "x")
    assert place.deviations[1, 0, 0] == pytest.approx(3.6)
    with pytest.raises(FileFormatError, match="line 1"):
        parse_csv(angular.replace("deviation_arcsec", "deviation_um"), ColumnMap(), "x")
    with pytest.raises(FileFormatError, match="E-FILE-CSV-SEVERAL"):
        parse_csv(FIELD.replace("position_mm", "position_mm,actual"), ColumnMap(), "x")


def test_a_column_that_cannot_be_what_it_says_is_doubted() -> None:
    wrong = FIELD.replace("15.00067", "1500.067")
    (doubt,) = parse_csv(wrong, ColumnMap(), "x").doubts
    assert (doubt.code, doubt.blocking) == ("S-READ-SIZE", True)
    assert "line 2 (target 15: 1500.07)" in doubt.text
    (doubt,) = parse_csv(wrong, ColumnMap(confirmed=True), "x").doubts
    assert (doubt.code, doubt.blocking) == ("S-READ-SIZE", False)


@st.composite
def sets(draw: st.DrawFn) -> MeasuredSet:
    unit: AxisUnit = draw(st.sampled_from(["mm", "deg"]))
    targets = sorted(draw(st.sets(st.integers(-5000, 5000), min_size=2, max_size=6)))
    # An arc through zero is read back with 340 deg as -20: the same places under other numbers.
    assume(unit == "mm" or across_zero([target / 10.0 for target in targets]) is None)
    shape = (len(targets), draw(st.integers(1, 3)), 2)
    values = draw(st.lists(VALUES, min_size=int(np.prod(shape)), max_size=int(np.prod(shape))))
    table = np.array([np.nan if value is None else value for value in values]).reshape(shape)
    table[0], table[:, 0, 0] = (
        np.nan_to_num(table[0]),
        np.nan_to_num(table[:, 0, 0]),
    )  # each target and repetition is there
    words = st.text(st.characters(blacklist_categories=("Cs",)), max_size=20)
    header = draw(
        st.dictionaries(st.sampled_from(["Machine", "By", "Note", "EXTRA PART", "Location"]), words, max_size=4)
    )
    ambient = Ambient(draw(st.sampled_from([None, 20.25])), draw(st.sampled_from([None, 1000.5])), 45.0, (20.5, 21.0))
    end = Ambient(21.0, 1001.5, 46.0, (20.75, 21.25))
    return MeasuredSet(np.array(targets) / 10.0, table, unit, ambient, end, "air+material", 11.5, header)


@given(sets())
def test_a_table_says_the_same_again(measured: MeasuredSet) -> None:
    text = CsvFormat().text(measured)
    again = parse_csv(text, ColumnMap(confirmed=True), "x")  # any numbers, also those that no axis has
    assert again.axis_unit == measured.axis_unit
    assert again.targets.tolist() == measured.targets.tolist()
    np.testing.assert_array_equal(again.deviations, measured.deviations)


@given(sets())
def test_a_vendor_file_says_the_same_again(measured: MeasuredSet) -> None:
    linear = measured.axis_unit == "mm"
    text = (RtlFormat() if linear else RtaFormat("arcsec")).text(measured)
    again = measured_set(parse(text, "x"), measured.axis_unit, lambda value: value, "x")
    assert again.targets.tolist() == measured.targets.tolist()
    if np.isfinite(measured.deviations[..., 1]).any() and np.nan_to_num(measured.deviations[..., 1]).any():
        np.testing.assert_array_equal(again.deviations, measured.deviations)
    assert again.ambient_end == measured.ambient_end
    assert again.expansion_ppm_per_k == 11.5


def test_a_vendor_file_keeps_what_nobody_here_understands(tmp_path: Path) -> None:
    text = (GOLDEN / "environment.rtl").read_text(encoding="utf-8", errors="replace")
    text = text.replace("RUNS::", "NEW PART::\r\nfirst : 1\r\n  second line\r\n\r\nRUNS::").replace(
        "TITLE:", "Fixture: 3b\r\nTITLE:"
    )
    path = tmp_path / "a.rtl"
    path.write_text(text, encoding="utf-8", newline="")
    found = RtlFormat().read(path)
    path.write_text(RtlFormat().text(found), encoding="utf-8", newline="")
    again = RtlFormat().read(path)
    for key in ("NEW PART", "EQUIPMENT", "Fixture", "Env factor", "Final Data", "Machine"):
        assert again.header[key] == found.header[key]
    np.testing.assert_array_equal(again.deviations, found.deviations)
    assert (again.ambient_start, again.ambient_end) == (found.ambient_start, found.ambient_end)


def test_header_words_cannot_open_a_section_or_a_line() -> None:
    header = {"Machine": "x\r\nEOF::\r\nDEVIATIONS::", "EXTRA": "a\nEOF::\nRUNS::\nb"}
    measured = MeasuredSet(np.array([0.0, 1.0]), np.ones((2, 1, 2)), "mm", header=header)
    again = parse(RtlFormat().text(measured), "x")
    assert len(again.rows) == 4
    assert again.section("EXTRA") == ("a", "b")


def test_rotary_and_linear_files_are_not_mixed_up() -> None:
    measured = MeasuredSet(np.array([0.0, 1.0]), np.ones((2, 1, 2)), "mm")
    with pytest.raises(ConfigError, match="E-FILE-KIND"):
        RtaFormat("mrad").text(measured)
    turned = RtaFormat("mrad").text(MeasuredSet(np.array([0.0, 1.0]), np.ones((2, 1, 2)), "deg"))
    assert measured_set(parse(turned, "x"), "deg", lambda value: value, "x").deviations[0, 0, 0] == pytest.approx(
        0.00484814
    )


@pytest.mark.parametrize("text", ["=1+1", "+1", "-2", "@SUM(A1)", "\t=1", "\r=1", " =1", "\x1b[31m=1"])
def test_fault_123_no_cell_of_text_is_a_formula_or_moves_the_cursor(text: str) -> None:
    measured = MeasuredSet(np.array([0.0]), np.ones((1, 1, 2)), "mm", header={"Machine": text, text: "x"})
    for line in CsvFormat().text(measured).splitlines():
        cells = line.split(",")
        assert not any(cell.startswith(("=", "+", "-", "@", "\t")) for cell in cells)
        assert line.isprintable()
    assert guarded("plain") == "plain"


def test_tables_of_one_layout_are_known_by_their_heading() -> None:
    monday = "Report 12\nDate: 2025-01-06\nUnit: mm\nSoll;Ist\n1,0;1,1\n2,0;2,1\n"
    tuesday = monday.replace("12", "13").replace("01-06", "01-07").replace("1,1", "9,9")
    assert heading(monday)[-1] == "Soll;Ist"
    assert signature_of(monday) == signature_of(tuesday) != ""
    assert signature_of(monday) != signature_of(monday.replace("mm", "um"))
    assert signature_of(monday) != signature_of(monday.replace("Soll;Ist", "Ist;Soll"))
    assert signature_of("t;X1;X2\n1;2;3\n") != signature_of("t;X2;X1\n1;2;3\n")
    assert signature_of("1 2 3\n4 5 6\n") == ""
