"""Files as other programs and people write them, through the commands: right figures, one question, or one refusal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from gateway.cli import app

RUNNER = CliRunner()
pytestmark = pytest.mark.usefixtures("inside_folder")
# Made-up deviations, um, by target (mm): runs 1 and 2, up and down.
AT = (0.0, 600.0, 1200.0)
UP, DOWN = ((0.1, 0.2), (3.1, 3.2), (6.1, 6.2)), ((2.1, 2.2), (5.1, 5.2), (8.1, 8.2))


def run(*words: str) -> Any:
    return RUNNER.invoke(app, list(words))


def figures(*words: str, code: int = 0) -> dict[str, Any]:
    result = run("evaluate", *words, "--json")
    assert result.exit_code == code, result.output
    found: dict[str, Any] = json.loads(result.stdout)[0]
    return found


def expected() -> dict[str, float]:
    """ISO 230-2 by numpy: E from the unidirectional means, A with two standard deviations, B the largest reversal."""
    up, down = np.array(UP), np.array(DOWN)
    ways = [(way.mean(axis=1), way.std(axis=1, ddof=1)) for way in (up, down)]
    means = np.concatenate([mean for mean, _s in ways])
    high = max((mean + 2 * s).max() for mean, s in ways)
    low = min((mean - 2 * s).min() for mean, s in ways)
    return {"E": float(np.ptp(means)), "A": float(high - low), "B": float(np.abs(ways[0][0] - ways[1][0]).max())}


def rows(value: Any, place: Any = "{:.3f}".format) -> list[tuple[str, str, str, str]]:
    ways = (("+", UP), ("-", DOWN))
    return [
        (place(at), sign, str(run + 1), value(at, found[i][run]))
        for run in (0, 1) for sign, found in ways for i, at in enumerate(AT)
    ]  # fmt: skip


def test_the_unit_of_a_declared_column_is_that_of_its_heading(tmp_path: Path) -> None:
    lines = [",".join(row) for row in rows(lambda _at, um: f"{um / 1000:.4f}")]
    Path("a.csv").write_text("\n".join(["mPos (mm),dir,pass no,err (mm)", *lines, ""]))
    said = ("target=1", "direction=2", "run=3", "deviation=4")
    columns = [word for one in said for word in ("--column", one)]
    assert run("import", "a.csv", *columns).exit_code == 0
    found = figures("a.csv", "--limit", "B=1", "--material-degc", "20", code=13)
    assert found["E"] == pytest.approx(expected()["E"])
    refused = run("evaluate", "a.csv", *columns, "--column", "reading_unit=um")
    assert (refused.exit_code, "E-FILE-CSV-CONTRADICTS" in refused.output) == (2, True)


@pytest.mark.parametrize(("head", "target", "value", "encoding"), [
    ("Soll mm;Richtung;Zyklus;Ist mm", "{:,.3f}", "{:,.4f}", "cp1252"),
    ("Soll mm;Richtung;Zyklus;Abweichung um", "{:,.0f}", "um", "cp1252"),
])  # fmt: skip
def test_thousands_in_every_spelling_give_the_same_figures(head: str, target: str, value: str, encoding: str) -> None:
    def spelled(text: str, group: str, point: str) -> str:
        return text.replace(",", "G").replace(".", point).replace("G", group)

    for number, (group, point) in enumerate(((".", ","), ("'", "."), ("\u00a0", ","), (" ", ","), ("", ","))):
        made = rows(
            lambda at, um: str(um) if value == "um" else value.format(at + um / 1000),
            target.format,
        )
        lines = [";".join((spelled(a, group, point), b, c, spelled(d, group, point))) for a, b, c, d in made]
        Path(f"{number}.csv").write_bytes("\n".join([head, *lines, ""]).encode(encoding))
    result = run("evaluate", *(f"{number}.csv" for number in range(5)), "--json")
    assert result.exit_code == 0, result.output
    for found in json.loads(result.stdout):
        assert {key: found[key] for key in ("E", "A", "B")} == pytest.approx(expected(), abs=1e-9)


def test_one_table_under_every_ending_gives_one_table_file_by_convert(tmp_path: Path) -> None:
    import openpyxl

    head = ("target_mm", "direction", "repetition", "deviation_um")
    text = "\n".join(",".join(row) for row in (head, *rows(lambda _at, um: str(um)))) + "\n"
    for name in ("a.csv", "a.txt", "a.dat"):
        Path(name).write_text(text)
    Path("a.tsv").write_text(text.replace(",", "\t"))
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.title = "X"
    for line in text.splitlines():
        sheet.append([float(cell) if cell[-1].isdigit() else cell for cell in line.split(",")])
    book.create_sheet("notes").append(["nothing", "here"])
    book.save("a.xlsx")
    words = ("--to", "eec", "--axis", "X", "--reference", "0", "--datum", "0=0")
    made = set()
    for name in ("a.csv", "a.txt", "a.dat", "a.tsv", "a.xlsx"):
        result = run("tables", "convert", name, *words, "-o", f"{name}.spf")
        assert result.exit_code == 0, result.output
        made.add(Path(f"{name}.spf").read_text().replace(name, "a"))
    assert len(made) == 1
    book.create_sheet("Y").append(list(head))
    book["Y"].append([0.0, "+", 1, 1.0])
    book.save("b.xlsx")
    asked = run("evaluate", "b.xlsx")
    assert "E-IMPORT-SHEET" in asked.output
    assert figures("b.xlsx", "--column", "sheet=X")["E"] == pytest.approx(expected()["E"])


def part(title: str, found: Any) -> str:
    lines = [f"{i + 1}|{at}|" + "|".join(f"{at + um / 1000:.4f}" for um in found[i]) + "|" for i, at in enumerate(AT)]
    head = "i |tgt_pos(i) [mm]|ref_pos(i,1) [mm]|ref_pos(i,2) [mm]|\n--- |--- |--- |--- |"
    return "\n".join([f"### {title}", "", head, *lines, "", ""])


def test_two_tables_or_two_files_of_opposite_ways_are_one_set() -> None:
    Path("both.txt").write_text("# report\n\n" + part("forward", UP) + part("backward", DOWN))
    Path("up.csv").write_text(part("", UP))
    Path("down.csv").write_text(part("", DOWN))
    Path("two.csv").write_text(part("", UP) + part("", DOWN))
    assert figures("both.txt")["A"] == pytest.approx(expected()["A"], abs=1e-6)
    assert "E-IMPORT-WAYS" in run("evaluate", "up.csv").output
    joined = figures("up.csv", "--column", "passes=up", "--column", "beside=down.csv")
    assert joined["A"] == pytest.approx(expected()["A"], abs=1e-6)
    assert "E-FILE-CSV-SECOND" in run("evaluate", "two.csv", "--column", "passes=up").output


def test_of_several_instruments_a_person_chooses_one_and_words_are_missing_readings() -> None:
    lines = [f"{i} | {5.0 * i} | {5.0 * i + 0.0003} | 0.0003 | " + ("Out of range | NaN" if i < 3 else
             f"{5.0 * i + 0.001 * i:.4f} | {0.001 * i:.4f}") for i in range(1, 13)]  # fmt: skip
    head = "Test | Setpoint [mm] | Resolver [mm] | Diff [mm] | ILD2300 [mm] | Diff [mm]"
    Path("a.csv").write_text("\n".join([head, *lines, ""]))
    asked = run("evaluate", "a.csv")
    assert (asked.exit_code, "E-IMPORT-CHOOSE" in asked.output, "column 5" in asked.output) == (2, True, True)
    found = figures("a.csv", "--column", "measured=5", "--column", "direction=up")
    assert found["targets"] == 10
    assert found["E_up"] == pytest.approx(9.0)
    assert any("line 2 (5), line 3 (10)" in flag for flag in found["flags"])


@pytest.mark.parametrize(("root", "said"), [("RenishawBallbar", "ballbar"), ("QIFDocument", "QIF"), (
    "digitalCalibrationCertificate", "DCC"), ("other", "no kind known")])  # fmt: skip
def test_an_xml_file_is_called_what_it_may_be(root: str, said: str) -> None:
    Path("a.xml").write_text(f"<{root}><x>1</x></{root}>")
    result = run("import", "a.xml")
    assert (result.exit_code, "E-FILE-XML-OTHER" in result.output, said in result.output) == (2, True, True)


def test_two_files_of_opposite_directions_are_said_to_be_one_set(tmp_path: Path) -> None:
    lines = rows(lambda _at, um: str(um))
    for name, way, word in (("a.csv", "+", "forward"), ("b.csv", "-", "backward")):
        own = [",".join((at, number, um)) for at, sign, number, um in lines if sign == way]
        Path(name).write_text("\n".join([word, "target (mm),run,deviation (um)", *own, ""]))
    said = "`trueflank evaluate a.csv --column beside=b.csv`"
    told = json.loads(run("evaluate", "a.csv", "b.csv", "--json").stdout)
    assert said in " ".join(told[0]["flags"])
    assert not [one for one in figures("a.csv")["flags"] if "beside" in one]
    _, command, *words = said.strip("`").split()
    found = figures(*words)
    assert command == "evaluate"
    for name, value in expected().items():
        assert found[name] == pytest.approx(value), name
