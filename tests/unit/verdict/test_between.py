"""Check stops after a push: they confirm a table, find one that only the targets agreed with, and name the way back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drivers.message import prose
from drivers.types.sensing import Ambient
from gateway.domain.captures import Between, Capture
from gateway.domain.outcomes import AxisVerdict, PushRecord
from gateway.evaluate.optics.corrections import begin
from gateway.evaluate.standards.iso230_2 import evaluate_iso230_2
from gateway.workflow.axes.verdict import check_between, judge_axis, judge_run
from tests.unit.verdict.test_explaining import CHANGE, OLD

TARGETS = CHANGE.targets
STOPS = np.array([20.3, 81.1, 139.0, 203.7, 261.9, 322.2])
Truth = Callable[[np.ndarray], np.ndarray]
PUSH = PushRecord(1, "C1", "committed", (), "")


def measured(truth: Truth, seed: int) -> Capture:
    rng = np.random.default_rng(seed)

    def read(places: np.ndarray) -> np.ndarray:
        return truth(places)[:, None, None] + rng.normal(scale=0.1, size=(len(places), 3, 2)) + np.array([0.3, -0.3])

    between = Between(STOPS, read(STOPS)[:, :2])
    rest = (0.0, Ambient(), Ambient(), begin("air+material"), None, None)
    return Capture("C1", "ECC", "deg", TARGETS, read(TARGETS), *rest, between=between)


def verdict(machine: Truth) -> AxisVerdict:
    """The machine measured before, with the old table live, and after the push of the new one."""
    new = replace(OLD, deviations=CHANGE.new.deviations)
    before = measured(machine, 1)
    after = measured(lambda q: machine(q) - new.at(q) + OLD.at(q), 2)
    known = [evaluate_iso230_2(one.targets, one.deviations, "arcsec") for one in (before, after)]
    left = machine(TARGETS) - new.at(TARGETS) + OLD.at(TARGETS)
    change = replace(CHANGE, predicted=left, predicted_U=np.full(24, 1.0))
    return judge_axis("C1", known[0], known[1], change=change, checked=check_between(change, after))


def as_the_table(q: np.ndarray) -> np.ndarray:
    return np.asarray(CHANGE.new.at(q) - OLD.at(q))


def comb(size: float) -> Truth:
    """Zero at every target (multiples of 15 deg) and up to ``size`` between them."""
    return lambda q: as_the_table(q) + size * np.sin(np.pi * q / 15.0) ** 2


def test_a_good_table_is_confirmed_between_the_targets() -> None:
    good = verdict(as_the_table)
    assert (good.improved, good.worse, good.within_prediction) == (True, False, True)
    assert "Positions between the targets, not measured before, confirm it (6)" in prose(good.words)
    assert judge_run((good,), (PUSH,), ()).outcome == "better"


def test_a_little_more_than_stated_between_them_is_said() -> None:
    little = verdict(comb(3.0))
    assert (little.improved, little.worse, little.within_prediction) == (True, False, False)
    assert "The prediction did not hold between the targets" in prose(little.words)


@pytest.mark.parametrize("machine", [comb(14.0), lambda q: as_the_table(q) * np.cos(np.pi * q / 15.0) ** 2])
def test_a_table_that_only_the_targets_agree_with_makes_the_axis_worse(machine: Truth) -> None:
    bad = verdict(machine)
    assert (bad.improved, bad.worse) == (False, True)
    assert "The axis became worse" in prose(bad.words)
    assert "trueflank rollback SITE --axis C1" in prose(bad.words)
    assert judge_run((bad,), (PUSH,), ()).outcome == "worse"


def test_without_stops_the_targets_decide() -> None:
    after = replace(measured(as_the_table, 2), between=None)
    assert check_between(CHANGE, after) is None
