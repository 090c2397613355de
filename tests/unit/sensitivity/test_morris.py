"""Morris against closed forms, against SALib, and rankings that say what they do not know."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.sensitivity.screening import _ties, elementary_effects, exhaustive, indices, rank_inputs, trajectories


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


@pytest.mark.parametrize(("inputs", "levels"), [(5, 4), (3, 6), (1, 2)])
def test_trajectories_are_those_of_morris_and_of_salib(inputs: int, levels: int) -> None:
    """On the grid, each input moved once by the one step either way, in any order; as often as SALib's samples do."""
    from SALib.sample.morris import sample

    ours = trajectories(inputs, 600, levels, seed=4)
    problem = {"num_vars": inputs, "names": list("abcde"[:inputs]), "bounds": [[0.0, 1.0]] * inputs}
    theirs = sample(problem, 600, num_levels=levels, seed=4).reshape(600, inputs + 1, inputs)
    step = levels / (2.0 * (levels - 1))
    for points in (ours, theirs):
        assert np.allclose(points * (levels - 1), np.rint(points * (levels - 1)))
        assert points.min() >= 0.0
        assert points.max() <= 1.0 + 1e-12
        moves = np.diff(points, axis=1)
        assert np.allclose(np.sort(np.abs(moves), axis=1)[:, -1], step)
        assert np.allclose(np.abs(moves).sum(axis=1), step)
    for figure in (lambda x: x[:, 0].mean(axis=0), lambda x: (np.diff(x, axis=1) > 0.0).any(axis=1).mean(axis=0)):
        assert np.allclose(figure(ours), 0.5, atol=0.09)
        assert np.allclose(figure(theirs), 0.5, atol=0.09)
    turns = np.argmax(np.abs(np.diff(ours, axis=1)) > 0.0, axis=1).mean(axis=0)
    assert np.allclose(turns, (inputs - 1) / 2.0, atol=0.25)


def test_what_is_settled_without_counting_is_settled_by_counting() -> None:
    rng = np.random.default_rng(9)
    for scale in (0.05, 0.5, 3.0):
        draws = np.abs(rng.normal(rng.normal(5.0, 2.0, 30), scale, (200, 30))).round(1)
        greater = (draws[:, :, None] > draws[:, None, :]).mean(axis=0)
        before = greater + (draws[:, :, None] == draws[:, None, :]).mean(axis=0) / 2.0
        wanted = (before > 0.025) & (before < 0.975) & ~np.eye(30, dtype=bool)
        assert np.array_equal(_ties(draws, 0.025), wanted)


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
    ranked = rank_inputs(["ECZ", "EXX", "EXZ", "EZZ"], effects, seed=7)
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
