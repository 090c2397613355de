"""The command `day`: 25 files become all 21 errors, a forecast and a report; what is missing is asked or refused."""

from __future__ import annotations

import json
import shutil
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from gateway.cli import app
from gateway.domain.captures import Capture
from gateway.domain.figures import Evaluation
from gateway.model.components import value
from gateway.model.error_model import TWENTY_ONE, ErrorModel
from gateway.store import RunFolder
from gateway.workflow.results.report import material_of
from gateway.workflow.run import stages
from simulators.cell.site import section
from tests.unit.components.machine import ARCSEC, PLACES, Machine
from tests.unit.components.site import site_data
from tests.unit.components.test_errormodel import wanted
from tests.unit.day.folder import answers, made

GEAR = Path(__file__).parents[3] / "examples" / "gears" / "eleven-lobes.toml"


def site(folder: Path) -> Path:
    """A site with one axis section for each of X, Z and C, and the work."""
    data = site_data([])
    shutil.copy(GEAR, folder / "gear.toml")
    data["work"] = {"gear": "gear.toml", "dresser": "", "height_mm": 10.0}
    data["machine"] = {"type": "YK-7350B", "number": "4711"}
    parts = [section(name, data[name]) for name in ("site", "controller", "work", "machine")]
    parts += [section("[instruments]", one) for one in data["instruments"]]
    parts += [section("[axes]", one) for one in data["axes"]]
    path = folder / "site.toml"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def asked(where: Path, *more: str, typed: str | None = None) -> Result:
    words = ["day", str(where / "day"), "--site", str(where / "site.toml"), *more]
    return CliRunner().invoke(app, words, input=typed)


def refused(result: Result) -> TrueflankError:
    assert isinstance(result.exception, TrueflankError), result.output
    return result.exception


def test_25_files_become_all_21_errors_a_forecast_and_a_report(tmp_path: Path) -> None:
    machine = Machine(3)
    site(tmp_path)
    answers(tmp_path / "day.answers.toml", made(tmp_path / "day", machine))
    told = asked(tmp_path, "--no-ask", "--json")
    assert told.exit_code == 0, told.output
    day = json.loads(told.stdout)
    assert {row["name"] for row in day["errors"] if row["state"] == "measured"} == set(TWENTY_ONE)
    model = RunFolder(Path(day["run_folder"])).get(stages.ERRORS, ErrorModel)
    for one in model.motions:
        at = PLACES[one.name[2]]
        true = wanted(machine, one.name)
        assert np.max(np.abs(value(one, at) - true)) < max(0.3, 0.05 * float(np.ptp(true))), one.name
    located = {one.name: one for one in model.locations}
    slopes = {
        name: np.polyfit(PLACES[name[2]], machine.motion(name, PLACES[name[2]]), 1)[0] * 1e-3 / ARCSEC
        for name in ("EZX", "EXZ", "EYZ")
    }
    square, table = machine.B0Z + slopes["EZX"] + slopes["EXZ"], machine.table_lean("B0C") + slopes["EZX"]
    assert located["B0Z"].value == pytest.approx(square, abs=0.3)
    assert located["A0C"].value == pytest.approx(machine.table_lean("A0C") + slopes["EYZ"], abs=0.3)
    assert located["B0C"].value == pytest.approx(table, abs=0.3)
    told = day["forecast"]
    assert told["after_um"] < told["with_own_um"] < told["before_um"]
    assert all(told[f"{step}_u_um"] > 0.0 for step in ("before", "with_own", "after"))
    assert told["sources_um"]["unmeasured"] == 0.0  # all 21 were measured
    assert told["sources_um"]["measured"] > 0.0
    assert told["largest"] == []
    assert Path(str(day["report"]["html"])).is_file()
    files = {row["file"]: row for row in day["files"]}
    assert "dynamic" in files["spindle.rtx"]["left_out"]
    assert files["x gieren.rta"]["error"] == "ECX"


def small(folder: Path, *names: str) -> Path:
    """A day of some of the files, and its site."""
    whole = made(folder / "whole", Machine(3))
    (folder / "day").mkdir()
    for name in names:
        shutil.copy(whole / name, folder / "day" / name)
    return site(folder)


