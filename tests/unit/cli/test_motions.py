"""Tables with several error motions: each is an import of its own, by its heading or by a declaration; none is lost."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.errors import TrueflankError
from drivers.types.results import MeasuredSet
from gateway.cli import app
from gateway.store import RunFolder

SIX = ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX")
UNITS = ("um",) * 3 + ("arcsec",) * 3


def deviations() -> Any:
    """(6, 5, 2, 2): a different curve for each motion, exact in three decimals."""
    return np.round(np.random.default_rng(8).uniform(-9.0, 9.0, (6, 5, 2, 2)), 3)


def table(path: Path, heads: tuple[str, ...], values: Any, target: str = "Target (mm)", more: str = "") -> Path:
    """One row a reading: target, direction, run, then a column for each motion, and one of temperatures."""
    lines = [";".join((target, "Direction", "Run", *heads, "Air (degC)"))]
    for run in range(2):
        for way, sign in enumerate("+-"):
            for at in range(5):
                cells = (f"{50 * at}", sign, str(run + 1), *(f"{one[at, run, way]:.3f}" for one in values), "20.1")
                lines.append(";".join(cells))
    path.write_text(more + "\n".join([*lines, ""]), encoding="utf-8")
    return path


def told(*words: str) -> Any:
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refused(*words: str) -> TrueflankError:
    result = CliRunner().invoke(app, [*words, "--json"])
    if isinstance(result.exception, TrueflankError):
        return result.exception
    (one,) = json.loads(result.stdout)
    return TrueflankError(one["error"]["code"], one["file"], **one["error"]["fields"])


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files and runs of each test lie in a folder of its own."""
    monkeypatch.chdir(tmp_path)


def stored(one: Any) -> MeasuredSet:
    return RunFolder(Path(one["folder"])).get("measured", MeasuredSet)


def test_six_motions_named_in_the_heading_are_six_imports_of_one_command() -> None:
    values = deviations()
    heads = tuple(f"{name} ({unit})" for name, unit in zip(SIX, UNITS, strict=True))
    table(Path("six.csv"), heads, values, more="Machine;Mill 7\n")
    found = told("import", "six.csv")
    assert [one["component"] for one in found] == list(SIX)
    assert all(one["new"] for one in found)
    for one, wanted in zip(found, values, strict=True):
        np.testing.assert_allclose(stored(one).deviations, wanted)
        assert stored(one).header["Machine"] == "Mill 7"
        assert "columns not read: Air (°C)" in one["notes"]
    again = told("import", "six.csv")
    assert not any(one["new"] for one in again)
    assert [one["run"] for one in again] == [one["run"] for one in found]
    rows = told("evaluate", "six.csv")
    assert [row["unit"] for row in rows] == list(UNITS)


def test_motions_are_declared_by_column_with_their_units_and_remembered() -> None:
    values = deviations()
    table(Path("plain.csv"), tuple(f"ch{at}" for at in range(6)), values)
    columns = ["EXX=4", "EBX=8", "EXX_unit=mm", "EBX_unit=arcsec"]
    words = [word for one in columns for word in ("--column", one)]
    found = told("import", "plain.csv", *words)
    assert [one["component"] for one in found] == ["EXX", "EBX"]
    np.testing.assert_allclose(stored(found[0]).deviations, values[0] * 1000.0)
    np.testing.assert_allclose(stored(found[1]).deviations, values[4])
    (left,) = (note for note in found[0]["notes"] if note.startswith("columns not read"))
    assert all(f"ch{at}" in left for at in (1, 2, 3, 5))
    assert refused("import", "plain.csv", "--column", "EYX=5", "--forget").code == "E-IMPORT-MOTION-UNIT"


def test_another_column_of_the_same_file_is_another_import() -> None:
    values = deviations()
    table(Path("plain.csv"), tuple(f"ch{at} (um)" for at in range(6)), values)

    def column(number: int) -> Any:
        said = ("target=1", f"deviation={number}", "run=3", "direction=column", "direction_column=2")
        said += ("separator=semicolon", "target_unit=mm", "reading_unit=um")
        return told("import", "plain.csv", *(word for one in said for word in ("--column", one)))[0]

    first, second, again = column(4), column(5), column(4)
    assert (first["new"], second["new"], again["new"]) == (True, True, False)
    assert again["run"] == first["run"] != second["run"]
    np.testing.assert_allclose(stored(second).deviations, values[1])


def test_words_of_the_field_name_the_motions_where_the_file_names_the_axis() -> None:
    values = deviations()
    heads = (
        "Linear (um)",
        "Straightness Y (um)",
        "Straightness Z (um)",
        "Roll (arcsec)",
        "Pitch (arcsec)",
        "Yaw (arcsec)",
    )
    table(Path("x.csv"), heads, values, more="Axis: X\n")
    senses = [word for name in SIX[1:] for word in ("--column", f"{name}_sense=1")]
    found = told("import", "x.csv", *senses)
    assert [one["component"] for one in found] == list(SIX)
    np.testing.assert_allclose(stored(found[4]).deviations, values[4])
    assert [one["component"] for one in told("import", "x.csv", "--motion", "ebx")] == ["EBX"]
    assert refused("import", "x.csv", "--motion", "EBZ").code == "E-IMPORT-MOTION"


def test_two_columns_of_one_motion_and_columns_without_a_unit_are_refused() -> None:
    values = deviations()[:2]
    table(Path("twice.csv"), ("EXX (um)", "EXX left (um)"), values)
    assert refused("import", "twice.csv").code == "E-IMPORT-MOTION-TWICE"
    table(Path("bare.csv"), ("EXX", "EYX (um)"), values)
    error = refused("import", "bare.csv")
    assert error.code == "E-IMPORT-MOTION-UNIT"
    assert "EXX_unit=um" in str(error)
    table(Path("target.csv"), ("EXX (um)", "EYX (um)"), values, target="Target")
    assert refused("import", "target.csv").code == "E-IMPORT-MOTION-UNIT"


def test_evaluate_takes_the_axis_or_component_that_is_asked_for(tmp_path: Path) -> None:
    table = tmp_path / "six.csv"
    stops = [(run, way, at) for run in (1, 2) for way in "+-" for at in (0, 100, 200, 300)]
    rows = [f"{at};{at / 100:.1f};{at / 50:.1f};{way};{run}" for run, way, at in stops]
    table.write_text("Position (mm);EXX (um);EYX (um);direction;run\n" + "\n".join(rows) + "\n", encoding="utf-8")
    said = CliRunner().invoke(app, ["evaluate", str(table), "--axis", "EYX", "--json"])
    (one,) = json.loads(said.output)
    assert (one["file"].split()[-1], one["M"]) == ("EYX", pytest.approx(6.0))
    assert not any("columns not read" in flag for flag in one["flags"])
    both = json.loads(CliRunner().invoke(app, ["evaluate", str(table), "--axis", "x", "--json"]).output)
    assert [found["file"].split()[-1] for found in both] == ["EXX", "EYX"]
    wrong = CliRunner().invoke(app, ["evaluate", str(table), "--axis", "Z"])
    assert wrong.exit_code == 2
    assert "EXX, X, EYX" in " ".join(wrong.output.split())
