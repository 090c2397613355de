"""The laser may count either way and the control may take its cross tables either way: the machine moves as wanted.

The signs are drawn by nobody here: each of the four machines is made, proved by its instruments, and judged by where
its axis really stands before and after.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.types.orders import SignProof
from drivers.types.tables import CompensationTable
from gateway.config import load_site
from gateway.domain.outcomes import PushRecord
from gateway.domain.proposals import TableChange
from gateway.interlocks.facts import value_at
from gateway.push.compare import table_in
from gateway.push.transaction import push_table
from gateway.say import silence
from gateway.workflow.axes.measure import fetch_tables
from gateway.workflow.control import signs
from gateway.workflow.run import push_context
from gateway.workflow.run.context import RunContext, open_context
from gateway.workflow.run.folder import new_run
from simulators.cell import Cell
from simulators.cellfile import load_cell
from tests.cell.bench import short
from tests.selftested import cell_running
from tests.signed import signed
from tests.sizes import few

NOTHING = np.zeros(0)
PLACES = np.linspace(-380.0, -20.0, 7)


def machine(laser: Any, cec: Any) -> Any:
    """The demo machine with these two signs."""
    file = load_cell("demo")
    instruments = tuple(
        one.model_copy(update={"sense": laser}) if hasattr(one, "sense") and one.name == "laser" else one
        for one in file.instruments
    )
    assert instruments != file.instruments or laser == 1
    changed = file.machine.model_copy(update={"cec_sign": cec})
    return file.model_copy(update={"instruments": instruments, "machine": changed})


def wave(function: Any, source: str, low: float, high: float, peak: float) -> CompensationTable:
    """A triangle over the axis' range, zero at both ends."""
    step = (high - low) / 20.0
    values = np.interp(np.arange(21), [0, 10, 20], [0.0, peak, 0.0])
    return CompensationTable(function, source, "X1", low, high, step, tuple(round(float(one), 3) for one in values))


async def pushed(at: RunContext, table: CompensationTable, before: tuple[CompensationTable, ...]) -> PushRecord:
    """Prove the sign with the laser, then push."""
    live = await fetch_tables(at, at.axis("X1"))
    context = push_context.table_context(at, table, None)
    proof = context.proof
    old = table_in(signed(live, proof.sign if proof is not None else 1), table)
    change = TableChange("X1", old.table, table, old.enabled, live.digest, NOTHING, NOTHING, NOTHING, base=live)
    if proof is None:
        (found,) = await signs.prove_table_signs(at, ((change, context),), signs.MountedInstruments(at))
        assert isinstance(found, SignProof)
        proof = found
    context = push_context.table_context(at, table, None)
    return await push_table(change, replace(context, proof=proof, approvals_needed=1, pushed=before))


def stands(cell: Cell) -> Any:
    """Where the encoder says X would stand, come from below, mm."""
    core = cell.nck.core
    return core.standing(core.axis("X1").index, PLACES, 1)


@pytest.mark.parametrize(("laser", "cec"), few([(-1, -1), (1, -1), (-1, 1), (1, 1)]))
def test_the_machine_moves_as_the_tables_say_whichever_way_both_count(tmp_path: Path, laser: int, cec: int) -> None:
    async def job() -> dict[str, Any]:
        clock = LoopClock()
        file = machine(laser, cec)
        async with cell_running(file, tmp_path / "cell", clock, wires="memory", block_s=1.0, seed=1) as cell:
            path = cell.site_path
            path.write_text(short(("X1", "Z1"), 9, 3)(path.read_text(encoding="utf-8")), encoding="utf-8")
            site = load_site(path)
            async with open_context(site, path, new_run(site, path), clock, silence) as at:
                own = wave("axis", "X1", -400.0, 0.0, 9.0)
                cross = wave("cross", "Z1", 0.0, 300.0, 6.0)
                first = stands(cell)
                records = [await pushed(at, own, ()), await pushed(at, cross, (own,))]
                z = float(cell.nck.axis_state("Z1").actual_position)
                proofs = [at.proofs.find(at.machine, function, "X1") for function in ("axis", "cross")]
            return {
                "records": records,
                "proofs": proofs,
                "moved": stands(cell) - first,
                "wanted": np.array([-value_at(own, x) - value_at(cross, z) for x in PLACES]) / 1000.0,
                "stored": float(cell.nck.get("$AN_CEC[0,10]")),
                "z": z,
            }

    seen = run_virtual(job)
    assert [record.outcome for record in seen["records"]] == ["committed", "committed"], seen["records"]
    assert [proof.sign for proof in seen["proofs"]] == [1, cec]
    assert seen["stored"] == pytest.approx(cec * 0.006)
    assert seen["moved"] == pytest.approx(seen["wanted"], abs=2e-4)
    assert float(np.max(np.abs(seen["wanted"]))) > 0.004
