"""Edges of the rules and figures in refusals that seeded mutants showed to be untested; each worked out by hand."""

from __future__ import annotations

from dataclasses import replace as frozen
from datetime import timedelta
from typing import Any

import numpy as np
import pytest

from drivers.types.abilities import TableLimits
from drivers.types.tables import TemperatureShift, reversal_of
from gateway.interlocks import MarkerCheck, PushFacts, largest_change, refusals, warnings
from gateway.interlocks.facts import ROUNDING
from gateway.interlocks.measurement import _both_ways, _pooled_deviation, allowed_drift_k, unmeasured_range
from gateway.interlocks.table import _is_same_deviation
from tests.unit.interlocks.asked import replace
from tests.unit.interlocks.test_every_code import CROSS, LIVE, TWO
from tests.unit.interlocks.test_interlocks import CAPTURE, CHANGE, GOOD, NOW, STATE


def refusal(facts: PushFacts, code: str) -> dict[str, Any]:
    """The fields of the one refusal of this code."""
    (found,) = (one for one in refusals(facts) if one.code == code)
    return dict(found.fields)


def warmed(now: TemperatureShift, capture: Any) -> set[str]:
    base = frozen(LIVE, temperature=TemperatureShift())
    change = frozen(GOOD.change, base=base)
    facts = replace(GOOD, live=frozen(LIVE, temperature=now), change=change, capture=capture)
    return {one.code for one in refusals(facts)}


def test_temperature_is_compared_at_the_outermost_targets_and_without_any_a_metre_around_zero() -> None:
    # The limit is 0.1 um. The shift is 0.11 um at the last target (400 mm) and 0.096 um at the one before (350 mm).
    assert "E-INT-TEMPERATURE-MOVED" in warmed(TemperatureShift(0.0, 0.00011 / 400.0), CAPTURE)
    assert "E-INT-TEMPERATURE-MOVED" not in warmed(TemperatureShift(0.0, 0.00009 / 400.0), CAPTURE)
    assert "E-INT-TEMPERATURE-MOVED" in warmed(TemperatureShift(0.0, 0.00011 / 1000.0), None)
    assert "E-INT-TEMPERATURE-MOVED" not in warmed(TemperatureShift(0.0, 0.00009 / 1000.0), None)


def test_the_change_of_a_constant_is_against_the_one_that_acts() -> None:
    new, old = reversal_of("X1", "mm", -2.4), reversal_of("X1", "mm", -0.4)
    change = frozen(CHANGE, new=new, old=old, old_enabled=True)
    assert largest_change(change) == 2.0
    assert largest_change(frozen(change, old_enabled=False)) == 2.4


def test_a_turn_that_was_measured_whole_leaves_nothing_unmeasured() -> None:
    targets = np.arange(0.0, 360.5, 0.5)
    table = frozen(GOOD.change.new, minimum=0.0, maximum=360.0, step=0.5, modulo=True, input_unit="deg")
    facts = replace(GOOD, change=frozen(GOOD.change, new=table), capture=frozen(CAPTURE, targets=targets))
    assert unmeasured_range(facts) == (-0.5, 0.5)


def test_figures_of_refusals_are_those_of_the_limit() -> None:
    old = frozen(CAPTURE, ended_utc=(NOW - timedelta(hours=2000)).isoformat())
    assert refusal(replace(GOOD, capture=old), "E-INT-AGE")["hours"] == 2000.0
    told = refusal(replace(CROSS, limits=TableLimits(50, 1e-6, 0.2, 0.0123456)), "E-INT-SUM")
    assert told["limit"] == 12.346
    values = tuple(value + 0.00046 if value == 15.5 else value for value in CROSS.change.new.deviations)
    table = frozen(CROSS.change.new, deviations=values)
    more = replace(CROSS, change=frozen(CROSS.change, new=table), limits=TableLimits(50, 1e-6, 0.2, 0.012))
    assert refusal(more, "E-INT-SUM")["total"] == 15.5


def test_where_nothing_is_switched_at_once_nothing_jumps() -> None:
    there = frozen(STATE, axes={"X1": frozen(STATE.axes["X1"], position=100.0)})  # the table is 12 um there
    now = replace(GOOD, moment="release", state=there)
    assert "E-INT-JUMP" in {one.code for one in refusals(now)}
    later = replace(now, can=frozen(now.can, switched="by-restart"))
    assert "E-INT-JUMP" not in {one.code for one in refusals(later)}
    off = replace(now, purpose="restore", change=frozen(CHANGE, old_enabled=False))
    assert "E-INT-JUMP" not in {one.code for one in refusals(off)}


