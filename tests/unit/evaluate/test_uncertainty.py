"""GUM and its Supplement 1: published examples, adaptive Monte Carlo, agreement with the law where linear."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.evaluate import distributions, montecarlo, propagation
from gateway.evaluate.around import beside
from gateway.evaluate.distributions import ArcSine, Normal, Rectangular, Student, Trapezoidal
from gateway.evaluate.parameters import of_readings
from gateway.evaluate.propagation import Input, agreement, law
from gateway.evaluate.straightness import straightness
from gateway.evaluate.trials import scatter_of_test
from gateway.evaluate.uncertainty import Budget, expanded

ROW = np.array([-1.0, -1.0, 0.0, 1.0, 1.0])


def total(drawn: dict) -> dict:
    return {"y": sum(drawn.values())}


def four(last: distributions.Distribution, rest: type = Rectangular) -> dict:
    one = Rectangular(0.0, sqrt(3.0)) if rest is Rectangular else Normal(0.0, 1.0)
    return {"a": one, "b": one, "c": one, "d": last}


def test_s1_additive_normal_agrees_with_the_law() -> None:
    found = montecarlo.propagate(four(Normal(0.0, 1.0), Normal), total, seed=5)["y"]
    assert found.converged
    assert found.u == pytest.approx(2.0, abs=0.02)
    assert found.symmetric == pytest.approx((-3.92, 3.92), abs=0.05)
    by_law = law(lambda x: sum(x.values()), {name: Input(0.0, 1.0) for name in "abcd"})
    assert (by_law.u, by_law.U) == pytest.approx((2.0, 3.92), abs=0.001)
    assert agreement(by_law, found).agrees


def test_s1_additive_rectangular_is_narrower_than_normal() -> None:
    found = montecarlo.propagate(four(Rectangular(0.0, sqrt(3.0))), total, seed=6)["y"]
    assert found.symmetric == pytest.approx((-3.88, 3.88), abs=0.05)


def test_s1_one_dominant_rectangle_is_not_borne_out_by_the_law() -> None:
    found = montecarlo.propagate(four(Rectangular(0.0, 10.0 * sqrt(3.0))), total, seed=7)["y"]
    assert found.u == pytest.approx(10.15, abs=0.1)
    assert found.symmetric == pytest.approx((-17.0, 17.0), abs=0.2)
    inputs = {"a": Input(0.0, 1.0), "b": Input(0.0, 1.0), "c": Input(0.0, 1.0), "d": Input(0.0, 10.0)}
    assert not agreement(law(lambda x: sum(x.values()), inputs), found).agrees


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
    found = montecarlo.propagate(MASS, mass, seed=8)["dm"]
    assert found.mean == pytest.approx(1.234, abs=0.0005)
    assert found.u == pytest.approx(0.0754, abs=0.0005)
    assert found.shortest == pytest.approx((1.0834, 1.3825), abs=0.005)
    first = law(lambda x: mass(x)["dm"], {name: Input(item.estimate, item.u) for name, item in MASS.items()})
    assert first.u == pytest.approx(0.0539, abs=0.0002)
    assert not agreement(first, found).agrees


def test_gum_h1_end_gauge_by_the_law() -> None:
    inputs = {"ls": Input(0, 25, 18), "d": Input(0, 9.7, 25.6), "da": Input(0, 2.9, 50), "dt": Input(0, 16.6, 2)}
    found = law(lambda x: sum(x.values()), inputs, probability=0.99)
    assert found.u == pytest.approx(31.67, abs=0.01)
    assert found.freedom == pytest.approx(16.76, abs=0.01)
    assert (found.k, found.U) == pytest.approx((2.92, 92.5), abs=0.2)
    assert found.share["ls"] == pytest.approx(25.0)


def test_correlated_inputs_add_or_cancel() -> None:
    inputs = {"a": Input(5.0, 3.0), "b": Input(2.0, 4.0), "unused": Input(0.0, 0.0)}
    r = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert law(lambda x: x["a"] + x["b"], inputs, correlation=r).u == pytest.approx(7.0)
    assert law(lambda x: x["a"] - x["b"], inputs, correlation=r).u == pytest.approx(1.0)
    assert law(lambda x: x["a"] - x["b"], inputs).u == pytest.approx(5.0)
    for wrong in (np.eye(2), 2.0 * np.eye(3)):
        with pytest.raises(ModelError, match="E-EVAL-CORRELATION"):
            law(lambda x: x["a"], inputs, correlation=wrong)
    drawn = distributions.correlated(np.random.default_rng(1), 20_000, [1.0, 2.0], [[4.0, 6.0], [6.0, 9.0]])
    assert np.cov(drawn.T) == pytest.approx(np.array([[4.0, 6.0], [6.0, 9.0]]), rel=0.05)


@pytest.mark.parametrize(
    "item",
    [Normal(3.0, 2.0), Rectangular(3.0, 2.0), Trapezoidal(3.0, 2.0), Trapezoidal(3.0, 2.0, 0.5), ArcSine(3.0, 2.0),
     Student(3.0, 0.5, 8.0)],
)  # fmt: skip
def test_every_distribution_has_the_moments_it_says(item: distributions.Distribution) -> None:
    drawn = item.draw(np.random.default_rng(2), 200_000)
    assert drawn.mean() == pytest.approx(item.estimate, abs=5 * item.u / sqrt(200_000))
    assert drawn.std() == pytest.approx(item.u, rel=0.02)


def test_few_readings_are_student_and_too_few_are_refused() -> None:
    found = distributions.of_readings([1.0, 2.0, 3.0, 4.0, 5.0])
    assert (found.estimate, found.freedom) == (3.0, 4)
    assert found.u == pytest.approx(sqrt(2.5 / 5) * sqrt(2.0))
    assert Student(0.0, 1.0, 2.0).u == float("inf")
    for wrong in ([1.0], [1.0, float("nan")], [[1.0, 2.0]]):
        with pytest.raises(ModelError, match="E-EVAL-REPEATED"):
            distributions.of_readings(wrong)


def test_trials_go_on_until_the_digits_asked_for_hold_and_say_so_when_they_may_not() -> None:
    one, two = (montecarlo.propagate({"a": Normal(0.0, 1.0)}, total, digits=d, seed=9)["y"] for d in (1, 2))
    assert one.trials < two.trials
    assert one.converged
    assert two.converged
    cut = montecarlo.propagate({"a": Normal(0.0, 0.99)}, total, digits=3, seed=9, most=20_000)["y"]
    assert not cut.converged
    assert cut.trials == 20_000
    same = montecarlo.propagate({"a": Normal(0.0, 1.0)}, total, digits=2, seed=9)["y"]
    assert same == two


@pytest.mark.parametrize("wrong", [{"probability": 1.0}, {"digits": 0}, {"block": 10}, {"most": 10_000}])
def test_impossible_trials_are_refused(wrong: dict) -> None:
    with pytest.raises(ModelError, match="E-EVAL-TRIALS"):
        montecarlo.propagate({"a": Normal(0.0, 1.0)}, total, **wrong)


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
    found = scatter_of_test(at, sloped(), "um", lambda x: of_readings(x, 2.0), systematic, seed=1)
    by_law = expanded(5, 2.0, systematic.systematic, targets=6)
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
    found = scatter_of_test(at, sloped((2,)), "um", lambda x: of_readings(x, 2.0), Budget(), seed=1)
    assert 2.0 * found["R_up"].u == pytest.approx(1.364 * 2.0, rel=0.02)
    assert expanded(5, 2.0, 0.0)["R_up"] == pytest.approx(1.414 * 2.0, rel=1e-3)


def test_systematic_terms_act_on_ranges_not_on_reversal_and_repeatability() -> None:
    at = np.linspace(0.0, 500.0, 6)
    bare, heavy = (
        scatter_of_test(at, sloped(), "um", lambda x: of_readings(x, 2.0), budget, seed=1)
        for budget in (Budget(), Budget(expansion=10.0))
    )
    for name in ("B", "R", "R_up"):
        assert heavy[name].u == pytest.approx(bare[name].u, rel=0.02)
    for name in ("E", "M", "A"):
        assert heavy[name].U > 3.0 * bare[name].U


def test_a_rotary_axis_takes_its_systematic_part_as_a_wave_and_one_run_needs_a_drift_test() -> None:
    at = np.arange(0.0, 360.0, 30.0)
    x = np.zeros((12, 5, 2)) + 1e-6 * ROW[None, :, None]
    found = scatter_of_test(at, x, "arcsec", lambda y: of_readings(y, 2.0), Budget(device=1.0), seed=1)
    assert found["E"].symmetric[1] == pytest.approx(1.14, rel=0.03)
    single = np.zeros((12, 1, 2))
    assert scatter_of_test(at, single, "arcsec", lambda y: of_readings(y, 2.0), Budget()) == {}
    drifting = scatter_of_test(at, single, "arcsec", lambda y: of_readings(y, 2.0), Budget(eve=0.5))
    assert "B_mean" in drifting
    assert "R" not in drifting


def test_tolerance_of_zero_uncertainty() -> None:
    assert montecarlo.numerical_tolerance(0.0, 2) == 0.0
    assert montecarlo.numerical_tolerance(0.0754, 2) == pytest.approx(0.0005)
    assert propagation.law(lambda x: x["a"], {"a": Input(1.0, 0.0)}).U == 0.0


def test_any_geometric_result_gets_its_uncertainty_beside_it() -> None:
    x = np.linspace(0.0, 400.0, 9)
    y = np.array([0.0, 2, 3, 5, 4, 3, 2, 1, 0])

    def result(row: np.ndarray) -> dict[str, float]:
        return {"slope": straightness(x, row, "lsq").slope, "zone": straightness(x, row).value}

    found = beside(result, y, 0.1, seed=2)
    slope = Input(0.0, 0.1 / float(np.sqrt(((x - x.mean()) ** 2).sum())))
    assert found["slope"].u == pytest.approx(slope.u, rel=0.05)
    assert found["zone"].symmetric[0] < result(y)["zone"] < found["zone"].symmetric[1]
    shared = beside(result, y, np.ones((9, 9)), covariance=True, seed=2)
    assert shared["slope"].u == pytest.approx(0.0, abs=1e-4)
    for wrong, covariance in ((np.ones(3), False), (-1.0, False), (np.ones(9), True)):
        with pytest.raises(ModelError, match="E-EVAL-SHAPE"):
            beside(result, y, wrong, covariance=covariance)
