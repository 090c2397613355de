"""A measured run's proposal for the tooth on a cell: both layers, set-up values and a flank that its truth grinds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import trueflank as tf
from drivers.clock import LoopClock, run_virtual
from drivers.types.tables import CompensationTable
from gateway.config import load_site
from gateway.correct.flank.noise import noise_patterns
from gateway.correct.outlook.flank_uncertainty import ProcessUncertainty, doubts
from gateway.correct.outlook.prediction import predict
from gateway.correct.part.inspected import setup_from_part
from gateway.correct.plan.layers import correct
from gateway.correct.plan.plan import AxisGrid, Plan
from gateway.domain.proposals import Proposal
from gateway.gear.cycloid import CycloidGear
from gateway.gear.flank import flank_figure, flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right
from gateway.model.error_model import chain_of_errors
from gateway.say import silence
from gateway.store import RunFolder
from gateway.tooth import FlankMap, InspectedFlank, ToothProposal
from gateway.workflow.axes.measure import fetch_tables, store_equipment
from gateway.workflow.control.push import push_run
from gateway.workflow.run import stages
from gateway.workflow.run.context import open_context
from gateway.workflow.run.folder import new_run
from gateway.workflow.tooth.proposal import ToothOutcome, correct_site
from simulators.cell import Cell
from simulators.cellfile import load_cell, with_plan
from simulators.grinding.grinder import rotation_axis_frame
from simulators.truth import Truth
from tests.cell.fitted import read
from tests.selftested import cell_running
from tests.unit.simulators.planned_run import ground

SEED = 11
OWN = {"X1": "EXX", "Z1": "EZZ", "C1": "ECC"}
GRIDS = Plan(
    (AxisGrid("X", -400.0, 0.0, 10.0), AxisGrid("Z", 0.0, 300.0, 10.0), AxisGrid("C", 0.0, 360.0, 5.0, modulo=True))
)
LATER_S = 720.0  # from one part to the next


async def measured(cell: Cell, clock: LoopClock, without: tuple[str, ...] = ()) -> RunFolder:
    """A run folder as `measure` leaves it, the readings taken from the truth and not over the wires."""
    path = cell.site_path
    site = load_site(path)
    folder, readings = new_run(site, path), read(cell.truth, SEED)
    async with open_context(site, path, folder, clock, silence, ()) as at:
        store_equipment(at)
        for name, error in OWN.items():
            capture = readings.capture(error, name, await fetch_tables(at, at.axis(name)), clock.utc().isoformat())
            folder.put(stages.setup(f"{error}-{name}"), capture)
    folder.put(stages.ERRORS, readings.model(without))
    return folder


def ground_flank(
    truth: Truth,
    tables: tuple[CompensationTable, ...],
    off_um: tuple[float, float] = (0.0, 0.0),
    more: int = 0,
    **set_up: float,
) -> FlankMap:
    """What a machine grinds with these tables (machine axes), the work that far off its axis; no rotation removed.

    ``more`` spaces than the cell's gear has make it another one.
    """
    part = truth.cell.part
    assert part is not None
    counted = {"zc": part.gear.zc + more, "zp": part.gear.zp + more}
    part = part.model_copy(update={"gear": part.gear.model_copy(update=counted)})
    grid = flank_grid(CycloidGear(**part.gear.model_dump()))

    def added(out: str) -> Any:
        mine = [one for one in tables if one.output_axis[0] == out]
        size = 1.0 / 3600.0 if out == "C" else 1e-3
        return lambda at: -size * sum(np.interp(_into(at, one), one.positions, one.deviations) for one in mine)

    true = rotation_axis_frame(truth, part.grinding.height_mm)
    seat = replace(true, origin=true.origin + 1e-3 * np.array([[*off_um, 0.0]]))
    work = ground(truth, part, seat, corrections={out: added(out) for out in "XZC"}, **set_up)
    spaces = np.arange(float(part.gear.zc))
    return FlankMap(grid.thetas, grid.zs, work.surplus_um(spaces, grid.thetas, grid.zs))


def _into(at: dict[str, NDArray[np.float64]], table: CompensationTable) -> NDArray[np.float64]:
    place = at[table.input_axis[0]]
    return np.mod(place, 360.0) if table.modulo else place


def _library_agrees(folder: RunFolder, site_path: Path, kept: ToothProposal) -> None:
    """The library on the run's folder states what the run's own proposal, and so its report, states."""
    site = load_site(site_path)
    assert site.work is not None
    gear, machine = tf.Gear.load(site_path.parent / site.work.gear), tf.Machine.load(folder.path)
    told, flank, best = kept.prediction, tf.flank(machine, gear), tf.correct(machine, gear)
    assert flank.rms == pytest.approx(told.before.rms_um, rel=1e-4)
    assert best.expected is not None
    np.testing.assert_allclose(best.expected.u_point_um, told.u_point_um, rtol=1e-6)
    assert best.expected.u_um == pytest.approx(told.u_um, rel=1e-6)
    assert best.expected.parts_um == pytest.approx(dict(told.parts_um), rel=1e-6, abs=1e-9)
    assert best.expected.rms_um == pytest.approx(told.rms_um, rel=0.1)  # its own axis tables, not the readings' own
    assert flank.u is not None


def test_a_measured_run_proposes_both_layers_and_the_flank_they_make(tmp_path: Path) -> None:
    async def job() -> tuple[ToothOutcome, Proposal, list[str], Truth]:
        clock = LoopClock()
        plan = with_plan(load_cell("demo"))
        async with cell_running(plan, tmp_path / "cell", clock, wires="memory", block_s=1.0) as cell:
            folder = await measured(cell, clock)
            site = load_site(cell.site_path)
            found = await correct_site(site, cell.site_path, folder, clock=clock, say=silence)
            shown = await push_run(folder, apply=False, machine_name="", clock=clock, say=silence)
            told = [line for refusals in shown.data["refusals"].values() for line in refusals]
            kept = folder.get(stages.TOOTH, ToothProposal)
            assert (kept.setup, kept.said, kept.cures) == (found.tooth.setup, found.tooth.said, found.tooth.cures)
            _library_agrees(folder, cell.site_path, kept)
            return found, folder.get(stages.PROPOSAL, Proposal), told, cell.truth

    found, stored, told, truth = run_virtual(job)
    flank = found.tooth.prediction
    print(found.as_data(), told, sep="\n")
    own = ["X1", "X1-reversal", "Z1", "Z1-reversal", "C1", "C1-reversal"]
    assert [change.name for change in stored.changes[:6]] == own
    cross = {change.new.name: change.new.index for change in stored.changes[6:]}
    assert set(cross) == {"X1(Z1)", "X1(C1)", "C1(Z1)", "C1(C1)"}
    assert sorted(cross.values()) == [0, 1, 2, 3]
    # Nothing refuses the push: signs are proved first, and the rest are warnings.
    assert [line for line in told if line.startswith(("E-", "W-INT-SLOPE"))] == []
    assert flank.u_um <= 0.25
    tables = tuple(one.new for one in stored.changes if not one.skipped and one.new.kind != "reversal")
    gear = CycloidGear(**truth.cell.part.gear.model_dump())  # type: ignore[union-attr]
    before, after = (set_right(ground_flank(truth, one), gear) for one in ((), tables))
    print(f"true {before.rms_um:.3f} -> {after.rms_um:.3f}")
    assert abs(before.rms_um - found.fair_before_um) < 2.0 * flank.u_um
    assert after.rms_um < 0.2 * before.rms_um
    assert np.sqrt(np.mean((after.deviation_um - flank.after.deviation_um) ** 2)) < flank.u_um
    # The tables are those of a machine, not of 39 places: another gear, with spaces between these, gets as good.
    other = replace(gear, zc=gear.zc + 2, zp=gear.zp + 2)
    before, after = (set_right(ground_flank(truth, one, more=2), other) for one in ((), tables))
    print(f"another gear {before.rms_um:.3f} -> {after.rms_um:.3f}")
    assert after.rms_um < 0.1 * before.rms_um


@pytest.mark.soak
@pytest.mark.parametrize(("repetitions", "counts"), [(5, {}), (2, {"Z": 11})])
def test_the_uncertainty_is_neither_too_small_nor_too_large_on_true_machines(
    repetitions: int, counts: dict[str, int]
) -> None:
    """Seeded machines: fitted, corrected, a trial part, set-up values from it; the next part against what was said."""
    cell, normalised = load_cell("demo"), []
    assert cell.part is not None
    gear = CycloidGear(**cell.part.gear.model_dump())
    grid, clamping = flank_grid(gear), cell.part.clamping.eccentric_um
    shop = ProcessUncertainty(clamping_um=clamping)
    for seed in range(21, 29):
        rng, truth = np.random.default_rng(seed), Truth(cell, seed)
        model = read(truth, seed, repetitions, counts).model()
        grinding = Grinding(chain_of_errors(model, height_mm=cell.part.grinding.height_mm), gear, 160.0)
        plan = replace(GRIDS, noise=noise_patterns(grinding, grid, doubts(model, grinding.chain, GRIDS)))
        found = correct(grinding, grid, plan)
        said = predict(grinding, grid, plan, model, found, shop).flank
        tables = (*found.own, *found.cross)
        trial = ground_flank(truth, tables, _off(rng, clamping))
        values = setup_from_part(_inspected(trial, rng), gear).setup
        set_up = {"x_mm": 1e-3 * values.x_um, "dressing_mm": 1e-3 * values.dressing_um}
        after = ground_flank(truth, tables, _off(rng, clamping), start_s=LATER_S, **set_up)
        turned = flank_figure(after.deviation_um, grid.section.h).rotation * grid.section.h
        missed = after.deviation_um - turned - said.after.deviation_um
        normalised.append(missed / said.u_point_um)
        print(f"{seed}: u {said.u_um:.3f}, missed {np.sqrt(np.mean(missed**2)):.3f}, expected {said.rms_um:.3f}")
    pooled = float(np.sqrt(np.mean(np.square(normalised))))
    print(f"pooled {pooled:.3f}")
    assert 0.7 < pooled < 1.2


def _off(rng: np.random.Generator, clamping_um: float) -> tuple[float, float]:
    """As the cell clamps: half to whole of that, any way."""
    far, way = clamping_um * rng.uniform(0.5, 1.0), rng.uniform(0.0, 2.0 * np.pi)
    return float(far * np.cos(way)), float(far * np.sin(way))


def _inspected(flank: FlankMap, rng: np.random.Generator) -> InspectedFlank:
    """Three heights of every space touched, 0.2 um of noise; the fitted flank as if it saw no more than that."""
    K, T, Z = flank.deviation_um.shape
    seen = replace(flank, deviation_um=flank.deviation_um + rng.normal(0.0, 0.2, (K, T, Z)))
    k, theta = np.repeat(np.arange(float(K)), T), np.tile(flank.theta_rad, K)
    none = np.zeros(0)
    one = (k, theta, np.zeros(K * T), seen.deviation_um[:, :, 2].ravel(), 0.2, none, none, none, none)
    return InspectedFlank("trial", "", "", *one, seen, 0.1)
