"""A short capture with every table acting against what was predicted: held, missed, or nothing to be said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.tooth import AxisOutlook
from gateway.views import acting_rows
from gateway.workflow.axes.short_capture import judge_combined_effect

AT = np.arange(0.0, 360.0, 30.0)
CURVE = 5.0 * np.cos(np.radians(3.0 * AT)) + np.sin(np.radians(AT))
OUTLOOK = AxisOutlook(
    "C1", "arcsec", AT, CURVE, np.full(AT.size, 0.4), M=float(np.ptp(CURVE)), M_U=0.57, M_alone=0.9, moved_by={}
)
FEW = np.array([0, 1, 4, 7, 11])


def seen(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return AT[FEW], values[FEW] + 7.0, np.full(FEW.size, 0.3)


def test_a_curve_as_predicted_holds_whatever_its_zero() -> None:
    noise = 0.3 * np.random.default_rng(4).normal(size=AT.size)
    check = judge_combined_effect(OUTLOOK, seen(CURVE + noise))
    assert check.held is True
    assert np.allclose(check.predicted, CURVE[FEW])
    assert np.allclose(check.U, np.hypot(0.3, 0.4))
    assert abs(check.M - np.ptp((CURVE + noise)[FEW])) < 1e-12
    assert abs(check.M_predicted - np.ptp(CURVE[FEW])) < 1e-12
    assert f"{check.M:.2f}" in str(check.words)
    (row,) = acting_rows([OUTLOOK], {"C1": check})
    assert (row.alone, row.answer) == ("0.90", "as predicted")
    assert row.seen.startswith(f"{check.M:.2f}")


@pytest.mark.parametrize("wrong", [-CURVE, 0.0 * CURVE, 1.3 * CURVE])
def test_a_table_that_acts_the_wrong_way_or_not_at_all_is_missed_and_says_how_far(wrong: np.ndarray) -> None:
    check = judge_combined_effect(OUTLOOK, seen(wrong))
    assert check.held is False
    assert f"{np.max(np.abs(check.measured - check.predicted)):.2f}" in str(check.words)
    assert "tables verify" in str(check.words)


def test_with_other_tables_live_nothing_is_judged() -> None:
    check = judge_combined_effect(OUTLOOK, seen(CURVE), others="C1 (CEC 3)")
    assert check.held is None
    assert "C1 (CEC 3)" in str(check.words)
    rows = acting_rows([OUTLOOK, replace(OUTLOOK, axis="X1")], {"C1": check})
    assert [row.answer for row in rows] == ["cannot tell: a table is not as pushed", "not checked"]
