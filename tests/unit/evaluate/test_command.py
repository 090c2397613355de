"""`trueflank evaluate`: standards by name, certainty, uncertainty, verdicts, re-compensation, friendly errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from gateway.cli import app
from gateway.workflow.run.outcome import LIMIT_EXCEEDED
from tests.unit.evaluate.real_sets import SETS, table

GOLDEN = Path(__file__).parents[2] / "golden" / "files"
RUNNER = CliRunner()


def csv_of(tmp_path: Path, name: str) -> str:
    targets, x = table(name)
    rows = [
        f"{target},{'+-'[way]},{run + 1},{float(x[i, run, way])!r}"
        for i, target in enumerate(targets.tolist())
        for run in range(x.shape[1])
        for way in (0, 1)
    ]
    path = tmp_path / f"{name}.csv"
    path.write_text("target_mm,direction,repetition,deviation_um\n" + "\n".join(rows))
    return str(path)


def told(*words: str, code: int = 0) -> dict:
    result = RUNNER.invoke(app, ["evaluate", *words, "--json"])
    assert result.exit_code == code, result.output
    return json.loads(result.stdout)[0]


def test_a_real_file_by_several_standards_with_all_its_labels(tmp_path: Path) -> None:
    path = csv_of(tmp_path, "ess_target_b02_x")
    iso, vdi = told(path), told(path, "--standard", "vdi3441")
    assert (iso["standard"], iso["edition"], iso["certainty"]) == ("ISO 230-2:2014", "2014", "from secondary sources")
    assert (iso["E"], iso["R"], iso["A"]) == pytest.approx((122.848, 55.1565, 135.262), rel=1e-5)
    assert (vdi["standard"], vdi["certainty"], vdi["formulas"]) == ("VDI/DGQ 3441:1977", "recalled", "its own")
    assert vdi["Pa"] == pytest.approx(iso["M"])
    assert set(iso["U"]) == {"B", "B_mean", "M", "E", "E_up", "E_down", "R", "R_up", "R_down", "A", "A_up", "A_down"}
    assert set(vdi["U"]) == {"U_max", "U_mean", "Ps_max", "Ps_mean", "Pa", "P"}
    assert iso["monte_carlo"]["A"]["seed"] == 1
    assert any("5 to 35 degC" in line for line in iso["supposed"])


def test_verdicts_are_pass_fail_and_not_decidable_with_the_rule(tmp_path: Path) -> None:
    path = csv_of(tmp_path, "ess_target_b02_x")
    limits = ("--limit", "A=200", "--limit", "E=50", "--limit", "R=56")
    found = told(path, *limits, code=LIMIT_EXCEEDED)["verdicts"]
    assert told(path, "--limit", "A=200")["verdicts"][0]["verdict"] == "pass"
    assert [item["verdict"] for item in found] == ["pass", "fail", "not decidable"]
    assert all("ISO 14253-1" in item["rule"] for item in found)
    text = RUNNER.invoke(app, ["evaluate", path, *limits]).output
    for words in ("A <= 200 µm: PASS", "E <= 50 µm: FAIL", "R <= 56 µm: NOT DECIDABLE", "rule: ISO 14253-1"):
        assert words in text


def test_a_known_temperature_makes_uncertainty_smaller(tmp_path: Path) -> None:
    path = csv_of(tmp_path, "ess_target_b02_z")
    wide, narrow = told(path), told(path, "--material-degc", "20.1")
    assert narrow["U"]["A"] < wide["U"]["A"]
    assert narrow["A"] == wide["A"]


def test_the_list_names_every_standard_and_its_certainty() -> None:
    text = RUNNER.invoke(app, ["evaluate", "--standard", "list"])
    assert text.exit_code == 0
    for words in ("ISO 230-2:2014", "GB/T 17421.2-2016", "NMTBA:1972", "recalled", "from secondary sources"):
        assert words in text.stdout
    listed = json.loads(RUNNER.invoke(app, ["evaluate", "--standard", "list", "--json"]).stdout)
    assert {"standard", "edition", "certainty", "formulas", "parameters"} <= set(listed[0])


def test_a_file_is_recompensated_and_says_so() -> None:
    path = str(GOLDEN / "environment.rtl")
    plain, again = told(path), told(path, "--expansion", "11.7", "--air", "ciddor")
    assert plain["corrected"] == ["air: by the instrument", "expansion: by the instrument"]
    assert again["corrected"][1].startswith("expansion: 11.7 ppm/K")
    assert [step["undone"] for step in again["corrections"]] == [False, False, True, True, False, False]
    assert again["E"] != plain["E"]
    assert again["E"] == pytest.approx(plain["E"], abs=3.0)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], "E-CLI-NO-FILES"),
        (["x.rtl", "--standard", "VDI 4441"], "E-CLI-STANDARD"),
        (["x.rtl", "--limit", "A"], "E-CLI-LIMIT"),
        (["x.rtl", "--limit", "A=ten"], "E-CLI-LIMIT"),
        ([str(GOLDEN / "environment.rtl"), "--limit", "Q=1"], "E-EVAL-LIMIT-NAME"),
        ([str(GOLDEN / "environment.rtl"), "--limit", "A=-1"], "E-EVAL-LIMIT"),
        ([str(GOLDEN / "environment.rtl"), "--air", "ether"], "E-CLI-AIR"),
        ([str(GOLDEN / "environment.rtl"), "--material-degc", "293.15"], "E-EVAL-AMBIENT"),
        ([str(GOLDEN / "environment.rtl"), "--material-degc", "nan"], "E-EVAL-AMBIENT"),
        ([str(GOLDEN / "rotary.rta"), "--unit", "mrad", "--expansion", "8"], "E-EVAL-NOT-LINEAR"),
    ],
)
def test_wrong_input_is_told_what_and_what_to_do(words: list[str], code: str) -> None:
    result = RUNNER.invoke(app, ["evaluate", *words])
    assert result.exit_code != 0
    said = str(result.exception) if isinstance(result.exception, TrueflankError) else result.output
    assert code in said
    assert "->" in said


def test_sets_are_there() -> None:
    assert len(SETS) == 8
