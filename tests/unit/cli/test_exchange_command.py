"""convert to and from other controls as a user types it: the files, what is said, what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from drivers.exchange.linuxcnc import LinuxCncScrew
from drivers.message import Message
from drivers.types.exchange import ReadAs
from gateway.cli import app
from gateway.domain.figures import Component
from gateway.model.error_model import ErrorModel, LocationError, UnmeasuredError
from gateway.workflow.errors21.error_file import error_set

GOLDEN = Path(__file__).parents[2] / "golden"
RUNNER = CliRunner()
MEASURED = (GOLDEN / "files" / "basic.rtl", "--axis", "X", "--datum", "0=100", "--reference", "100")


def typed(*words: object) -> str:
    result = RUNNER.invoke(app, [str(word) for word in words], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def refused(*words: object) -> TrueflankError:
    result = RUNNER.invoke(app, [str(word) for word in words])
    assert isinstance(result.exception, TrueflankError), result.output
    return result.exception


def test_a_measured_file_becomes_a_screw_file_with_both_directions(tmp_path: Path) -> None:
    screw = tmp_path / "x.comp"
    assert "prove the sign" in typed("tables", "convert", *MEASURED, "--to", "linuxcnc", "-o", screw)
    (table,) = LinuxCncScrew().read(screw.read_text(), "", ReadAs("X", "mm", "trims"))
    assert table.places == (50.0, 100.0, 150.0)  # the file's own zero stands at machine position 100
    assert table.deviations[1] + table.reverse[1] == pytest.approx(0.0)  # the mean is zero at the reference
    assert table.reverse[1] - table.deviations[1] == pytest.approx(0.376, abs=1e-3)  # the reversal stays


def test_what_a_double_measured_says_so_in_every_file_that_comes_of_it(tmp_path: Path) -> None:
    measured, screw, listed, own = (tmp_path / name for name in ("d.rtl", "x.comp", "x.lis", "x.ini"))
    text = MEASURED[0].read_text(encoding="cp1252")
    measured.write_text(text.replace("TITLE:", "TITLE: SIMULATED"), encoding="cp1252")
    assert "SIMULATED" in measured.read_text(encoding="cp1252")
    typed("tables", "convert", measured, *MEASURED[1:], "--to", "linuxcnc", "-o", screw)
    typed("tables", "convert", screw, "--from", "linuxcnc", "--to", "twincat", "--axis", "X", "-o", listed)
    grid = ("--min", "50", "--max", "150", "--step", "50")
    typed("tables", "convert", measured, "--axis", "AX1", *MEASURED[3:], *grid, "--to", "eec", "-o", own)
    assert all("SIMULATED" in one.read_text() for one in (screw, listed, own))


def test_one_format_becomes_the_other_and_the_rounding_is_said(tmp_path: Path) -> None:
    screw, listed, sheet = (tmp_path / name for name in ("x.comp", "x.lis", "x.csv"))
    typed("tables", "convert", *MEASURED, "--to", "linuxcnc", "-o", screw)
    told = typed("tables", "convert", screw, "--from", "linuxcnc", "--to", "twincat", "--axis", "X", "-o", listed)
    assert "largest difference is 0.0380 µm" in told
    assert "with --form real it would be 0.0000 µm" in told
    typed("tables", "convert", listed, "--from", "twincat", "--to", "table-csv", "--axis", "X", "-o", sheet)
    assert "axis,X,X,mm,um,0,0,100.0,-0.2,0.2" in sheet.read_text().splitlines()


def test_a_file_of_the_control_becomes_a_sheet(tmp_path: Path) -> None:
    told = typed(
        "tables", "convert", GOLDEN / "tables" / "control_axes.ini", "--from", "tables", "--axis", "AX1",
        "--to", "table-csv", "-o", tmp_path / "x.csv",
    )  # fmt: skip
    assert "0.0000 µm" in told


def test_what_cannot_be_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    file, out = MEASURED[0], tmp_path / "out"
    assert refused("tables", "convert", *MEASURED, "--to", "linucnc", "-o", out).code == "E-CLI-LAYER"
    assert refused("tables", "convert", file, "--to", "linuxcnc", "-o", out).code == "E-CLI-AXIS"
    assert refused("tables", "convert", file, "--axis", "X", "--to", "linuxcnc", "-o", out).code == "E-CLI-DATUM"
    assert (
        refused("tables", "convert", *MEASURED, "--to", "twincat", "--form", "odd", "-o", out).code == "E-EXCHANGE-FORM"
    )
    beyond = refused("tables", "convert", *MEASURED[:-1], "500", "--to", "linuxcnc", "-o", out)
    assert beyond.code == "E-COMP-FREE"
    assert not out.exists()
    screw = tmp_path / "x.comp"
    typed("tables", "convert", *MEASURED, "--to", "linuxcnc", "-o", screw)
    kind = refused("tables", "convert", screw, "--from", "linuxcnc", "--axis", "X", "--to", "isg-volumetric", "-o", out)
    assert kind.code == "E-EXCHANGE-KIND"
    assert (
        refused("tables", "convert", screw, "--from", "odd", "--axis", "X", "--to", "twincat", "-o", out).code
        == "E-EXCHANGE-NAME"
    )
    assert refused("tables", "convert", *MEASURED, "--to", "linuxcnc", "-o", screw).code == "E-CLI-EXISTS"
    table = GOLDEN / "tables" / "control_axes.ini"
    other = refused("tables", "convert", table, "--from", "tables", "--axis", "Q", "--to", "table-csv", "-o", out)
    assert (other.code, other.fields["known"]) == ("E-EXCHANGE-AXIS", "AX1, AX4")
    assert refused("tables", "convert", table, "--from", "tables", "--to", "table-csv", "-o", out).code == "E-CLI-AXIS"
    assert not out.exists()


SHEET = (
    "kind,output_axis,input_axis,input_unit,deviation_unit,modulo,direction,position,deviation,deviation_reverse\n"
    "axis,X,X,mm,µm,0,0,0,0,-8\naxis,X,X,mm,µm,0,0,25,{typed},-6\naxis,X,X,mm,µm,0,0,50,5,-4\n"
)
TO_SCREW = ("--from", "table-csv", "--to", "linuxcnc", "--axis", "X", "-o")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "cp1252"])
def test_a_sheet_is_read_in_every_encoding_that_spreadsheets_save(tmp_path: Path, encoding: str) -> None:
    sheet = tmp_path / "x.csv"
    sheet.write_text(SHEET.format(typed=2), encoding=encoding)
    assert "note:" not in typed("tables", "convert", sheet, *TO_SCREW, tmp_path / "x.comp")
    assert (tmp_path / "x.comp").read_text().splitlines()[1].split() == ["25.000000000", "-0.002000000", "0.006000000"]


def test_a_workbook_under_another_name_is_told_as_one(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(b"PK\3\4 and what else a workbook holds")
    assert refused("tables", "convert", tmp_path / "x.csv", *TO_SCREW, tmp_path / "x.comp").code == "E-EXCHANGE-NO-TEXT"


def test_numbers_that_no_axis_has_are_refused_and_unlikely_ones_told(tmp_path: Path) -> None:
    sheet, screw = tmp_path / "x.csv", tmp_path / "x.comp"
    sheet.write_text(SHEET.format(typed=5000))
    assert refused("tables", "convert", sheet, *TO_SCREW, screw).code == "E-EXCHANGE-LARGE"
    assert not screw.exists()
    sheet.write_text(SHEET.format(typed=50))
    assert "changes by 50 µm between 0 and 25 mm" in typed("tables", "convert", sheet, *TO_SCREW, screw)
    sheet.write_text(SHEET.format(typed=290))
    assert "at 25 mm: 290 µm is much for an axis" in typed("tables", "convert", sheet, *TO_SCREW, screw, "--force")


def test_a_screw_file_of_positions_comes_back_and_is_not_taken_for_one_of_trims(tmp_path: Path) -> None:
    sheet, screw, again = (tmp_path / name for name in ("x.csv", "x.comp", "again.csv"))
    sheet.write_text(SHEET.format(typed=2))
    typed("tables", "convert", sheet, *TO_SCREW, screw, "--form", "positions")
    back = ("tables", "convert", screw, "--from", "linuxcnc", "--to", "table-csv", "--axis", "X", "-o", again)
    assert refused(*back).code == "E-EXCHANGE-LARGE"
    typed(*back, "--form", "positions")
    assert "axis,X,X,mm,um,0,0,25.0,2.0,-6.0" in again.read_text().splitlines()


def test_fitted_errors_stand_at_their_positions_with_what_is_not_known() -> None:
    line = Component(
        "EXX",
        "X",
        "mm",
        "polynomial",
        (0.0, 100.0),
        np.array([1.0, 2.0]),
        np.zeros((2, 2)),
        {"centre": 50.0, "scale": 50.0, "degree": 1},
    )
    model = ErrorModel(
        (line,),
        (LocationError("B0Z", 6.5, 0.1, "arcsec"),),
        (UnmeasuredError("EZZ", 5.0, "um"),),
        said=(Message.stored("said"),),
    )
    found = error_set(model, points=3)
    assert list(found.curves[0].positions) == [0.0, 50.0, 100.0]
    assert list(found.curves[0].values) == [-1.0, 1.0, 3.0]
    assert found.locations == {"B0Z": 6.5}
    assert found.notes == ("said", "not measured: EZZ")


def test_our_own_pair_of_tables_by_direction_comes_back_as_one_axis(tmp_path: Path) -> None:
    pair, sheet = tmp_path / "pair.spf", tmp_path / "x.csv"
    typed("tables", "convert", *MEASURED, "--min", "50", "--max", "150", "--step", "50", "--to", "cec", "-o", pair)
    typed("tables", "convert", pair, "--from", "tables", "--axis", "X", "--to", "table-csv", "-o", sheet)
    rows = [line.split(",") for line in sheet.read_text().splitlines() if line.startswith("axis,X,X")]
    assert [float(row[7]) for row in rows] == [50.0, 100.0, 150.0]
    written = {
        (int(number), int(point)): 1000.0 * float(value)
        for number, point, value in re.findall(r"AN_CEC\[(\d),(\d)\]=(\S+)", pair.read_text())
    }
    assert len(written) == 6
    for point, row in enumerate(rows):
        assert [float(row[8]), float(row[9] or row[8])] == pytest.approx([written[0, point], written[1, point]])


def test_files_of_other_controls_are_named_and_their_open_facts_asked(tmp_path: Path) -> None:
    table, sheet = tmp_path / "x.com", tmp_path / "x.csv"
    table.write_text("BEGIN AXIS_X.COM MM\nNR AXISPOS BACKLASH X\n0 -10 0 0.001\n1 0 0.001 0.002\n[END]\n")
    assert "E-FILE-CONTROL" in RUNNER.invoke(app, ["evaluate", str(table)]).output
    told = refused("tables", "lint", table)
    assert (told.code, told.fields["format"]) == ("E-FILE-CONTROL", "heidenhain")
    words = ("tables", "convert", table, "--from", "heidenhain", "--axis", "X", "--to", "table-csv", "-o", sheet)
    assert refused(*words).code == "E-EXCHANGE-SIGN"
    typed(*words, "--form", "correction")
    assert "axis,X,X,mm,um,0,0,0.0,-2.0,-1.0" in sheet.read_text().splitlines()
    cal = tmp_path / "x.cal"
    to_cal = ("tables", "convert", table, "--from", "heidenhain", "--axis", "X", "--to", "aerotech", "-o", cal)
    assert refused(*to_cal, "--form", "error").code == "E-EXCHANGE-CURVES"
    assert refused(
        "tables", "convert", table, "--from", "fagor", "--axis", "X", "--to", "linuxcnc", "-o", cal
    ).code == ("E-EXCHANGE-FAGOR")
    assert not cal.exists()
