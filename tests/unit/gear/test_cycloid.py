"""The cycloid disc against its own definition, its limits and its modifications."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import catalogue
from gateway.errors import ModelError
from gateway.gear.cycloid import CycloidGear, limits, undercut_limit
from gateway.gear.flank import flank_grid
from tests.unit.gear.machines import GEARS, RV40E

MODIFIED = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0, drp=-0.02, drrp=0.01, drot=2e-4)


def literature(gear: CycloidGear, theta: float) -> tuple[float, float]:
    """The (1 - i) phi form with modifications, y mirrored, in 30 digits."""
    with mpmath.workdps(30):
        rp, r, a = mpmath.mpf(gear.rp) + gear.drp, mpmath.mpf(gear.rrp) + gear.drrp, mpmath.mpf(gear.a)
        i, phi = mpmath.mpf(gear.zp) / gear.zc, mpmath.mpf(theta) * gear.zc
        d = -gear.drot * float(np.sign(theta))
        root = mpmath.sqrt(1 + (a * gear.zp / rp) ** 2 - 2 * a * gear.zp / rp * mpmath.cos(phi))
        first, second = rp - r / root, a / rp * (rp - gear.zp * r / root)
        x = first * mpmath.cos((1 - i) * phi + d) - second * mpmath.cos(i * phi - d)
        y = first * mpmath.sin((1 - i) * phi + d) + second * mpmath.sin(i * phi - d)
        return float(x), float(-y)


@pytest.mark.parametrize("gear", [*GEARS, MODIFIED], ids=lambda g: f"{g.rp}-{g.zc}-{g.drp}")
def test_profile_is_the_literature_form(gear: CycloidGear) -> None:
    for theta in np.linspace(-0.97, 0.98, 14) * gear.half_pitch:
        s = gear.section(theta)
        np.testing.assert_allclose((s.x, s.y), literature(gear, float(theta)), atol=3e-14)


@pytest.mark.parametrize("gear", GEARS, ids=lambda g: f"{g.rp}-{g.zc}")
def test_normal_curvature_and_arc_follow_from_the_points(gear: CycloidGear) -> None:
    t = np.linspace(-0.99, 0.99, 40001) * gear.half_pitch
    s = gear.section(t)
    dx, dy = np.gradient(s.x, t, edge_order=2), np.gradient(s.y, t, edge_order=2)
    np.testing.assert_allclose(np.hypot(s.nx, s.ny), 1.0, atol=1e-15)
    np.testing.assert_allclose((dx * s.nx + dy * s.ny) / s.speed, 0.0, atol=1e-6)
    np.testing.assert_allclose(np.hypot(dx, dy), s.speed, rtol=1e-5)
    turning = np.gradient(np.unwrap(np.arctan2(s.ny, s.nx)), t)
    np.testing.assert_allclose((turning / s.speed)[5:-5], s.curvature[5:-5], atol=2e-4)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(s.x), np.diff(s.y)))])
    np.testing.assert_allclose(gear.arc(t) - gear.arc(t[0]), along, atol=1e-7)
    np.testing.assert_allclose(gear.theta_at(gear.arc(t[::500])), t[::500], atol=1e-14)


def test_all_lobes_are_the_same_space_turned() -> None:
    k = np.arange(RV40E.zc)[:, None]
    t = np.linspace(-1.0, 1.0, 9) * RV40E.half_pitch
    s = RV40E.space(t, k)
    np.testing.assert_allclose(np.hypot(s.x, s.y), np.broadcast_to(np.hypot(*RV40E.section(t).xy.T), s.x.shape))
    np.testing.assert_allclose((s.x[1:, 0], s.y[1:, 0]), (s.x[:-1, -1], s.y[:-1, -1]), atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(4, 60), st.floats(0.05, 0.98), st.floats(20.0, 200.0))
def test_undercut_limit_is_the_smallest_concave_radius(zp: int, K: float, rp: float) -> None:
    a = K * rp / zp
    t = np.linspace(0.0, np.pi / (zp - 1), 20001)
    S = 1.0 + K * K - 2.0 * K * np.cos((zp - 1) * t)
    k0 = (1.0 + zp * K * K - (1.0 + zp) * K * np.cos((zp - 1) * t)) / (rp * S**1.5)
    assert undercut_limit(rp, a, zp) == pytest.approx(1.0 / float(np.max(k0)), rel=1e-6)


def test_modifications_move_the_flank_as_stated() -> None:
    t = np.linspace(-0.9, 0.9, 12) * RV40E.half_pitch
    plain = RV40E.section(t)

    def normal_shift(**change: float) -> np.ndarray:
        s = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0, **change).section(t)
        return (s.x - plain.x) * plain.nx + (s.y - plain.y) * plain.ny

    np.testing.assert_allclose(normal_shift(drrp=0.01), -0.01, atol=1e-13)
    K, S = RV40E.K, 1.0 + RV40E.K**2 - 2.0 * RV40E.K * np.cos(39 * t)
    np.testing.assert_allclose(normal_shift(drp=1e-5), 1e-5 * (1.0 - K * np.cos(39 * t)) / np.sqrt(S), atol=1e-9)
    turned = normal_shift(drot=1e-6)
    np.testing.assert_allclose(turned, 1e-6 * np.sign(t) * plain.h, atol=1e-9)
    assert np.all(turned < 0.0)


def test_limits_tell_undercut_that_a_gear_refuses() -> None:
    found = limits(64.0, 4.7, 1.3, 40, 39)
    assert found.undercut
    assert found.rrp_max == pytest.approx(4.611667828285367)
    assert not RV40E.limits().undercut


GOOD: dict[str, Any] = {"rp": 64.0, "rrp": 3.0, "a": 1.3, "zp": 40, "zc": 39, "b": 10.0}
BAD: list[tuple[str, dict[str, Any], str]] = [
    ("E-GEAR-UNDERCUT", {"rrp": 4.62}, "4.61"),
    ("E-GEAR-UNDERCUT", {"drrp": 1.7}, "4.61"),
    ("E-GEAR-K1", {"a": 1.6}, "1.0"),
    ("E-GEAR-K1", {"drp": -12.5}, "1.0"),
    ("E-GEAR-LOBES", {"zc": 40}, "zc + 1"),
    ("E-GEAR-LOBES", {"zp": 40.5, "zc": 39.5}, "whole"),
    ("E-GEAR-LOBES", {"zp": 3, "zc": 2}, "3"),
    ("E-GEAR-POSITIVE", {"rp": -64.0}, "above 0"),
    ("E-GEAR-POSITIVE", {"b": 0.0}, "above 0"),
    ("E-GEAR-POSITIVE", {"drrp": -3.0}, "above 0"),
    ("E-GEAR-NUMBER", {"a": float("nan")}, "finite"),
    ("E-GEAR-NUMBER", {"a": "1.3"}, "finite"),
    ("E-GEAR-NUMBER", {"zc": True}, "finite"),
    ("E-GEAR-ROTATION", {"drot": 0.05}, "0.04"),
    ("E-GEAR-KEY", {"teeth": 39}, "teeth"),
]


@pytest.mark.parametrize(("code", "change", "limit"), BAD)
def test_bad_gears_are_refused_with_the_limit(code: str, change: dict[str, Any], limit: str) -> None:
    with pytest.raises(ModelError) as caught:
        CycloidGear.of({**GOOD, **change})
    assert caught.value.code == code
    assert code in catalogue()
    assert limit in caught.value.what
    assert "<" not in caught.value.what


def test_missing_data_are_named() -> None:
    with pytest.raises(ModelError) as caught:
        CycloidGear.of({"rp": 64.0})
    assert caught.value.code == "E-GEAR-MISSING"


def test_grid_is_even_in_arc_over_95_percent() -> None:
    grid = flank_grid(RV40E, profile=11, width=5)
    assert grid.shape == (39, 22, 5)
    steps = np.diff(RV40E.arc(grid.thetas))
    np.testing.assert_allclose(steps, steps[0], rtol=1e-10)
    assert 22 * steps[0] == pytest.approx(0.95 * 2.0 * RV40E.limits().half_lobe_arc)
    np.testing.assert_allclose(grid.thetas, -grid.thetas[::-1], atol=1e-15)
    assert np.mean(grid.zs**2) == pytest.approx(100.0 / 12.0 * (1.0 - 1.0 / 25.0))


def test_the_tip_alone_is_that_of_the_limits() -> None:
    gear = CycloidGear(64.0, 3.0, 1.3, 40, 39, 10.0)
    assert gear.tip_radius == gear.limits().r_tip == pytest.approx(62.3)  # 64 + 1.3 - 3
