"""lint, diff and convert as a user types them: right input, wrong input, exit codes, JSON, nothing overwritten."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from drivers.errors import ConfigError, TrueflankError
from gateway.cli import app

GOLDEN = Path(__file__).parents[2] / "golden"
RUNNER = CliRunner()
GOOD = (
    "%_N_AX_EEC_INI\nCHANDATA(1)\n$AA_ENC_COMP[0,0,X1]=0.0\n$AA_ENC_COMP[0,1,X1]=0.002\n$AA_ENC_COMP[0,2,X1]=0.001\n"
    "$AA_ENC_COMP_STEP[0,X1]=50\n$AA_ENC_COMP_MIN[0,X1]=0\n$AA_ENC_COMP_MAX[0,X1]=100\n$AA_ENC_COMP_IS_MODULO[0,X1]=0\nM17\n"
)


def typed(*words: object) -> Result:
    return RUNNER.invoke(app, [str(word) for word in words])


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def refusal(*words: object) -> TrueflankError:
    result = typed(*words)
    assert isinstance(result.exception, TrueflankError), result.output
    return result.exception


class TestLint:
    def test_clean_doubtful_and_wrong_end_differently(self, tmp_path: Path) -> None:
        good = written(tmp_path, "good.ini", "\ufeff" + GOOD)
        clean = typed("tables", "lint", good, "--reference", "x1=0")
        assert (clean.exit_code, clean.output) == (0, f"{good}: no findings\n")
        steep = written(tmp_path, "steep.ini", GOOD.replace("=0.002", "=0.015"))
        doubtful = typed("tables", "lint", steep, "--reference", "0")
        assert doubtful.exit_code == 0
        assert doubtful.output.startswith("warning: W-TABLE-STEEP")
        assert "1 warning\n" in doubtful.output
        assert typed("tables", "lint", steep, "--reference", "0", "--strict").exit_code == 7
        bad = written(tmp_path, "bad.ini", GOOD.replace("[0,1,X1]=", "[0,1,X1] "))
        wrong = typed("tables", "lint", bad)
        assert wrong.exit_code == 7
        assert "error: E-TABLE-EQUALS" in wrong.output
        assert "line 4" in wrong.output

    def test_what_the_machine_holds(self, tmp_path: Path) -> None:
        good = written(tmp_path, "good.ini", GOOD)
        assert "MD38000" in typed("tables", "lint", good, "--points", 2).output
        assert typed("tables", "lint", good, "--points", 2).exit_code == 7
        assert typed("tables", "lint", good, "--points", 3).exit_code == 0
        assert "0.4 mm/min" in typed("tables", "lint", good, "--velocity", 10000).output
        pair = GOLDEN / "tables" / "manual_pair_x.spf"
        assert "MD18342" in typed("tables", "lint", pair, "--cec-points", 10, "--points", 999).output
        assert typed("tables", "lint", pair, "--control", "828d", "--reference", "-5").exit_code == 0
        assert refusal("tables", "lint", good, "--control", "808E").exit_code == 2

    def test_as_data(self, tmp_path: Path) -> None:
        bad = written(tmp_path, "bad.ini", GOOD.replace("=0.002", "=0,002"))
        told = json.loads(typed("tables", "lint", bad, "--json").stdout)
        assert (told["wrong"], told["doubtful"]) == (2, 0)
        assert {(one["severity"], one["code"]) for one in told["findings"]} == {
            ("wrong", "E-TABLE-COMMA"),
            ("wrong", "E-TABLE-GAP"),
        }

    def test_what_cannot_be_read_or_understood(self, tmp_path: Path) -> None:
        assert refusal("tables", "lint", tmp_path / "none.ini").code == "E-CLI-READ"
        good = written(tmp_path, "good.ini", GOOD)
        assert refusal("tables", "lint", good, "--reference", "X1=abc").code == "E-CLI-POSITION"
        assert refusal("tables", "lint", good, "--reference", "nan").code == "E-CLI-POSITION"

    def test_the_manuals_files(self) -> None:
        printed = typed("tables", "lint", GOLDEN / "tables" / "manual_802d.ini")  # 6.73 in -400 .. 400
        assert (printed.exit_code, "W-TABLE-STEP" in printed.output) == (0, True)
        assert "point 0 to 118, up to 394.14" in printed.output
        # the printed example rises by 7 um in its first mm and is not zero at 0: good to read, not to load
        first = typed("tables", "lint", GOLDEN / "tables" / "manual_eec_x1.ini", "--points", 801, "--reference", "0")
        assert first.exit_code == 7
        assert "E-TABLE-SLOPE" in first.output


class TestDiff:
    def test_exit_codes_of_diff(self, tmp_path: Path) -> None:
        first = written(tmp_path, "a.ini", GOOD)
        layout = written(
            tmp_path, "b.spf", "; another layout\n" + GOOD.partition("CHANDATA(1)\n")[2].replace("=", " = ")
        )
        other = written(tmp_path, "c.ini", GOOD.replace("=0.002", "=0.0045"))
        broken = written(tmp_path, "d.ini", GOOD.replace("MAX", "MAKS"))
        gap = written(tmp_path, "e.ini", GOOD.replace("$AA_ENC_COMP[0,1,X1]=0.002\n", ""))
        same = typed("tables", "diff", first, layout)
        assert (same.exit_code, "have the same content" in same.output) == (0, True)
        different = typed("tables", "diff", first, other)
        assert different.exit_code == 1
        assert "EEC X1 encoder 0 X1(X1): 1 of 3 points differ" in different.output
        assert "largest: EEC X1 encoder 0 X1(X1) at 50: +2.5000 µm" in different.output
        for trouble in (broken, gap, tmp_path / "none.ini"):
            assert typed("tables", "diff", first, trouble).exit_code == 2
        assert "line 8" in typed("tables", "diff", first, broken).output

    def test_as_data(self, tmp_path: Path) -> None:
        first = written(tmp_path, "a.ini", GOOD + "")
        other = GOOD.replace("=0.002", "=0.0045").replace("M17", "$MA_BACKLASH[0,X1]=0.003\nM17")
        told = json.loads(typed("tables", "diff", first, written(tmp_path, "c.ini", other), "--json").stdout)
        assert told["largest"] == {
            "table": "EEC X1 encoder 0 X1(X1)",
            "position": 50.0,
            "change": pytest.approx(2.5),
            "unit": "um",
        }
        assert told["tables"][0]["differences"][0]["second"] == pytest.approx(4.5)
        assert told["settings"][0]["name"] == "$MA_BACKLASH[0,X1]"
        assert json.loads(typed("tables", "diff", first, first, "--json").stdout)["same"] is True

    def test_a_back_up_against_itself_says_its_leftovers(self) -> None:
        path = GOLDEN / "sinumerik" / "backup_c1.spf"
        result = typed("tables", "diff", path, path)
        assert result.exit_code == 0
        assert "1 points from 3 on do not act" in result.output

    def test_a_rotary_axis_without_a_telling_name(self, tmp_path: Path) -> None:
        first = written(tmp_path, "a.ini", GOOD)
        other = written(tmp_path, "c.ini", GOOD.replace("=0.002", "=0.003"))
        assert "+3.6000 arcsec" in typed("tables", "diff", first, other, "--rotary", "x1").output


class TestConvert:
    result = GOLDEN / "files" / "environment.rtl"

    def ask(self, folder: Path, *more: object, to: str = "eec", output: str = "x1.spf") -> Result:
        return typed("tables", "convert", self.result, "--to", to, "--axis", "X1", "-o", folder / output, *more)

    def test_the_datum_is_asked_for_and_nothing_is_written(self, tmp_path: Path) -> None:
        for given in ((), ("--reference", 0), ("--datum", "0=100")):
            result = self.ask(tmp_path, *given)
            assert isinstance(result.exception, ConfigError)
            assert result.exception.code == "E-CLI-DATUM"
            assert "0 to 500 mm" in result.exception.what
        assert not list(tmp_path.iterdir())

    def test_eec_from_a_measured_file_passes_lint(self, tmp_path: Path) -> None:
        result = self.ask(tmp_path, "--reference", 100, "--datum", "0=100", output="x1.ini")
        assert result.exit_code == 0, result.output
        text = (tmp_path / "x1.ini").read_text()
        assert text.startswith("%_N_AX_EEC_INI\nCHANDATA(1)\n; made by trueflank from environment.rtl\n")
        assert "$AA_ENC_COMP_MIN[0,X1]=100.0" in text
        assert "$AA_ENC_COMP[0,0,X1]=0.000000" in text
        assert typed("tables", "lint", tmp_path / "x1.ini", "--reference", 100).output.endswith("no findings\n")

    def test_cec_says_its_sign_is_unproven_everywhere(self, tmp_path: Path) -> None:
        result = self.ask(tmp_path, "--reference", 100, "--datum", "0=100", to="cec")
        assert result.exit_code == 0
        assert "W-COMP-CROSS-SIGN" in result.output
        assert "; CEC SIGN UNPROVEN" in (tmp_path / "x1.spf").read_text()
        assert "W-TABLE-CEC-SIGN" in typed("tables", "lint", tmp_path / "x1.spf").output

    def test_an_existing_file_is_left_alone_without_force(self, tmp_path: Path) -> None:
        kept = written(tmp_path, "x1.spf", "precious")
        known = ("--reference", 100, "--datum", "0=100")
        result = self.ask(tmp_path, *known)
        assert isinstance(result.exception, ConfigError)
        assert result.exception.code == "E-CLI-EXISTS"
        assert kept.read_text() == "precious"
        assert self.ask(tmp_path, *known, "--force").exit_code == 0
        assert "M17" in kept.read_text()
        assert self.ask(tmp_path / "nowhere", *known).exception.code == "E-CLI-WRITE"  # type: ignore[union-attr]

    def test_a_rotary_file_needs_its_unit_confirmed(self, tmp_path: Path) -> None:
        words = [
            "tables",
            "convert",
            GOLDEN / "files" / "rotary.rta",
            "--to",
            "eec",
            "--axis",
            "AX4",
            "-o",
            tmp_path / "c.arc",
        ]
        words += ["--reference", 0, "--datum", "0=0"]
        assert refusal(*words).code == "E-FILE-RTA-UNIT"
        assert not list(tmp_path.iterdir())
        result = typed(*words, "--unit", "arcsec", "--accept-doubt", "S-EVAL-TINY=made for a test", "--json")
        assert result.exit_code == 0, result.output
        told = json.loads(result.stdout)
        assert told["written"] is True
        assert (tmp_path / "c.arc").read_text().startswith("%_N_TFTABLES_SPF\n;$PATH=/_N_SPF_DIR\n")

    def test_a_csv_and_a_grid(self, tmp_path: Path) -> None:
        rows = [f"{10 * at},{way},1,{at % 3 / 2}" for at in range(5) for way in "+-"]
        path = written(tmp_path, "r.csv", "target_mm,direction,repetition,deviation_um\n" + "\n".join(rows) + "\n")
        out = tmp_path / "x.mpf"
        words = [
            "tables",
            "convert",
            path,
            "--to",
            "eec",
            "--axis",
            "x1",
            "-o",
            out,
            "--reference",
            0,
            "--datum",
            "0=0",
        ]
        assert typed(*words, "--step", 5, "--min", 0, "--index", 1).exit_code == 0
        text = out.read_text()
        assert "$AA_ENC_COMP_STEP[1,X1]=5.0" in text
        assert "$AA_ENC_COMP[1,8,X1]" in text
        assert refusal(*words, "--to", "both").code == "E-CLI-LAYER"
        assert refusal(*words, "--form", "pdf").code == "E-TABLE-FORM"
        assert refusal(*words, "--datum", "5").code == "E-CLI-POSITION"
        assert refusal(*words, "--datum", "0=0", "--datum", "10=11").code == "E-COMP-DATUM"

    def test_a_table_beyond_the_limits_is_not_written(self, tmp_path: Path) -> None:
        rows = [f"{10 * at},{way},1,{15 * at}" for at in range(3) for way in "+-"]
        path = written(tmp_path, "r.csv", "target_mm,direction,repetition,deviation_um\n" + "\n".join(rows) + "\n")
        words = ["tables", "convert", path, "--to", "eec", "--axis", "X1", "-o", tmp_path / "x.spf", "--reference", 0]
        assert refusal(*words, "--datum", "0=0").exit_code == 7
        assert not (tmp_path / "x.spf").exists()
