"""The verdict in words: right where the hypotheses are far enough apart, silent where they are not, never wrong."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.message import prose
from drivers.types.values import FloatArray
from gateway.evaluate.behaviour.table_effect import APART, TableEffect, why

TRUTHS = {"as-predicted": -1.0, "not-active": 0.0, "wrong-sign": 1.0, "doubled": -2.0}
TRIALS = 2000


def _shape(rng: np.random.Generator, count: int) -> FloatArray:
    """A table's effect at random targets: offset, slope, waves and roughness."""
    x = np.sort(rng.uniform(0.0, 1.0, count))
    waves = sum(rng.normal() * np.sin(2 * np.pi * k * x + rng.uniform(0, 6.3)) for k in (1, 2, 3))
    shape = rng.normal() * 3 + rng.normal() * x + waves + 0.2 * rng.normal(size=count)
    return np.asarray(shape - np.mean(shape)) + rng.normal()


def _trial(rng: np.random.Generator, apart: float, slope: float) -> TableEffect:
    """One measured push: ``apart`` is RMS(d) / U."""
    count = int(rng.integers(6, 60))
    d = _shape(rng, count)
    U = rng.uniform(0.5, 1.5, count)
    U *= float(np.std(d)) / apart / np.sqrt(np.mean(U**2))
    before = d + rng.normal() + rng.normal(size=count) * U / 2.0
    after = before + slope * d + rng.normal(scale=5.0) + rng.normal(size=count) * U / 2.0
    return why(before, after, d, U, "um")


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_never_a_wrong_verdict_where_the_hypotheses_are_too_near(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(TRIALS):
        slope = float(rng.choice([*TRUTHS.values(), -0.5, 0.5, 3.0]))
        found = _trial(rng, rng.uniform(0.05, 0.999) * APART, slope)
        assert found.kind == "cannot-tell"
        assert "cannot be determined" in prose(found.words)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_the_right_verdict_where_they_are_apart(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for number in range(TRIALS):
        kind = list(TRUTHS)[number % len(TRUTHS)]
        found = _trial(rng, APART * rng.uniform(1.001, 20.0), TRUTHS[kind])
        assert found.kind == kind, number
        assert abs(found.slope - TRUTHS[kind]) <= 2.0 * found.slope_u


@pytest.mark.parametrize("slope", TRUTHS.values())
def test_never_another_hypothesis_even_when_the_error_looks_like_the_table(slope: float) -> None:
    """The worst pattern an error of RMS U can have, at the nearest distance at which anything is decided."""
    rng = np.random.default_rng(3)
    for _ in range(500):
        d = _shape(rng, 12)
        centred = d - np.mean(d)
        U = np.full(12, float(np.std(d)) / (APART * 1.0001))
        worst = rng.uniform(-1.0, 1.0) * U * centred / np.std(d)
        found = why(d, d + slope * d + worst, d, U)
        assert TRUTHS.get(found.kind, slope) == slope


def test_the_words_say_what_to_do() -> None:
    d = np.array([0.0, 8.0, -3.0, 5.0, 12.0, -6.0])
    U = np.full(6, 0.8)
    said = {kind: prose(why(d, d + slope * d, d, U, "arcsec").words) for kind, slope in TRUTHS.items()}
    assert "acts as predicted" in said["as-predicted"]
    assert "not active" in said["not-active"]
    assert "wrong sign" in said["wrong-sign"]
    assert "acts twice" in said["doubled"]
    half = why(d, d - 0.5 * d, d, U, "arcsec")
    assert half.kind == "partly"
    assert "50 %" in prose(half.words)
    for slope in (0.5, -3.0, 2.0):
        assert why(d, d + slope * d, d, U).kind == "something-else"


def test_what_the_table_does_not_explain_is_said() -> None:
    rng = np.random.default_rng(4)
    d = _shape(rng, 40) * 10.0
    U = np.full(40, float(np.std(d)) / 20.0)
    other = np.linspace(-1.0, 1.0, 40) ** 2
    other = (other - other.mean()) / other.std() * np.std(d)
    little = why(d, d - d + 0.2 * other, d, U, "um")
    assert little.kind == "as-predicted"
    assert "not explained" in prose(little.words)
    much = why(d, d - d + 1.5 * other, d, U, "um")
    assert much.kind == "something-else"
    assert "not explained" in prose(much.words)
    assert not why(d, d - d, d, U, "um").unexplained


def test_missing_targets_are_left_out_and_too_few_decide_nothing() -> None:
    d = np.array([0.0, 8.0, -3.0, 5.0, 12.0, -6.0])
    U = np.full(6, 0.5)
    after = np.zeros(6)
    after[2] = np.nan
    assert why(d, after, d, U).kind == "as-predicted"
    after[[0, 1, 3]] = np.inf
    for few in (why(d, after, d, U), why(d, d, np.zeros(6), U), why(d[:0], d[:0], d[:0], U[:0])):
        assert few.kind == "cannot-tell"
        assert few.words
