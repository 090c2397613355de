"""Real positioning tests: parameters as worked out by exact rational arithmetic elsewhere, and all relations."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.evaluate.standards import statistics
from gateway.evaluate.standards.registry import evaluate_by, standards
from tests.unit.evaluate.real_sets import SETS, table

# B, B_mean, M, E, E_up, E_down, R, R_up, R_down, A, A_up, A_down in um, six figures.
BY_HAND = {
    "ess_slit_example": (
        4.486, 0.3668, 9.243, 12.94, 6.838, 12.94,
        14.3375, 14.3375, 7.93138, 21.9697, 20.0863, 19.0906,
    ),
    "ess_target_b02_x": (
        33.578, 25.3678, 93.652, 122.848, 90.646, 98.034,
        55.1565, 28.3106, 19.3569, 135.262, 108.416, 111.49,
    ),
    "ess_target_b02_z": (
        2.364, 1.6136, 33.363, 35.278, 32.914, 33.812,
        6.4059, 6.4059, 3.38053, 36.8504, 36.8504, 35.0683,
    ),
    "ess_target_w42_x1": (
        54.678, 39.5392, 33.683, 67.224, 31.368, 41.794,
        273.457, 264.912, 210.29, 273.457, 264.912, 239.233,
    ),
    "ess_target_w42_x_8A": (
        51.238, 35.4444, 22.26, 63.542, 28.064, 26.464,
        237.149, 125.285, 237.149, 243.37, 141.39, 243.37,
    ),
    "ess_target_w42_y_ild50": (
        18.592, 10.5524, 9.68, 26.482, 15.138, 14.6,
        94.3305, 72.6399, 94.3305, 96.6779, 74.3082, 96.6779,
    ),
    "ess_target_w42_z_ild2300": (
        31.76, -5.6444, 19.917, 41.124, 41.124, 26.338,
        50.8835, 35.4674, 31.404, 63.1146, 63.1146, 42.9149,
    ),
    "psi_fat_sat_nm": (
        0.0122, 0.0054, 0.0277, 0.0368, 0.0246, 0.033,
        0.068815, 0.0503269, 0.0629031, 0.0888072, 0.0642824, 0.0888072,
    ),
}  # fmt: skip
RELATIONS = (
    ("M", "E"), ("E_up", "E"), ("E_down", "E"), ("E", "A"), ("R_up", "R"), ("R_down", "R"),
    ("R", "A"), ("A_up", "A"), ("A_down", "A"), ("B", "R"), ("B", "E"),
)  # fmt: skip


@pytest.mark.parametrize("name", SETS)
def test_parameters_as_by_hand_and_their_relations(name: str) -> None:
    targets, x = table(name)
    found = evaluate_by("ISO 230-2:2014", targets, x, "um", monte_carlo=False).values
    for parameter, expected in zip(statistics.NAMES, BY_HAND[name], strict=True):
        assert found[parameter] == pytest.approx(expected, rel=1e-5), parameter
    for small, large in RELATIONS:
        assert found[small] <= found[large] * (1 + 1e-12), (small, large)
    assert abs(found["B_mean"]) <= found["B"]


@pytest.mark.parametrize("name", SETS)
def test_every_standard_evaluates_real_data_with_uncertainty_beside_it(name: str) -> None:
    targets, x = table(name)
    for item in standards():
        found = evaluate_by(item.name, targets, x, "um", monte_carlo=False)
        assert all(value is not None and np.isfinite(value) for value in found.values.values())
        assert found.standard.certainty in ("from secondary sources", "recalled")
    assert evaluate_by("VDI 3441", targets, x, "um", monte_carlo=False).values["Pa"] == pytest.approx(
        BY_HAND[name][2], rel=1e-5
    )


def test_monte_carlo_beside_a_real_set_holds_its_own_mean_and_is_repeatable() -> None:
    targets, x = table("ess_target_b02_x")
    first, again = (evaluate_by("2014", targets, x, "um", seed=3) for _ in range(2))
    other = evaluate_by("2014", targets, x, "um", seed=4)
    assert first.trials == again.trials
    assert first.trials["E"].mean != other.trials["E"].mean
    for name, outcome in first.trials.items():
        assert outcome.symmetric[0] <= outcome.mean <= outcome.symmetric[1]
        assert outcome.shortest[1] - outcome.shortest[0] <= outcome.symmetric[1] - outcome.symmetric[0]
        assert other.trials[name].u == pytest.approx(outcome.u, rel=0.03)
