"""`evaluate` of folders: in processes as in one, and a table that a stopped work goes on behind."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

from click.testing import Result
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from gateway.cli import app

GOLDEN = Path(__file__).parents[2] / "golden" / "files"
# E of basic.rtl by hand: the largest of its six deviations less the smallest, um.
E_UM = 2.875


def asked(*words: str | Path) -> Result:
    return CliRunner().invoke(app, ["evaluate", *map(str, words)])


def folder(where: Path, count: int) -> Path:
    """So many copies of one file, half of them a folder deeper, beside a text that is no result."""
    (where / "day" / "deeper").mkdir(parents=True)
    (where / "day" / "notes.doc").write_text("no result", encoding="utf-8")
    for number in range(count):
        place = where / "day" / ("deeper" if number % 2 else "")
        shutil.copy(GOLDEN / "basic.rtl", place / f"x{number}.rtl")
    return where / "day"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_processes_give_the_answers_of_one(tmp_path: Path) -> None:
    day = folder(tmp_path, 9)
    (day / "broken.rtl").write_text("nothing of a result", encoding="utf-8")
    alone, together = asked(day, "--json"), asked(day, "--json", "--jobs", "2")
    found = json.loads(together.stdout)
    assert found == json.loads(alone.stdout)
    assert together.exit_code == alone.exit_code == 2
    assert len(found) == 10
    assert [one["error"]["code"] for one in found if "error" in one] == ["E-FILE-DETECT"]
    assert {one["E"] for one in found if "error" not in one} == {E_UM}


def test_a_table_begun_again_goes_on_behind_what_holds(tmp_path: Path) -> None:
    day, table = folder(tmp_path, 3), tmp_path / "all.csv"
    first = asked(day, "--table", table, "--limit", "E=1")  # not decidable: one repetition gives no U
    whole = table.read_text(encoding="utf-8")
    assert first.exit_code == 21
    assert [float(row["E"]) for row in rows(table)] == [E_UM] * 3
    # Stopped in the middle of the last line, and one file has changed since.
    table.write_text(whole[:-40], encoding="utf-8")
    changed = day / "x0.rtl"
    changed.write_bytes(changed.read_bytes() + b"\r\n")
    again = asked(day, "--table", table, "--limit", "E=1", "--json")
    assert json.loads(again.stdout)["held"] == 1
    assert again.exit_code == 21
    assert sorted(row["file"] for row in rows(table)) == sorted(str(one) for one in day.rglob("*.rtl"))
    assert [float(row["E"]) for row in rows(table)] == [E_UM] * 3
    # All of them stand there now; what they say counts all the same, and another question holds none of them.
    told = asked(day, "--table", table, "--limit", "E=1", "--json")
    assert (json.loads(told.stdout)["held"], told.exit_code) == (3, 21)
    other = asked(day, "--table", table, "--json")
    assert (json.loads(other.stdout)["held"], other.exit_code) == (0, 0)


def test_a_file_that_could_not_be_read_is_tried_again(tmp_path: Path) -> None:
    day, table = folder(tmp_path, 1), tmp_path / "all.csv"
    (day / "broken.rtl").write_text("nothing of a result", encoding="utf-8")
    assert asked(day, "--table", table).exit_code == 2
    assert {row["error"].partition(":")[0] for row in rows(table)} == {"", "E-FILE-DETECT"}
    again = asked(day, "--table", table, "--json")
    assert again.exit_code == 2
    assert json.loads(again.stdout)["held"] == 1
    assert len(rows(table)) == 2


def test_no_other_file_is_taken_for_a_table(tmp_path: Path) -> None:
    day, table = folder(tmp_path, 1), tmp_path / "all.csv"
    table.write_text("a,b\n1,2\n", encoding="utf-8")
    error = asked(day, "--table", table).exception
    assert isinstance(error, TrueflankError)
    assert error.code == "E-CLI-TABLE"
    assert table.read_text(encoding="utf-8") == "a,b\n1,2\n"
    (tmp_path / "empty").mkdir()
    none = asked(tmp_path / "empty").exception
    assert isinstance(none, TrueflankError)
    assert none.code == "E-CLI-NO-RESULTS"
