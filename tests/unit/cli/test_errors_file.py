"""`correct --run` with a file of errors from another program: its forecast, and what is asked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from drivers import registry
from drivers.errors import TrueflankError
from drivers.types.exchange import ErrorCurve, ErrorSet
from gateway.cli import app
from gateway.config import load_site
from gateway.model.components import value
from gateway.workflow.errors21.error_file import StatedErrors, error_set, model_of_errors, read_errors
from tests.unit.cli.test_inspecting import site

X = np.linspace(-400.0, 0.0, 41)
C = np.linspace(0.0, 360.0, 73)
ERRORS = ErrorSet(
    (
        ErrorCurve("EXX", "mm", X, 5.0 + 0.02 * X),
        ErrorCurve("EYX", "mm", X, 2.0 * np.sin(X / 50.0)),
        ErrorCurve("ECC", "deg", C, np.round(6.0 * np.cos(np.deg2rad(2.0 * C)), 9)),
        ErrorCurve("EYY", "mm", X, 0.0 * X),
    ),
    {"B0Z": 4.0, "X0C": 10.0},
)


def called(*words: object) -> Result:
    return CliRunner().invoke(app, list(map(str, words)))


def written(path: Path, *, ours: bool = True) -> Path:
    text = registry.load("etalon-exchange", "error-exchange")().text(ERRORS, ())
    lines = text.splitlines() if ours else [line for line in text.splitlines() if not line.startswith("//")]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_errors_of_a_file_become_the_model_with_the_u_that_was_stated(tmp_path: Path) -> None:
    tree = load_site(site(tmp_path))
    model = model_of_errors(read_errors(written(tmp_path / "e.txt")), StatedErrors(2.0, 1.0), tree)
    assert model.measured == ("EXX", "EYX", "ECC", "B0Z")
    assert len(model.unknown) == 21 - 4
    assert (model.systematic["EXX"], model.systematic["ECC"], model.locations[0].u) == (1.0, 0.5, 0.5)
    motions = {one.name: one for one in model.motions}
    reference = next(axis.reference for axis in tree.axes if axis.letter == "X")
    middle = 0.5 * (X[3] + X[4])
    assert value(motions["EXX"], [middle])[0] == pytest.approx(0.02 * (middle - reference), abs=1e-5)
    straight = (2.0 * np.sin(X[3] / 50.0) + 2.0 * np.sin(X[4] / 50.0)) / 2.0
    assert value(motions["EYX"], [middle])[0] == pytest.approx(straight, abs=1e-5)
    wrapped = value(motions["ECC"], [-45.0, 315.0, 90.0]) - value(motions["ECC"], [0.0])
    assert wrapped == pytest.approx([-6.0, -6.0, -12.0], abs=0.01)
    assert "EYY, X0C" in "\n".join(map(str, model.said))
    again = error_set(model)  # the way back
    assert {one.name for one in again.curves} == {"EXX", "EYX", "ECC"}


def test_the_forecast_of_a_file_proposes_tables_and_stores_nothing(tmp_path: Path) -> None:
    path = site(tmp_path)
    told = called("correct", path, "--run", written(tmp_path / "e.txt"), "--error-u", "2,1", "--json")
    assert told.exit_code == 0, told.output
    found = json.loads(told.output)
    assert found["forecast"]["before_um"] > found["forecast"]["after_um"] > 0.0
    assert any(one["name"] == "C(C)" for one in found["forecast"]["tables"])
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--error-u", "2,1"), "E-ERRORS-SENSE"),
        (("--error-u", "2,1", "--sense", "maybe"), "E-ERRORS-SENSE"),
        (("--sense", "error"), "E-ERRORS-U"),
        (("--sense", "error", "--error-u", "0,1"), "E-ERRORS-U"),
    ],
)
def test_what_a_file_of_errors_does_not_hold_is_asked(tmp_path: Path, words: tuple[str, ...], code: str) -> None:
    told = called("correct", site(tmp_path), "--run", written(tmp_path / "e.txt", ours=False), *words)
    assert isinstance(told.exception, TrueflankError)
    assert told.exception.code == code


def test_values_that_are_corrections_are_turned(tmp_path: Path) -> None:
    path = written(tmp_path / "e.txt", ours=False)
    errors, turned = read_errors(path, "error"), read_errors(path, "correction")
    np.testing.assert_allclose(turned.curves[1].values, -errors.curves[1].values)
    assert (errors.locations["B0Z"], turned.locations["B0Z"]) == (4.0, -4.0)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("X Z EXX\n0 0 0\n0 5 1\n10 0 0\n10 5 2\n", "E-ERRORS-FIELD"),
        ("Y EYY\n0 0\n10 1\n", "E-ERRORS-NONE"),
        ("C ECC\n0 0\n180 0.0001\n360 0.0002\n", "E-ERRORS-TURN"),
        ("target;deviation\n0;1\n", "E-ERRORS-FORMAT"),
    ],
)
def test_files_that_make_no_model_are_refused(tmp_path: Path, text: str, code: str) -> None:
    path = tmp_path / "e.csv"
    path.write_text(text, encoding="utf-8")
    told = called("correct", site(tmp_path), "--run", path, "--error-u", "2,1", "--sense", "error")
    assert isinstance(told.exception, TrueflankError), told.output
    assert told.exception.code == code
