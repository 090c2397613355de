"""The part before is asked whether the model is right: reversed optics are refused and named, honest ones pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import TrueflankError
from gateway import audit
from gateway.tooth import ToothVerdict
from gateway.workflow.run import stages
from gateway.workflow.tooth import proposal
from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from simulators.cell.setup_files import write_setup_file, write_site_of_files
from simulators.cellfile import load_cell, with_plan
from tests.closing.machines import machine
from tests.closing.parts import Asked, asked, turned
from tests.closing.reckoned import BLOCK_S
from tests.closing.runs import closed, quick
from tests.selftested import cell_running

# Of the errors that a straightness or angle set-up measures those that show on a flank beyond what doubts it.
SHOWN = ("EXC", "EYC", "EAC", "EBC")


def look(seed: int, folder: Path, *reversed_: str) -> Asked:
    """What a closing run on the machine of a seed makes of its part."""
    found, _ = run_virtual(lambda: asked(turned(machine(seed), *reversed_), folder))
    return found


@pytest.mark.long
@pytest.mark.timeout(900)
def test_reversed_optics_end_a_run_before_its_tables_and_measured_anew_it_goes_on(tmp_path: Path) -> None:
    def mount_right(cell: Cell, path: Path) -> None:
        """Somebody turns the indicator round; the bench measures that set-up again."""
        setups = cell.file.setups
        cell.bench.turn_round("EXC")
        (table,) = path.with_suffix(".setups").glob("EXC-*.csv")
        write_setup_file(cell, "EXC", "C1", table)
        assert [one.reversed for one in setups if one.component == "EXC"] == [True]

    async def run() -> tuple[Asked, Asked | None]:
        return await asked(turned(with_plan(load_cell("demo")), "EXC"), tmp_path, mount_right)

    first, again = run_virtual(run)
    assert (first.code, first.exit_code, first.proposed) == ("E-PART-APART", 6, False)
    assert first.found.missed_um > 3.0 * first.found.u_um
    (only,) = first.found.explanations
    assert (only.error, only.how) == ("EXC", "reversed")
    assert only.left_um < 0.2 * first.found.missed_um
    assert "EXC-C1" in first.text
    assert again is not None
    assert (again.code, again.proposed, again.found.outcome) == ("", True, "agrees")
    assert again.found.missed_um < 2.0 * again.found.u_um


@pytest.mark.soak
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("seed", range(1, 21))
def test_seeded_machines_with_one_reversed_optic_and_honest_ones(tmp_path: Path, seed: int) -> None:
    error = SHOWN[seed % len(SHOWN)]
    honest, wrong = look(seed, tmp_path / "honest"), look(seed, tmp_path / "wrong", error)
    print(seed, error, honest.found.ratio, wrong.found)
    assert (honest.code, honest.found.outcome, honest.found.explanations) == ("", "agrees", ())
    assert (wrong.code, wrong.proposed) == ("E-PART-APART", False)
    assert [(one.error, one.how) for one in wrong.found.explanations] == [(error, "reversed")]


@pytest.mark.soak
@pytest.mark.timeout(1800)
async def test_a_whole_run_with_a_reversed_indicator_writes_nothing(tmp_path: Path) -> None:
    """Live set-up by set-up for what C does, the operator mounts one indicator the wrong way round."""
    clock = LoopClock()
    file = with_plan(load_cell("demo"))
    async with cell_running(file, tmp_path, clock, wires="memory", block_s=BLOCK_S) as cell:
        cell.operator.change(mounts_reversed=("EXC",))
        tables = await BackDoor(cell).answer({"ask": "tables"})
        with pytest.raises(TrueflankError) as caught:
            await closed(cell, clock, live_index)
        assert (caught.value.code, caught.value.exit_code) == ("E-PART-APART", 6)
        assert "EXC-C1" in str(caught.value)
        assert await BackDoor(cell).answer({"ask": "tables"}) == tables


@pytest.mark.long
@pytest.mark.timeout(1800)
async def test_a_flank_that_became_worse_takes_all_tables_of_the_run_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody asks the part here, so a reversed indicator's tables are written; then the old ones act again."""
    monkeypatch.setattr(proposal, "compare_part_with_model", lambda *_given, **_more: {})
    clock = LoopClock()
    file = turned(with_plan(load_cell("demo")), "EXC")
    async with cell_running(file, tmp_path, clock, wires="memory", block_s=BLOCK_S) as cell:
        before = await BackDoor(cell).answer({"ask": "tables"})
        done = await closed(cell, clock, quick)
        verdict = done.folder.get(stages.TOOTH_VERDICT, ToothVerdict)
        assert (verdict.outcome, done.folder.state) == ("worse", "worse")
        assert len(verdict.taken_back) >= 4
        assert [code for code in done.watched.said if code.startswith("P-CLOSE")] == [
            "P-CLOSE-BACK",
            "P-CLOSE-UNEXPLAINED",
            "P-CLOSE-GOING-BACK",
        ]
        after = await BackDoor(cell).answer({"ask": "tables"})
        switched = {axis: table["enabled"] for axis, table in after["tables"].items()}
        assert switched == {axis: table["enabled"] for axis, table in before["tables"].items()}
        actions = [entry["action"] for entry in audit.read_entries(tmp_path / "runs")]
        assert actions.count("close-goes-back") == 1
        assert actions.count("rollback-committed") == len(verdict.taken_back)


def live_index(cell: Cell, text: str) -> str:
    """The set-up of EXC as it is mounted live, everything else as files that the cell's bench wrote."""
    path = cell.site_path
    path.write_text(text, encoding="utf-8")
    every = {setup.component for setup in cell.file.setups}
    write_site_of_files(cell, path, every - {"EXC"})
    return path.read_text(encoding="utf-8")