def test_what_is_open_is_refused_with_the_lines_that_would_answer_it(tmp_path: Path) -> None:
    small(tmp_path, "x_pos.rtl", "x gieren.rta", "z tilt 2.rta")
    error = refused(asked(tmp_path, "--no-ask"))
    assert error.code == "E-DAY-OPEN"
    assert "[all]" in error.what
    assert "unit = " in error.what
    assert "[axes.X1]" in error.what
    assert "datum = 0" in error.what
    assert not list((tmp_path / "runs").glob("2*"))


def test_answers_are_asked_once_and_remembered(tmp_path: Path) -> None:
    small(tmp_path, "x_pos.rtl", "z tilt 2.rta")
    told = asked(tmp_path, "--language", "de", typed="+\n1e400\n0,0\nlight years\nmrad\nEBZ\n+\n0\n+\n")
    assert told.exit_code == 0, told.output
    assert "'1e400' ist keine Position" in told.output
    assert "'light years' geht nicht; möglich: mrad" in told.output
    assert "In welcher Einheit" in told.output
    assert "light years" in told.output
    kept = (tmp_path / "day.answers.toml").read_text(encoding="utf-8")
    assert 'unit = "mrad"' in kept
    assert '[files."z tilt 2.rta"]\nerror = "EBZ"' in kept
    again = json.loads(asked(tmp_path, "--no-ask", "--json").stdout)
    assert [row["name"] for row in again["errors"] if row["state"] == "measured"] == ["EXX", "EBZ"]
    assert {one["name"] for one in again["open"]} >= {"ECC", "EXC", "EXX"}


def test_instrument_and_sheet_are_asked_for_at_the_terminal(tmp_path: Path) -> None:
    """Two instruments beside each other, and a workbook of two sheets: each answered as a person types it."""
    import openpyxl

    (tmp_path / "day").mkdir()
    site(tmp_path)
    places = (-400.0, -300.0, -200.0, -100.0, 0.0)
    head = "Target [mm];Direction;Run;Resolver [mm];Laser [mm]"
    lines = [f"{at};{way};{run};{at + 0.002};{at + 0.004}" for run in (1, 2) for way in "+-" for at in places]
    (tmp_path / "day" / "EXX.csv").write_text("\n".join([head, *lines, ""]))
    book = openpyxl.Workbook()
    for name, um in (("first", 1.0), ("second", 7.0)):
        sheet = book.create_sheet(name)
        sheet.append(["target_mm", "direction", "run", "deviation_um"])
        for run in (1, 2):
            for way in "+-":
                for at in (0.0, 75.0, 150.0, 225.0, 300.0):
                    sheet.append([at, way, run, um * at / 300.0])
    del book["Sheet"]
    book.save(tmp_path / "day" / "EZZ.xlsx")
    open_ = refused(asked(tmp_path, "--no-ask")).what
    assert "Several instruments read EXX.csv" in open_
    assert "EZZ.xlsx has several sheets" in open_
    told = asked(tmp_path, typed="+\nmeasured=5\n+\n0\nsheet=second\n+\n0\n" + "unknown\n" * 4)
    assert told.exit_code == 0, told.output
    assert "'+' will not do; known: measured=4 or deviation=4" in told.output
    kept = (tmp_path / "day.answers.toml").read_text(encoding="utf-8")
    assert '[files."EXX.csv"]\ncolumns = "measured=5"' in kept
    assert '[files."EZZ.xlsx"]\ncolumns = "sheet=second"' in kept
    (folder,) = (tmp_path / "runs").glob("2*")
    model = RunFolder(folder).get(stages.ERRORS, ErrorModel)
    slope = next(one for one in model.motions if one.name == "EZZ")
    np.testing.assert_allclose(np.ptp(value(slope, np.array([0.0, 300.0]))), 7.0, atol=0.01)


def test_a_square_that_was_not_turned_over_is_asked_for_its_own_angle_once(tmp_path: Path) -> None:
    small(tmp_path, "square B0Z X1.csv", "square B0Z Z1.csv")
    known = '[all]\nsense = "+"\n' + "".join(f'[axes.{one}1]\ndatum = 0\ndirection = "+"\n' for one in "XZ")
    (tmp_path / "day.answers.toml").write_text(known, encoding="utf-8")
    assert "own_angle = ?" in refused(asked(tmp_path, "--no-ask")).what
    told = asked(tmp_path, typed="90\nunknown\n")
    assert told.exit_code == 0, told.output
    assert "'90' is not an angle of a square" in told.output
    assert "not measured" in told.output
    assert 'own_angle = "unknown"' in (tmp_path / "day.answers.toml").read_text(encoding="utf-8")
    (tmp_path / "day.answers.toml").write_text(known, encoding="utf-8")
    assert asked(tmp_path, typed="0,8\n").exit_code == 0
    again = json.loads(asked(tmp_path, "--no-ask", "--json").stdout)
    assert "B0Z" in [row["name"] for row in again["errors"] if row["state"] == "measured"]


