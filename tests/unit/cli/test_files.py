"""The commands on files, as a user types them: right input, wrong input, exit codes, JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.errors import ConfigError, TrueflankError
from gateway.cli import app

GOLDEN = Path(__file__).parents[2] / "golden" / "files"
RUNNER = CliRunner()


def _csv(tmp_path: Path, *rows: str) -> Path:
    path = tmp_path / "c.csv"
    path.write_text("target_mm,direction,repetition,deviation_um\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_evaluate_prints_what_was_worked_by_hand(tmp_path: Path) -> None:
    up, down = (-1.0, -1.0, 0.0, 1.0, 1.0), (1.0, 1.0, 2.0, 3.0, 3.0)
    rows = []
    for target in range(5):
        for repetition in range(5):
            rows.append(f"{100 * target},+,{repetition + 1},{target + up[repetition]}")
            rows.append(f"{100 * target},-,{repetition + 1},{target + down[repetition]}")
    result = RUNNER.invoke(app, ["evaluate", str(_csv(tmp_path, *rows)), "--json"])
    assert result.exit_code == 0
    told = json.loads(result.stdout)[0]
    assert told["standard"] == "ISO 230-2:2014"
    assert (told["B"], told["M"], told["E"]) == pytest.approx((2.0, 4.0, 6.0))
    assert told["A"] == pytest.approx(10.0)


def test_the_edition_of_1988_takes_three_sigma() -> None:
    path = GOLDEN / "environment.rtl"
    new = json.loads(RUNNER.invoke(app, ["evaluate", str(path), "--json"]).stdout)[0]
    old = json.loads(RUNNER.invoke(app, ["evaluate", str(path), "--standard", "1988", "--json"]).stdout)[0]
    assert old["R_up"] == pytest.approx(1.5 * new["R_up"])
    assert old["E"] == new["E"]


def test_one_bad_file_does_not_hide_the_good_one(tmp_path: Path) -> None:
    bad = _csv(tmp_path, "0,+,1,abc")
    result = RUNNER.invoke(app, ["evaluate", str(bad), str(GOLDEN / "environment.rtl"), "--json"])
    assert result.exit_code == 2
    told = json.loads(result.stdout)
    assert told[0]["error"]["code"] == "E-FILE-LINE"
    assert "line 2" in told[0]["error"]["what"]
    assert told[1]["E"] > 0.0


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["evaluate", "x.doc"], "E-CLI-FILE"),
        (["evaluate", "none.rtl"], "E-FILE-READ"),
        (["evaluate", str(GOLDEN / "rotary.rta")], "E-FILE-RTA-UNIT"),
    ],
)
def test_wrong_files_are_told_what_where_and_what_to_do(words: list[str], code: str) -> None:
    result = RUNNER.invoke(app, words)
    assert result.exit_code == 2
    assert code in result.output
    assert "->" in result.output


def test_an_rta_is_read_once_its_unit_is_confirmed() -> None:
    result = RUNNER.invoke(app, ["evaluate", str(GOLDEN / "rotary.rta"), "--unit", "mrad", "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout)[0]["unit"] == "arcsec"


def test_an_unknown_standard_is_refused() -> None:
    result = RUNNER.invoke(app, ["evaluate", "x.rtl", "--standard", "1066"])
    assert isinstance(result.exception, ConfigError)
    assert "E-CLI-STANDARD" in str(result.exception)


def test_schema_is_json_and_names_every_section() -> None:
    result = RUNNER.invoke(app, ["docs", "schema"])
    assert result.exit_code == 0
    assert {"site", "controller", "instruments", "axes"} <= set(json.loads(result.stdout)["properties"])


def test_run_with_apply_needs_the_machines_name(tmp_path: Path) -> None:
    from tests.unit.ground.test_config import GOOD

    site = tmp_path / "site.toml"
    site.write_text(GOOD, encoding="utf-8")
    result = RUNNER.invoke(app, ["run", str(site), "--apply", "--machine", "other"])
    assert isinstance(result.exception, TrueflankError)
    assert result.exception.exit_code == 8
    assert "grinder-7" in str(result.exception)
    assert not (tmp_path / "runs").exists()


def test_check_reports_every_device_that_does_not_open_at_once(tmp_path: Path) -> None:
    from tests.unit.ground.test_config import GOOD

    site = tmp_path / "site.toml"
    settings = 'settings = { security = "None" }\n\n[[instruments]]'
    text = GOOD.replace("opc.tcp://127.0.0.1:4840", "opc.tcp://127.0.0.1:9").replace("127.0.0.1:5001", "127.0.0.1:9")
    site.write_text(text.replace("\n[[instruments]]", settings, 1), encoding="utf-8")
    result = RUNNER.invoke(app, ["doctor", "devices", str(site)])
    assert isinstance(result.exception, TrueflankError)
    causes = getattr(result.exception, "causes", ())
    assert {name for name, _cause in causes} == {"controller", "laser"}
    assert result.exception.exit_code == 3
