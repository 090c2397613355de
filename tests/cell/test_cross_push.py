"""A proposal with cross tables on a simulated machine: the sign is measured first, then the tables act as they say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.tables import CompensationTable
from gateway.config import load_site
from gateway.domain.outcomes import Verdict
from gateway.domain.proposals import Proposal, TableChange
from gateway.push.compare import table_in
from gateway.say import silence
from gateway.workflow.axes.measure import fetch_tables
from gateway.workflow.control.push import apply_proposal
from gateway.workflow.run import audit_trail, stages
from gateway.workflow.run.context import open_context
from gateway.workflow.run.folder import new_run
from tests.cell.bench import short
from tests.selftested import cell_running
from tests.sizes import few

NOTHING = np.zeros(0)
# The cell draws the sense in which its control applies cross tables.
SEEDS = {1: 1, -1: 6}


def wave(step: float, low: float, high: float, unit: Any, index: int, source: str) -> CompensationTable:
    """Zero at both ends and the reference, 8 um at the middle of the input axis' range."""
    count = round((high - low) / step) + 1
    values = np.interp(np.arange(count), [0, (count - 1) // 2, count - 1], [0.0, 8.0, 0.0])
    return CompensationTable(
        "cross",
        source,
        "X1",
        low,
        high,
        step,
        tuple(round(float(value), 3) for value in values),
        modulo=unit == "deg",
        index=index,
        input_unit=unit,
    )


@pytest.mark.parametrize("sign", few([-1, 1]))
def test_cross_tables_are_proved_pushed_and_act(tmp_path: Path, sign: int) -> None:
    async def job() -> dict[str, Any]:
        clock = LoopClock()
        async with cell_running(
            "demo", tmp_path / "cell", clock, wires="memory", block_s=1.0, seed=SEEDS[sign]
        ) as cell:
            path = cell.site_path
            path.write_text(short(("X1", "Z1", "C1"), 9, 3)(path.read_text(encoding="utf-8")), encoding="utf-8")
            site = load_site(path)
            folder = new_run(site, path)
            async with open_context(site, path, folder, clock, silence) as at:
                grids = {axis.name: axis.table for axis in site.axes}
                live = await fetch_tables(at, at.axis("X1"))
                z = grids["Z1"]
                tables = (
                    wave(z.step, z.minimum, z.maximum, "mm", 0, "Z1"),
                    wave(45.0, 0.0, 360.0, "deg", 1, "C1"),
                )
                changes = tuple(
                    TableChange(
                        "X1", table_in(live, one).table, one, False, live.digest, NOTHING, NOTHING, NOTHING, base=live
                    )
                    for one in tables
                )
                proposal = Proposal(at.machine, changes, (), clock.utc().isoformat())
                folder.put(stages.PROPOSAL, proposal)
                assert audit_trail.record_proposal(at, proposal) == ""
                verdict = await apply_proposal(at, proposal, {})
                proof = at.proofs.find(at.machine, "cross", "X1")
            middle = (len(tables[0].deviations) - 1) // 2
            return {
                "verdict": verdict,
                "proof": proof,
                "stages": folder.stages,
                "value": float(cell.nck.get(f"$AN_CEC[0,{middle}]")),
                "switches": [bool(cell.nck.get(f"$SN_CEC_TABLE_ENABLE[{number}]")) for number in (0, 1)],
                "axis": bool(cell.nck.get("$MA_CEC_ENABLE[X1]")),
            }

    seen = run_virtual(job)
    verdict: Verdict = seen["verdict"]
    assert seen["proof"].sign == sign
    assert verdict.proofs == (seen["proof"], seen["proof"])
    assert {"push-X1-cec0", "push-X1-cec1", "verdict"} <= set(seen["stages"])
    assert seen["value"] == pytest.approx(sign * 0.008)
    assert (seen["switches"], seen["axis"]) == ([True, True], True)
