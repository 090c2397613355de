"""A pushed axis explained from its tables: the words of the verdict name what happened to the very table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.message import prose
from drivers.types.tables import CompensationTable
from gateway.domain.figures import Evaluation
from gateway.domain.proposals import TableChange
from gateway.domain.values import FloatArray
from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2
from gateway.evaluate.uncertainty.budget import Budget
from gateway.workflow.axes.verdict import explain_residual, judge_axis

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
    assert said in str(explain_residual(CHANGE, before, before + slope * SHAPE + 0.7).words[0])


def test_an_old_table_that_was_off_took_nothing_away() -> None:
    whole = NEW.at(TARGETS)
    change = replace(CHANGE, old_enabled=False)
    assert explain_residual(change, whole, 0.0 * whole).kind == "as-predicted"
    assert explain_residual(CHANGE, whole, 0.0 * whole).kind != "doubled"


def test_a_poor_prediction_does_not_hide_what_two_good_measurements_show() -> None:
    poor = replace(CHANGE, predicted_U=np.full(24, 6.0))
    assert explain_residual(poor, SHAPE, 0.0 * SHAPE).kind == "cannot-tell"
    assert explain_residual(poor, SHAPE, 0.0 * SHAPE, 1.2).kind == "as-predicted"
    assert explain_residual(CHANGE, SHAPE, 0.0 * SHAPE, 6.0).kind == "as-predicted"


def test_other_targets_decide_nothing() -> None:
    assert explain_residual(CHANGE, SHAPE[1:], SHAPE[1:]).kind == "cannot-tell"
    assert explain_residual(CHANGE, SHAPE, SHAPE[1:]).kind == "cannot-tell"


@pytest.mark.parametrize("U", [0.1, 1.0, 3.0, 6.0])
@pytest.mark.parametrize("slope", [-2.0, -1.0, -0.5, 0.0, 1.0])
def test_one_verdict_in_one_sentence_and_no_reason_against_it(slope: float, U: float) -> None:
    def figures(mean: FloatArray) -> Evaluation:
        x = np.repeat(mean[:, None, None], 2, axis=2) + np.array([[-0.05], [0.05]])
        return evaluate_iso230_2(TARGETS, x, "arcsec", budget=Budget(device=U))

    told = judge_axis("C1", figures(SHAPE), figures(SHAPE + slope * SHAPE), replace(CHANGE, predicted_U=np.full(24, U)))
    verdict, *reasons = prose(told.words).split(". ")
    improved, same = "improved by more than" in verdict, "did not change by more than" in verdict
    assert [improved, same, "became worse" in verdict].count(True) == 1
    assert improved == told.improved
    assert told.worse == ("became worse" in verdict)
    assert f"M {np.ptp(SHAPE):.2f} -> {np.ptp(SHAPE) * abs(1.0 + slope):.2f} arcsec" in prose(told.words)
    against = {
        True: ("cannot be determined", "is not active", "wrong sign"),
        False: ("cannot be determined",) if told.worse else (),
    }[improved]
    assert not [one for one in reasons for word in against if word in one]
