"""GUM and its Supplement 1: published examples, adaptive Monte Carlo, agreement with the law where linear."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import sqrt

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.evaluate.standards import positioning_trials, registry, statistics
from gateway.evaluate.standards.positioning_trials import scatter_of_test
from gateway.evaluate.standards.statistics import parameters_of_moments
from gateway.evaluate.uncertainty import montecarlo
from gateway.evaluate.uncertainty import montecarlo as distributions
from gateway.evaluate.uncertainty.budget import Budget, expanded_uncertainties
from gateway.evaluate.uncertainty.montecarlo import Normal, Rectangular
from tests.steps import said

ROW = np.array([-1.0, -1.0, 0.0, 1.0, 1.0])


def total(drawn: dict) -> dict:
    return {"y": sum(drawn.values())}


def trials(inputs: dict, model: Callable[[dict], dict], **how: object) -> Mapping[str, montecarlo.TrialOutcome]:
    """Trials of independent inputs through a model."""
    return montecarlo.run_trials(
        lambda rng, count: model({k: one.draw(rng, count) for k, one in inputs.items()}), **how
    )


def four(last: distributions.Distribution, rest: type = Rectangular) -> dict:
    one = Rectangular(0.0, sqrt(3.0)) if rest is Rectangular else Normal(0.0, 1.0)
    return {"a": one, "b": one, "c": one, "d": last}


def iso_scatter(at: np.ndarray, x: np.ndarray, unit: str, budget: Budget, **more: object) -> dict:
    """The test made again by ISO 230-2 (2 s)."""
    return dict(
        scatter_of_test(at, x, unit, None, budget, of_table=lambda mean, s: parameters_of_moments(mean, s, 2.0), **more)
    )


def test_s1_additive_normal() -> None:
    found = trials(four(Normal(0.0, 1.0), Normal), total, seed=5)["y"]
    assert found.converged
    assert found.u == pytest.approx(2.0, abs=0.02)
    assert found.symmetric == pytest.approx((-3.92, 3.92), abs=0.05)


def test_s1_additive_rectangular_is_narrower_than_normal() -> None:
    found = trials(four(Rectangular(0.0, sqrt(3.0))), total, seed=6)["y"]
    assert found.symmetric == pytest.approx((-3.88, 3.88), abs=0.05)


def test_s1_one_dominant_rectangle() -> None:
    found = trials(four(Rectangular(0.0, 10.0 * sqrt(3.0))), total, seed=7)["y"]
    assert found.u == pytest.approx(10.15, abs=0.1)
    assert found.symmetric == pytest.approx((-17.0, 17.0), abs=0.2)


def mass(x: dict) -> dict:
    air = (x["air"] - 1.2) * (1.0 / x["weight"] - 1.0 / x["reference"])
    return {"dm": (x["m"] + x["dm"]) * (1.0 + air) - 100_000.0}


MASS = {
    "m": Normal(100_000.0, 0.050),
    "dm": Normal(1.234, 0.020),
    "air": Rectangular(1.2, 0.1),
    "weight": Rectangular(8000.0, 1000.0),
    "reference": Rectangular(8000.0, 50.0),
}


def test_s1_mass_calibration_where_the_first_order_fails() -> None:
    found = trials(MASS, mass, seed=8)["dm"]
    assert found.mean == pytest.approx(1.234, abs=0.0005)
    assert found.u == pytest.approx(0.0754, abs=0.0005)
    assert found.shortest == pytest.approx((1.0834, 1.3825), abs=0.005)


@pytest.mark.parametrize(
    "item",
    [Normal(3.0, 2.0), Rectangular(3.0, 2.0)],
)
def test_every_distribution_has_the_moments_it_says(item: distributions.Distribution) -> None:
    drawn = item.draw(np.random.default_rng(2), 200_000)
    assert drawn.mean() == pytest.approx(item.estimate, abs=5 * item.u / sqrt(200_000))
    assert drawn.std() == pytest.approx(item.u, rel=0.02)


def test_trials_go_on_until_the_digits_asked_for_hold_and_say_so_when_they_may_not() -> None:
    one, two = (trials({"a": Normal(0.0, 1.0)}, total, digits=d, seed=9)["y"] for d in (1, 2))
    assert one.trials < two.trials
    assert one.converged
    assert two.converged
    cut = trials({"a": Normal(0.0, 0.99)}, total, digits=3, seed=9, most=20_000)["y"]
    assert not cut.converged
    assert cut.trials == 20_000
    same = trials({"a": Normal(0.0, 1.0)}, total, digits=2, seed=9)["y"]
    assert same == two


@pytest.mark.parametrize("wrong", [{"probability": 1.0}, {"digits": 0}, {"block": 10}, {"most": 10_000}])
def test_impossible_trials_are_refused(wrong: dict) -> None:
    with pytest.raises(ModelError, match="E-EVAL-TRIALS"):
        trials({"a": Normal(0.0, 1.0)}, total, **wrong)


def test_intervals_of_a_skew_output() -> None:
    y = np.sort(np.random.default_rng(3).exponential(1.0, 200_000))
    symmetric, shortest = montecarlo.symmetric_interval(y, 0.95), montecarlo.shortest_interval(y, 0.95)
    assert symmetric == pytest.approx((0.02532, 3.689), rel=0.03)
    assert shortest[0] == pytest.approx(0.0, abs=1e-3)
    assert shortest[1] == pytest.approx(2.996, rel=0.02)


def sloped(noisy: tuple[int, ...] = tuple(range(6))) -> np.ndarray:
    """Six targets, extremes far apart at both ends, s exactly 1 at the `noisy` ones and a thousandth elsewhere."""
    s = np.where(np.isin(np.arange(6), noisy), 1.0, 1e-3)
    means = np.array([-100.0, -30.0, -10.0, 10.0, 30.0, 100.0])
    up = means[:, None] + s[:, None] * ROW
    return np.stack([up + np.array([-10.0, 0.0, 20.0, 0.0, 0.0, 10.0])[:, None], up], axis=2)


@pytest.mark.parametrize("systematic", [Budget(), Budget(device=2.0, temperature=1.0)])
def test_law_and_monte_carlo_of_a_test_agree_where_it_is_linear(systematic: Budget) -> None:
    at = np.linspace(0.0, 500.0, 6)
    found = iso_scatter(at, sloped(), "um", systematic, seed=1)
    by_law = expanded_uncertainties(5, 2.0, systematic.systematic, targets=6)
    for name, share in (
        ("B", 0.03),
        ("B_mean", 0.03),
        ("M", 0.03),
        ("E", 0.03),
        ("E_up", 0.03),
        ("E_down", 0.03),
        ("A", 0.05),
    ):
        assert 2.0 * found[name].u == pytest.approx(by_law[name], rel=share), name


def test_repeatability_by_the_law_is_a_little_large_as_sampling_theory_says() -> None:
    at = np.linspace(0.0, 500.0, 6)
    found = iso_scatter(at, sloped((2,)), "um", Budget(), seed=1)
    assert 2.0 * found["R_up"].u == pytest.approx(1.364 * 2.0, rel=0.02)
    assert expanded_uncertainties(5, 2.0, 0.0)["R_up"] == pytest.approx(1.414 * 2.0, rel=1e-3)


def test_systematic_terms_act_on_ranges_not_on_reversal_and_repeatability() -> None:
    at = np.linspace(0.0, 500.0, 6)
    bare, heavy = (iso_scatter(at, sloped(), "um", budget, seed=1) for budget in (Budget(), Budget(expansion=10.0)))
    for name in ("B", "R", "R_up"):
        assert heavy[name].u == pytest.approx(bare[name].u, rel=0.02)
    for name in ("E", "M", "A"):
        assert heavy[name].U > 3.0 * bare[name].U


def test_a_rotary_axis_takes_its_systematic_part_as_a_wave_and_one_run_needs_a_drift_test() -> None:
    at = np.arange(0.0, 360.0, 30.0)
    x = np.zeros((12, 5, 2)) + 1e-6 * ROW[None, :, None]
    found = iso_scatter(at, x, "arcsec", Budget(device=1.0), seed=1)
    assert found["E"].symmetric[1] == pytest.approx(1.14, rel=0.03)
    single = np.zeros((12, 1, 2))
    assert iso_scatter(at, single, "arcsec", Budget()) == {}
    drifting = iso_scatter(at, single, "arcsec", Budget(eve=0.5))
    assert "B_mean" in drifting
    assert "R" not in drifting


@pytest.mark.parametrize("gaps", [False, True])
def test_means_and_deviations_drawn_themselves_scatter_as_those_of_readings_drawn_one_by_one(gaps: bool) -> None:
    rng = np.random.default_rng(8)
    at = np.linspace(0.0, 400.0, 9)
    x = 4.0 * np.sin(at / 60.0)[:, None, None] + rng.normal(0.0, 0.6, (9, 5, 2)) + np.array([0.0, 1.5])
    if gaps:
        x[2, 1:3, 0], x[5, 1:, 1], x[7, :, 1] = np.nan, np.nan, np.nan
    budget = Budget(device=0.3, expansion=0.5)
    drawn = iso_scatter(at, x, "um", budget, seed=3)
    one_by_one = scatter_of_test(
        at, x, "um", lambda y: parameters_of_moments(*statistics.moments(y), 2.0), budget, seed=4
    )
    assert set(drawn) == set(one_by_one)
    assert {"A", "B", "R", "E"} <= set(drawn)
    for name, outcome in drawn.items():
        assert outcome.mean == pytest.approx(one_by_one[name].mean, abs=0.03 * outcome.u), name
        assert outcome.u == pytest.approx(one_by_one[name].u, rel=0.03), name
        assert np.allclose(outcome.symmetric, one_by_one[name].symmetric, atol=0.15 * outcome.u), name
        assert outcome.converged


def test_a_test_of_very_many_targets_is_drawn_in_parts_and_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """With bounds made small for a small test: the same distribution, never more numbers at a time than said."""
    at = np.linspace(0.0, 400.0, 9)
    x = 4.0 * np.sin(at / 60.0)[:, None, None] + np.random.default_rng(8).normal(0.0, 0.6, (9, 5, 2))
    whole = iso_scatter(at, x, "um", Budget(device=0.3), seed=3)
    monkeypatch.setattr(positioning_trials, "SCATTER", 2000)
    monkeypatch.setattr(positioning_trials, "DRAWN", positioning_trials.LEAST_TRIALS * 18)
    seen: list[int] = []

    def formulas(mean: np.ndarray, s: np.ndarray) -> Mapping[str, np.ndarray]:
        seen.append(mean.size)
        return parameters_of_moments(mean, s, 2.0)

    parts = scatter_of_test(at, x, "um", None, Budget(device=0.3), of_table=formulas, seed=4)
    assert max(seen) <= 2000
    assert {outcome.trials for outcome in parts.values()} == {positioning_trials.LEAST_TRIALS}
    for name, outcome in parts.items():
        assert outcome.u == pytest.approx(whole[name].u, rel=0.08), name


def test_a_test_of_too_many_targets_for_trials_says_so_and_has_no_intervals(monkeypatch: pytest.MonkeyPatch) -> None:
    at = np.linspace(0.0, 400.0, 9)
    x = 4.0 * np.sin(at / 60.0)[:, None, None] + np.random.default_rng(8).normal(0.0, 0.6, (9, 5, 2))
    usual = registry.evaluate_by("2014", at, x, "um", budget=Budget(device=0.3))
    monkeypatch.setattr(positioning_trials, "DRAWN", positioning_trials.LEAST_TRIALS * 18 - 1)
    found = registry.evaluate_by("2014", at, x, "um", budget=Budget(device=0.3))
    assert [flag.code for flag in found.flags if flag not in usual.flags] == ["S-EVAL-TOO-MANY"]
    assert dict(found.trials) == {}
    assert found.values == usual.values
    assert found.U["B"] == usual.U["B"], "by the law of propagation"


def test_intervals_that_are_not_settled_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(positioning_trials, "SHARE", 0.0)
    x = np.zeros((6, 5, 2)) + np.random.default_rng(2).normal(0.0, 1.0, (6, 5, 2))
    found = registry.evaluate_by("2014", np.linspace(0.0, 500.0, 6), x, "um")
    (note,) = (flag for flag in said(found) if "Monte Carlo" in flag)
    moving = {name for name, outcome in found.trials.items() if not outcome.converged}
    assert moving
    assert all(name in note for name in moving)


def test_tolerance_of_zero_uncertainty() -> None:
    assert montecarlo.numerical_tolerance(0.0, 2) == 0.0
    assert montecarlo.numerical_tolerance(0.0754, 2) == pytest.approx(0.0005)
