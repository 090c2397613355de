"""First order about the mean drive against the full model, and about what it cannot do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.units import um_to_mm
from gateway.gear.cycloid import CycloidGear
from gateway.gear.first_order import first_order, linear_flank
from gateway.gear.flank import flank_grid
from gateway.gear.grinding import Grinding
from gateway.model.error_model import TWENTY_ONE, yk7350b
from gateway.reducer.contact import Assembly
from gateway.reducer.figures import crank_angles
from gateway.reducer.firstorder import MachineTransmission, lost_motion_map, transmission_map
from gateway.reducer.records import Reducer, for_gear, shipped
from gateway.tooth import FlankMap
from tests.sizes import few
from tests.unit.reducer.drives import ARCSEC, flank, forty

SMALL = CycloidGear(rp=42.5, rrp=2.5, a=1.3, zp=18, zc=17, b=10.0, drrp=0.005)


def _full(drive: Reducer, parts: list[FlankMap]) -> np.ndarray:
    psi = Assembly(drive, parts).solve(crank_angles(drive, 24), drive.rated_nm).psi * ARCSEC
    return np.asarray(psi - psi.mean())


def _random(gear: CycloidGear, seed: int, size: float, width: int = 3) -> FlankMap:
    rng = np.random.default_rng(seed)
    k = 2.0 * np.pi * np.arange(gear.zc)[:, None, None] / gear.zc
    A, B = (sum(rng.normal() * size * np.cos(m * k + rng.uniform(0, 7)) for m in (1, 2, 3)) for _ in range(2))
    lead = np.linspace(-1.0, 1.0, width)
    return flank(gear, A=A * (1.0 + 0.5 * lead), B=B, width=width)


def test_tiny_errors_move_the_full_model_as_the_matrix_says() -> None:
    drive = for_gear(SMALL, "crank-holes")
    parts = [_random(SMALL, seed, 0.01) for seed in (1, 2)]
    found = transmission_map(drive, replace(parts[0], deviation_um=0.0 * parts[0].deviation_um), steps=24)
    change = _full(drive, parts) - found.mean_arcsec
    first = found.curve(parts) - found.mean_arcsec
    assert np.max(np.abs(first - change)) < 0.02 * np.ptp(change)


@pytest.mark.parametrize(("name", "seed"), few([("", 3), ("", 4), ("", 5), ("RV-40E-like", 6), ("RV-20E-like", 7)]))
def test_errors_of_micrometres_are_ranked_by_it_within_some_per_cent(name: str, seed: int) -> None:
    drive = shipped(name, "bore") if name else for_gear(SMALL, "bore")
    parts = [_random(drive.gear, seed, 0.7)] * 2
    found = transmission_map(drive, parts[0], steps=24)
    assert np.ptp(found.curve(parts)) == pytest.approx(np.ptp(_full(drive, parts)), rel=0.2)


def test_the_machine_s_errors_reach_it_through_the_flank_s_jacobian() -> None:
    drive = for_gear(SMALL, "crank-holes")
    grid, grinding = flank_grid(SMALL), Grinding(yk7350b(), SMALL, 120.0)
    nominal = FlankMap(grid.thetas, grid.zs, np.zeros(grid.shape))
    found = transmission_map(drive, nominal, steps=24)
    rows = found.rows(linear_flank(grinding, grid, list(TWENTY_ONE)).jacobian())
    size = um_to_mm(1.0)
    at = TWENTY_ONE.index("EXC")
    one = replace(grinding, chain=yk7350b({"EXC": size}))
    e = np.broadcast_to(first_order(one, grid.k, grid.theta, grid.z), grid.shape) * 1e3
    part = FlankMap(grid.thetas, grid.zs, np.array(e))
    assert found.curve([part, part]) - found.mean_arcsec == pytest.approx(rows[:, at] * size, abs=1e-9)
    unseen = [TWENTY_ONE.index(name) for name in ("EZX", "EZZ", "EZC", "EAZ", "EBZ")]
    assert np.max(np.abs(rows[:, unseen])) < 1e-6 * np.max(np.abs(rows))


def test_many_machines_are_one_product() -> None:
    rng = np.random.default_rng(0)
    ours = MachineTransmission(rng.normal(size=(50, 4)), rng.normal(size=50))
    vectors = rng.normal(size=(4, 130))
    curves = ours.matrix @ vectors + ours.mean[:, None]
    assert ours.curves(vectors) == pytest.approx(curves)
    assert ours.peak_to_peak_arcsec(vectors) == pytest.approx(np.ptp(curves, axis=0))


def test_a_deeper_cut_adds_the_lost_motion_of_the_pins_that_touch() -> None:
    """A constant -A adds at least 2 A sqrt(1 - K^2) / (a zc), half as much again where many pins touch."""
    drive = forty(drrp=0.004)
    part = flank(drive.gear, A=-1.0)
    row = lost_motion_map(drive, replace(part, deviation_um=0.0 * part.deviation_um), steps=24)
    least = 2.0 * 1e-3 * np.sqrt(1.0 - drive.gear.K**2) / drive.lever_mm * ARCSEC
    assert least < row @ part.deviation_um.ravel() < 1.6 * least
