"""A run on a cell whose axis hides structure between its targets: more of them, said first, judged by the truth."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.message import prose
from gateway.config import load_site
from gateway.domain.captures import Capture
from gateway.domain.outcomes import Verdict
from gateway.domain.proposals import Proposal
from gateway.store import RunFolder
from gateway.workflow.errors21.measurement import measure_site
from gateway.workflow.run import stages
from simulators.cellfile import CellFile
from tests.cell.bench import main_job, short
from tests.cell.test_components import truth_of, without_positioning
from tests.cell.test_hostile import Term, bump, period, wave, with_terms
from tests.closing.families import relative
from tests.selftested import cell_running
from tests.sizes import soak


@pytest.mark.long
@pytest.mark.parametrize(
    ("motion", "axis", "term", "left"),
    [
        ("EXX", "X1", bump(-130.0, 15.0, -8.0), 3.5),
        # The table's step holds nothing of 8 mm: its 6 um stay, and the scatter of the outermost means.
        soak(("EXX", "X1", period(8.0, 3.0), 7.5)),
        ("ECC", "C1", wave(36, 3.0), 4.0),
    ],
)
def test_a_run_measures_more_where_its_axis_hides_something(
    tmp_path: Path, motion: str, axis: str, term: Term, left: float
) -> None:
    cell: CellFile = with_terms(motion, term, even=axis == "C1")
    judged = main_job(tmp_path, cell, edit=short((axis,), 25 if axis == "C1" else 21, 5))
    folder = RunFolder(Path(judged.outcome.run_folder))
    change = folder.get(stages.PROPOSAL, Proposal).changes[0]
    asked = [fields for code, fields in judged.said if code == "P-MORE-TARGETS"]
    capture = folder.get(stages.capture(axis, "before"), Capture)
    targets = capture.targets.size
    unread = sum(
        int(count) for count in re.findall(r"(\d+) more could not be read", "\n".join(map(str, capture.notes)))
    )
    print(judged.before, judged.after, targets, asked, unread)
    assert judged.outcome.data["outcome"] == "better"
    verdict = folder.get(stages.VERDICT, Verdict).axes[0]
    assert verdict.after.targets.size == targets
    assert "acts as predicted" in prose(verdict.words)
    assert judged.after[axis]["M"] <= left < judged.before[axis]["M"]
    assert judged.after[axis]["M"] <= float(np.ptp(change.predicted) + 2.0 * np.max(change.predicted_U))
    assert targets == (25 if axis == "C1" else 21) + sum(int(str(fields["count"])) for fields in asked) - unread
    assert unread <= 1


@pytest.mark.long
def test_a_worn_guide_gets_more_targets_where_the_tooth_is_ground(tmp_path: Path) -> None:
    """A hollow of 47 mm in the straightness of Z; its set-up has a target every 15 mm and half an hour to spare."""
    file = relative("worn", 2, "11-lobe disc")
    said: list[tuple[str, dict[str, object]]] = []

    async def job() -> tuple[Capture, np.ndarray, np.ndarray]:
        clock = LoopClock()
        async with cell_running(file, tmp_path / "cell", clock, wires="memory", block_s=1.0) as cell:
            site = without_positioning(load_site(cell.site_path))
            found = await measure_site(
                site, cell.site_path, clock=clock, say=lambda code, /, **fields: said.append((code, fields)),
                wanted=("EXZ",), resume=None,
            )  # fmt: skip
            folder = RunFolder(Path(found.run_folder))
            travel = np.linspace(0.0, 300.0, 601)
            return folder.get(stages.setup("EXZ-Z1"), Capture), travel, await truth_of(cell, "EXZ", travel)

    capture, travel, true = run_virtual(job)
    (asked,) = [fields for code, fields in said if code == "P-MORE-TARGETS"]
    print(asked, capture.targets)
    assert capture.targets.size == 21 + int(str(asked["count"]))
    means = np.nanmean(capture.deviations, axis=(1, 2))
    assert face_missed(travel, capture.targets, means, true) < 0.15


def face_missed(travel: np.ndarray, at: np.ndarray, means: np.ndarray, true: np.ndarray) -> float:
    """How far straight lines between means vary from the truth over a face around 150 mm, RMS; optics lean at will."""
    missed = np.interp(travel, at, means) - true
    missed -= np.polyval(np.polyfit(travel, missed, 1), travel)
    return float(np.std(missed[np.abs(travel - 150.0) <= 10.0]))
