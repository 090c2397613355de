"""The interferometer of the paper's section 5 against the speed of light and worked cases."""

from __future__ import annotations

import numpy as np
import pytest

import trueflank as tf

LIGHT_MM_S = 299_792_458_000.0
NM = 632.990577


def test_the_shift_is_the_doppler_effect_of_light_and_its_integral_the_way() -> None:
    speed = 250.0  # mm/s
    frequency = LIGHT_MM_S / (NM * 1e-6)
    # Reflected light of a source that the mirror leaves: f (c - v) / (c + v), to first order f - 2 v f / c.
    exact = frequency * (1.0 - (LIGHT_MM_S - speed) / (LIGHT_MM_S + speed))
    shift = tf.interferometer.doppler_shift_hz(speed * 60.0)
    assert float(shift) == pytest.approx(exact, rel=1e-6)
    assert float(tf.interferometer.length_mm(shift * 4.0)) == pytest.approx(speed * 4.0, rel=1e-12)  # 4 s of it
    np.testing.assert_allclose(tf.interferometer.length_mm([0, 1, -2]) * 1e6, [0.0, NM / 2.0, -NM], rtol=1e-12)


def test_the_wavelength_in_air_is_shorter_by_the_index() -> None:
    air = tf.interferometer.wavelength_nm(air_degc=20.0, pressure_hpa=1013.25, humidity_pct=50.0)
    assert NM / air - 1.0 == pytest.approx(2.714e-4, abs=2e-7)  # usual air, by any of the equations
    with pytest.raises(tf.TrueflankError, match="E-EVAL-AMBIENT"):
        tf.interferometer.wavelength_nm(air_degc=293.0, pressure_hpa=1013.25, humidity_pct=50.0)


def test_a_feed_is_checked_before_measuring() -> None:
    limit = tf.interferometer.greatest_feed_mm_min(1e6)
    assert limit == pytest.approx(1e6 * NM * 1e-6 / 2.0 * 60.0)
    assert tf.interferometer.check_feed(0.25 * limit, 1e6) == pytest.approx(0.25)
    assert tf.interferometer.check_feed(-limit, 1e6) == pytest.approx(1.0)
    with pytest.raises(tf.TrueflankError, match=r"E-LIBRARY-FEED.*more than the counter follows: 18990 mm/min"):
        tf.interferometer.check_feed(1.001 * limit, 1e6)


def test_angular_optics_are_an_arcsine_of_their_spacing() -> None:
    spacing = 30.0
    angles = np.array([-10.0, 0.0, 0.5, 10.0])
    ways = spacing * np.sin(np.deg2rad(angles))
    np.testing.assert_allclose(tf.interferometer.angle_arcsec(ways, spacing), angles * 3600.0, rtol=1e-12)
    with pytest.raises(tf.TrueflankError, match="at most 30 mm"):
        tf.interferometer.angle_arcsec(30.1, spacing)


def test_a_counter_turned_calibrator_shows_the_axis_and_whether_it_closes() -> None:
    targets = np.arange(0.0, 361.0, 30.0)
    true = 3.0 * np.sin(np.deg2rad(targets)) + np.where(targets == 360.0, 1.5, 0.0)  # arcsec, and 1.5 of drift
    device = -targets + 0.02  # the device counts against the axis; its zero is its own
    laser = (true / 3600.0) + 0.02
    found = tf.interferometer.rotary_deviations_arcsec(targets, device, laser)
    np.testing.assert_allclose(found, true, atol=1e-9)
    assert tf.interferometer.closure_arcsec(targets, found) == pytest.approx(1.5)
    assert tf.interferometer.closure_arcsec(targets[:-1], found[:-1]) is None


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: tf.interferometer.length_mm("many"),
        lambda: tf.interferometer.length_mm(1.0, -633.0),
        lambda: tf.interferometer.length_mm(1.0 + 0j),
        lambda: tf.interferometer.length_mm(np.ma.masked_array([1.0], [True])),
        lambda: tf.interferometer.check_feed(np.nan, 1e6),
        lambda: tf.interferometer.angle_arcsec(1.0, 0.0),
    ],
)
def test_what_is_no_number_is_refused(wrong) -> None:
    with pytest.raises(tf.TrueflankError, match="E-LIBRARY-KIND"):
        wrong()


def test_the_shift_is_the_frequency_times_twice_the_speed_over_that_of_light() -> None:
    feed_m_s = 1.2 / 60.0
    shift = 2.0 * feed_m_s / 299_792_458.0 * tf.interferometer.frequency_hz()
    assert float(tf.interferometer.doppler_shift_hz(1200.0)) == pytest.approx(shift, rel=1e-12)
    with pytest.raises(tf.TrueflankError, match="E-LIBRARY-KIND"):
        tf.interferometer.frequency_hz(0.0)
