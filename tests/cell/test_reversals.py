"""Reversals of ten machines through a run: true |B| at and between the targets afterwards; the truth is the judge."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from drivers.message import Message
from simulators.cellfile import CellFile, load_cell
from tests.cell.bench import main_job, short
from tests.sizes import soak


def lagging(axis: str, B: float, scatter: float = 0.0, tilt: float = 0.0) -> CellFile:
    """The demo machine with this reversal of one axis, um or arcsec; ``tilt`` more to each end, or once round."""
    raw = load_cell("demo").model_dump()
    for one in raw["axes"]:
        if one["name"] == axis:
            middle, half = sum(one["travel"]) / 2.0, (one["travel"][1] - one["travel"][0]) / 2.0
            along: dict[str, Any] = {"kind": "harmonic", "order": 1, "amplitude": tilt, "phase_deg": 30.0}
            if one["kind"] == "linear":
                along = {"kind": "polynomial", "coefficients": [0.0, tilt], "center": middle, "scale": half}
            one["reversal"] = [{"kind": "constant", "value": B}, *([along] if tilt else [])]
            one |= {"hysteresis": None, "scatter": scatter}
    return CellFile.model_validate(raw)


def run_on(folder: Path, cell: CellFile, axis: str) -> tuple[Any, dict[str, Any]]:
    source: Any = cell
    judged = main_job(folder, source, edit=short((axis,), 12, 4))
    report = json.loads(Path(judged.outcome.data["report"]["json"]).read_text(encoding="utf-8"))
    return judged, report["axes"][0]


def findings(told: dict[str, Any]) -> list[str]:
    """What an axis' report found, in English."""
    return [str(Message.from_data(one)) for one in told["findings"]]


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("axis", "B", "scatter"),
    [
        soak(("X1", -0.5, 0.0)),
        soak(("X1", 0.9, 0.0)),
        ("X1", -2.2, 0.1),
        soak(("X1", 8.0, 0.0)),
        soak(("Z1", -3.5, 0.1)),
        ("Z1", 5.5, 0.0),
        soak(("C1", -0.6, 0.0)),
        ("C1", 2.0, 0.1),
    ],
)
def test_a_constant_reversal_is_gone_at_and_between_the_targets(
    tmp_path: Path, axis: str, B: float, scatter: float
) -> None:
    judged, told = run_on(tmp_path, lagging(axis, B, scatter), axis)
    before, after = judged.before[axis], judged.after[axis]
    U = told["parameters"]["B"]["after_u"]
    assert after["B"] <= U + 0.1 * before["B"]
    assert after["M"] <= 0.3 * before["M"]
    assert judged.outcome.data["outcome"] == "better"
    assert [one["push"]["outcome"] for one in told["beside"]] == ["committed"]


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_reversal_within_its_scatter_is_left_alone_and_said_to_be(tmp_path: Path) -> None:
    judged, told = run_on(tmp_path, lagging("X1", 0.3, 0.5), "X1")
    assert "S-REVERSAL-WITHIN" in judged.outcome.data["not_corrected"]["X1-reversal"]
    assert any("X1-reversal" in line for line in findings(told))
    assert judged.after["X1"]["B"] <= judged.before["X1"]["B"] + 1e-6


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("axis", "B", "tilt"), [("X1", -3.0, 1.5), soak(("C1", 1.5, -1.0))])
def test_what_depends_on_the_position_goes_into_a_pair_of_tables(
    tmp_path: Path, axis: str, B: float, tilt: float
) -> None:
    judged, told = run_on(tmp_path, lagging(axis, B, tilt=tilt), axis)
    U = told["parameters"]["B"]["after_u"]
    assert judged.after[axis]["B"] <= U + 0.1 * judged.before[axis]["B"]
    assert judged.after[axis]["M"] <= 0.3 * judged.before[axis]["M"]
    assert judged.outcome.data["outcome"] == "better"
    assert [one["push"]["outcome"] for one in told["beside"]] == ["committed"] * 3


@pytest.mark.long
@pytest.mark.timeout(900)
def test_without_room_for_a_pair_what_depends_on_the_position_stays_and_is_never_larger(tmp_path: Path) -> None:
    cell = lagging("X1", -3.0, tilt=1.5)
    cell = cell.model_copy(update={"machine": cell.machine.model_copy(update={"cec_points": (100, 0, 0, 0)})})
    judged, told = run_on(tmp_path, cell, "X1")
    U = told["parameters"]["B"]["after_u"]
    assert judged.after["X1"]["B"] <= 0.6 * judged.before["X1"]["B"]
    assert judged.after["X1"]["B"] <= 1.5 + U + 0.1 * judged.before["X1"]["B"]
    assert any("B is then 1." in line for line in findings(told))
