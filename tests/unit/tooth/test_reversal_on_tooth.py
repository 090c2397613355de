"""What a reversal does to a flank, ground by the truth in the directions of the program: C turns one way, X comes up.

The truth knows each axis' reversal; what the gateway makes of a capture is held against the ground flank.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.types.tables import CompensationTable
from gateway.config import WorkSection
from gateway.correct.plan.reversal import reversal_pair
from gateway.model.waves import fit_means
from gateway.table import Grid
from gateway.workflow.tooth.messages import one_way_message
from simulators.cellfile import CellFile, load_cell
from simulators.truth import Truth
from tests.cell.fitted import read
from tests.closing.judge import Places, places, rms
from tests.unit.simulators.planned_run import ground

NO_TABLES: Any = None
WORK = WorkSection.model_construct(index_sense=-1)
C_WAVE = {"kind": "harmonic", "order": 1, "amplitude": 1.5, "phase_deg": 30.0}


def demo(reversals: dict[str, list[dict[str, Any]]]) -> CellFile:
    """The demo machine with these reversals and no others."""
    raw = load_cell("demo").model_dump()
    for one in raw["axes"]:
        one |= {"reversal": reversals.get(one["letter"], []), "hysteresis": None}
    return CellFile.model_validate(raw)


def flank(cell: CellFile, corrections: dict[str, Any] | None = None) -> tuple[np.ndarray, Places]:
    """The true flank (K, T, Z) with x zero, dressing and rotation put right."""
    assert cell.part is not None
    at = places(cell.part)
    work = ground(Truth(cell), cell.part, corrections=corrections)
    return at.set_right(work.surplus_um(at.spaces, at.t, at.z)), at


def constant(value: float) -> dict[str, Any]:
    return {"kind": "constant", "value": value}


@pytest.fixture(scope="module")
def none() -> np.ndarray:
    return flank(demo({}))[0]


def test_a_reversal_that_is_the_same_everywhere_leaves_no_mark(none: np.ndarray) -> None:
    """Nor does one of X that varies along its travel, for X works at one place."""
    varies = {"kind": "polynomial", "coefficients": [0.0, 3.0], "center": -200.0, "scale": 200.0}
    lagging = {"X": [constant(-8.0), varies], "Z": [constant(5.0)], "C": [constant(2.0)]}
    assert rms(flank(demo(lagging))[0] - none) < 0.01


def test_what_varies_marks_the_flank_by_what_is_said(none: np.ndarray) -> None:
    cell = demo({"C": [constant(2.0), C_WAVE]})
    marked, at = flank(cell)
    capture = read(Truth(cell), 3).capture("ECC", "C1", NO_TABLES, "")
    said = one_way_message("C1", capture, WORK, (), lever_mm=at.lever)
    assert len(said) == 1
    moved = rms(marked - none)
    assert moved > 0.05
    assert float(re.findall(r"makes ([0-9.]+)", str(said[0]))[0]) == pytest.approx(moved, abs=0.01)
    assert "in the direction -," in str(said[0])
    one_sided = replace(capture, deviations=capture.deviations * np.array([1.0, np.nan]))
    assert one_way_message("C1", one_sided, WORK, (), lever_mm=at.lever) == ()


def test_the_half_that_acts_in_the_direction_of_the_program_takes_the_mark_away(none: np.ndarray) -> None:
    """The other half acts when C turns the other way; it would make the mark twice as large."""
    cell = demo({"C": [constant(2.0), C_WAVE]})
    mark = rms(flank(cell)[0] - none)
    targets = np.arange(0.0, 360.0, 15.0)
    B = Truth(cell).deviation("C", targets, 1) - Truth(cell).deviation("C", targets, -1)
    curve = fit_means(
        targets, B, np.full(targets.size, 0.05), name="ECC", axis="C1", axis_unit="deg", kind="rotary", modulo=True
    )
    pair = reversal_pair(curve, "deg", Grid(0.0, 360.0, 5.0), reference=0.0, modulo=True)
    left = {table.direction: rms(flank(cell, {"C": added_by(table)})[0] - none) for table in pair}
    assert left[-1] < 0.05 * mark
    assert left[1] == pytest.approx(2.0 * mark, rel=0.05)


def added_by(table: CompensationTable) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
    """What a control adds to C, deg: it takes the deviation that the table holds away."""
    return lambda at: -np.interp(np.mod(at["C"], 360.0), table.positions, table.deviations) / 3600.0
