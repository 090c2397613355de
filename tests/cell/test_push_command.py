"""A stored proposal: shown with what speaks against it, nothing written; then pushed, proved, measured again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from gateway import audit
from gateway.cli.next_steps import after_push_preview, push_options
from gateway.config import load_site
from gateway.errors import WriteRefused
from gateway.say import silence
from gateway.store import Store
from gateway.workflow.complete_run import run_site
from gateway.workflow.control.push import push_run
from gateway.workflow.run.self_test import self_test_site
from simulators.cell import cell_running
from simulators.cell.backdoor import BackDoor
from tests.cell.bench import short


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a run folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_proposal_is_shown_then_pushed(tmp_path: Path) -> None:
    async def job() -> dict[str, Any]:
        clock = LoopClock()
        async with cell_running("demo", tmp_path / "cell", clock, wires="memory", block_s=1.0, seed=3) as cell:
            path = cell.site_path
            path.write_text(short(("C1",), 9, 3)(path.read_text(encoding="utf-8")), encoding="utf-8")
            site, judge = load_site(path), BackDoor(cell)
            with pytest.raises(WriteRefused, match="E-RUN-SELF-TEST"):
                await run_site(site, path, apply=True, machine_name=site.site.name, clock=clock, say=silence)
            made = await run_site(site, path, apply=False, machine_name="", clock=clock, say=silence)
            folder = Store(path.parent / site.site.store).open(made.run_folder)
            with pytest.raises(WriteRefused, match="E-INT-NO-SELF-TEST"):
                await push_run(folder, apply=True, machine_name=site.site.name, clock=clock, say=silence)
            untested = await push_run(folder, apply=False, machine_name="", clock=clock, say=silence)
            tables = await judge.answer({"ask": "tables"})
            tested = await self_test_site(site, path, axis="", clock=clock, say=silence)
            shown = await push_run(folder, apply=False, machine_name="", clock=clock, say=silence)
            untouched = await judge.answer({"ask": "tables"}) == tables
            before = cell.figures("C1")["M"]
            pushed = await push_run(folder, apply=True, machine_name=site.site.name, clock=clock, say=silence)
            whole = contents(folder.path)
            again = await push_run(folder, apply=False, machine_name="", clock=clock, say=silence)
            assert contents(folder.path) == whole
            return {
                "made": made,
                "untested": untested,
                "tested": tested,
                "shown": shown,
                "untouched": untouched,
                "pushed": pushed,
                "again": again,
                "M": (before, cell.figures("C1")["M"]),
                "steps": folder.stages,
                "state": folder.state,
                "last": list(audit.read_entries(folder.path.parent))[-1],
            }

    seen = run_virtual(job)
    assert any("until `trueflank doctor self-test` has passed" in str(line) for line in seen["made"].lines)
    assert "PRODUCT OF TABLE 0" in seen["tested"].data["axes"]["C1"]["passed"]
    assert seen["untested"].data["refused_by"] == ["E-INT-NO-SELF-TEST"]
    assert (
        after_push_preview(seen["untested"].data["refused_by"], "R", "S", push_options("x", "M"))
        == "doctor self-test S"
    )
    assert (
        after_push_preview(seen["shown"].data["refused_by"], "R", "S", push_options("x", "M"))
        == "push R --apply --machine M"
    )
    assert seen["untouched"]
    assert any("is proved first" in str(line) for line in seen["shown"].lines)
    assert seen["pushed"].data["outcome"] == "better"
    assert seen["M"][1] < 0.7 * seen["M"][0]
    assert {"push-C1", "verdict", "capture-C1-after"} <= set(seen["steps"])
    assert seen["again"].data["refusals"]["C1"] == []
    assert seen["state"] == seen["again"].state == "better"
    assert seen["last"]["action"] == "push-looked"