def test_limits_of_the_site_are_decided_and_an_overdue_calibration_is_told_or_refused(tmp_path: Path) -> None:
    small(tmp_path, "x_pos.rtl")
    with (tmp_path / "site.toml").open("a", encoding="utf-8") as file:
        file.write('[[equipment]]\nname = "laser head"\ninstrument = "laser"\num_per_m = 0.2\ndue = "2020-01-01"\n')
        file.write('[[tolerances]]\naxis = "X1"\nlimits = { A = 0.5 }\n')
    kept = '[axes.X1]\ndatum = 0\ndirection = "+"\n'
    (tmp_path / "day.answers.toml").write_text(kept, encoding="utf-8")
    told = asked(tmp_path, "--no-ask")
    assert told.exit_code == 13, told.output
    folder = RunFolder(next((tmp_path / "runs").glob("2*")))
    conditions = folder.get(stages.capture("X1", "before"), Capture).conditions
    assert conditions is not None
    assert conditions.stated == {"um_per_m": 0.2}
    assert material_of(folder).started_utc == "2026-11-20 09:15", "not the day on which the files were read"
    assert "laser head (2020-01-01)" in told.output
    assert "FAIL" in told.output
    with (tmp_path / "site.toml").open("a", encoding="utf-8") as file:
        file.write("[report]\nrefuse_overdue = true\n")
    assert refused(asked(tmp_path, "--no-ask")).code == "E-CAP-OVERDUE"


def test_one_file_has_one_U_in_day_evaluate_and_report_and_what_a_certificate_states_moves_it(tmp_path: Path) -> None:
    """U(M) by Annex A of ISO 230-2 from the readings themselves: eve of both directions, and four systematic terms."""
    small(tmp_path, "x_pos.rtl")
    path, file, out = tmp_path / "site.toml", tmp_path / "day" / "x_pos.rtl", tmp_path / "out"
    (tmp_path / "day.answers.toml").write_text('[axes.X1]\ndatum = 0\ndirection = "+"\n', encoding="utf-8")
    bare, found = path.read_text(encoding="utf-8"), []
    length_m = float(np.ptp(PLACES["X"])) / 1000.0
    for um_per_m, register in ((0.5, ""), (3.0, "um_per_m = 3.0\n"), (3.0, "um_per_m = 3.0\nkelvin = 4.0\n")):
        head = '[[equipment]]\nname = "head"\ninstrument = "laser"\n'
        path.write_text(f"{bare}\n{head}{register}" if register else bare, encoding="utf-8")
        day = json.loads(asked(tmp_path, "--no-ask", "--json").stdout)
        by_day = RunFolder(Path(day["run_folder"])).get(stages.evaluation("X1", "before"), Evaluation).U
        words = ["evaluate", str(file), "--site", str(path), "--json"]
        evaluated = json.loads(CliRunner().invoke(app, words).stdout)[0]
        done = CliRunner().invoke(app, ["report", str(file), "--site", str(path), "--out", str(out)])
        assert done.exit_code == 0, done.output
        page = unescape((out / "calibration-report.html").read_text(encoding="utf-8"))
        for key in ("A", "E", "M"):
            assert evaluated["U"][key] == pytest.approx(by_day[key], rel=1e-12)
            assert f"U({key}) {by_day[key]:.2f}" in page
        supposed = " ".join(evaluated["supposed"])
        assert ("0.5 um/m" in supposed) is (not register)
        warm = 8.0 * length_m * (4.0 if "kelvin" in register else 0.6 * 0.2)
        found.append(by_day["M"] ** 2 - (um_per_m * length_m) ** 2 - warm**2)
    assert found == pytest.approx([found[0]] * 3, rel=1e-6), "all else of U(M) is the same"


