"""A closing run with the builder's own cycle: a person runs it, set-up values go to its numbers, the truth judges."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.message import prose
from gateway.config import SiteFile, load_site
from gateway.domain.equipment import Equipment
from gateway.domain.grinding_process import SetupHandover, SetupProof
from gateway.errors import IllegalTransition, WriteRefused
from gateway.push import JOURNALS, setup_history
from gateway.store import RunFolder
from gateway.store.machine_books import SetupProofBook
from gateway.tooth import GroundPart, ToothProposal, ToothVerdict
from gateway.workflow.complete_run import AFTER, TRIAL, close_site
from gateway.workflow.run import stages
from gateway.workflow.run.folder import store_of
from gateway.workflow.tooth.verdict import BEFORE
from simulators.cell import Cell
from simulators.cell.builder_cycle import CYCLE, X_NUMBER
from simulators.cellfile import load_cell, with_plan
from tests.closing.judge import places, rms
from tests.closing.reckoned import BLOCK_S
from tests.closing.runs import Watched, quick
from tests.selftested import cell_running

DRESSER = 200
OFF = {X_NUMBER: 0.014, DRESSER: -0.011}
"""What the builder's numbers are wrong by at first, mm."""


@dataclass
class Shop(Watched):
    """Runs the builder's cycle where the gateway asks for it."""

    def say(self, code: str, /, **fields: object) -> None:
        super().say(code, **fields)
        if code == "P-CYCLE-RUN":
            assert self.cell.run_builder_cycle()


def with_places(cell: Cell, text: str) -> str:
    """The numbers of the builder's cycle in place of the wheel's for our own program."""
    site = quick(cell, text)
    keys = f'x_place = "R{X_NUMBER}"\ndressing_place = "R{DRESSER}"'
    return re.sub(r'^wheel_place = "R200"$', keys, site, flags=re.MULTILINE)


def prove(site: SiteFile, path: Path, folder: RunFolder) -> None:
    """Somebody has proved both senses by a known step."""
    machine = folder.get(stages.EQUIPMENT, Equipment).machine
    kept = SetupProofBook(store_of(site, path).root)
    for name, place in (("x", f"R{X_NUMBER}"), ("dressing", f"R{DRESSER}")):
        kept.save(SetupProof(machine, name, place, "mm", 1, 1.0, 0.05, "2026-01-01T00:00:00+00:00"))  # type: ignore[arg-type]


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_loop_closes_over_the_builders_cycle(tmp_path: Path) -> None:
    async def main() -> None:
        clock = LoopClock()
        plan = with_plan(load_cell("eleven"))
        async with cell_running(plan, tmp_path, clock, wires="memory", block_s=BLOCK_S) as cell:
            path = cell.site_path
            path.write_text(with_places(cell, path.read_text(encoding="utf-8")), encoding="utf-8")
            for number, value in OFF.items():
                cell.nck.set(f"R[{number}]", value, 0)
            site, shop = load_site(path), Shop(cell)
            asked = {"apply": True, "machine_name": site.site.name, "clock": clock, "say": shop.say}
            with pytest.raises(WriteRefused) as caught:
                await close_site(site, path, cycle=CYCLE, **asked)  # type: ignore[arg-type]
            assert [one.code for one in caught.value.fields["reasons"]] == ["E-HAND-SENSE"] * 2  # type: ignore[attr-defined]
            assert cell.shop.ground is None
            folder = RunFolder(shop.folder)
            prove(site, path, folder)
            with pytest.raises(IllegalTransition) as other:
                await close_site(site, path, cycle="OTHER", resume=folder, **asked)  # type: ignore[arg-type]
            assert other.value.code == "E-CYCLE-RESUME"
            outcome = await close_site(site, path, resume=folder, **asked)  # type: ignore[arg-type]

            # By the truth: the flank is better than the first part is with its set-up values right.
            first, last = (shop.parts[one].work for one in (BEFORE, AFTER))
            at = places(first.spec)
            before, fair, after = rms(at.flank(first)), rms(at.set_right(at.flank(first))), rms(at.flank(last))
            said = folder.get(stages.TOOTH, ToothProposal).prediction
            verdict = folder.get(stages.TOOTH_VERDICT, ToothVerdict)
            print(f"true flank {before:.2f} um, set right {fair:.2f}, after {after:.2f}, predicted {said.rms_um:.2f}")
            print(prose(verdict.words), outcome.state)
            assert (verdict.outcome, outcome.state) == ("better", "better")
            assert after < 0.5 * fair < before
            assert abs(after - said.rms_um) < 3.0 * said.rms_u_um

            # What was handed over is what the control holds, and what the next run begins with.
            handed = [folder.get(stages.handed(one), SetupHandover) for one in (TRIAL, AFTER)]
            assert [one.outcome for one in handed] == ["committed"] * 2
            ground = folder.get(stages.ground(AFTER), GroundPart)
            for number, name, um in (
                (X_NUMBER, "x", ground.setup.x_um),
                (DRESSER, "dressing", ground.setup.dressing_um),
            ):
                held = float(cell.nck.get(f"R[{number}]"))  # type: ignore[arg-type]
                added = sum(v.added for one in handed for v in one.values if v.name == name)
                assert held == pytest.approx(OFF[number] + 1e-3 * added, abs=1e-9)
                assert added == pytest.approx(um, abs=0.1)
            serial = folder.get(stages.EQUIPMENT, Equipment).machine.serial
            assert len(setup_history(store_of(site, path).root / JOURNALS, serial)) == 2
            gear = site.work.gear.stem if site.work else ""
            assert gear
            books = list((store_of(site, path).root / "set-up-values").rglob("*.json"))
            assert len(books) == 1
            assert CYCLE in books[0].name.upper()

    run_virtual(main)
