"""The proof: seeded machines in virtual time, others over their wires, tables on and off; written down by itself.

`make soak` runs it on 20 machines, `make soak N=200` on more; `PROOF=folder` says where the document goes.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import LoopClock
from gateway.store import RunFolder
from gateway.tooth import ToothProposal
from gateway.workflow.run import stages
from simulators.cellfile import load_cell, with_plan
from tests.closing.pool import jobs, prove
from tests.closing.proof import machine_row, write
from tests.closing.record import violations
from tests.selftested import cell_running

DOCS = Path(__file__).parents[2] / "docs"
WORKERS = 2
SAME_UM = 0.15


@pytest.mark.soak
@pytest.mark.timeout(0)
def test_seeded_machines_end_at_their_floor_and_the_run_says_so(tmp_path: Path) -> None:
    count = int(os.environ.get("TRUEFLANK_MACHINES", "20"))
    results = prove(jobs(count), tmp_path, WORKERS, lambda one: print(machine_row(one), flush=True))
    command = "make soak" if count == 20 else f"make soak N={count}"
    write(results, Path(os.environ.get("TRUEFLANK_PROOF") or DOCS), command)
    assert violations(results) == []


@pytest.mark.soak
@pytest.mark.timeout(3000)
async def test_tables_switched_off_bring_the_old_flanks_back(tmp_path: Path) -> None:
    """CEC off: the flank that EEC alone makes, as foretold. EEC off too: the first part again."""
    from tests.closing.again import expected, ground_now, switched
    from tests.closing.judge import places, places_at, rms
    from tests.closing.runs import closed

    clock = LoopClock()
    async with cell_running(with_plan(load_cell("demo")), tmp_path, clock, wires="memory", block_s=0.5) as cell:
        done = await closed(cell, clock)
        first, last = (done.watched.parts[part].work for part in ("before", "after"))
        at = places(first.spec)
        change = rms(at.trued(at.flank(last)) - at.trued(at.flank(first)))
        assert change > 4.0 * SAME_UM

        await switched(cell, "$MA_CEC_ENABLE[{axis}]", on=False)
        alone, began = await ground_now(cell)
        off = at.trued(at.flank(alone)) - at.trued(expected(cell, alone, began, at))
        assert rms(off) < SAME_UM
        assert rms(at.trued(at.flank(alone)) - at.trued(at.flank(last))) > 2.0 * SAME_UM
        said = RunFolder(done.folder.path).get(stages.TOOTH, ToothProposal).prediction
        there = places_at(first.spec, said.with_own.theta_rad, said.with_own.z_mm)
        missed = rms(there.trued(there.flank(alone)) - there.trued(said.with_own.deviation_um))
        assert missed < 2.0 * float(np.hypot(said.u_um, SAME_UM))

        await switched(cell, "$MA_ENC_COMP_ENABLE[0,{axis}]", on=False)
        bare, _ = await ground_now(cell)
        assert rms(at.trued(at.flank(bare)) - at.trued(at.flank(first))) < SAME_UM
