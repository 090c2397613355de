"""U of a range over a turn: from the shape of the calibrator's error, judged by drawn calibrators and by a formula."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2
from gateway.evaluate.uncertainty.budget import Budget

AT = np.arange(0.0, 360.0, 15.0)
ROW = 0.01 * np.array([-1.0, -1.0, 0.0, 1.0, 1.0])
CALIBRATOR = Budget(turning=1.0)


def read(mean: np.ndarray) -> np.ndarray:
    return mean[:, None, None] + ROW[None, :, None] * np.ones(2)


def wave(order: int, amplitude: float, phase: float) -> np.ndarray:
    return amplitude * np.cos(order * np.radians(AT) - phase)


@pytest.mark.parametrize(("apart", "variance"), [(180, 2.0), (90, 3.0)])
def test_far_apart_extremes_have_the_uncertainty_of_a_difference(apart: int, variance: float) -> None:
    """Waves of one and of two turns of variance 1/2 each: var(e(a) - e(b)) = 2 - cos d - cos 2d."""
    mean = np.zeros(AT.size)
    mean[[2, 2 + apart // 15]] = 40.0, -40.0
    U = evaluate_iso230_2(AT, read(mean), "arcsec", budget=CALIBRATOR).U
    assert U["M"] == pytest.approx(2.0 * 0.5 * np.sqrt(variance), rel=0.04)
    assert U["E"] == pytest.approx(U["A"], rel=0.03)
    assert U["B"] < 0.05


def test_a_table_made_of_the_calibrators_own_error_is_within_the_ranges_uncertainty() -> None:
    """The table takes what the calibrator shows: M reads next to nothing, the truth is the calibrator's own range."""
    rng = np.random.default_rng(4)
    beyond, machines = 0, 100
    for number in range(machines):
        order = 1 + number % 2
        error = wave(order, 1.0, 0.0) * rng.normal(0.0, 0.5) + wave(order, 1.0, np.pi / 2.0) * rng.normal(0.0, 0.5)
        left = 0.05 * rng.standard_normal(AT.size)
        found = evaluate_iso230_2(AT, read(left), "arcsec", budget=CALIBRATOR)
        assert found.M is not None
        beyond += abs(np.ptp(left - error) - found.M) > found.U["M"]
    assert 0.01 * machines <= beyond <= 0.1 * machines