def test_two_files_of_one_thing_a_copy_a_broken_one_and_another_axis_are_each_said(tmp_path: Path) -> None:
    small(tmp_path, "x_pos.rtl", "EZX.csv")
    day = tmp_path / "day"
    text = (day / "x_pos.rtl").read_bytes()
    (day / "copy.rtl").write_bytes(text)
    (day / "x again.rtl").write_bytes(text.replace(b"as found", b"as left!"))
    (day / "x of another.rtl").write_bytes(text.replace(b"Axis: X", b"Axis: Y"))
    (day / "cut.rtl").write_bytes(text[: len(text) // 2])
    (day / "notes.pdf").write_bytes(b"%PDF")
    answers_of = tmp_path / "day.answers.toml"
    answers_of.write_text('[all]\nsense = "+"\n[axes.X1]\ndatum = 0\ndirection = "+"\n', encoding="utf-8")
    error = refused(asked(tmp_path, "--no-ask"))
    assert "cut.rtl: the file is incomplete" in error.what
    assert "copy.rtl and x again.rtl both hold EXX. Does x again.rtl count?" in error.what
    with answers_of.open("a", encoding="utf-8") as file:
        file.write('[files."cut.rtl"]\nuse = false\n[files."x again.rtl"]\nuse = false\n')
    told = json.loads(asked(tmp_path, "--no-ask", "--json").stdout)
    said = {row["file"]: row["left_out"] for row in told["files"]}
    assert "axis Y is not in the site file" in said["x of another.rtl"]
    assert "same bytes as copy.rtl" in said["x_pos.rtl"]
    assert said["notes.pdf"] == "no result file"
    assert said["EZX.csv"] == ""


def test_a_layout_that_nobody_described_is_refused_with_its_first_lines(tmp_path: Path) -> None:
    small(tmp_path)
    (tmp_path / "day" / "x.rts").write_text("".join(f"line {n}\n" for n in range(1, 9)), encoding="cp1252")
    error = refused(asked(tmp_path, "--no-ask"))
    assert error.code == "E-DAY-OPEN"
    told = asked(tmp_path, typed="no\n")
    assert "line 5" in told.output
    assert "line 6" not in told.output
    assert "CSV" in told.output
    assert refused(told).code == "E-DAY-NO-RESULTS"


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16", "utf-8"])
def test_the_first_lines_of_such_a_layout_are_shown_in_its_own_letters(tmp_path: Path, encoding: str) -> None:
    small(tmp_path)
    (tmp_path / "day" / "x.rts").write_bytes("Gerät Nº 7\r\nzwölf\r\n".encode(encoding) * 400)
    told = asked(tmp_path, typed="no\n")
    assert "Gerät Nº 7" in told.output
    assert "zwölf" in told.output


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("[all]\nunits = 1\n", "E-DAY-KEY"),
        ("[all]\nunit = 1\n", "E-DAY-ANSWER"),
        ('[files."x_pos.rtl"]\nerror = "EQQ"\n', "E-DAY-ANSWER"),
        ("[axes.X1]\ndatum = 1e7\n", "E-DAY-ANSWER"),
        ("[all]\nown_angle = 90\n", "E-DAY-ANSWER"),
        ('[all]\nown_angle = "about right"\n', "E-DAY-ANSWER"),
        ('[files."x_pos.rtl"]\noffset = [0.0, 1e9, 0.0]\n', "E-DAY-ANSWER"),
        ('[files."x_pos.rtl"]\nerror = "EBX"\n[axes.X1]\ndatum=0\n', "E-DAY-UNIT-OF"),
        ('[files."gone.rtl"]\nuse = false\n', "E-DAY-NO-FILE"),
        ("[all\n", "E-DAY-ANSWERS"),
        ("[files.a]\n[other]\n", "E-DAY-ANSWERS"),
    ],
)
def test_wrong_answers_are_named(tmp_path: Path, text: str, code: str) -> None:
    small(tmp_path, "x_pos.rtl")
    (tmp_path / "day.answers.toml").write_text(text, encoding="utf-8")
    assert refused(asked(tmp_path, "--no-ask")).code == code


def test_an_empty_folder_no_folder_a_huge_file_and_a_site_file_of_somebody_are_refused(tmp_path: Path) -> None:
    small(tmp_path)
    assert refused(asked(tmp_path)).code == "E-DAY-EMPTY"
    with (tmp_path / "day" / "huge x.rtl").open("wb") as file:
        file.truncate(200 << 20)
    error = refused(asked(tmp_path, "--no-ask"))
    assert "huge x.rtl: the file cannot be read: it is larger than" in error.what
    (tmp_path / "day").rename(tmp_path / "elsewhere")
    assert refused(asked(tmp_path)).code == "E-DAY-FOLDER"
