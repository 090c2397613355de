"""Closing runs with a short plan: positioning live, everything else from files; the truth is the judge."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.clock import LoopClock
from gateway import audit
from gateway.config import load_site
from gateway.say import silence
from gateway.store import RunFolder
from gateway.tooth import ToothProposal
from gateway.workflow.complete_run import close_site
from gateway.workflow.run import stages
from simulators.cell import Cell
from simulators.cell.backdoor import BackDoor
from simulators.cell.setup_files import write_site_of_files
from simulators.cellfile import CellFile, load_cell, with_plan
from tests.closing.machines import machine
from tests.closing.presses import by_kind
from tests.closing.reckoned import BLOCK_S, unlike
from tests.closing.record import MachineResult
from tests.closing.runs import run_machine
from tests.selftested import cell_running
from tests.sizes import soak

LIVE = {"EXX", "EZZ", "ECC"}
# NCK resets, mountings, blanks: the most that the short plan of the shipped cell may ask for.
ASKED = (3, 10, 3)
# Presses of NC START beyond those that confirm what was mounted or clamped, by their cause: the most of each.
PRESSED = {
    "P-NC-READ": 4,  # 3 axes at the files' set-ups; all before the trial tables
    "P-PUSH-START": 4,  # trial tables, the old ones again, axis layer, cross layer
    "P-PUSH-EFFECT": 2,  # of each layer
    "P-GRIND-PREPARED": 3,  # of each part
    "P-START-SETUP TFSENSE": 2,  # all set-ups; all sign proofs. The rest goes on in a program that runs
}


def short(cell: Cell, text: str) -> str:
    """X and Z at fewer targets, and every set-up but those of X, Z and C as a file that the cell's bench wrote."""
    path = cell.site_path
    path.write_text(
        text.replace("count = 11", "count = 21").replace("repetitions = 2", "repetitions = 5"), encoding="utf-8"
    )
    write_site_of_files(cell, path, {setup.component for setup in cell.file.setups} - LIVE)
    axes, rest = path.read_text(encoding="utf-8").split("[[setups]]", 1)
    few = axes.replace("count = 21", "count = 11").replace("repetitions = 5", "repetitions = 4")
    return f"{few}[[setups]]{rest}"


def kept(one: MachineResult) -> list[str]:
    """What a single machine breaks of what all are held to."""
    said = [one.failed] if one.failed else []
    said += ["above its floor"] if one.after_um > one.limit_um else []
    said += ["worse"] if one.after_um > one.set_right_um + 2.0 * one.u_um else []
    said += [f"{part.name} off by {part.off:.2f}" for part in one.components if part.off > part.limit]
    return said


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("name", "absent_at"), [("eleven", "trial"), *map(soak, (("demo", ""), ("2", ""), ("4", "")))])
def test_a_short_plan_ends_at_the_floor_of_its_machine(tmp_path: Path, name: str, absent_at: str) -> None:
    """On one of them nobody loads the trial part: the run stops, goes on later, and does nothing twice.

    The shipped machine goes through its whole plan beside (`tests/closing/test_asked.py`), and is judged the same.
    """
    file: CellFile = machine(int(name)) if name.isdecimal() else with_plan(load_cell(name))
    found = run_machine(file, file.seed, tmp_path, short=True, edit=short, absent_at=absent_at, least=False)
    print(found)
    assert kept(found) == []
    assert found.done_twice == ()
    assert found.after_um < 0.5 * found.set_right_um
    assert found.outcome == "better"
    print(found.presses.listed())
    done = [sum(one.startswith(word) for one in found.presses.handled) for word in ("mounted ", "clamped ")]
    asked = (len(found.presses.resets), *done)
    assert name != "demo" or all(count <= most for count, most in zip(asked, ASKED, strict=True)), asked
    pressed = by_kind(found.presses.starts)
    assert name != "demo" or all(count <= PRESSED.get(cause, 0) for cause, count in pressed.items()), pressed
    assert name != "demo" or unlike(tmp_path / "site.toml", found.presses, found.virtual_s) == []
    assert audit.read_log_state(tmp_path / "runs", file.machine.serial).alarms == {}


@pytest.mark.long
async def test_a_plan_from_files_ends_with_a_proposal_for_the_tooth(tmp_path: Path) -> None:
    """The smaller one of the same loop: nothing is mounted, ground or written without `apply`."""
    clock = LoopClock()
    async with cell_running(with_plan(load_cell("demo")), tmp_path, clock, wires="memory", block_s=BLOCK_S) as cell:
        path = write_site_of_files(cell, cell.site_path)
        tables = await BackDoor(cell).answer({"ask": "tables"})
        done = await close_site(load_site(path), path, apply=False, machine_name="", clock=clock, say=silence)
        folder = RunFolder(Path(done.run_folder))
        tooth = folder.get(stages.TOOTH, ToothProposal)
        assert tooth.prediction.after.rms_um < 0.5 * tooth.prediction.before.rms_um
        assert stages.PROPOSAL in folder.stages
        assert await BackDoor(cell).answer({"ask": "tables"}) == tables
        assert not [line for line in cell.operator.log if line.startswith(("mounted", "clamped"))]
        assert cell.shop.ground is None
