"""C with a cross table over itself: its short capture finds the curve that was predicted for all tables together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.tables import CompensationTable
from gateway.config import GuardSection, load_site
from gateway.domain.captures import Capture
from gateway.domain.proposals import TableChange
from gateway.evaluate.behaviour.repetitions import robust_means
from gateway.push.compare import table_in
from gateway.say import silence
from gateway.store import RunFolder, Store
from gateway.tooth import FlankMap, FlankPrediction, SetupValues, ToothProposal
from gateway.views.runs import last_acting
from gateway.workflow.axes.measure import measure_axis, store_equipment
from gateway.workflow.axes.propose import axis_changes, store_proposal
from gateway.workflow.axes.short_capture import check_u, guard_site, judge_combined_effect, verify_combined_effect
from gateway.workflow.control.push import apply_proposal
from gateway.workflow.run import stages
from gateway.workflow.run.context import open_context
from gateway.workflow.run.folder import new_run
from gateway.workflow.tooth.messages import full_correction_outlooks
from tests.cell.bench import section, short
from tests.selftested import cell_running

NOTHING = np.zeros(0)
EMPTY = FlankMap(np.zeros(1), np.zeros(1), np.zeros((1, 1, 1)))
SIZE = 6.0


def over_itself() -> CompensationTable:
    """C(C): three waves of 6 arcsec in the turn, zero at the reference."""
    at = np.arange(0.0, 360.5, 15.0)
    values = tuple(round(float(v), 3) for v in SIZE * np.sin(np.radians(3.0 * at)))
    return CompensationTable("cross", "C1", "C1", 0.0, 360.0, 15.0, values, True, 0, "deg", "deg")


@pytest.mark.long
def test_c_deviates_on_purpose_as_predicted_and_a_wrong_prediction_is_seen(tmp_path: Path) -> None:
    async def job() -> tuple[RunFolder, Any, Any, Any]:
        clock = LoopClock()
        async with cell_running("demo", tmp_path / "cell", clock, wires="memory", block_s=1.0) as cell:
            path = cell.site_path
            guard = section("guard", {"targets": 6, "repetitions": 2})
            text = short(("C1",), 9, 3)(path.read_text(encoding="utf-8"))
            path.write_text(f"{text}\n{guard}", encoding="utf-8")
            site = load_site(path)
            folder = new_run(site, path)
            async with open_context(site, path, folder, clock, silence) as at:
                store_equipment(at)
                measured = {"C1": await measure_axis(at, at.axis("C1"), "before")}
                own, *_ = await axis_changes(at, measured)
                live, new = measured["C1"].capture.live, over_itself()
                assert live is not None
                cross = TableChange(
                    "C1", table_in(live, new).table, new, False, live.digest, NOTHING, NOTHING, NOTHING, base=live
                )
                proposal = store_proposal(at, (own, cross), (measured["C1"].digest,))
                said = FlankPrediction(EMPTY, EMPTY, EMPTY, 0.0, 0.1, np.zeros((1, 1, 1)), 0.1, 0.1)
                folder.put(
                    stages.TOOTH, ToothProposal(SetupValues(), said, axes=full_correction_outlooks((own,), (cross,)))
                )
                assert await verify_combined_effect(at) == ()  # nothing acts yet
                await apply_proposal(at, proposal, measured)
                (found,) = await verify_combined_effect(at)
                assert (await verify_combined_effect(at))[
                    0
                ].words == found.words  # what is stored is not measured again
                capture = folder.get(stages.capture("C1", "acting"), Capture)
                wrong = replace(full_correction_outlooks((own,), (cross,))[0], deviation=own.predicted)
                missed = judge_combined_effect(wrong, check_u(at.axis("C1"), capture, GuardSection()))
                assert robust_means(capture.targets, capture.deviations).s < 0.5
            guarded = await guard_site(site, path, folder, "C1", clock=clock, say=silence)
            return folder, found, missed, guarded

    folder, found, missed, guarded = run_virtual(job)
    print(found, missed, guarded, sep="\n")
    assert found.held is True
    assert found.M > 1.5 * SIZE
    assert abs(found.M - found.M_predicted) < 2.0 * np.hypot(found.M_U, found.M_predicted_U)
    assert missed.held is False
    assert guarded.verdict.answer == "still valid"  # with the cross table that was pushed after C was measured
    (row,) = last_acting(Store(folder.path.parent))
    assert (row.axis, row.answer) == ("C1", "as predicted")
