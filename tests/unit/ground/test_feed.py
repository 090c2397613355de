"""The feed against what the counter follows: 2 v / lambda, worked out by hand."""

from __future__ import annotations

import pytest

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
