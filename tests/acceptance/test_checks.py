"""The acceptance of a cell in one process: each check sees what the cell has, and fails where something is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.probes import Allowance
from gateway.acceptance.judging import cases, run_check
from gateway.acceptance.sheet import CheckResult, sheet_text
from gateway.acceptance.working import SiteDesk, about
from gateway.config import load_site
from gateway.say import silence
from simulators.cell import Cell, cell_running
from tests.selftested import keep


def accepted(
    folder: Path,
    names: tuple[str, ...],
    allow: Allowance = "read",
    *,
    tested: bool = True,
    change: Any = None,
    road: str = "opcua",
) -> dict[str, CheckResult]:
    """Results of these checks by their names, on the smallest cell."""

    async def main() -> dict[str, CheckResult]:
        clock = LoopClock()
        async with cell_running("zero", folder, clock, wires="memory", road=road) as cell:
            if tested:
                keep(cell.site_path, cell.file)
            if change is not None:
                change(cell)
            site = load_site(cell.site_path)
            desk = SiteDesk(site, cell.site_path, clock, silence)
            wanted = [one for one in cases(site) if one[0].name in names]
            found = [await run_check(check, axis, desk, allow) for check, axis in wanted]
            return {one.name: one for one in found}

    return run_virtual(main)


def test_what_can_be_read_is_accepted_and_what_lies_above_is_said(tmp_path: Path) -> None:
    found = accepted(tmp_path, ("identity", "limits", "rights", "motion", "table"))
    told = {name: one.outcome for name, one in found.items()}
    above = {name for name in told if name.startswith(("motion", "table"))}
    assert {told[name] for name in above} == {"skipped"}
    assert {name: word for name, word in told.items() if name not in above and word != "passed"} == {}
    assert found["motion X1"].said == "needs --allow move; this acceptance has --allow read"
    assert "V4.94" in found["identity"].said


def test_a_mailbox_is_accepted_too_and_what_it_does_not_have_is_skipped(tmp_path: Path) -> None:
    found = accepted(tmp_path, ("connection", "identity", "axis", "limits", "rights"), road="modbus")
    print({name: (one.outcome, one.said) for name, one in found.items()})
    assert {name for name, one in found.items() if one.outcome == "failed"} == set()
    assert found["rights"].outcome == "skipped"
    assert found["identity"].outcome == "passed"


def test_what_is_wrong_fails_with_the_next_step(tmp_path: Path) -> None:
    def change(cell: Cell) -> None:
        cell.nck.lose_reference("X1")

    found = accepted(tmp_path, ("axis", "self-test"), tested=False, change=change)
    assert found["axis X1"].outcome == "failed"
    assert "not referenced" in found["axis X1"].said
    assert found["self-test X1"].outcome == "failed"
    assert "trueflank self-test" in found["self-test X1"].said


@pytest.mark.long
def test_an_instrument_that_counts_the_wrong_optics_is_not_accepted(tmp_path: Path) -> None:
    def change(cell: Cell) -> None:
        cell.operator.change(mounts_wrong=["EXX"])

    found = accepted(tmp_path, ("motion",), "move", change=change)
    assert found["motion X1"].outcome == "failed"


def test_the_sheet_shows_every_result_and_lines_to_sign(tmp_path: Path) -> None:
    result = CheckResult("axis <X1>", "read", what="known", outcome="failed", said="no axis & no limit")

    async def main() -> dict[str, str]:
        async with cell_running("zero", tmp_path, LoopClock(), wires="memory") as cell:
            return about(load_site(cell.site_path), "move")

    head = run_virtual(main)
    text = sheet_text([result], head)
    assert "axis &lt;X1&gt;" in text
    assert "no axis &amp; no limit" in text
    assert "0 passed, 1 failed, 0 skipped" in text
    assert head["site"] in text
    assert "Accepted by" in text
