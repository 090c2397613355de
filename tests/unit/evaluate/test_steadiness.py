"""Drift and jumps of seeded captures, and what no table cures."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.capture.targets import Cycle
from gateway.evaluate.behaviour.dynamics import steadiness
from gateway.evaluate.standards.iso230_2 import describe_incurable, evaluate_iso230_2, incurable_part
from tests.unit.evaluate.hostile import captured


def test_good_machines_are_steady() -> None:
    shapes = [{}, {"repetitions": 2}, {"repetitions": 3, "count": 9}, {"scatter": 1.0}]
    found = [captured(seed, **shapes[seed % 4]).steady() for seed in range(200)]
    assert sum(bool(one.said) for one in found) <= 4
    assert max(one.u for one in found) < 0.1


def test_a_jump_is_found_with_its_moment_and_size() -> None:
    moments = np.random.default_rng(2).uniform(0.15, 0.85, 40) * 700.0
    found = [captured(s, disturbed=lambda t, at=at: 3.0 * (t > at)).steady() for s, at in enumerate(moments)]
    hits = [
        abs(one.jump - 3.0) < 0.4 and abs(one.jump_at_s - at) < 20.0 for one, at in zip(found, moments, strict=True)
    ]
    assert sum(hits) >= 36
    assert "jump by +3" in str(found[hits.index(True)].said[0])


@pytest.mark.parametrize(("cycle", "harm"), [("standard", 0.02), ("pilgrim", 0.15), ("pendulum", 0.6)])
def test_drift_is_found_and_does_harm_where_places_are_not_revisited(cycle: Cycle, harm: float) -> None:
    """Linear drift drops out of the mean of up and down over all targets; target by target it looks like position."""
    found = captured(7, cycle=cycle, disturbed=lambda t: 20.0 * t / 3600.0).steady()
    assert found.drift == pytest.approx(4.0, abs=max(0.6, 3.0 * found.drift_u))
    assert any("drifted" in told for told in map(str, found.said))
    assert found.u < 0.02 if cycle == "standard" else found.u > harm


def test_single_visits_show_nothing() -> None:
    one = captured(8, repetitions=2)
    once = one.deviations.copy()
    once[:, 1:] = np.nan
    assert np.isnan(steadiness(one.times, once, "um").drift_u)


def test_reversal_and_scatter_are_named_as_what_no_table_cures() -> None:
    targets = np.linspace(0.0, 400.0, 11)
    rng = np.random.default_rng(3)
    x = 2.0 * np.sin(targets / 80.0)[:, None, None] + 7.5 * np.array([1.0, -1.0]) + rng.normal(size=(11, 5, 2)) * 0.2
    loose = evaluate_iso230_2(targets, x, "um")
    left, share = incurable_part(loose)
    assert left == pytest.approx(15.0 + 4.0 * 0.2 + 0.3, abs=0.5)
    assert share > 0.75
    assert "scatter alone would leave 1.7" in str(describe_incurable(loose)[0])
    assert describe_incurable(evaluate_iso230_2(targets, x - 7.5 * np.array([1.0, -1.0]), "um")) == ()
    assert incurable_part(evaluate_iso230_2(targets, x[:, :1], "um")) is None
