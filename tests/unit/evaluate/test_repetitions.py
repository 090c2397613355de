"""Repetitions: outliers are seen and left out of the means, drift and wide scatter are no outliers."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.domain.values import FloatArray
from gateway.evaluate.behaviour import repetitions
from gateway.evaluate.behaviour.doubts import doubts_of
from gateway.evaluate.behaviour.repetitions import doubtful_readings, robust_means


def run(seed: int, m: int = 24, n: int = 5, noise: float = 0.15) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    curve = 10 * np.sin(np.arange(m))
    return curve, curve[:, None, None] + np.array([0.3, -0.3]) + rng.normal(0, noise, (m, n, 2))


def test_means_and_scatter_of_clean_data() -> None:
    curve, x = run(1)
    found = robust_means(np.arange(24.0), x)
    assert found.suspects == ()
    assert found.s == pytest.approx(0.15, rel=0.15)
    assert np.abs(found.mean - curve).max() < 5 * 0.15 / np.sqrt(10)
    np.testing.assert_allclose(found.mean_up - found.mean_down, x.mean(axis=1) @ [1, -1], atol=1e-12)
    np.testing.assert_allclose(found.u, found.s / np.sqrt(10))


@pytest.mark.parametrize("seed", range(8))
def test_outliers_are_named_and_left_out(seed: int) -> None:
    curve, x = run(seed)
    rng = np.random.default_rng(100 + seed)
    places = {tuple(int(rng.integers(0, size)) for size in x.shape) for _ in range(3)}
    for place in places:
        x[place] += rng.choice((-1, 1)) * 2.0
    found = robust_means(np.arange(24.0), x)
    assert set(found.suspects) == places
    assert np.abs(found.mean - curve).max() < 5 * 0.15 / np.sqrt(8)


def test_false_alarms_are_rare() -> None:
    alarms = sum(len(robust_means(np.arange(24.0), run(seed)[1]).suspects) for seed in range(60))
    assert alarms <= 1


def test_a_drift_shared_by_each_pass_is_no_suspicion() -> None:
    curve, x = run(2)
    x += np.array([0.0, 5.0, 11.0, 12.0, 12.5])[None, :, None]
    x[7, 3, 1] += 3.0
    found = robust_means(np.arange(24.0), x)
    assert found.suspects == ((7, 3, 1),)
    assert found.s == pytest.approx(0.15, rel=0.2)
    level = found.mean - found.mean.mean() - (curve - curve.mean())
    assert np.abs(level).max() < 0.3
    np.testing.assert_allclose(np.diff(found.pass_offsets[:, 0]), [5.0, 6.0, 1.0, 0.5], atol=0.2)


def test_a_target_that_scatters_is_not_an_outlier() -> None:
    _, x = run(3, n=5)
    x[4] += np.array([-4.0, 5.0, 1.0, -5.0, 3.0])[:, None]
    found = robust_means(np.arange(24.0), x)
    assert found.suspects == ()
    np.testing.assert_allclose(found.mean_up[4], (x - found.pass_offsets[None])[4, :, 0].mean())
    assert found.s > 0.3


@pytest.mark.parametrize("n", [3, 5])
def test_a_place_whose_readings_do_not_agree_is_taken_again_and_left_to_the_other_way(n: int) -> None:
    """Two of three, or three of five, off by other amounts: no reading stands out, and none is right by itself."""
    curve, x = run(7, n=n)
    x[4, :, 1] += np.array([0.0, 3.5, -5.0, 3.9, -0.2])[:n]
    found = robust_means(np.arange(24.0), x)
    assert found.suspects == ()
    assert found.s == pytest.approx(0.15, rel=0.2)
    assert found.mean[4] == pytest.approx(curve[4], abs=5.0 * 0.15 / np.sqrt(n))
    assert found.u[4] == pytest.approx(found.s / np.sqrt(n))
    doubted = doubtful_readings(x - found.pass_offsets[None])
    assert doubted[4, :, 1].all()
    assert doubted.sum() == n


def test_nothing_is_taken_again_of_clean_readings() -> None:
    assert sum(int(doubtful_readings(run(seed, n=3)[1]).sum()) for seed in range(60)) <= 2


def test_readings_alike_to_the_last_digit_are_not_outliers() -> None:
    _, x = run(4, noise=0.03)
    assert robust_means(np.arange(24.0), np.round(x, 1)).suspects == ()


def test_two_repetitions_are_too_few_to_suspect_any() -> None:
    _, x = run(5, n=2)
    x[3, 0, 0] += 50.0
    assert robust_means(np.arange(24.0), x).suspects == ()


def test_gaps_and_single_directions() -> None:
    curve, x = run(6)
    x[3, 2, 1] = np.nan
    x[9, :, 1] = np.nan
    found = robust_means(np.arange(24.0), x)
    assert np.abs(found.mean - curve).max() < 0.4
    assert found.u[9] > found.u[8]
    x[:, :, 1] = np.nan
    alone = robust_means(np.arange(24.0), x)
    assert np.isnan(alone.mean_down).all()
    assert np.isfinite(alone.mean).all()


def test_one_run_each_way_takes_scatter_from_the_reversal() -> None:
    _, x = run(7, n=1)
    found = robust_means(np.arange(24.0), x)
    assert found.s == pytest.approx(0.15, rel=0.5)
    assert np.isfinite(found.u).all()


def _told_out(targets: FloatArray, x: FloatArray) -> list[str]:
    return [one.text for one in doubts_of(targets, x, "mm") if one.code.startswith("S-EVAL-OUT")]


def test_readings_out_of_line_are_told_with_their_place_the_farthest_first() -> None:
    targets = np.arange(24.0)
    _, x = run(8)
    assert not _told_out(targets, x)
    x[3, 2, 1] -= 50.0
    x[9, 0, 0] += 20.0
    x[5, 1:, 0] = np.nan
    first, second, last = _told_out(targets, x)
    assert first.startswith("out of line: at 3, approach -, reading 3 by -")
    assert second.startswith("out of line: at 9, approach +, reading 1 by +")
    assert "in the figures" in last
    for number in range(10, 18):
        x[number, number % 5, 1] += 40.0
    assert _told_out(targets, x)[-2] == "5 more readings are out of line"


@pytest.mark.parametrize("missing", [0.0, 0.3, 0.9])
def test_medians_of_what_is_there_are_those_of_numpy(missing: float) -> None:
    rng = np.random.default_rng(3)
    x = rng.normal(size=(7, 6, 2))
    x[rng.random(x.shape) < missing] = np.nan
    for axis in range(3):
        nothing = np.isnan(x).all(axis=axis)
        expected = np.where(nothing, 0.0, np.nanmedian(np.where(np.expand_dims(nothing, axis), 0.0, x), axis))
        np.testing.assert_array_equal(repetitions._median(x, axis), expected)
