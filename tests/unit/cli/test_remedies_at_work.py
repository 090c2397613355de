"""Remedies that need a run, a day's folder or a cell that runs: what is printed is done until the job is done."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from drivers.errors import TrueflankError, catalogue
from gateway.capture.corrections import from_live
from gateway.cli import app
from gateway.cli.cell import CellRequest, cell_process
from gateway.domain.equipment import SenseProof
from gateway.store import Store
from gateway.workflow.run import stages
from tests.sizes import few
from tests.unit.cli.test_import_export import AXIS, captured
from tests.unit.day.test_day import site

EXAMPLES = Path(__file__).parents[3] / "examples"
TABLE = "Axis: X1\ntarget_mm,direction,repetition,deviation_um\n" + "".join(
    f"{at},{way},{run},{at % 7 / 10}\n"
    for at in (-390.0, -300.0, -200.0, -110.0, 0.0)
    for way in "+-"
    for run in (1, 2)
)
ANSWERS = {"error": '"EXX"', "datum": "0", "direction": '"+"', "material_degc": "20", "use": "true"}
MOST_ROUNDS = 6


def typed(line: str) -> Result:
    return CliRunner().invoke(app, shlex.split(line))


def refused(line: str, code: str) -> TrueflankError:
    """The error of a command, which has the code and prints its remedy."""
    error = typed(line).exception
    assert isinstance(error, TrueflankError), line
    assert error.code == code
    assert error.hint
    return error


def calls(error: TrueflankError) -> list[str]:
    return re.findall(r"`(?:trueflank|python) ([^`]+)`", error.hint)


def answered(line: str) -> Result:
    """A day, its open questions written into the file that the error names until it has none."""
    for _ in range(MOST_ROUNDS):
        result = typed(line)
        error = result.exception
        if not isinstance(error, TrueflankError):
            return result
        assert error.code == "E-DAY-OPEN", str(error)
        assert "write the answers into this file" in error.hint
        asked = str(error.fields["lines"])
        written = re.sub(
            r'^(\w+) = (?:""|\?).*$', lambda one: f"{one[1]} = {ANSWERS[one[1]]}", asked, flags=re.MULTILINE
        )
        assert " = " in written
        with Path(error.where).open("a", encoding="utf-8") as file:
            file.write(f"{written}\n")
    raise AssertionError("the questions have no end")


def a_run() -> None:
    folder = Store(Path("runs")).create("g1", {"site_file": ""})
    capture = from_live(AXIS, captured(AXIS)[0], SenseProof("laser", "X1", 1, 1.0, (0.0, 10.0, 0.0)), "nothing")
    for phase in ("before", "after"):
        folder.put(stages.capture("X1", phase), capture)


def several_captures() -> None:
    a_run()
    line = "runs export latest --to csv -o a.csv --axis X1"
    assert "--axis" in (hint := refused(line, "E-EXPORT-SEVERAL").hint)
    assert "--phase before" in hint
    assert typed(f"{line} --phase after").exit_code == 0
    assert "target_mm" in Path("a.csv").read_text()


def no_such_capture() -> None:
    a_run()
    line = "runs export latest --to csv -o a.csv"
    assert "--axis and --phase" in refused(f"{line} --axis Z1 --phase after", "E-EXPORT-NOTHING").hint
    assert typed(f"{line} --axis X1 --phase after").exit_code == 0


def an_empty_day() -> None:
    site(Path.cwd())
    Path("day").mkdir()
    line = "day day --site site.toml --no-ask"
    assert "copy the files" in refused(line, "E-DAY-EMPTY").hint
    Path("day/X1.csv").write_text(TABLE)
    refused(line, "E-DAY-OPEN")
    done = answered(line)
    assert done.exit_code == 0, done.output
    assert "EXX" in done.output


def a_layout_that_is_not_public() -> None:
    """The table in its place is asked about like any other; `an_empty_day` goes on from there."""
    site(Path.cwd())
    Path("day").mkdir()
    Path("day/X1.rts").write_bytes(b"LASER 7\n\x00\x01")
    line = "day day --site site.toml --no-ask"
    assert "is not public" in str(refused(line, "E-DAY-OPEN"))
    assert "export a table as text" in catalogue()["E-DAY-UNDESCRIBED"]["do"]
    Path("day/X1.rts").rename("X1.rts")
    Path("day/X1.csv").write_text(TABLE)
    assert "Which error does X1.csv hold" in str(refused(line, "E-DAY-OPEN"))


def presses_that_nobody_counts() -> None:
    shutil.copytree(EXAMPLES / "sites", "sites")
    shutil.copytree(EXAMPLES / "gears", "gears")
    path = Path("sites/mailbox-grinder.toml")
    (call,) = calls(refused(f"run {path} --plan --axis X1", "E-DAY-ROAD"))
    call = call.replace("SITE", str(path))
    assert "list the set-up of each axis" in refused(call, "E-SETUP-NONE").hint
    with path.open("a", encoding="utf-8") as file:
        file.write('\n[[setups]]\naxis = "X1"\ncomponent = "EXX"\ninstrument = "laser"\n')
    done = typed(call)
    assert done.exit_code == 0, done.output
    assert "EXX" in done.output


def a_cell() -> None:
    """One cell for all that needs one, for its start takes seconds."""
    refused("simulate nosuch --site none.toml", "E-CLI-CELL")
    (call,) = calls_of("E-CLI-CELL")
    shown = call.replace("NAME", "nosuch").replace("FILE", "none.toml")
    done = subprocess.run([sys.executable, *shlex.split(shown)], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "nosuch" in done.stderr + done.stdout
    (call,) = calls(refused("simulate panel cell.toml status", "E-CLI-NO-CELL"))
    assert call == "simulate"
    with cell_process(CellRequest(cell="demo", site=Path("cell.toml"), speed=50.0)):
        assert typed("simulate panel cell.toml status").exit_code == 0
        (call,) = calls(refused("simulate panel cell.toml dance", "E-CLI-CELL-WORD"))
        listed = typed(call.replace("SITE", "cell.toml"))
        assert listed.exit_code == 0
        assert "press" in listed.output


def calls_of(code: str) -> list[str]:
    return re.findall(r"`(?:trueflank|python) ([^`]+)`", catalogue()[code]["do"])


AT_WORK: dict[str, Callable[[], None]] = {
    "E-EXPORT-SEVERAL": several_captures,
    "E-EXPORT-NOTHING": no_such_capture,
    "E-DAY-EMPTY": an_empty_day,
    "E-DAY-OPEN": an_empty_day,
    "E-DAY-UNDESCRIBED": a_layout_that_is_not_public,
    "E-DAY-ROAD": presses_that_nobody_counts,
    "E-CLI-CELL": a_cell,
    "E-CLI-NO-CELL": a_cell,
    "E-CLI-CELL-WORD": a_cell,
}
"""What provokes each code and follows its remedy; one of them may follow several."""


WORKS = sorted(set(AT_WORK.values()), key=lambda one: (one is a_cell, one.__name__))


@pytest.mark.parametrize("work", few(WORKS, len(WORKS) - 1))
def test_following_what_is_printed_ends_the_trouble_at_work(
    work: Callable[[], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    work()
