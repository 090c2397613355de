"""Vibrations and settling from records whose content is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.recordings import Recording, RecordingGap
from gateway.errors import NotIdentifiable
from gateway.evaluate.behaviour.dynamics import amplitude_spectrum, evaluate_settling

RATE = 2000.0


def record(values: np.ndarray, **more: object) -> Recording:
    return Recording(values, RATE, "um", **more)  # type: ignore[arg-type]


@settings(max_examples=60)
@given(st.floats(20.0, 900.0), st.floats(0.05, 20.0), st.floats(0.0, 6.28))
def test_a_sine_shows_its_frequency_and_amplitude(frequency: float, amplitude: float, phase: float) -> None:
    t = np.arange(20_000) / RATE
    found = amplitude_spectrum(record(3.0 + amplitude * np.sin(2 * np.pi * frequency * t + phase)), 2048)
    assert found.peaks[0].frequency_hz == pytest.approx(frequency, abs=0.1)
    assert found.peaks[0].amplitude == pytest.approx(amplitude, rel=0.02)
    assert found.rms == pytest.approx(amplitude / np.sqrt(2), rel=0.02)


def test_two_vibrations_and_noise_are_told_apart() -> None:
    t = np.arange(40_000) / RATE
    noise = np.random.default_rng(5).normal(0.0, 0.3, t.size)
    values = 2.0 * np.sin(2 * np.pi * 50.0 * t) + 0.5 * np.sin(2 * np.pi * 147.0 * t) + noise
    peaks = amplitude_spectrum(record(values), 2048, 2).peaks
    assert [peak.frequency_hz for peak in peaks] == pytest.approx([50.0, 147.0], abs=0.3)
    assert [peak.amplitude for peak in peaks] == pytest.approx([2.0, 0.5], rel=0.1)


def test_a_gap_is_not_bridged() -> None:
    t = np.arange(8000) / RATE
    whole = np.sin(2 * np.pi * 100.0 * t)
    # The second half comes in with the opposite phase: bridged, it would cancel in part.
    values = np.concatenate([whole[:4000], -whole[4000:]])
    found = amplitude_spectrum(record(values, gaps=(RecordingGap(4000, 10),)), 1024)
    assert found.peaks[0].amplitude == pytest.approx(1.0, rel=0.02)


def test_too_short_a_record_is_told() -> None:
    for call in (amplitude_spectrum, lambda r: evaluate_settling(r, 1.0)):
        with pytest.raises(NotIdentifiable) as caught:
            call(record(np.zeros(10)))
        assert caught.value.code == "E-EVAL-DYNAMIC-SHORT"


def ringing_move(decay_s: float = 0.05, frequency: float = 30.0, sign: float = 1.0) -> np.ndarray:
    t = np.arange(4000) / RATE - 0.2
    after = 1.0 - np.exp(-t / decay_s) * np.cos(2 * np.pi * frequency * t)
    return sign * 100.0 * np.where(t < 0, 0.0, after)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ringing_move_settles_when_its_envelope_does(sign: float) -> None:
    found = evaluate_settling(record(ringing_move(sign=sign)), 1.0)
    assert found.step == pytest.approx(sign * 100.0, abs=0.5)
    assert found.time_s is not None
    # exp(-t/0.05) = 1 % at t = 0.230 s; the last swing outside lies within half a period before it.
    assert 0.230 - 1 / 60 <= found.time_s <= 0.231
    assert found.overshoot == pytest.approx(100.0 * np.exp(-1 / 60 / 0.05), rel=0.02)
    assert found.ringing is not None
    assert found.ringing.frequency_hz == pytest.approx(30.0, rel=0.05)


def test_a_slow_move_has_no_overshoot() -> None:
    t = np.arange(4000) / RATE - 0.2
    values = np.where(t < 0, 0.0, 10.0 * (1.0 - np.exp(-t / 0.1)))
    found = evaluate_settling(record(values), 0.1, start_s=0.2)
    assert found.overshoot <= 0.1
    assert found.ringing is None
    assert found.time_s == pytest.approx(0.1 * np.log(100.0), rel=0.02)


def test_what_never_settles_is_said() -> None:
    t = np.arange(4000) / RATE
    values = np.where(t < 0.2, 0.0, 50.0) + 3.0 * np.sin(2 * np.pi * 40.0 * t)
    assert evaluate_settling(record(values), 1.0, start_s=0.2).time_s is None


def test_no_move_and_a_gap_are_refused() -> None:
    for values, gaps, code in (
        (np.zeros(4000), (), "E-EVAL-DYNAMIC-MOVE"),
        (ringing_move(), (RecordingGap(5, 1),), "E-EVAL-DYNAMIC-GAP"),
    ):
        with pytest.raises(NotIdentifiable) as caught:
            evaluate_settling(record(values, gaps=gaps), 1.0)
        assert caught.value.code == code


def test_late_noise_beyond_the_band_does_not_bend_the_ringing() -> None:
    values = ringing_move()
    values[[2500, 3100, 3700]] += [1.5, -1.5, 1.5]
    found = evaluate_settling(record(values), 1.0)
    assert found.ringing is not None
    assert found.ringing.frequency_hz == pytest.approx(30.0, rel=0.05)
