"""The goal of a correction: transmission error by the full model on seeded machines, and what it costs in the flank."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.units import mm_to_um
from gateway.correct.flank.flank_model import places_of_grid
from gateway.correct.outlook.drive_outlook import costliest, drive_proposal, expected_drive
from gateway.correct.outlook.flank_uncertainty import FlankDoubts, column_doubts
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import Plan
from gateway.correct.solve.optimise import optimise
from gateway.errors import ModelError
from gateway.gear.first_order import ErrorParameter, bounded_first_order, first_order
from gateway.gear.flank import FlankGrid
from gateway.gear.grinding import Grinding
from gateway.model.motion import Fourier
from gateway.reducer import uncertainty
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import crank_angles, without_limit
from gateway.reducer.firstorder import transmission_map
from gateway.reducer.goal import DriveGoal, GoalKind, flank_target, goal_of
from gateway.reducer.records import Tolerances, for_gear
from gateway.reducer.uncertainty import essentials
from gateway.study.inputs import ErrorFile, GearFile, validate_file
from gateway.study.machine import grid_of, grinding_of, plan_of
from gateway.tooth import FlankMap, next_for_drive
from tests.sizes import few, soak
from tests.unit.reducer.drives import COARSE, coarse

SMALL = {"rp": 36.0, "rrp": 2.5, "a": 1.5, "zp": 12, "zc": 11, "b": 10.0, "drrp": 0.006}
LARGE = {"rp": 64.0, "rrp": 3.0, "a": 1.3, "zp": 40, "zc": 39, "b": 10.0}


def _machine(seed: int, gear: dict[str, float]) -> tuple[Grinding, FlankGrid, Plan, DriveGoal]:
    file = validate_file(
        {
            "name": "gear",
            "gear": gear,
            "grinding": {"centre_distance_mm": 160.0},
            "flank": {"profile": 6, "width": 3},
        },
        GearFile,
        "gear",
    )
    errors = validate_file({"name": "machine", "seeded": {"seed": seed}}, ErrorFile, "errors")
    grinding = grinding_of(file, errors)
    goal = goal_of("transmission", for_gear(grinding.gear, "crank-holes"), limits={"transmission_arcsec": 1000.0})
    return grinding, grid_of(file, grinding.gear), plan_of(errors, grinding), goal


def _map(machine: Grinding, grid: FlankGrid) -> FlankMap:
    e = np.broadcast_to(bounded_first_order(machine, grid.k, grid.theta, grid.z).second, grid.shape)
    return FlankMap(grid.thetas, grid.zs, mm_to_um(np.array(e)))


def _error(goal: DriveGoal, machine: Grinding, grid: FlankGrid) -> float:
    parts = [_map(machine, grid)] * len(goal.drive.discs)
    return essentials(without_limit(goal.drive), parts).error_arcsec


MACHINES = [
    *few([(1, SMALL), *((seed, LARGE) for seed in range(1, 7))], more=2),
    *(soak((seed, LARGE)) for seed in range(7, 21)),
]


@pytest.mark.parametrize(("seed", "gear"), MACHINES)
def test_the_goal_transmission_leaves_at_most_half_of_what_axis_tables_leave(seed: int, gear: dict[str, float]) -> None:
    grinding, grid, plan, goal = _machine(seed, gear)
    found = correct(grinding, grid, replace(plan, goal=goal))
    alone, best = (_error(goal, one, grid) for one in (found.machine_with_own, found.machine))
    assert best <= 0.5 * alone
    assert found.checked.rms < found.with_own.rms


@pytest.fixture(autouse=True)
def _coarse(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "gear" not in request.fixturenames or request.getfixturevalue("gear") is not LARGE:
        coarse(monkeypatch)


@pytest.fixture(scope="module")
def small() -> tuple[Grinding, FlankGrid, Plan, DriveGoal, LayeredCorrection]:
    grinding, grid, plan, goal = _machine(2, SMALL)
    goal = replace(goal, drive=replace(goal.drive, discs=goal.drive.discs[:1]))
    with pytest.MonkeyPatch.context() as patch:
        coarse(patch)
        return grinding, grid, plan, goal, correct(grinding, grid, replace(plan, goal=goal))


def test_each_goal_is_best_in_its_own_figure_and_the_flank_s_costs_the_drive(
    small: tuple[Grinding, FlankGrid, Plan, DriveGoal, LayeredCorrection], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uncertainty, "BLOCK", 1)
    grinding, grid, plan, goal, found = small
    told = drive_proposal(grinding, grid, plan=plan, goal=goal, found=found, steps=COARSE, most=3)
    rows = {row.name: row for row in told.rows}
    mine = rows["this goal: transmission"]
    assert mine.transmission_arcsec <= min(row.transmission_arcsec for row in told.rows) + 1e-9
    assert rows["rms"].flank_um <= mine.flank_um
    assert mine.flank_um == pytest.approx(mm_to_um(found.checked.rms), rel=1e-6)
    assert told.transmission_u_arcsec > 0.0
    assert [one.verdict for one in told.limits] == ["pass"]


def test_the_target_s_rows_are_the_first_order_of_the_drive(
    small: tuple[Grinding, FlankGrid, Plan, DriveGoal, LayeredCorrection],
) -> None:
    grinding, grid, _, goal, _ = small
    target = flank_target(goal, grid)
    e = np.broadcast_to(first_order(grinding, grid.k, grid.theta, grid.z), grid.shape)
    form = np.stack([grid.section.nx[:, 0], grid.section.ny[:, 0], grid.section.h[:, 0]], axis=1)
    abg = np.einsum("ct,ktz->kzc", np.linalg.pinv(form), e)
    nominal = FlankMap(grid.thetas, grid.zs, np.zeros(grid.shape))
    found = [transmission_map(goal.drive, nominal, torque_nm=s * goal.drive.rated_nm) for s in (1.0, -1.0)]
    part = FlankMap(grid.thetas, grid.zs, mm_to_um(e))
    curves = np.concatenate([one.curve([part]) - one.mean_arcsec for one in found])
    arcsec = np.pi / 180.0 / 3600.0 * goal.drive.lever_mm
    wanted = np.sqrt(np.mean(curves**2)) * arcsec * np.sqrt(e.size)
    assert np.linalg.norm(target.rows @ abg.ravel()) == pytest.approx(wanted, rel=0.02)
    turned = np.zeros((11, 3, 3))
    turned[..., 2] = 1e-4
    assert np.max(np.abs(target.rows @ turned.ravel())) < 1e-9


@pytest.mark.long
def test_a_doubt_of_the_machine_widens_what_is_expected(
    small: tuple[Grinding, FlankGrid, Plan, DriveGoal, LayeredCorrection],
) -> None:
    _, grid, _, goal, found = small
    exact = Tolerances(pin_radius_um=0.0, pin_place_um=0.0, eccentricity_um=0.0, hole_um=0.0)
    sure = replace(goal, drive=replace(goal.drive, tolerances=exact))
    patterns = np.zeros((11 * 3, 3, 1))
    patterns[:, 0, 0] = np.repeat(0.003 * np.cos(2.0 * 2.0 * np.pi * np.arange(11) / 11), 3)
    doubt = FlankDoubts(places_of_grid(grid), ("EXC",), patterns)
    unsure = expected_drive(sure, found.machine, grid, doubt, steps=COARSE, most=15)
    assert unsure.figures["error_arcsec"].u > 1.0


def test_what_an_unmeasured_error_costs_is_the_drive_s_own_error_of_it(
    small: tuple[Grinding, FlankGrid, Plan, DriveGoal, LayeredCorrection],
) -> None:
    grinding, grid, _, goal, _ = small
    size = 5e-4  # mm
    wave = Fourier(0.0, (0.0, size), ())
    clean = replace(grinding, chain=grinding.chain.without_errors())
    columns = [(ErrorParameter("EXC", wave), 1.0), ("EXX", size), ("EZC", size)]
    doubt = column_doubts(clean, grid, columns)
    told = costliest(goal.drive, clean, grid, doubt=doubt, measured={"EXX"}, steps=COARSE)
    assert told[0].error == "EXC"
    assert {one.error: one.measured for one in told} == {"EXC": False, "EXX": True, "EZC": False}
    # By the full model: how the drive's curve moves where that error is in its discs.
    wrong = replace(clean, chain=clean.chain.with_errors({"EXC": wave}))
    alpha, free = crank_angles(goal.drive, COARSE), without_limit(goal.drive)
    with_it, without = (
        Assembly(free, [_map(one, grid)]).solve(alpha, goal.drive.rated_nm).psi for one in (wrong, clean)
    )
    moved = float(np.ptp(np.degrees(with_it - without) * 3600.0))
    assert told[0].cost_arcsec == pytest.approx(moved, rel=0.2)
    assert {one.error: one.cost_arcsec for one in told}["EZC"] < 1e-6
    assert next_for_drive(told) == told[0]
    assert next_for_drive(told[1:]) is None


def test_goals_that_cannot_be_are_refused() -> None:
    grinding, grid, _, goal = _machine(1, SMALL)
    for kind, weights in (("weights", (1.0, -1.0, 0.0)), ("weights", (0.0, 1.0, 0.0)), ("speed", None)):
        wrong: GoalKind = kind  # type: ignore[assignment]
        with pytest.raises(ModelError, match="E-REDUCER-GOAL"):
            goal_of(wrong, goal.drive, weights)
    with pytest.raises(ModelError, match="E-REDUCER-GOAL"):
        goal_of("rms", goal.drive, limits={"noise": 1.0})
    with pytest.raises(ModelError, match="E-REDUCER-DATUM"):
        goal_of("rms", replace(goal.drive, datum=None))
    few_spaces = FlankGrid(grid.gear, grid.ks[:3], grid.thetas, grid.zs)
    with pytest.raises(ModelError, match="E-REDUCER-FLANK"):
        flank_target(goal, few_spaces)
    with pytest.raises(ModelError, match="E-CORRECT-NORM"):
        optimise(grinding, grid, [], norm="max", target=flank_target(goal, grid))
