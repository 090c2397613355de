"""How one approach scatters: outliers, drift, the reversal's own scatter and the instrument's noise kept out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.types.sensing import Ambient
from gateway.domain.captures import Capture, Corrections
from gateway.evaluate.behaviour.repeatability import approach_of

TARGETS = np.linspace(0.0, 345.0, 24)


def capture(deviations: np.ndarray, reading_u: float = 0.0) -> Capture:
    air, done = Ambient(20.0, 1000.0, 50.0, (20.0,)), Corrections()
    return Capture("C1", "ECC", "deg", TARGETS, deviations, reading_u, air, air, done, None, None)


def read(seed: int, repetitions: int, scatter: float, half: float = 0.0) -> np.ndarray:
    """A curve, a reversal whose half varies by ``half``, passes that drift, and scatter."""
    rng = np.random.default_rng(seed)
    curve = 5.0 * np.sin(np.deg2rad(TARGETS)) + rng.normal(0.0, 1.0, TARGETS.size)
    sense = (0.6 + rng.normal(0.0, half, TARGETS.size))[:, None, None] * np.array([1.0, -1.0])
    drift = 0.4 * np.arange(repetitions)[None, :, None]
    return curve[:, None, None] + sense + drift + rng.normal(0.0, scatter, (TARGETS.size, repetitions, 2))


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("repetitions", [2, 5])
def test_two_outliers_change_nothing(repetitions: int) -> None:
    plain, spoilt, reversal = [], [], []
    for seed in range(30):
        x = read(seed, repetitions, 0.1)
        plain.append(approach_of(capture(x)).scatter)
        x[3, 0, 0] += 3.0
        x[17, 1, 1] -= 2.0
        found = approach_of(capture(x))
        spoilt.append(found.scatter)
        reversal.append(found.reversal)
    assert rms(plain) == pytest.approx(0.1, rel=0.08)
    assert rms(spoilt) == pytest.approx(0.1, rel=0.08)
    assert rms(reversal) < 0.06


@pytest.mark.parametrize("repetitions", [2, 5])
def test_a_reversal_that_varies_is_told_beside_the_scatter(repetitions: int) -> None:
    found = [approach_of(capture(read(seed, repetitions, 0.1, half=0.2))) for seed in range(30)]
    assert rms([one.reversal for one in found]) == pytest.approx(0.2, rel=0.1)
    assert rms([one.scatter for one in found]) == pytest.approx(0.1, rel=0.1)


def test_what_the_instrument_scatters_within_a_reading_is_none_of_the_axis() -> None:
    one = capture(read(1, 5, 0.1))
    whole, less = approach_of(one).scatter, approach_of(replace(one, reading_u=0.08)).scatter
    assert less == pytest.approx(np.sqrt(whole**2 - 0.08**2))
    assert approach_of(replace(one, reading_u=0.5)).scatter == 0.0
    assert approach_of(replace(one, reading_u=float("nan"))).scatter == whole


def test_single_readings_tell_by_their_reversal_at_most() -> None:
    found = approach_of(capture(read(2, 1, 0.1)))
    assert 0.05 < found.scatter < 0.2
    assert found.reversal < 0.1


@pytest.mark.parametrize(("repetitions", "scatter"), [(1, 0.0), (2, 0.1), (5, 0.1)])
def test_one_side_alone_tells_its_scatter_where_it_repeats_and_no_reversal(repetitions: int, scatter: float) -> None:
    found = []
    for seed in range(30):
        one_way = read(seed, repetitions, 0.1)
        one_way[:, :, 1] = np.nan
        found.append(approach_of(capture(one_way)))
    assert rms([one.scatter for one in found]) == pytest.approx(scatter, rel=0.08)
    assert [one.reversal for one in found] == [0.0] * 30


def test_a_standstill_test_takes_the_instruments_noise_off_the_axis() -> None:
    """Noise slower than a reading's window: the windows see none of it, readings at rest see it all."""
    rng, kept, blind = np.random.default_rng(9), [], []
    for seed in range(30):
        noisy = read(seed, 5, 0.1) + rng.normal(0.0, 0.3, (TARGETS.size, 5, 2))
        rest = float(np.std(rng.normal(0.0, 0.3, 12), ddof=1))
        one = replace(capture(noisy, 0.02), rest_u=rest, rest_count=12)
        kept.append(approach_of(one).scatter)
        blind.append(approach_of(replace(one, rest_count=0)).scatter)
    assert rms(blind) > 0.28
    assert rms(kept) == pytest.approx(0.1, abs=0.07)


def test_readings_at_rest_that_show_no_more_than_their_windows_change_nothing() -> None:
    rng, one = np.random.default_rng(3), capture(read(1, 5, 0.1), 0.05)
    found = [replace(one, rest_u=float(np.std(rng.normal(0.0, 0.05, 6), ddof=1)), rest_count=6) for _ in range(100)]
    assert sum(approach_of(rested).scatter != approach_of(one).scatter for rested in found) <= 10