def test_a_single_table_that_is_too_large_is_no_sum() -> None:
    values = (0.0, 50.0, 100.0, 150.0, 200.5, 150.0, 100.0, 50.0, 0.0)
    table = frozen(CROSS.change.new, deviations=values)
    alone = replace(CROSS, change=frozen(CROSS.change, new=table), limits=frozen(CROSS.limits, max_sum=None))
    found = {one.code for one in refusals(alone)}
    assert "E-INT-VALUE" in found
    assert "E-INT-SUM" not in found


def test_what_a_pair_of_curves_takes_counts_from_the_pair_that_acts() -> None:
    """Measured 2 um between the directions, 1 um of it taken already and 3 um then: nothing of it is left."""
    new = frozen(CHANGE.new, reverse=tuple(one - 3.0 for one in CHANGE.new.deviations))
    old = frozen(CHANGE.old, reverse=tuple(one - 1.0 for one in CHANGE.old.deviations))
    change = frozen(CHANGE, new=new, old=old, old_enabled=True, predicted=np.zeros(9))
    both = np.zeros((9, 5, 2))
    both[:, :, 0] = 2.0
    before, after = _both_ways(frozen(CAPTURE, deviations=both), change)
    assert before > 0.9
    assert after == 0.0


def test_how_many_have_agreed_is_told_with_the_person_who_pushes() -> None:
    told = refusal(replace(TWO, approvals=()), "E-INT-APPROVAL-MISSING")
    assert (told["needed"], told["have"]) == (2, 1)


def test_two_targets_are_one_interval() -> None:
    capture = frozen(CAPTURE, targets=np.array([100.0, 300.0]))
    assert unmeasured_range(replace(GOOD, capture=capture)) == (-100.0, 200.0)


def test_a_far_change_is_told_with_three_decimals() -> None:
    values = (0.0, 10.0, 20.0, 66.00046, 20.0, 10.0, 0.0, 0.0, 0.0)
    far = frozen(CHANGE, new=frozen(CHANGE.new, step=500.0, maximum=4000.0, deviations=values))
    (told,) = (one for one in warnings(replace(GOOD, change=far)) if one.code == "W-INT-CHANGE")
    assert told.fields["change"] == 66.0


def test_one_deviation_is_known_by_shape_and_size() -> None:
    one = CHANGE.new
    sizes = {
        factor: frozen(one, deviations=tuple(factor * each for each in one.deviations)) for factor in (0.4, 1.0, 3.0)
    }
    assert [_is_same_deviation(table, one) for table in sizes.values()] == [False, True, False]


def test_scatter_is_pooled_by_squares() -> None:
    """Two readings 1 and 3 of one approach and two equal ones of the other: squares 1 + 1 over two degrees."""
    assert _pooled_deviation(np.array([[[1.0, 5.0], [3.0, 5.0]]])) == 1.0


def test_a_marker_of_which_nothing_is_known_names_no_transaction() -> None:
    assert MarkerCheck() == MarkerCheck(ours=True, behind="", lost=0, stranger=0)


def test_warmth_of_a_short_table_is_held_against_what_it_corrects() -> None:
    """200 mm grow by 3.5 um/m/K times 0.2 m = 0.7 um a K; a quarter of 20 um is 5 um: 7.14 K."""
    new = frozen(GOOD.change.new, minimum=0.0, maximum=200.0, step=25.0, deviations=(0.0, 20.0, *([0.0] * 7)))
    change = frozen(GOOD.change, new=new, old_enabled=False)
    assert allowed_drift_k(change) == pytest.approx(5.0 / 0.7)


def test_the_value_at_the_reference_may_be_its_very_limit() -> None:
    limit = GOOD.bounds.reference + ROUNDING
    for value, wanted in ((limit, False), (float(np.nextafter(limit, np.inf)), True)):
        flat = frozen(GOOD.change.new, deviations=(value,) * 9)
        found = {one.code for one in refusals(replace(GOOD, change=frozen(GOOD.change, new=flat)))}
        assert ("E-INT-REF-VALUE" in found) is wanted
