"""A closing run whose wheel has a form error: told in the order of corrections, dressed once, proved by truth."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from gateway.config import load_site
from gateway.domain.grinding_process import CorrectionOrder, UnexplainedField, WheelVerdict
from gateway.process.wheel import SenseProof
from gateway.store import RunFolder
from gateway.study.dresser import load_dresser
from gateway.workflow.complete_run import AFTER, close_site
from gateway.workflow.run import stages
from gateway.workflow.tooth.verdict import BEFORE
from simulators.cell import Cell
from simulators.cellfile import Wheel, load_cell, with_plan
from simulators.grinding import WorkPiece
from tests.closing.judge import places, rms
from tests.closing.reckoned import BLOCK_S
from tests.closing.runs import Watched, quick
from tests.selftested import cell_running

DRESSER = """[dresser]
columns = ["axial", "correction"]
length_unit = "mm"
correction_unit = "um"
sign = 1
diamond_radius_mm = 0.4
"""
FORM = {"form": [{"waves": 1.5, "left_um": 1.5, "right_um": 1.1}]}


@dataclass
class Shop(Watched):
    """Gives the dresser the table that the run asks for."""

    def say(self, code: str, /, **fields: object) -> None:
        super().say(code, **fields)
        if code == "P-WHEEL-DRESS":
            lines = Path(str(fields["file"])).read_text(encoding="utf-8").splitlines()
            rows = np.array(list(csv.reader(lines)), dtype=float)
            assert self.cell.shop.give_dresser(rows[:, 0].tolist(), rows[:, 1].tolist())


def true_form(work: WorkPiece) -> float:
    """RMS of what all spaces have alike that neither a shift nor a turn makes, um: the wheel's form by the truth."""
    t = work.lobes.even(40)
    flank = work.surplus_um(np.arange(float(work.spec.gear.zc)), t, np.array([-3.0, 0.0, 3.0])).mean(axis=(0, 2))
    point, normal = work.lobes.profile(t)
    moves = np.stack([normal.real, normal.imag, (point.conjugate() * normal).imag], axis=1)
    return rms(np.asarray(flank - moves @ np.linalg.lstsq(moves, flank, rcond=None)[0]))


def with_dresser(cell: Cell, text: str) -> str:
    path = cell.site_path.parent / "dresser.toml"
    path.write_text(DRESSER, encoding="utf-8")
    load_dresser(path).keep(SenseProof(1.0, 0.0, 0.05, "proved"))
    return quick(cell, text).replace("[work]\n", '[work]\ndresser_file = "dresser.toml"\n')


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_wheel_is_dressed_by_what_the_run_told_of_it(tmp_path: Path) -> None:
    async def main() -> None:
        clock = LoopClock()
        plan = with_plan(load_cell("eleven")).model_copy(update={"wheel": Wheel.model_validate(FORM)})
        async with cell_running(plan, tmp_path, clock, wires="memory", block_s=BLOCK_S) as cell:
            path = cell.site_path
            path.write_text(with_dresser(cell, path.read_text(encoding="utf-8")), encoding="utf-8")
            site, shop = load_site(path), Shop(cell)
            asked = {"apply": True, "machine_name": site.site.name, "clock": clock, "say": shop.say}
            outcome = await close_site(site, path, **asked)  # type: ignore[arg-type]
            folder = RunFolder(Path(outcome.run_folder))
            first, last = (shop.parts[one].work for one in (BEFORE, AFTER))
            order = folder.get(stages.ORDER, CorrectionOrder)
            verdict = folder.get(stages.WHEEL_VERDICT, WheelVerdict)
            print(order, verdict, true_form(first), true_form(last), outcome.state)
            assert outcome.state == "better"
            assert all(one.u_um < 0.7 for one in order.steps)
            assert {one.name for one in order.steps} == {"as ground", "set-up", "tables", "wheel"}
            assert verdict.held
            assert verdict.before_um == pytest.approx(true_form(first), abs=0.1)
            assert verdict.after_um == pytest.approx(true_form(last), abs=0.1)
            assert true_form(last) < 0.2 * true_form(first)
            # What the order told of the whole flank, form and all, is what was ground.
            at = places(first.spec)
            as_ground = order.steps[0]
            assert rms(at.flank(first)) == pytest.approx(as_ground.flank_um, rel=0.15)
            assert rms(at.flank(last)) < order.undressed_floor_um
            assert shop.said.count("P-WHEEL-DRESS") == 1
            assert not folder.get(stages.UNEXPLAINED, UnexplainedField).common_um > 1.0

    run_virtual(main)
