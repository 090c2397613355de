"""A run on a cell whose axis hides structure between its targets: more of them, said first, judged by the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gateway.domain.captures import Capture
from gateway.domain.outcomes import Verdict
from gateway.domain.proposals import Proposal
from gateway.store import RunFolder
from gateway.workflow import stages
from simulators.cellfile import CellFile
from tests.cell.bench import main_job, short
from tests.cell.test_hostile import Term, bump, period, wave, with_terms


@pytest.mark.long
@pytest.mark.parametrize(
    ("motion", "axis", "term", "left"),
    [
        ("EXX", "X1", bump(-130.0, 15.0, -8.0), 3.5),
        # The table's step holds nothing of 8 mm: its 6 um stay, and the scatter of the outermost means.
        ("EXX", "X1", period(8.0, 3.0), 7.5),
        ("ECC", "C1", wave(36, 3.0), 4.0),
    ],
)
def test_a_run_measures_more_where_its_axis_hides_something(
    tmp_path: Path, motion: str, axis: str, term: Term, left: float
) -> None:
    cell: CellFile = with_terms(motion, term, even=axis == "C1")
    judged = main_job(tmp_path, cell, edit=short((axis,), 24 if axis == "C1" else 21, 5))
    folder = RunFolder(Path(judged.outcome.run_folder))
    change = folder.get(stages.PROPOSAL, Proposal).changes[0]
    asked = [fields for code, fields in judged.said if code == "P-MORE-TARGETS"]
    targets = folder.get(stages.capture(axis, "before"), Capture).targets.size
    print(judged.before, judged.after, targets, asked)
    assert judged.outcome.data["outcome"] == "better"
    verdict = folder.get(stages.VERDICT, Verdict).axes[0]
    assert verdict.after.targets.size == targets
    assert "acts as predicted" in verdict.words
    assert judged.after[axis]["M"] <= left < judged.before[axis]["M"]
    assert judged.after[axis]["M"] <= float(np.ptp(change.predicted) + 2.0 * np.max(change.predicted_U))
    assert targets == (24 if axis == "C1" else 21) + sum(int(str(fields["count"])) for fields in asked)
