"""ISO 230-2: relations that always hold, incomplete data, one direction, one run, uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gateway.errors import ModelError
from gateway.evaluate.standards import iso230_2, statistics
from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2
from gateway.evaluate.uncertainty.budget import Budget, linear_budget
from tests.steps import said

SHAPES = st.tuples(st.integers(2, 9), st.integers(2, 6), st.just(2))
READINGS = SHAPES.flatmap(lambda shape: arrays(np.float64, shape, elements=st.floats(-50, 50, width=32)))
SCALARS = ("B", "B_mean", "M", "E", "E_up", "E_down", "R", "R_up", "R_down", "A", "A_up", "A_down")


def figures(x: np.ndarray, **kwargs: object) -> dict[str, float]:
    result = evaluate_iso230_2(np.arange(x.shape[0], dtype=float), x, "um", **kwargs)
    return {name: getattr(result, name) for name in SCALARS}


@settings(max_examples=60, deadline=None)
@given(READINGS)
def test_relations_of_complete_data(x: np.ndarray) -> None:
    f = figures(x)
    slack = 1e-9
    for small, large in (
        ("M", "E"), ("E_up", "E"), ("E_down", "E"), ("E", "A"), ("R_up", "R"), ("R_down", "R"),
        ("R", "A"), ("A_up", "A"), ("A_down", "A"), ("B", "R"), ("B", "E"),
    ):  # fmt: skip
        assert f[small] <= f[large] + slack, (small, large)
    assert abs(f["B_mean"]) <= f["B"] + slack


@settings(max_examples=40, deadline=None)
@given(READINGS, st.floats(-1000, 1000), st.floats(0.1, 10.0))
def test_shift_scale_and_swap(x: np.ndarray, shift: float, scale: float) -> None:
    base, moved = figures(x), figures(x * scale + shift)
    swapped = figures(x[:, :, ::-1])
    for name in SCALARS:
        assert moved[name] == pytest.approx(scale * base[name], abs=1e-7)
    for name in ("B", "M", "E", "R", "A"):
        assert swapped[name] == pytest.approx(base[name], abs=1e-9)
    assert swapped["B_mean"] == pytest.approx(-base["B_mean"], abs=1e-9)
    assert swapped["A_up"] == pytest.approx(base["A_down"], abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(READINGS)
def test_edition_1988_takes_three_sigma(x: np.ndarray) -> None:
    three, two = figures(x, edition="1988"), figures(x)
    assert three["R_up"] == pytest.approx(1.5 * two["R_up"])
    assert three["E"] == two["E"]
    assert three["A"] >= two["A"] - 1e-9


def test_repeatability_decided_by_one_direction() -> None:
    s = np.array([-1, -1, 0, 1, 1.0])
    x = np.stack([s + 0.5, 3 * s], axis=1)[None]
    result = evaluate_iso230_2([0.0], x, "um")
    repeatability = result.R
    assert repeatability == pytest.approx(12.0)
    assert "one target" in said(result)


def complete() -> np.ndarray:
    return np.random.default_rng(4).normal(size=(6, 5, 2)) + np.arange(6.0)[:, None, None]


def test_missing_reading_uses_its_own_n_and_is_flagged() -> None:
    x = complete()
    x[2, 1, 0] = np.nan
    result = evaluate_iso230_2(np.arange(6.0), x, "um")
    row = np.delete(x[2, :, 0], 1)
    assert result.mean_up[2] == pytest.approx(row.mean())
    assert result.s_up[2] == pytest.approx(row.std(ddof=1))
    assert said(result) == ("n = 4 of 5 at i = 3",)
    assert result.A is not None


def test_target_without_one_approach_stays_out_of_B_M_R() -> None:
    x = complete()
    x[5, :, 1] = np.nan
    x[5, :, 0] += 100.0
    result, rest = evaluate_iso230_2(np.arange(6.0), x, "um"), evaluate_iso230_2(np.arange(5.0), x[:5], "um")
    assert (result.B, result.M, result.R) == (rest.B, rest.M, rest.R)
    assert np.isnan(result.B_i[5])
    assert result.E is not None
    assert result.E > 100.0
    assert result.A_up is not None
    assert result.A_up > 100.0
    assert result.A_down == rest.A_down
    assert "no approach - at i = 6" in said(result)


def test_unidirectional_has_no_bidirectional_results() -> None:
    x = complete()
    x[:, :, 1] = np.nan
    result = evaluate_iso230_2(np.arange(6.0), x, "arcsec")
    assert [result.B, result.M, result.E, result.R, result.A, result.E_down] == [None] * 6
    assert result.A_up is not None
    assert said(result) == ("unidirectional",)
    assert set(result.U) == {"E_up", "R_up", "A_up"}


def test_one_run_has_no_spread() -> None:
    result = evaluate_iso230_2(np.arange(6.0), complete()[:, :1], "um")
    assert result.R is None
    assert result.A is None
    assert result.E is not None
    assert said(result) == ("n = 1: no s, R, A",)


def test_one_lone_reading_is_left_out_of_R_and_A() -> None:
    x = complete()
    x[0, 1:, 0] = np.nan
    result = evaluate_iso230_2(np.arange(6.0), x, "um")
    assert result.A is not None
    assert np.isnan(result.R_i[0])
    assert "a target has one reading: left out of R, A" in said(result)


def test_uncertainty_coefficients_and_systematic_terms() -> None:
    u = evaluate_iso230_2(np.arange(6.0), complete(), "um", budget=Budget(device=3.0, temperature=4.0, eve=1.0)).U
    assert u["B"] == pytest.approx(0.632, abs=1e-3)
    assert u["M"] == pytest.approx(np.hypot(0.447, 5.0), abs=1e-3)
    assert u["R_up"] == pytest.approx(1.414, abs=1e-3)
    assert u["R"] == pytest.approx(1.183, abs=1e-3)
    assert u["A"] == pytest.approx(np.hypot(1.183, 5.0), abs=1e-3)


def test_uncertainty_of_B_covers_by_simulation() -> None:
    rng = np.random.default_rng(1)
    spread = [np.diff(rng.normal(size=(5, 2)).mean(axis=0))[0] for _ in range(4000)]
    assert 2.0 * np.std(spread) == pytest.approx(2.0 * 0.632, rel=0.05)


def test_temperature_dominates_the_usual_budget() -> None:
    budget = linear_budget(
        1750.0, expansion_ppm_per_k=12.0, off_20_k=5.0, temperature_range_k=1.0, expansion_range_ppm_per_k=2.0
    )
    assert budget.temperature == pytest.approx(12.6)
    assert budget.expansion == pytest.approx(10.5)


@pytest.mark.parametrize(
    ("targets", "x", "code"),
    [
        ([0.0, 1.0], np.zeros((3, 5, 2)), "E-EVAL-SHAPE"),
        ([0.0], np.full((1, 2, 2), np.inf), "E-EVAL-INFINITE"),
        ([0.0, 1.0], np.stack([np.zeros((2, 2)), np.full((2, 2), np.nan)]), "E-EVAL-EMPTY"),
    ],
)
def test_bad_input_is_refused(targets: list[float], x: np.ndarray, code: str) -> None:
    with pytest.raises(ModelError) as caught:
        evaluate_iso230_2(targets, x, "um")
    assert caught.value.code == code
    assert caught.value.hint


def test_unknown_edition_and_shapeless_rows() -> None:
    with pytest.raises(ModelError, match="E-EVAL-EDITION"):
        evaluate_iso230_2([0.0], np.zeros((1, 5, 2)), "um", edition="2030")
    with pytest.raises(ModelError, match="E-EVAL-SHAPE"):
        statistics.from_rows([[0, 1]], [[0, 1], [2, 3]])


def test_numacc4_by_two_passes() -> None:
    row = [10000000.2] + [10000000.1, 10000000.3] * 500
    result = iso230_2.evaluate_iso230_2([10000000.0], statistics.from_rows([row]), "um")
    assert result.s_up[0] == pytest.approx(0.1, rel=1e-7)


def test_long_axes_need_one_run_at_intervals_of_250_mm_at_most_on_average() -> None:
    assert iso230_2.minimum_targets("linear", 2000.0) == (10, 5)
    assert iso230_2.minimum_targets("linear", 2100.0) == (10, 1)
    assert iso230_2.minimum_targets("linear", 4000.0) == (17, 1)
    assert iso230_2.minimum_targets("rotary", 360.0) == (8, 5)
    assert iso230_2.minimum_targets("rotary", 720.0) == (16, 1)
    assert iso230_2.minimum_targets("rotary", 400.0) == (9, 1)
