"""What of a measured reversal is taken, by which means, and what is left alone; judged by curves made here."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.errors import Gap
from gateway.correct.plan.reversal import reversal_advice, reversal_pair
from gateway.domain.figures import Component
from gateway.errors import ModelError
from gateway.model.waves import fit_means
from gateway.table import Grid

AT = np.linspace(0.0, 200.0, 21)
u = 0.05


def curve(B: NDArray[np.float64], doubt: float = u) -> Component:
    known = np.isfinite(B)
    return fit_means(
        AT[known], B[known], np.full(int(known.sum()), doubt), name="EXX", axis="X1", axis_unit="mm", kind="linear"
    )


def seen(B: NDArray[np.float64], seed: int = 1, doubt: float = u) -> NDArray[np.float64]:
    return B + np.random.default_rng(seed).normal(0.0, doubt, B.size)


def test_an_even_reversal_is_taken_by_a_constant_alone() -> None:
    B = seen(np.full(21, -3.0))
    found = reversal_advice(curve(B), B, u)
    assert found.constant == pytest.approx(-3.0, abs=0.05)
    assert found.left <= 0.15
    assert not found.depends
    assert not found.within


def test_what_lies_within_its_scatter_is_left_alone() -> None:
    B = seen(np.full(21, 0.3), doubt=0.4)
    found = reversal_advice(curve(B, 0.4), B, 0.4)
    assert found.within
    assert found.constant == 0.0
    assert found.left == found.largest


def test_a_common_doubt_counts_at_every_place_alike() -> None:
    B = seen(np.full(21, 0.3))
    assert reversal_advice(curve(B), B, u).constant != 0.0
    assert reversal_advice(curve(B), B, u, common_u=0.2).constant == 0.0


def test_a_reversal_of_both_signs_gets_no_constant_that_makes_it_larger() -> None:
    B = seen(np.where(AT > 180.0, 0.5, -0.5) * 3.0 * np.abs(np.sin(AT / 40.0)))
    found = reversal_advice(curve(B), B, u)
    assert found.left <= found.largest


def test_what_depends_on_position_is_said_to() -> None:
    B = seen(-3.0 + 2.0 * np.sin(AT / 30.0))
    found = reversal_advice(curve(B), B, u)
    assert found.depends
    assert 1.5 < found.left < found.largest


def test_a_reversal_without_its_uncertainty_is_refused() -> None:
    B = np.full(21, -3.0)
    with pytest.raises(ModelError, match="E-CORRECT-REVERSAL"):
        reversal_advice(curve(B), B, 0.0)
    with pytest.raises(ModelError, match="E-CORRECT-REVERSAL"):
        reversal_advice(curve(B), np.full(21, np.nan), u)


@pytest.mark.parametrize("seed", range(4))
def test_what_depends_on_the_position_goes_to_a_pair_and_the_rest_to_the_constant(seed: int) -> None:
    B = seen(-3.0 + 2.0 * np.sin(AT / 30.0), seed)
    B[4] = np.nan
    fitted = curve(B)
    assert reversal_advice(fitted, B, u).depends
    up, down = reversal_pair(fitted, "mm", Grid(0.0, 200.0, 10.0), reference=0.0, modulo=False)
    assert (up.direction, down.direction) == (1, -1)
    assert (up.input_axis, up.output_axis, up.kind) == ("X1", "X1", "cross")
    assert up.deviations[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(np.array(up.deviations), -np.array(down.deviations), atol=1e-9)
    # Coming from - the first acts, coming from + the second: their difference and the constant are all of B.
    taken = np.array(up.deviations) - np.array(down.deviations) - 3.0
    np.testing.assert_allclose(taken, -3.0 + 2.0 * np.sin(up.positions / 30.0), atol=0.3)
    with pytest.raises(Gap, match="E-COMP-REACH"):
        reversal_pair(fitted, "mm", Grid(-50.0, 200.0, 10.0), reference=0.0, modulo=False)
