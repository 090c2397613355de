"""The prediction of the flank: calibrated on machines drawn from the doubts; set-up values; what stays of B."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.correct.flank.compensability import tangential_cure
from gateway.correct.flank.mounting import WorkMounting, without_mounting
from gateway.correct.flank.noise import noise_patterns
from gateway.correct.flank.tables import Table, TableGrid, with_tables
from gateway.correct.outlook.flank_uncertainty import CLAMPING, DRIFT, SIZE, ProcessUncertainty, doubts
from gateway.correct.outlook.prediction import Prediction, flank_map, predict
from gateway.correct.outlook.ranking import cure_errors, rank_errors
from gateway.correct.part.inspected import setup_from_part
from gateway.correct.plan.layers import LayeredCorrection, correct
from gateway.correct.plan.plan import AxisGrid, Plan, table_of
from gateway.domain.figures import Component
from gateway.domain.values import FloatArray
from gateway.gear.first_order import ErrorParameter
from gateway.gear.flank import FlankGrid, flank_grid
from gateway.gear.grinding import Grinding
from gateway.gear.process_drift import set_right
from gateway.model.chain import Motion
from gateway.model.error_model import ErrorModel, LocationError, UnmeasuredError, chain_of_errors
from gateway.model.motion import MotionSum
from gateway.tooth import FlankMap, InspectedFlank
from tests.unit.gear.machines import DISC, RV40E

HEIGHT, E_MM = 150.0, 160.0
PLAN = Plan(
    (AxisGrid("X", -400.0, 0.0, 20.0), AxisGrid("Z", 0.0, 300.0, 5.0), AxisGrid("C", 0.0, 360.0, 10.0, modulo=True))
)
SHOP = ProcessUncertainty(
    clamping_um=0.4, infeed_um=0.12, index_arcsec=0.4, drift_um_per_h=0.6, drift_arcsec_per_h=2.0, setup_um=0.0
)
UM, ARCSEC = 1e-3, float(np.pi / 648000.0)


def component(name: str, rng: np.random.Generator, u: float) -> Component:
    """A smooth motion of a few um or arcsec whose coefficients are known to u each."""
    axis = name[2]
    if axis == "C":
        basis, domain, count = "fourier", (0.0, 345.0), 7
        # No once-per-turn wave but in C's own: it would be the work's place on the table.
        parameters: dict[str, object] = {"period": 360.0, "orders": (1, 2, 5) if name == "ECC" else (2, 3, 5)}
    else:
        domain = (-400.0, 0.0) if axis == "X" else (0.0, 300.0)
        basis, count = "polynomial", 5
        parameters = {"degree": 4, "centre": sum(domain) / 2.0, "scale": (domain[1] - domain[0]) / 2.0}
    coefficients = rng.normal(0.0, 1.5, count) * (np.arange(count) > 0)
    covariance = u**2 * np.eye(count)
    unit = "deg" if axis == "C" else "mm"
    return Component(name, axis, unit, basis, domain, coefficients, covariance, parameters)  # type: ignore[arg-type]


@cache
def known(unknown: tuple[str, ...] = ("EXC",)) -> ErrorModel:
    """A machine measured well but for one error, with a doubt of EXX that any x zero takes."""
    rng = np.random.default_rng(3)
    names = ("EXX", "EBX", "EXZ", "EYZ", "ECZ", "ECC", "EXC", "EYC", "EBC")
    motions = tuple(component(name, rng, 0.08) for name in names if name not in unknown)
    return ErrorModel(
        motions=motions,
        locations=(LocationError("B0Z", 4.0, 0.4, "arcsec"), LocationError("A0C", -3.0, 0.4, "arcsec")),
        unknown=tuple(UnmeasuredError(name, 1.5, "um") for name in unknown),
        systematic={"EXX": 2.0, "ECC": 0.5, "EXC": 0.05},
    )


@cache
def corrected(unknown: tuple[str, ...] = ("EXC",)) -> tuple[Grinding, FlankGrid, Plan, LayeredCorrection, Prediction]:
    """The fitted machine, what is proposed for it, and what is expected of that."""
    model = known(unknown)
    chain = chain_of_errors(model, height_mm=HEIGHT)
    grinding, grid = Grinding(chain, RV40E, E_MM), flank_grid(RV40E, profile=5, width=3)
    plan = replace(PLAN, noise=noise_patterns(grinding, grid, doubts(model, chain, PLAN)))
    found = correct(grinding, grid, plan)
    return grinding, grid, plan, found, predict(grinding, grid, plan, model, found, SHOP)


def drawn(grinding: Grinding, unknown: tuple[str, ...], rng: np.random.Generator) -> Grinding:
    """A machine as it may be by what is known of it."""
    more: dict[str, list[Motion]] = {}
    for parameter, u in doubts(known(unknown), grinding.chain, PLAN):
        one = parameter if isinstance(parameter, ErrorParameter) else ErrorParameter(parameter)
        more.setdefault(one.name, []).append(_scaled(one.basis, float(rng.normal(0.0, u))))
    errors: dict[str, Motion] = {}
    for name, parts in more.items():
        axis, key = grinding.chain.error_place(name)
        at = grinding.chain.axis(axis)
        if name.startswith("E"):
            errors[name] = MotionSum((at.err.get(key, 0.0), *parts))
        else:
            errors[name] = float(MotionSum((at.loc.get(key, 0.0), *parts))(np.zeros(())))
    return replace(grinding, chain=grinding.chain.with_errors(errors))


def _scaled(basis: object, size: float) -> Motion:
    def motion(q: FloatArray) -> FloatArray:
        return size * (basis(q) if callable(basis) else np.ones_like(q))

    return motion


def part(
    machine: Grinding, grid: FlankGrid, found: LayeredCorrection, rng: np.random.Generator, wander: FloatArray
) -> FlankMap:
    """One part with the tables, clamped anew, every approach with its scatter; zeros (2, K) of X and C wander."""
    chain, K = machine.chain, grid.ks.size
    tables = [table for one in (*found.own, *found.cross) if (table := table_of(chain, one)) is not None]
    at = np.mod(machine.commands(grid.ks, 0.0)["C"], 2.0 * np.pi)
    order = np.argsort(at)
    scatter = rng.normal(0.0, 1.0, (2, K)) * np.array([[SHOP.infeed_um * UM], [SHOP.index_arcsec * ARCSEC]])
    for out, values in zip("XC", scatter + wander, strict=True):
        tables.append(Table(TableGrid(out, "C", at[order], 2.0 * np.pi), values[order]))
    x, y = rng.normal(0.0, SHOP.clamping_um / 2.0 * UM, 2)
    return flank_map(without_mounting(with_tables(machine, tables), WorkMounting(x, y)), grid)


@pytest.mark.parametrize("unknown", [(), ("EXC",)])
def test_the_uncertainty_is_calibrated_on_machines_drawn_from_the_doubts(unknown: tuple[str, ...]) -> None:
    """Trial part, set-up values from it, next part: its flank lies around the prediction as u says, point by point."""
    grinding, grid, _, found, outlook = corrected(unknown)
    flank, missed, sizes = outlook.flank, [], []
    section = RV40E.section(grid.thetas)
    ways = [np.broadcast_to(one[None, :, None], grid.shape).ravel() for one in (section.nx, section.ny, section.h)]
    design = np.stack(ways, axis=1)
    rates = np.array([[SHOP.drift_um_per_h * UM], [SHOP.drift_arcsec_per_h * ARCSEC]]) * SHOP.part_h
    ramp = (grid.ks - grid.ks.mean()) / np.ptp(grid.ks)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        machine, growth = drawn(grinding, unknown, rng), rng.normal(0.0, rates) * ramp
        trial = part(machine, grid, found, rng, growth)
        after = part(machine, grid, found, rng, growth + rng.normal(0.0, rates))
        constants = np.linalg.lstsq(design, trial.deviation_um.ravel(), rcond=None)[0]
        rest = after.deviation_um.ravel() - design[:, :2] @ constants[:2]
        rest -= design[:, 2] * (design[:, 2] @ rest) / (design[:, 2] @ design[:, 2])
        missed.append((rest.reshape(grid.shape) - flank.after.deviation_um) / flank.u_point_um)
        sizes.append(float(np.sqrt(np.mean(rest**2))))
    pooled = float(np.sqrt(np.mean(np.square(missed))))
    print(f"pooled {pooled:.3f}, RMS {np.mean(sizes):.3f} expected {flank.rms_um:.3f} +- {flank.rms_u_um:.3f}")
    assert 0.8 < pooled < 1.2
    assert abs(np.mean(sizes) - flank.rms_um) < 3.0 * flank.rms_u_um / len(sizes) ** 0.5
    assert flank.u_um == pytest.approx(np.sqrt(np.mean(flank.u_point_um**2)), rel=1e-9)


def test_what_a_set_up_value_takes_is_no_doubt_and_what_nobody_measured_is_the_largest() -> None:
    _, _, _, found, outlook = corrected()
    parts = outlook.flank.parts_um
    # 2 um of EXX stand on the flank as a constant: the trial part tells x zero.
    assert parts["EXX"] < 1e-6
    assert found.setup.x_um != 0.0
    assert sum(value**2 for value in parts.values()) == pytest.approx(outlook.flank.u_um**2)
    # Half of 0.4 um in each direction: half the square of either is normal to the flank, all around the gear.
    assert parts[CLAMPING] == pytest.approx(0.2, rel=1e-6)
    assert parts[DRIFT] < 0.2
    all_known = corrected(())[4]
    assert all_known.flank.parts_um["EXC"] < 0.2
    assert parts["EXC"] > 0.4
    assert all_known.flank.u_um < outlook.flank.u_um
    assert all_known.worth
    assert outlook.worth


def test_a_probe_of_another_size_is_set_into_the_next_part_and_into_u() -> None:
    """Points that all look half a micrometre too high ask for as much infeed as no flank needs."""
    grinding, grid, plan, found, outlook = corrected()
    flank = set_right(flank_map(grinding, grid), RV40E)
    high = replace(flank, deviation_um=flank.deviation_um + 0.5)
    wrong = setup_from_part(inspected(high, 0.01), RV40E).setup
    zero = [Table(TableGrid("X", "Z", np.zeros(1)), np.array([wrong.x_um * UM]))]
    moved = flank_map(with_tables(grinding, zero), grid).deviation_um - flank_map(grinding, grid).deviation_um
    told = predict(grinding, grid, plan, known(), found, replace(SHOP, size_um=0.5)).flank
    assert told.parts_um[SIZE] == pytest.approx(np.sqrt(np.mean(moved**2)), rel=0.1)
    assert told.u_um == pytest.approx(np.hypot(outlook.flank.u_um, told.parts_um[SIZE]))
    assert outlook.flank.parts_um[SIZE] == 0.0


def test_a_machine_of_which_little_is_known_gets_no_cross_tables() -> None:
    """What would correct less than its uncertainty is left alone: here everything."""
    spans = tuple(
        UnmeasuredError(name, 4.0, "arcsec" if name[1] in "ABC" else "um") for name in ("ECC", "EXC", "EYC", "EXZ")
    )
    small = replace(component("EXC", np.random.default_rng(1), 0.5), coefficients=np.full(7, 0.1))
    model = ErrorModel(motions=(small,), unknown=tuple(one for one in spans if one.name != "EXC"))
    chain = chain_of_errors(model, height_mm=HEIGHT)
    grinding, grid = Grinding(chain, RV40E, E_MM), flank_grid(RV40E, profile=5, width=3)
    found = correct(grinding, grid, replace(PLAN, noise=noise_patterns(grinding, grid, doubts(model, chain, PLAN))))
    assert not found.cross
    assert not predict(grinding, grid, PLAN, model, found, SHOP).worth
    bold = correct(grinding, grid, PLAN)
    assert bold.cross
    assert not predict(grinding, grid, PLAN, model, bold, SHOP).worth


def test_errors_are_ranked_and_told_by_what_cures_them() -> None:
    grinding, grid, *_ = corrected()
    ranked = rank_errors(grinding, grid, PLAN, known(), r=10)
    cured = {one.error: one for one in cure_errors(grinding, grid, PLAN, known())}
    assert {one.error for one in ranked} == set(cured) == {*known().measured, "EXC"}
    assert all(one.low_um <= one.mu_star_um <= one.high_um and one.rank[0] <= one.rank[1] for one in ranked)
    assert ranked[-1].mu_star_um < 1e-9  # EXX: a constant, taken by x zero
    assert (cured["EXX"].by, cured["ECC"].by) == ("X zero", "C(C)")
    assert all(one.floor_um <= one.rms_um + 1e-12 for one in cured.values())


def test_on_eleven_lobes_a_third_of_b_stays() -> None:
    grid = flank_grid(DISC, profile=11, width=5)
    section = DISC.section(grid.thetas)
    turn, *_ = np.linalg.lstsq(section.h[:, None], section.ny, rcond=None)
    left = np.sqrt(np.mean((section.ny - section.h * turn) ** 2) / np.mean(section.ny**2))
    assert DISC.zc == 11
    assert 0.3 < left < 0.45
    assert tangential_cure(DISC, grid.thetas).eta == pytest.approx(left, rel=1e-9)


def inspected(flank: FlankMap, u_um: float) -> InspectedFlank:
    K, T, Z = flank.deviation_um.shape
    k, theta, z = (
        np.broadcast_to(one, (K, T, Z)).ravel()
        for one in (np.arange(float(K))[:, None, None], flank.theta_rad[:, None], flank.z_mm)
    )
    places = (np.repeat(np.arange(float(K)), Z), np.tile(flank.z_mm, K), np.zeros((K * Z, 3)), np.zeros((K * Z, 3)))
    return InspectedFlank("trial", "", "", k, theta, z, flank.deviation_um.ravel(), u_um, *places, flank, 0.1)


@pytest.mark.parametrize("gear", [RV40E, DISC])
def test_set_up_values_from_a_part_take_its_constants(gear: object) -> None:
    """Ground with zeros that are off, the part tells by how much; ground again with what it tells nothing is left."""
    disc = RV40E if gear is RV40E else DISC
    grinding = Grinding(chain_of_errors(known(), height_mm=HEIGHT), disc, E_MM if gear is RV40E else 190.0)
    grid = flank_grid(disc, profile=6, width=3)

    def ground(x_um: float, dressing_um: float) -> FlankMap:
        zero = [Table(TableGrid("X", "Z", np.zeros(1)), np.array([x_um * UM]))]
        dressed = replace(grinding.dressing, offset=dressing_um * UM)
        return flank_map(with_tables(replace(grinding, dressing=dressed), zero), grid)

    found = setup_from_part(inspected(ground(4.0, -2.5), 0.2), disc)
    again = ground(4.0 + found.setup.x_um, -2.5 + found.setup.dressing_um)
    assert found.setup.c_arcsec == 0.0
    assert abs(again.rms_um - set_right(again, disc).rms_um) < 0.01
    assert again.rms_um < ground(4.0, -2.5).rms_um
    assert found.u.x_um < 0.1
    rest = setup_from_part(inspected(again, 0.2), disc)
    assert (rest.setup.x_um, rest.setup.dressing_um) == (0.0, 0.0)
    assert len(rest.said) == 2
    # As it stood before, with readings of 20 um: nothing can be told.
    vague = setup_from_part(inspected(ground(4.0 + found.setup.x_um + 1.0, 0.0), 200.0), disc)
    assert vague.setup.x_um == 0.0
