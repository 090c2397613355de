"""Judged by the truth over many seeds: better where there is an error, no table where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.domain.proposals import TableChange
from gateway.evaluate.behaviour.repetitions import robust_means
from tests.unit.table import truth as little
from tests.unit.table.world import live, turn

SEEDS = range(36)


@pytest.mark.parametrize("sign", [1, -1])
def test_rotary_axis_of_the_demo(sign: int) -> None:
    rounds = [turn(little.rotary(seed, sign=sign), seed, rotary=True) for seed in SEEDS]
    assert all(r.change.skipped is None for r in rounds)
    assert max(r.after / r.before for r in rounds) <= 0.1
    assert max(r.after for r in rounds) <= 1.5
    assert all(r.change.new.deviations[0] == r.change.new.deviations[-1] == 0.0 for r in rounds)


@pytest.mark.parametrize("sign", [1, -1])
def test_linear_axes(sign: int) -> None:
    rounds = [turn(little.linear(seed, sign=sign), seed, rotary=False) for seed in SEEDS]
    assert all(r.after <= max(2.0, 0.15 * r.before) for r in rounds)
    assert all(r.change.new.deviations[0] == 0.0 for r in rounds)


@pytest.mark.parametrize("rotary", [True, False])
def test_no_error_no_table(rotary: bool) -> None:
    make = little.rotary if rotary else little.linear
    rounds = [turn(make(seed, scale=0.0), seed, rotary=rotary) for seed in SEEDS]
    assert all(str(r.change.skipped).startswith("S-COMP-WITHIN-U") for r in rounds)
    assert all(r.after <= r.before for r in rounds)


@pytest.mark.parametrize("rotary", [True, False])
@pytest.mark.parametrize("scale", [0.02, 0.05, 0.1, 0.3, 1.5])
def test_never_worse_at_any_size(rotary: bool, scale: float) -> None:
    make = little.rotary if rotary else little.linear
    for seed in range(10):
        result = turn(make(seed, scale=scale), seed, rotary=rotary)
        assert result.after <= result.before + 0.1


@pytest.mark.parametrize("rotary", [True, False])
def test_second_round_meets_the_prediction_and_does_no_harm(rotary: bool) -> None:
    make = little.rotary if rotary else little.linear
    for seed in range(8):
        world = make(seed)
        first = turn(world, seed, rotary=rotary).change
        off = robust_means(first.targets, remeasured(world, first, seed + 77)).mean - first.predicted
        assert np.abs(off - off.mean()).max() <= first.predicted_U.min()
        second = turn(world, seed + 300, rotary=rotary, acts=live(first.new))
        assert second.after <= second.before + 0.05
        assert second.change.skipped or second.before > 1.5


def remeasured(world: little.Truth, change: TableChange, seed: int) -> np.ndarray:
    return little.capture(world, change.targets, seed, residual=lambda at: world.error(at) - change.new.at(at))
