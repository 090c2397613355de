"""The feed against what the counter follows: 2 v / lambda, worked out by hand."""

from __future__ import annotations

import math

import pytest

from drivers.attocube.settings import AttocubeSettings
from drivers.bridge.settings import BridgeSettings
from drivers.settings import DriverSettings
from drivers.umd.settings import UmdSettings
from drivers.units import followed_feed_mm_min, fringe_rate_hz


def test_the_fringe_rate_of_a_feed() -> None:
    # 6 m/min are 100 mm/s; half a wavelength of 632.99 nm is 316.495 nm, so 315 961 fringes pass in a second.
    assert fringe_rate_hz(6000.0, 632.99) == pytest.approx(0.1 / 316.495e-9, rel=1e-9)
    for feed in (1.0, 500.0, 24_000.0):
        assert followed_feed_mm_min(fringe_rate_hz(feed, 632.99), 632.99) == pytest.approx(feed)


def test_a_counter_declares_the_feed_that_it_follows() -> None:
    assert UmdSettings().followed_feed_mm_min is None
    assert UmdSettings(max_speed_mm_s=100.0).followed_feed_mm_min == 6000.0
    slow = UmdSettings(max_fringe_hz=100_000.0)  # 100 000 x 316.495 nm = 31.65 mm/s
    assert slow.followed_feed_mm_min == pytest.approx(1898.97, abs=0.01)


def test_angular_optics_are_followed_by_the_way_of_their_reflectors() -> None:
    # 10 000 x 316.495 nm = 3.165 mm/s; over 30 mm that is 0.1055 rad/s = 6.045 deg/s = 362.7 deg/min.
    turning = UmdSettings(max_fringe_hz=10_000.0, optics_spacing_mm=30.0)
    by_hand = math.degrees(10_000.0 * 316.495e-6 / 30.0) * 60.0
    assert turning.followed_feed_deg_min == pytest.approx(by_hand, rel=1e-5)
    assert turning.followed_feed_mm_min is None, "the angle of a linear axis says nothing of its way"
    assert UmdSettings(max_fringe_hz=10_000.0).followed_feed_deg_min is None
    assert UmdSettings(optics_spacing_mm=30.0).followed_feed_deg_min is None


def test_other_instruments_follow_as_the_site_states() -> None:
    assert BridgeSettings(max_speed_mm_s=4000.0).followed_feed_mm_min == 240_000.0
    assert BridgeSettings(max_speed_deg_s=12.0).followed_feed_deg_min == 720.0
    assert AttocubeSettings(max_speed_mm_s=2000.0).followed_feed_mm_min == 120_000.0
    for unknown in (BridgeSettings(), AttocubeSettings(), BridgeSettings(max_speed_mm_s=0.0), UmdSettings()):
        assert isinstance(unknown, DriverSettings)
        assert unknown.counts_motion
        assert unknown.followed_feed_mm_min is unknown.followed_feed_deg_min is None
    assert [one.states_speed for one in (BridgeSettings(), BridgeSettings(max_speed_mm_s=0.0))] == [False, True]
