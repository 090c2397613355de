"""A ground part inspected over the bridge, the drift guard from gears, a run from a gear; judged by the true flank."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import LoopClock, run_virtual
from drivers.errors import TrueflankError
from gateway.config import SiteFile, load_site
from gateway.domain.proposals import Proposal
from gateway.say import silence
from gateway.store import RunFolder, Store
from gateway.tooth import GearProposal, GroundPart, InspectedFlank, SetupValues
from gateway.workflow.control.push import push_run
from gateway.workflow.run.folder import store_of
from gateway.workflow.tooth import inspection
from gateway.workflow.tooth.from_gear import propose_from_gear
from gateway.workflow.tooth.inspection import guard_gear_site, inspect_site
from simulators.cell import Cell
from simulators.cellfile import CellFile, load_cell, with_plan
from simulators.grinding import WorkPiece
from simulators.inspection import GearInspectionServer
from simulators.truth import Truth
from tests.cell.test_components import few
from tests.selftested import cell_running
from tests.unit.simulators.planned_run import ground

Story = Callable[[Cell, SiteFile, LoopClock], Awaitable[None]]


def on_cell(folder: Path, story: Story, plan: CellFile | None = None) -> None:
    async def job() -> None:
        clock = LoopClock()
        async with cell_running(
            plan or with_plan(load_cell("demo")), folder / "cell", clock, wires="memory", block_s=1.0
        ) as cell:
            cell.site_path.write_text(few(9, 2)(cell.site_path.read_text(encoding="utf-8")), encoding="utf-8")
            site = load_site(cell.site_path)
            quick = site.operator.model_copy(update={"start_timeout_s": 60.0})
            await story(cell, site.model_copy(update={"operator": quick}), clock)

    run_virtual(job)


def part_of(truth: Truth, **planned: Any) -> WorkPiece:
    assert truth.cell.part is not None
    return ground(truth, truth.cell.part, **planned)


def true_flank(work: WorkPiece, flank: InspectedFlank) -> np.ndarray:
    """What is really there at the places judged, um, one rotation removed."""
    t, z = flank.fitted.theta_rad, flank.fitted.z_mm
    surplus = work.surplus_um(np.arange(float(work.spec.gear.zc)), t, z)
    point, normal = work.lobes.profile(t)
    lever = np.broadcast_to((point.conjugate() * normal).imag[None, :, None], surplus.shape)
    return np.asarray(surplus - lever * np.sum(lever * surplus) / np.sum(lever**2))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


class Hands:
    """One cell's site, its store, and the calls of this story with what was said."""

    def __init__(self, cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        self.cell, self.site, self.clock = cell, site, clock
        self.store = Store(store_of(site, cell.site_path).root)
        self.said: list[str] = []

    def say(self, code: str, /, **_fields: object) -> None:
        self.said.append(code)

    async def inspect(
        self, work: WorkPiece, part: str, run: RunFolder | None = None
    ) -> tuple[InspectedFlank, RunFolder]:
        self.cell.shop.put(work)
        asked = {"clock": self.clock, "say": self.say, "run": run}
        return await inspect_site(self.site, self.cell.site_path, part=part, **asked)  # type: ignore[arg-type]

    async def guard(self, work: WorkPiece, run: RunFolder) -> str:
        self.cell.shop.put(work)
        found = await guard_gear_site(self.site, self.cell.site_path, run, clock=self.clock, say=silence)
        return found.verdict.answer

    async def refused(self, run: RunFolder | None = None, part: str = "other") -> str:
        with pytest.raises(TrueflankError) as caught:
            await inspect_site(self.site, self.cell.site_path, part=part, clock=self.clock, say=silence, run=run)
        return caught.value.code


@pytest.mark.long
def test_a_part_is_inspected_and_guards_its_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The flank within what is stated; wrong parts refused; the same machine holds, 4 um deeper does not."""

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        hands = Hands(cell, site, clock)
        assert await hands.refused() == "E-INSPECT-UNCLAMPED"
        work = part_of(cell.truth, x_mm=-0.011)
        found, run = await hands.inspect(work, "after")
        true = true_flank(work, found)
        assert rms(found.fitted.deviation_um - true) <= found.rms_u_um
        assert found.fitted.rms_um == pytest.approx(rms(true), abs=found.rms_u_um)
        bottom = np.argmin(np.abs(found.fitted.theta_rad))
        leans = [
            np.polyfit(found.fitted.z_mm, e[:, bottom, :].mean(axis=0), 1)[0] for e in (found.fitted.deviation_um, true)
        ]
        assert abs(leans[1]) > 0.03
        assert leans[0] == pytest.approx(leans[1], abs=0.01)
        assert 0.1 < found.rms_u_um < 0.35
        assert found.u_um == pytest.approx(0.2, rel=0.1)
        assert (found.source, found.serial, run.state) == ("gear", "GMM-0031", "inspected")
        assert hands.said[-1] == "P-INSPECTED"
        assert any("clamping eccentricity" in line for line in map(str, found.said))
        assert found.figures["F_p"] > found.figures["f_p"] > 0.2
        assert run.get("inspected-after", InspectedFlank).fitted.rms_um == pytest.approx(found.fitted.rms_um, rel=1e-12)
        raw = run.get("inspected-after-raw", inspection.RawInspection)
        assert raw.whole.points_mm[:, 2].min() == pytest.approx(0.5)
        assert await hands.refused(run) == "E-INSPECT-SAME"

        answerer = cell.instruments["gear"]
        assert isinstance(answerer, GearInspectionServer)
        gear = answerer.machine
        gear.change(wrong_part=True)
        cell.shop.put(part_of(cell.truth))
        assert await hands.refused() == "E-INSPECT-GEAR"
        gear.change(wrong_part=False, wrong_spaces=1)
        cell.shop.put(part_of(cell.truth))
        assert await hands.refused() == "E-GEAR-ENDED"
        gear.change(wrong_spaces=0, glitches=3)
        cell.shop.put(work, work.number)
        with pytest.raises(TrueflankError, match="E-INSPECT-SAME"):
            await guard_gear_site(site, cell.site_path, run, clock=clock, say=silence)
        assert await hands.guard(part_of(cell.truth, x_mm=-0.011, start_s=600.0), run) == "still valid"
        gear.change(glitches=0)
        assert await hands.guard(part_of(cell.truth, x_mm=-0.015), run) == "re-measure this axis"
        monkeypatch.setattr(inspection, "LEVELS", (-0.4, 0.0, 0.4))
        assert await hands.guard(work, run) == "cannot tell"

    on_cell(tmp_path, story)


def corrections_of(cell: Cell, proposal: Proposal) -> dict[str, Any]:
    """The proposal's tables as a control would add them to the encoder: -d of what each input axis says."""

    def added(out: str) -> Callable[[dict[str, np.ndarray]], np.ndarray]:
        def total(places: dict[str, np.ndarray]) -> np.ndarray:
            value = np.zeros_like(places["X"])
            for change in proposal.changes:
                if cell.file.axis(change.axis).letter == out and not change.skipped:
                    over = places[cell.file.axis(change.new.input_axis).letter]
                    value = value - change.new.at(over) / (3600.0 if out == "C" else 1000.0)
            return value

        return total

    return {out: added(out) for out in ("X", "C")}


def test_a_run_from_a_gear_makes_the_next_one_good(tmp_path: Path) -> None:
    """Tables and set-up values from one inspected part alone bring the true flank of the next below 0.35 um."""

    async def story(cell: Cell, site: SiteFile, clock: LoopClock) -> None:
        hands = Hands(cell, site, clock)
        work = part_of(cell.truth)
        found, run = await hands.inspect(work, "before")
        made = GroundPart("before", SetupValues(), 39, "", "", {"C1": "0" * 64})
        other = hands.store.create("demo", {})
        for stage, record in (("inspected-before", found), ("ground-before", made)):
            other.put(stage, record)
        with pytest.raises(TrueflankError, match="E-INSPECT-TABLES"):
            await propose_from_gear(site, cell.site_path, other, clock=clock, say=silence)
        outcome = await propose_from_gear(site, cell.site_path, run, clock=clock, say=hands.say)
        folder = hands.store.open(outcome.run_folder)
        assert folder.state == "proposed"
        proposal, gear = folder.get("proposal", Proposal), folder.get("from-gear", GearProposal)
        assert {change.layer for change in proposal.changes} == {"cross"}
        assert all(not change.skipped for change in proposal.changes), outcome.lines
        assert len({change.new.index for change in proposal.changes}) == len(proposal.changes)
        setup = gear.setup
        values = {
            "x_mm": setup.x_um / 1000.0,
            "c_deg": setup.c_arcsec / 3600.0,
            "dressing_mm": setup.dressing_um / 1000.0,
        }
        better = part_of(cell.truth, corrections=corrections_of(cell, proposal), **values)
        before, after = rms(true_flank(work, found)), rms(true_flank(better, found))
        print(f"true flank: {before:.3f} um before, {after:.3f} um after, {gear.after.rms_um:.3f} um predicted")
        assert before > 3.0
        assert after <= 0.35
        assert after == pytest.approx(gear.after.rms_um, abs=2.0 * gear.u_um)

        shown = await push_run(folder, apply=False, machine_name="", clock=clock, say=silence)
        assert {change.name for change in proposal.changes} == set(shown.data["refusals"])
        reasons = [line for each in shown.data["refusals"].values() for line in each]
        assert all("sign" in line for line in reasons), reasons
        around = [np.array(change.new.deviations) for change in proposal.changes if change.new.modulo]
        assert all(np.sum(np.abs(np.diff(values))) < 4.0 * np.ptp(values) for values in around)

    on_cell(tmp_path, story)
