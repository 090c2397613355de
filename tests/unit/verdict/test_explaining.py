"""A pushed axis explained from its tables: the words of the verdict name what happened to the very table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.types.tables import CompensationTable
from gateway.domain.proposals import TableChange
from gateway.workflow.axes.explaining import explain

OLD = CompensationTable("axis", "C1", "C1", 0.0, 360.0, 60.0, (0.0, 2.0, 4.0, 2.0, -1.0, -3.0, 0.0), True)
NEW = replace(OLD, deviations=(0.0, 9.0, 15.0, 4.0, -12.0, -9.0, 0.0))
TARGETS = np.arange(0.0, 360.0, 15.0)
SHAPE = NEW.at(TARGETS) - OLD.at(TARGETS)
CHANGE = TableChange("C1", OLD, NEW, True, "base", TARGETS, np.zeros(24), np.full(24, 0.8))


@pytest.mark.parametrize(
    ("slope", "said"),
    [(-1.0, "as predicted"), (0.0, "not active"), (1.0, "wrong sign"), (-2.0, "acts twice"), (-0.5, "Only 50 %")],
)
def test_what_the_new_table_did_over_the_old(slope: float, said: str) -> None:
    before = SHAPE + np.random.default_rng(5).normal(scale=0.2, size=24)
    assert said in explain(CHANGE, before, before + slope * SHAPE + 0.7).words


def test_an_old_table_that_was_off_took_nothing_away() -> None:
    whole = NEW.at(TARGETS)
    change = replace(CHANGE, old_enabled=False)
    assert explain(change, whole, 0.0 * whole).kind == "as-predicted"
    assert explain(CHANGE, whole, 0.0 * whole).kind != "doubled"


def test_a_poor_prediction_does_not_hide_what_two_good_measurements_show() -> None:
    poor = replace(CHANGE, predicted_U=np.full(24, 6.0))
    assert explain(poor, SHAPE, 0.0 * SHAPE).kind == "cannot-tell"
    assert explain(poor, SHAPE, 0.0 * SHAPE, 1.2).kind == "as-predicted"
    assert explain(CHANGE, SHAPE, 0.0 * SHAPE, 6.0).kind == "as-predicted"


def test_other_targets_decide_nothing() -> None:
    assert explain(CHANGE, SHAPE[1:], SHAPE[1:]).kind == "cannot-tell"
    assert explain(CHANGE, SHAPE, SHAPE[1:]).kind == "cannot-tell"
