"""Fitting: worked cases, structure taken and noise left, honest uncertainty, datum, closed turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.domain.figures import Component
from gateway.errors import ModelError, NotIdentifiable
from gateway.model import components, fit
from gateway.model.components import (
    at_datum,
    design,
    leave_one_out_rows,
    motion_uncertainty,
    separate_nodes,
    standard_uncertainty,
    value,
)
from gateway.model.fit import solve_weighted

LINEAR = {"name": "EXX", "axis": "X", "axis_unit": "mm"}
GUIDE = {"name": "EXZ", "axis": "Z", "axis_unit": "mm"}
ROTARY = {"name": "ECC", "axis": "C", "axis_unit": "deg"}
Q = np.linspace(-200.0, 200.0, 21)


def test_cubic_is_reproduced_by_the_spline() -> None:
    cubic = 1e-9 * Q**3 - 2e-5 * Q
    knots = {"knots": (*[Q[0]] * 4, -100.0, 0.0, 100.0, *[Q[-1]] * 4)}
    found = solve_weighted(design("bspline", knots, Q), cubic, np.ones(Q.size))
    fitted = Component("EXZ", "Z", "mm", "bspline", (Q[0], Q[-1]), found.coefficients, found.covariance, knots)
    expected = [-0.0030590000000000005, 5.9972999999999895e-05, -0.0009336250000000005, 0.003900599000000001]
    np.testing.assert_allclose(value(fitted, [-190.0, -3.0, 55.0, 199.0]), expected, rtol=1e-9, atol=1e-12)


def unequal(m: int, seed: int) -> np.ndarray:
    even = np.arange(m) * 360.0 / m
    return even + np.random.default_rng(seed).uniform(-0.3, 0.3, m) * 360.0 / m


@pytest.mark.parametrize("seed", range(6))
def test_harmonics_are_found_and_no_others(seed: int) -> None:
    at = unequal(24, seed)
    truth = 8 * np.cos(np.radians(at - 20)) + 3 * np.sin(np.radians(2 * at)) + 2 * np.cos(np.radians(6 * at))
    noisy = truth + np.random.default_rng(seed + 50).normal(0, 0.05, 24)
    found = fit.fit_positioning(at, noisy, 0.05, kind="rotary", modulo=True, **ROTARY)
    assert found.basis == "fourier"
    assert set(found.parameters["orders"]) >= {1, 2, 6}
    assert len(found.parameters["orders"]) <= 4
    dense = np.arange(0.0, 360.0, 1.0)
    wanted = 8 * np.cos(np.radians(dense - 20)) + 3 * np.sin(np.radians(2 * dense))
    wanted += 2 * np.cos(np.radians(6 * dense))
    assert np.abs(value(found, dense) - wanted).max() < 0.2


@pytest.mark.parametrize("kind", ["linear", "rotary"])
def test_noise_alone_is_a_constant(kind: str) -> None:
    constant = 0
    for seed in range(40):
        at = unequal(24, seed)
        noise = np.random.default_rng(seed + 900).normal(0, 0.05, 24)
        found = fit.fit_positioning(at, noise, 0.05, kind=kind, modulo=kind == "rotary", **ROTARY)
        constant += found.basis == "constant"
    assert constant >= 36


def test_uncertainty_covers_what_was_missed() -> None:
    inside, total = 0, 0
    dense = np.linspace(0.0, 400.0, 81)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        at = np.sort(rng.uniform(0, 400, 21))
        at[[0, -1]] = 0.0, 400.0
        truth = (3e-2 * at, 3e-2 * dense)
        found = fit.fit_positioning(at, truth[0] + rng.normal(0, 0.1, 21), 0.1, kind="linear", **LINEAR)
        inside += int(np.sum(np.abs(value(found, dense) - truth[1]) <= 2 * standard_uncertainty(found, dense)))
        total += dense.size
    assert inside / total > 0.88


def test_scatter_left_by_the_fit_is_in_the_covariance() -> None:
    at = np.linspace(0.0, 400.0, 21)
    rough = 0.02 * at + np.random.default_rng(6).normal(0, 0.5, 21)
    found = fit.fit_positioning(at, rough, 0.01, kind="linear", **LINEAR)
    assert found.basis == "polynomial"
    assert float(standard_uncertainty(found, 200.0)) > 0.05
    assert found.residual_rms > 0.3


def test_a_step_does_not_wreck_the_rest() -> None:
    at = np.linspace(0.0, 400.0, 21)
    found = fit.fit_positioning(at, 0.02 * at + (at > 190.0), 0.02, kind="linear", **LINEAR)
    dense = np.linspace(0.0, 400.0, 4001)
    miss = value(found, dense) - 0.02 * dense - (dense > 190.0)
    assert np.abs(miss).max() < 1.0
    assert np.abs(miss[dense < 120]).max() < 0.2


def test_a_hollow_between_few_targets_is_followed_better_than_by_straight_lines() -> None:
    """Guides worn over 30 to 60 mm, targets 15 mm apart: what is left over 20 mm in the middle of them."""
    dense, lines, curves = np.linspace(140.0, 160.0, 41), [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        length, depth, middle = rng.uniform(30.0, 60.0), rng.uniform(4.0, 8.0), rng.uniform(120.0, 180.0)

        def hollow(q: np.ndarray, length: float = length, depth: float = depth, middle: float = middle) -> np.ndarray:
            wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * (q - middle) / length)
            return np.where(np.abs(q - middle) < length / 2.0, -depth * wave, 0.0)

        at = np.linspace(0.0, 300.0, 21)
        at[1:-1] += rng.uniform(-3.0, 3.0, 19)
        means = hollow(at) + rng.normal(0.0, 0.05, at.size)
        found = fit.fit_through(at, means, 0.05, **GUIDE)
        lines.append(np.std(np.interp(dense, at, means) - hollow(dense)))
        curves.append(np.std(value(found, dense) - hollow(dense)))
    print(f"median {np.median(lines):.2f} and {np.median(curves):.2f} um")
    assert np.median(curves) < 0.6 * np.median(lines)
    assert np.mean(np.square(curves)) < 0.7 * np.mean(np.square(lines))


def test_an_axis_driven_by_a_screw_shorter_than_its_targets_gets_straight_lines() -> None:
    at, more = np.linspace(0.0, 300.0, 21), []
    dense = np.linspace(0.0, 300.0, 1201)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        places = at + np.append(np.append(0.0, rng.uniform(-3.0, 3.0, 19)), 0.0)
        means = np.sin(2.0 * np.pi * places / 8.0 + seed) + rng.normal(0.0, 0.05, 21)
        ranges = [np.ptp(value(fit.fit_through(places, means, 0.05, **one), dense)) for one in (LINEAR, GUIDE)]
        more.append(ranges[1] - ranges[0])
    assert min(more) >= -1e-9
    assert np.mean(np.asarray(more) > 0.05) > 0.5


def test_what_a_target_misses_is_the_curve_through_the_others() -> None:
    at = np.cumsum(np.random.default_rng(3).uniform(8.0, 16.0, 9))
    means = np.sin(at / 15.0)
    missed = leave_one_out_rows(at) @ means
    for k in range(1, 8):
        others = np.arange(9) != k
        left_out = fit.fit_through(at[others], means[others], 0.1, **GUIDE)
        assert missed[k - 1] == pytest.approx(means[k] - float(value(left_out, at[k])), abs=1e-6)


@pytest.mark.parametrize("beside_mm", [0.0, 1e-3, 0.1, 0.5, 2.0])
def test_targets_close_together_make_no_swing_beside_them(beside_mm: float) -> None:
    """Their scatter over so short a way is a slope that would go on over the next gap."""
    rng = np.random.default_rng(11)
    at = np.linspace(0.0, 300.0, 21)
    at = np.sort(np.concatenate([at, at + beside_mm if beside_mm else at]))
    means = np.where(np.abs(at - 150.0) < 20.0, -3.0 - 3.0 * np.cos(np.pi * (at - 150.0) / 20.0), 0.0)
    found = fit.fit_positioning(at, means + rng.normal(0.0, 0.05, at.size), 0.05, kind="linear", **LINEAR)
    values = value(found, np.linspace(0.0, 300.0, 1201))
    print(found.basis, values.min(), values.max())
    assert values.max() < 1.0
    assert values.min() > -7.0


def test_places_too_close_together_are_one_and_graded_ones_stay() -> None:
    np.testing.assert_allclose(separate_nodes(np.asarray([0.0, 1.0, 1.08, 2.0, 3.0])), [0.0, 1.04, 2.0, 3.0])
    np.testing.assert_allclose(separate_nodes(np.asarray([3.0, 2.0, 1.0, 1.0, 0.01, 0.0])), [0.0, 1.0, 2.0, 3.0])
    graded = np.asarray([0.0, 15.0, 30.0, 33.75, 37.5, 41.25, 45.0, 60.0])
    np.testing.assert_allclose(separate_nodes(graded), graded)
    np.testing.assert_allclose(separate_nodes(np.asarray([5.0, 5.0])), [5.0])


def test_nothing_is_extrapolated_and_a_turn_repeats() -> None:
    at = np.linspace(0.0, 400.0, 21)
    found = fit.fit_positioning(at, 1e-4 * (at - 100) ** 2, 0.05, kind="linear", **LINEAR)
    for outside in (-50.0, 500.0):
        with pytest.raises(ModelError, match="E-MODEL-RANGE"):
            value(found, [0.0, outside])
    turn = fit.fit_positioning(unequal(12, 1), np.cos(np.radians(unequal(12, 1))), 0.01, kind="rotary", **ROTARY)
    np.testing.assert_allclose(value(turn, [10.0, 370.0, -350.0]), float(value(turn, 10.0)))


def test_few_places_around_a_modulo_axis_make_a_closed_polygon() -> None:
    at, means = [0.0, 90.0, 180.0, 270.0], [0.0, 5.0, -3.0, 2.0]
    found = fit.fit_positioning(at, means, 0.1, kind="rotary", modulo=True, **ROTARY)
    assert components.is_periodic(found) or found.basis == "constant"
    assert float(value(found, 0.0)) == pytest.approx(float(value(found, 360.0)))


def test_part_of_a_turn_is_not_closed() -> None:
    at = np.linspace(-60.0, 60.0, 13)
    found = fit.fit_positioning(at, 0.05 * at, 0.02, kind="rotary", **ROTARY)
    assert not components.is_periodic(found)


def test_the_first_target_may_be_measured_again_after_a_turn() -> None:
    at = np.append(np.arange(0.0, 360.0, 15.0), 360.0)
    found = fit.fit_positioning(at, 6 * np.cos(np.radians(at)), 0.05, kind="rotary", modulo=True, **ROTARY)
    assert found.parameters["orders"] == (1,)


def test_a_turn_that_ends_elsewhere_than_it_began_is_not_closed() -> None:
    """A gear ratio that is a little off adds up; what an instrument drifts by does not open a turn."""
    at = np.linspace(0.0, 360.0, 25)
    for slope, modulo, periodic in ((0.1, False, False), (0.003, False, True), (0.1, True, True)):
        means = slope * at + 9.0 * np.sin(np.deg2rad(at))
        fitted = fit.fit_positioning(
            at, means, 0.05, kind="rotary", axis_unit="deg", name="EAA", axis="A", modulo=modulo
        )
        assert components.is_periodic(fitted) == periodic
        if not periodic:
            assert np.abs(value(fitted, at) - means).max() < 0.2


@pytest.mark.parametrize("basis", ["constant", "polynomial", "fourier", "bspline", "piecewise", "cubic", "closed"])
def test_datum_takes_the_offset_and_its_uncertainty(basis: str) -> None:
    found = example(basis)
    zeroed = at_datum(found, 120.0)
    dense = np.linspace(0.0, 360.0, 91)
    np.testing.assert_allclose(value(zeroed, dense), value(found, dense) - value(found, 120.0), atol=1e-9)
    assert float(standard_uncertainty(zeroed, 120.0)) == pytest.approx(0.0, abs=1e-7)


def example(basis: str) -> Component:
    parameters: dict[str, object] = {
        "constant": {},
        "polynomial": {"centre": 180.0, "scale": 180.0, "degree": 3},
        "fourier": {"period": 360.0, "orders": (1, 4)},
        "bspline": {"knots": (0.0,) * 4 + (100.0, 250.0) + (360.0,) * 4},
        "piecewise": {"nodes": (0.0, 50.0, 200.0, 360.0), "period": None},
        "cubic": {"nodes": (0.0, 50.0, 140.0, 200.0, 290.0, 360.0), "period": None},
        "closed": {"nodes": (0.0, 50.0, 200.0), "period": 360.0},
    }[basis]
    name = "piecewise" if basis == "closed" else basis
    size = components.design(name, parameters, np.asarray([1.0])).shape[1]
    rng = np.random.default_rng(2)
    root = rng.normal(size=(size, size))
    return Component("EXX", "X", "mm", name, (0.0, 360.0), rng.normal(size=size), root @ root.T, parameters)


def test_fit_with_reference_is_zero_there() -> None:
    found = fit.fit_positioning(Q, 0.01 * Q + 7.0, 0.05, kind="linear", reference=0.0, **LINEAR)
    assert float(value(found, 0.0)) == pytest.approx(0.0, abs=1e-12)
    assert float(value(found, 100.0)) == pytest.approx(1.0)


def test_missing_means_are_left_out() -> None:
    means = 0.01 * Q
    means[3] = np.nan
    found = fit.fit_positioning(Q, means, 0.02, kind="linear", **LINEAR)
    assert float(value(found, Q[3])) == pytest.approx(0.01 * Q[3], abs=1e-6)


def test_identical_readings_are_no_error() -> None:
    found = fit.fit_positioning(Q, 0.01 * Q, 0.0, kind="linear", **LINEAR)
    assert float(value(found, 50.0)) == pytest.approx(0.5)


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(NotIdentifiable, match="E-MODEL-POINTS"):
        fit.fit_positioning([1.0, 1.0], [0.0, 1.0], 0.1, kind="linear", **LINEAR)
    with pytest.raises(ModelError, match="E-MODEL-U"):
        fit.fit_positioning(Q, Q, np.nan, kind="linear", **LINEAR)
    with pytest.raises(ModelError, match="E-MODEL-BASIS"):
        value(replace(example("constant"), basis="wavelet"), 1.0)
    knots = {"knots": (*[Q[0]] * 4, -199.0, -198.0, -197.0, -196.0, -195.0, *[Q[-1]] * 4)}
    with pytest.raises(NotIdentifiable, match="E-MODEL-CONDITION"):
        solve_weighted(design("bspline", knots, Q), Q, np.ones(Q.size))


@pytest.mark.parametrize("m", [2, 3, 4, 5])
def test_a_handful_of_targets_is_fitted(m: int) -> None:
    at = np.linspace(0.0, 100.0, m)
    found = fit.fit_positioning(at, 0.1 * at, 0.05, kind="linear", **LINEAR)
    assert np.abs(value(found, at) - 0.1 * at).max() < 6.0


def test_readings_that_no_curve_follows_leave_every_place_in_doubt() -> None:
    """Nothing is left of a constant at its datum, and its own uncertainty is zero; the motion is as rough as it was."""
    rough = np.random.default_rng(3).normal(0.0, 6.0, Q.size)
    found = fit.fit_positioning(Q, rough, 0.2, name="EAX", axis="X", axis_unit="mm", kind="linear", reference=0.0)
    missed = np.abs(value(found, Q) - (rough - rough[Q == 0.0]))
    assert np.mean(missed <= 2.0 * motion_uncertainty(found, Q)) > 0.8
    assert np.mean(missed <= 2.0 * standard_uncertainty(found, Q)) < 0.5
