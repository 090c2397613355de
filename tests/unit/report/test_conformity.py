"""Tolerances, register and conditions: from the site file to pass, fail or not decidable, and to the exit code."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.types.identity import Identity
from gateway.audit import act_as
from gateway.cli import app
from gateway.config import AxisSection, SiteFile, load_site, read_site
from gateway.domain.captures import Conditions
from gateway.errors import CaptureError
from gateway.evaluate.uncertainty.budget import budget_of
from gateway.report import InstrumentNote, ReportMaterial
from gateway.report.document.whole import document
from gateway.store import RunFolder, Store
from gateway.workflow.axes.measure import report_overdue_calibrations, stated_uncertainties, with_conditions
from gateway.workflow.results.conformity import judge_limits, with_conformity
from gateway.workflow.results.endings import closing_outcome
from gateway.workflow.results.report import material_of, standing_report, write_report
from gateway.workflow.run import stages
from gateway.workflow.run.folder import was_simulated
from tests.unit.report import closing, synthetic
from tests.unit.report.test_document import texts
from tests.unit.report.test_tooth_run import AXIS, GEAR, SITE, fill

REGISTER = """
[[equipment]]
name = "laser head"
maker = "Maker"
type = "L-1"
serial = "42"
certificate = "C-7"
laboratory = "Lab"
calibrated = 2025-03-01
due = 2026-03-01
um_per_m = 0.2
kelvin = 0.06
"""


MACHINE = '\n[machine]\ntype = "{}"\nnumber = "12"\n'
"""The machine that the files name."""


def site(folder: Path, *more: str) -> Path:
    """A site file of three axes with more sections behind."""
    axes = [("X", "linear", "false"), ("Z", "linear", "false"), ("C", "rotary", "true")]
    text = SITE + "".join(AXIS.format(name=name, kind=kind, modulo=modulo) for name, kind, modulo in axes)
    path = folder / "site.toml"
    path.write_text(text + "".join(more))
    return path


def tolerance(limits: str, standard: str = "ISO 230-2:2014") -> str:
    """Limits of X1."""
    return f'\n[[tolerances]]\naxis = "X1"\nstandard = "{standard}"\nlimits = {{ {limits} }}\n'


@pytest.fixture
def material() -> ReportMaterial:
    return synthetic.material()


def verdicts(tree: SiteFile, material: ReportMaterial) -> dict[str, str]:
    """Verdict by figure."""
    return {one.decision.parameter: one.decision.verdict for one in judge_limits(tree, material)}


def test_a_limit_is_passed_failed_or_open_with_u_and_as_left(tmp_path: Path, material: ReportMaterial) -> None:
    after = material.axes[0].after
    assert after is not None
    assert after.A is not None
    limits = f"A = {after.A + 0.1}, E = 50.0, R = 0.5"
    found = judge_limits(load_site(site(tmp_path, tolerance(limits))), material)
    assert [one.decision.verdict for one in found] == ["not decidable", "pass", "fail"]
    assert all(one.as_left and one.of == "X1" for one in found)
    before = replace(material, axes=(replace(material.axes[0], after=None, capture_after=None),))
    assert not judge_limits(load_site(tmp_path / "site.toml"), before)[0].as_left


def test_another_standard_is_evaluated_from_the_readings(tmp_path: Path, material: ReportMaterial) -> None:
    found = judge_limits(load_site(site(tmp_path, tolerance("P = 90.0", "VDI/DGQ 3441:1977"))), material)
    assert [(one.standard, one.decision.parameter) for one in found] == [("VDI/DGQ 3441:1977", "P")]
    assert found[0].decision.value is not None
    assert found[0].decision.verdict == "pass"


def test_a_gear_is_judged_by_class_and_by_figure(tmp_path: Path) -> None:
    said = "\n[gear_tolerance]\ngrade = 5\nmodule_mm = 4.0\ndiameter_mm = 100.0\nwidth_mm = 20.0\n"
    said += "limits = { F_r = 0.01 }\n"
    found = {one.decision.parameter: one for one in judge_limits(load_site(site(tmp_path, said)), closing.material())}
    # ISO 1328-1, class 5 for d 100, m 4, b 20: F_alpha hypot(5.7, 7.2) = 9.2 -> 9.0 um; f_p 6.7 -> 6.5 um.
    assert (found["F_alpha"].decision.limit, found["f_p"].decision.limit) == (9.0, 6.5)
    assert found["F_alpha"].decision.verdict == "pass"
    assert (found["F_r"].decision.verdict, found["F_r"].standard) == ("not decidable", "")
    assert "f_falpha" not in found  # the inspection did not tell it, and no figure asks for it


def test_mistakes_in_register_and_tolerances_are_told_with_their_place(tmp_path: Path) -> None:
    wrong = tolerance("A = 5.0, Q = 1.0").replace("X1", "X9") + tolerance("A = 1.0", "ISO 999")
    wrong += REGISTER.replace("due = 2026", "due = 2024") + "\n[gear_tolerance]\ngrade = 5\nlimits = { F_x = 1.0 }\n"
    faults = {
        ".".join(map(str, one.path)): f"{one.code} {[*map(str, one.fields.values())]}"
        for one in read_site(site(tmp_path, wrong)).faults
    }
    assert "X1" in faults["tolerances.0.axis"]
    assert "no figure" in faults["tolerances.0.limits.Q"]
    assert "ISO 230-2:2014" in faults["tolerances.1.standard"]
    assert "calibrated" in faults["equipment.0.due"]
    assert "module_mm" in faults["gear_tolerance.grade"]
    assert "F_alpha" in faults["gear_tolerance.limits.F_x"]


def test_a_certificate_takes_the_place_of_an_assumption(tmp_path: Path, material: ReportMaterial) -> None:
    tree = load_site(site(tmp_path, REGISTER))
    assert stated_uncertainties(tree, "laser") == {"um_per_m": 0.2, "kelvin": 0.06}
    capture = material.axes[0].capture_before
    assert capture is not None
    usual = budget_of(capture)
    better = budget_of(replace(capture, conditions=Conditions(stated=stated_uncertainties(tree, "laser"))))
    length_m = float(capture.targets[-1] - capture.targets[0]) / 1000.0
    assert better.device == pytest.approx(0.2 * length_m)
    assert usual.device == pytest.approx(0.5 * length_m)
    assert better.temperature == pytest.approx(11.5 * length_m * 0.06)
    turned = material.axes[2].capture_before
    assert turned is not None
    assert budget_of(replace(turned, conditions=Conditions(stated={"arcsec": 0.4}))).turning == 0.4


def test_an_overdue_calibration_warns_and_refuses_where_the_site_says_so(tmp_path: Path) -> None:
    heard: list[str] = []

    def say(code: str, **fields: object) -> None:
        heard.append(f"{code} {fields['name']}")

    tree = load_site(site(tmp_path, REGISTER))
    report_overdue_calibrations(tree, date(2026, 3, 1), say)
    assert heard == []
    report_overdue_calibrations(tree, date(2026, 3, 2), say)
    assert heard == ["P-CAP-OVERDUE laser head (2026-03-01)"]
    strict = load_site(site(tmp_path, REGISTER, "\n[report]\nrefuse_overdue = true\n"))
    with pytest.raises(CaptureError, match="laser head"):
        report_overdue_calibrations(strict, date(2026, 3, 2), say)


STOOD = {"X": -10.0, "Z": 150.0, "C": 90.0}


def stored(folder: Path, path: Path) -> RunFolder:
    """A run of that site with one axis measured."""
    run = Store(folder / "runs").create("mill", {"site_file": str(path)})
    run.write_text("site.toml", path.read_text())
    axis = synthetic.material().axes[0]
    assert axis.before is not None
    assert axis.capture_before is not None
    run.put(stages.evaluation("X1", "before"), axis.before)
    run.put(
        stages.capture("X1", "before"),
        replace(axis.capture_before, conditions=Conditions(feed=1000.0, stands=STOOD, operator="anna")),
    )
    return run


def test_who_is_signed_in_is_who_measured_unless_the_site_file_names_somebody(tmp_path: Path) -> None:
    tree = load_site(site(tmp_path))
    capture = synthetic.material().axes[0].capture_before
    assert capture is not None

    read = tree.axes[0]
    live = read.model_copy(update={"measure": read.measure.model_copy(update={"file": None})})

    def named(of: SiteFile, axis: AxisSection = live) -> str:
        found = with_conditions(capture, axis, of, {}).conditions
        return "nobody" if found is None else found.operator

    assert named(tree) == ""
    with act_as("anna"):
        assert named(tree) == "anna"
        assert named(tree, read) == "", "who gives a file has not measured it"
        own = tree.model_copy(update={"report": tree.report.model_copy(update={"operator": "B. Smith"})})
        assert named(own) == "B. Smith"


def test_the_report_ends_with_its_verdict_and_tells_equipment_and_conditions(tmp_path: Path) -> None:
    path = site(tmp_path, tolerance("A = 1.0"), REGISTER, '\n[machine]\nmaker = "Grinders"\nyear = 2019\n')
    run = stored(tmp_path, path)
    path.unlink()  # the run's own copy is enough, at any later time
    told = "\n".join(texts(document(material_of(run)).blocks))
    for word in (
        "C-7, Lab, 2025-03-01",
        "0.2 um/m, 0.06 K",
        "Grinders",
        "2019",
        "1000 mm/min",
        "does not conform",
        "C 90 deg, Z 150 mm",
        "anna",
    ):
        assert word in told
    shown = CliRunner().invoke(app, ["report", str(run.path), "--json"])
    assert shown.exit_code == 13, shown.output
    data = json.loads(shown.output)
    assert data["verdicts"] == ["fail"]
    assert Path(data["pdf"]).read_bytes().startswith(b"%PDF-1.7")
    assert data["number"] in Path(data["document"]).read_text()
    assert run.differences() == ()


OLD = ("--accept", "date=2020")  # the file is older than a year


def test_files_become_a_report_and_evaluate_decides_by_the_site(tmp_path: Path) -> None:
    path = site(tmp_path, MACHINE.format("Example"), tolerance("A = 1.0"))
    source = Path(__file__).parents[2] / "golden" / "files"
    file = sorted(source.rglob("*.rtl"))[0]
    shown = CliRunner().invoke(app, ["report", str(file), "--out", str(tmp_path / "out"), "--language", "de"])
    assert shown.exit_code == 0, shown.output
    assert "Kalibrierbericht" in (tmp_path / "out" / "calibration-report.html").read_text()
    found = CliRunner().invoke(app, ["evaluate", str(file), "--site", str(path), "--axis", "X1", "--json", *OLD])
    assert found.exit_code in (13, 21), found.output
    assert json.loads(found.output)[0]["verdicts"][0]["parameter"] == "A"


def test_a_report_decides_on_every_file_whose_axis_has_the_letter(tmp_path: Path) -> None:
    """The files say X, the site X1; what the report of each ends with is what `evaluate` ends with."""
    source = Path(__file__).parents[2] / "golden" / "files" / "environment.rtl"
    other = tmp_path / "again.rtl"
    other.write_bytes(source.read_bytes())
    for limit, word, code in ((500.0, "PASS", 0), (0.001, "FAIL", 13)):
        path = site(tmp_path, MACHINE.format("Schleifmaschine für Räder"), tolerance(f"A = {limit}"))
        for files in ([source], [source, other]):
            done = CliRunner().invoke(
                app, ["report", *map(str, files), "--site", str(path), "--out", str(tmp_path / "out"), *OLD]
            )
            assert done.exit_code == code, done.output
            assert f"limits of the site: {len(files)} {word}" in done.output
            told = CliRunner().invoke(app, ["evaluate", *map(str, files), "--site", str(path), *OLD])
            assert (told.exit_code, told.output.count(f": {word}")) == (code, len(files)), told.output


def test_a_double_in_the_loop_is_told_by_every_file_of_the_run(tmp_path: Path) -> None:
    path = site(tmp_path)
    real = write_report(stored(tmp_path, path))
    path.write_text(path.read_text().replace('name = "mill"', 'name = "mill"\nsimulated = true', 1))
    run = stored(tmp_path, path)
    paths = write_report(run)
    assert "SIMULATED" in paths.html.read_text()
    assert json.loads(paths.json.read_text())["simulated"] is True
    for name in ("results.csv", "index.html"):
        assert "SIMULATED" in (run.path / name).read_text()
        assert "SIMULATED" not in (real.html.parent / name).read_text()
    assert "SIMULATED" not in real.html.read_text()
    assert paths.picture.read_bytes() != real.picture.read_bytes()
    named = InstrumentNote("laser", Identity("bridge", "XR20-W (simulated)", "1"))
    assert was_simulated(load_site(site(tmp_path)), (named,))
    assert not was_simulated(
        load_site(tmp_path / "site.toml"), (InstrumentNote("laser", Identity("umd", "uMD1", "1")),)
    )


def test_a_report_of_the_same_records_is_not_drawn_again(tmp_path: Path) -> None:
    run = stored(tmp_path, site(tmp_path))
    assert standing_report(run, material_of(run)) is None
    paths = write_report(run)
    assert standing_report(run, material_of(run)) == paths
    later = synthetic.material().axes[0]
    assert later.after is not None
    run.put(stages.evaluation("X1", "after"), later.after)
    assert standing_report(run, material_of(run)) is None


@pytest.mark.parametrize(("limit", "code", "word"), [(500.0, 0, "PASS"), (0.01, 13, "FAIL")])
def test_the_end_of_a_closing_run_says_every_verdict_and_ends_with_its_code(
    tmp_path: Path, limit: float, code: int, word: str
) -> None:
    path = site(tmp_path, tolerance(f"A = {limit}"))
    (tmp_path / "gear.toml").write_text(GEAR.read_text())
    run = Store(tmp_path / "runs").create("mill", {"site_file": str(path)})
    fill(run)
    done = closing_outcome(run, load_site(path))
    assert done.exit_code == code
    assert any(line.startswith("X1 A ") and line.endswith(f"as left): {word}") for line in map(str, done.lines))
    assert str(done.lines[-1]).startswith("tooth: ")
    assert done.data["conformity"][0]["verdict"] == word.lower()
    worse = with_conformity(replace(done, exit_code=9), judge_limits(load_site(path), material_of(run)))
    assert worse.exit_code == 9
