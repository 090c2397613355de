"""Morris against closed forms, against SALib, and rankings that say what they do not know."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.sensitivity.morris import elementary_effects, exhaustive, indices, trajectories
from gateway.sensitivity.ranks import ranking


def test_a_linear_function_has_its_coefficients_as_effects() -> None:
    a = np.array([1.5, -2.0, 0.25, 0.0])
    points = trajectories(4, 8, 4, seed=3)
    effects = elementary_effects(points, points @ a)
    assert np.allclose(effects, a, atol=1e-12)
    stats = exhaustive(a, 4)
    assert np.allclose(stats.mu, a)
    assert np.allclose(stats.mu_star, np.abs(a))
    assert np.allclose(stats.sigma, 0.0, atol=1e-12)
    assert np.allclose(np.abs(stats.mu_share).sum(), 1.0)


def test_indices_agree_with_salib_on_a_coupled_function() -> None:
    from SALib.analyze.morris import analyze

    points = trajectories(3, 30, 6, seed=11)
    y = points[..., 0] * points[..., 1] + np.sin(3.0 * points[..., 2])
    ours = indices(elementary_effects(points, y))
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0, 1]] * 3}
    theirs = analyze(problem, points.reshape(-1, 3), y.reshape(-1), num_levels=6, num_resamples=10)
    assert np.allclose(ours.mu, np.asarray(theirs["mu"]))
    assert np.allclose(ours.mu_star, np.asarray(theirs["mu_star"]))
    assert np.allclose(ours.sigma, np.asarray(theirs["sigma"]))


def test_several_outputs_are_worked_at_once() -> None:
    points = trajectories(3, 5, 4, seed=2)
    outputs = np.stack([points @ [1.0, 2.0, 3.0], points @ [0.0, -1.0, 0.5]], axis=-1)
    effects = elementary_effects(points, outputs)
    assert effects.shape == (5, 3, 2)
    assert np.allclose(effects[..., 1], [0.0, -1.0, 0.5], atol=1e-12)


def test_a_clear_ranking_is_settled_and_a_tie_is_said() -> None:
    rng = np.random.default_rng(5)
    effects = np.stack(
        [rng.normal(10.0, 0.5, 40), rng.normal(3.0, 1.0, 40), rng.normal(3.0, 1.0, 40), np.zeros(40)], axis=1
    )
    ranked = ranking(["ECZ", "EXX", "EXZ", "EZZ"], effects, seed=7)
    assert ranked[0].name == "ECZ"
    assert ranked[0].tied_with == ()
    assert ranked[0].rank_low == ranked[0].rank_high == 1
    middle = {item.name: item for item in ranked[1:3]}
    assert middle["EXX"].tied_with == ("EXZ",)
    assert middle["EXZ"].tied_with == ("EXX",)
    assert ranked[3].name == "EZZ"
    assert ranked[3].mu_star == 0.0


@pytest.mark.parametrize(("levels", "code"), [(3, "E-SENS-LEVELS"), (0, "E-SENS-LEVELS")])
def test_odd_levels_are_refused(levels: int, code: str) -> None:
    with pytest.raises(ModelError, match=code):
        trajectories(3, 4, levels)


def test_points_that_are_no_trajectories_are_refused() -> None:
    points = trajectories(3, 4, 4, seed=1).copy()
    points[2, 1] = points[2, 0]
    with pytest.raises(ModelError, match="trajectory 2"):
        elementary_effects(points, points[..., 0])
