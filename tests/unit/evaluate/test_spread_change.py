"""A larger R after a push: chance is called chance, and what is more is named by what made it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gateway.evaluate.behaviour.repeatability import SpreadChange, compare_spread
from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2

AT = np.linspace(0.0, 400.0, 11)


def read(seed: int, scatter: float = 0.1, n: int = 5) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.sin(AT / 90.0)[:, None, None] + rng.normal(0.0, scatter, (AT.size, n, 2)) + np.array([0.2, -0.2])


def judged(before: np.ndarray, after: np.ndarray) -> SpreadChange:
    R = tuple(evaluate_iso230_2(AT, x, "um").R for x in (before, after))
    captures: list[Any] = [SimpleNamespace(targets=AT, deviations=x, unit="um") for x in (before, after)]
    found = compare_spread(*captures, (R[0], R[1]))
    assert found is not None
    return found


def test_the_same_axis_measured_twice_is_hardly_ever_called_worse() -> None:
    found = [judged(read(seed), read(1000 + seed)) for seed in range(80)]
    assert sum(one.after > 1.05 * one.before for one in found) > 24  # R alone would have cried wolf
    assert sum(one.why != "chance" for one in found) <= 6


def test_an_axis_that_scatters_half_more_is_told_by_name_and_rule() -> None:
    found = [judged(read(seed), read(1000 + seed, 0.15)) for seed in range(20)]
    assert sum(one.why == "scatter" for one in found) >= 16
    assert "F test" in " ".join(str(word) for word in found[0].words)


@pytest.mark.parametrize("why", ["outliers", "drift", "reversal"])
def test_what_made_it_is_told_apart(why: str) -> None:
    after = read(7)
    if why == "outliers":
        after[3, 2, 0] += 3.0
    elif why == "drift":
        after += 0.4 * np.arange(5.0)[None, :, None]
    else:
        after += np.array([0.15, -0.15])
    assert judged(read(3), after).why == why


def test_a_smaller_r_needs_no_words() -> None:
    assert judged(read(1, 0.2), read(2, 0.1)).words == ()
