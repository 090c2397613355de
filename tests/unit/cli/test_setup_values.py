"""`push --setup-values`: typed by a person, a step judged by the next part, and what the next part says of a value."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from drivers.errors import TrueflankError
from gateway.cli import app
from gateway.domain.grinding_process import (
    EstimatedValue,
    HeldValue,
    ProcessShare,
    Separation,
    SetupHandover,
    WheelForm,
)
from gateway.store import RunFolder, Store
from gateway.store.machine_books import SetupProofBook
from gateway.tooth import GroundPart, SetupValues
from gateway.workflow.run import stages
from gateway.workflow.tooth.processing import verify_handover
from tests.unit.approve.test_approve import MACHINE
from tests.unit.approve.test_command import SITE

WORK = """
[work]
gear = "gear.toml"
height_mm = 100.0
infeed = "X1"
x_entry = "R12 of GRIND.MPF"
"""


def separation(part: str, x: float, swivel: float = 0.0, u: float = 0.2) -> Separation:
    values = {
        "x_um": EstimatedValue(x, u),
        "dressing_um": EstimatedValue(0.1, u),
        "swivel_arcsec": EstimatedValue(swivel, 5.0 * u, "arcsec"),
    }
    form = WheelForm(np.zeros(2), np.zeros(2), np.zeros((2, 2)))
    none = EstimatedValue(0.0, 1.0)
    return Separation((part,), 2.0, 0.2, (ProcessShare("wheel", 1.0, 0.1),), (), form, none, False, values, {}, {})


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    site = tmp_path / "site.toml"
    site.write_text(SITE + WORK)
    folder = Store(tmp_path / "runs").create("mill", {"site_file": str(site)})
    folder.put(stages.separated("p1"), separation("p1", 3.2))
    return folder


def push(run: RunFolder, *words: str) -> Result:
    return CliRunner().invoke(app, ["push", str(run.path), "--store", str(run.path.parent), *words])


def code(result: Result) -> str:
    assert isinstance(result.exception, TrueflankError), result.output
    return result.exception.code


def test_a_person_types_where_no_place_is_named_and_the_next_part_verifies(run: RunFolder) -> None:
    shown = push(run, "--setup-values", "p1")
    assert shown.exit_code == 0, shown.output
    assert "+3.2 µm" in shown.output
    assert "R12 of GRIND.MPF" in shown.output
    assert not run.has(stages.handed("p1"))
    assert code(push(run, "--setup-values", "p1", "--apply", "--machine", "lathe")) == "E-RUN-NAME"
    done = push(run, "--setup-values", "p1", "--apply", "--machine", "mill", "--json")
    assert json.loads(done.output)["outcome"] == "typed"
    assert code(push(run, "--setup-values", "p1", "--apply", "--machine", "mill")) == "E-HAND-TWICE"
    for left, said in ((0.1, "W-HAND-VERIFIED"), (3.1, "W-HAND-NOT-VERIFIED"), (6.4, "W-HAND-NOT-VERIFIED")):
        assert [one.code for one in verify_handover(run, separation("p2", left))] == [said]


def test_only_what_is_known_is_handed_over(run: RunFolder) -> None:
    assert code(push(run, "--setup-values", "p9")) == "E-HAND-SEPARATE"
    run.put(stages.separated("small"), separation("small", 0.39))
    assert code(push(run, "--setup-values", "small")) == "E-HAND-SMALL"
    run.put(stages.separated("own"), separation("own", 5.0))
    run.put(stages.ground("own"), GroundPart("own", SetupValues(x_um=4.0), 39, "", ""))
    assert code(push(run, "--setup-values", "own")) == "E-HAND-OWN"
    assert code(push(run, "--setup-values", "p1", "--step", "x")) == "E-HAND-STEP"


@pytest.mark.parametrize(
    ("after", "exit_code", "sense"),
    [(-1.8, 0, 1), (8.1, 0, -1), (3.3, 1, None), (-6.9, 1, None), (0.7, 1, None)],
)
def test_the_next_part_judges_the_step(run: RunFolder, after: float, exit_code: int, sense: int | None) -> None:
    """A step of 5 um: seen, reversed, not seen, twice as large (a diameter), half as large."""
    run.put(stages.separated("p2"), separation("p2", after))
    assert code(push(run, "--setup-values", "p2", "--before", "p1")) == "E-HAND-NO-STEP"
    value = HeldValue("x", "R210", "mm", 5.0, 0.0, 0.005)
    run.put(stages.handed("p1"), SetupHandover("p1", (value,), "committed", 7, "x", machine=MACHINE))
    judged = push(run, "--setup-values", "p2", "--before", "p1", "--json")
    assert judged.exit_code == exit_code, judged.output
    told = json.loads(judged.output)
    assert (told["gain"], told["sense"]) == (pytest.approx((3.2 - after) / 5.0), sense)
    kept = SetupProofBook(run.path.parent).of(MACHINE)
    assert [(one.name, one.place, one.sense) for one in kept] == ([("x", "R210", sense)] if sense else [])
