"""Inspection values from computed and from measured flank points."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.errors import catalogue
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear
from gateway.gear.envelope import exact
from gateway.gear.first_order import first_order
from gateway.gear.flank import FlankGrid, Inspection, flank_grid, inspect, pitch_values, runout_values, trace_values
from gateway.gear.grinding import Grinding
from gateway.gear.measured_points import flank_points
from gateway.model.error_model import yk7350b
from gateway.model.motion import Fourier
from tests.unit.gear.machines import DISC, RV40E

MODIFIED = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0, drp=-0.02, drrp=0.01, drot=2e-4)


def inspected(gear: CycloidGear = RV40E, **errors: object) -> Inspection:
    grid = flank_grid(gear, width=5)
    grinding = Grinding(yk7350b(errors, c_frame="fixed"), gear, gear.rp + 96.0)  # type: ignore[arg-type]
    return inspect(grid, first_order(grinding, grid.k, grid.theta, grid.z))


def test_a_straight_trace_has_slope_and_no_form() -> None:
    found = trace_values([[1.0, 1.5, 2.5]], [0.0, 1.0, 3.0])
    np.testing.assert_allclose((found.F, found.f_H), 1.5)
    np.testing.assert_allclose(found.f_f, 0.0, atol=1e-15)
    bent = trace_values([1.0, -1.0, 1.0], [-1.0, 0.0, 1.0])
    np.testing.assert_allclose((bent.F, bent.f_H, bent.f_f), (2.0, 0.0, 2.0), atol=1e-15)


def test_taper_and_helix_by_their_signs() -> None:
    taper = inspected(B0Z=1e-4)
    np.testing.assert_allclose(taper.lead.f_H[:, 0], taper.lead.f_H[:, 1], rtol=1e-9)
    nx = RV40E.section(RV40E.theta_at(0.0)).nx
    assert 0.0 < taper.lead.f_H[0, 0] <= 1e-4 * 8.0 * nx
    helix = inspected(A0C=1e-4)
    np.testing.assert_allclose(helix.lead.f_H[:, 0], -helix.lead.f_H[:, 1], rtol=1e-9)
    np.testing.assert_allclose(helix.lead.f_f, 0.0, atol=1e-15)


def test_pure_ecc_is_pitch_and_nothing_else() -> None:
    wave = Fourier(0.0, (2e-5, 1e-5), (0.0, -3e-5))
    found = inspected(ECC=wave)
    c = -2.0 * np.pi * np.arange(39) / 39
    theta = flank_grid(RV40E).thetas
    half = 0.5 * RV40E.limits().half_lobe_arc
    at = theta[theta > 0][np.argmin(np.abs(RV40E.arc(theta[theta > 0]) - half))]
    r = float(np.hypot(*RV40E.section(at).xy))
    for side in (0, 1):
        np.testing.assert_allclose(found.pitch[side].F, -r * wave(c), atol=1e-15)
        assert found.pitch[side].F_p == pytest.approx(r * np.ptp(wave(c)))
        assert np.sum(found.pitch[side].f) == pytest.approx(0.0, abs=1e-15)
    assert found.runout.F_r < 1e-15


@pytest.mark.parametrize("gear", [RV40E, DISC, CycloidGear(90.0, 7.0, 4.0, 13, 12, 15.0)])
def test_eccentric_work_runs_out_by_its_eccentricity(gear: CycloidGear) -> None:
    c = Fourier(0.0, (0.006,)), Fourier(0.0, (), (0.006,))
    found = inspected(gear, EXC=c[0], EYC=c[1]).runout
    wanted = 2.0 * 0.006 if gear.zc % 2 == 0 else 0.006 * (1.0 + np.cos(np.pi / gear.zc))
    assert found.F_r == pytest.approx(wanted, rel=1e-9)
    assert found.eccentricity == pytest.approx(0.006, rel=1e-9)


@pytest.mark.parametrize("gear", [RV40E, DISC, MODIFIED])
def test_measured_points_give_back_the_ground_flank(gear: CycloidGear) -> None:
    grid = flank_grid(gear, profile=6, width=3)
    grinding = Grinding(yk7350b({"EXX": 0.004, "ECC": 3e-5, "EBX": 5e-5}), gear, gear.rp + 96.0)
    e = exact(grinding, grid.k, grid.theta, grid.z)
    s = gear.space(grid.theta, grid.k)
    points = np.stack(np.broadcast_arrays(s.x + e * s.nx, s.y + e * s.ny, grid.z), axis=-1)
    found = flank_points(gear, points)
    np.testing.assert_allclose(found.deviation, e.ravel(), atol=1e-12)
    np.testing.assert_allclose(found.theta, np.broadcast_to(grid.theta, grid.shape).ravel(), atol=1e-12)
    np.testing.assert_array_equal(found.k, np.broadcast_to(grid.k, grid.shape).ravel())


def test_order_of_spaces_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    grid = flank_grid(DISC, profile=4, width=3)
    e = rng.normal(size=grid.shape)
    mixed = rng.permutation(DISC.zc)
    other = FlankGrid(DISC, grid.ks[mixed], grid.thetas, grid.zs)
    np.testing.assert_allclose(inspect(other, e[mixed]).pitch[0].F, inspect(grid, e).pitch[0].F)


def test_what_cannot_be_inspected_is_refused() -> None:
    grid = flank_grid(DISC, profile=4, width=3)
    some = flank_grid(DISC, spaces=(0, 1))
    uneven = FlankGrid(DISC, grid.ks, grid.thetas + 0.01, grid.zs)
    for code, make in (
        ("E-GEAR-SPACES", lambda: inspect(some, np.zeros(some.shape))),
        ("E-GEAR-SPACES", lambda: inspect(uneven, np.zeros(grid.shape))),
        ("E-GEAR-SPACES", lambda: inspect(grid, np.zeros(3))),
        ("E-GEAR-TRACE", lambda: trace_values([1.0, np.nan], [0.0, 1.0])),
        ("E-GEAR-TRACE", lambda: trace_values([1.0, 2.0], [1.0, 1.0])),
        ("E-GEAR-TRACE", lambda: pitch_values([0.0], 1.0, 1.0)),
        ("E-GEAR-TRACE", lambda: runout_values([0.0, np.inf], [0.0, 0.0], 1.0)),
        ("E-GEAR-POINT", lambda: flank_points(DISC, [[0.0, 0.0, 0.0]])),
        ("E-GEAR-POINT", lambda: flank_points(DISC, [[np.nan, 0.0, 0.0]])),
    ):
        with pytest.raises(ModelError) as caught:
            make()
        assert caught.value.code == code
        assert code in catalogue()
        assert "<" not in caught.value.what
