"""Tables side by side: what counts as the same, where they agree, and where the effect is plain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.types.abilities import TableLimits
from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.interlocks.facts import MAX_JUMP, value_at
from gateway.push.compare import agreeing_position, effect_positions, same_set, table_facts, table_from_facts, tolerance
from gateway.table.comparison import differences
from tests.unit.push.double import NEVER, NEW, OLD, table

OFF = LiveTable(OLD, enabled=False)
ON = LiveTable(OLD, enabled=True)
ROTARY = CompensationTable(
    "axis", "C1", "C1", 0.0, 360.0, 30.0,
    tuple(float(v) for v in 20.0 * np.sin(np.radians(np.arange(13) * 30.0))), True, input_unit="deg", output_unit="deg",
)  # fmt: skip


def test_tolerance_is_half_the_last_place() -> None:
    assert tolerance(TableLimits(10, 1e-6, 1.0), OLD) == pytest.approx(0.0005, abs=2e-6)
    assert tolerance(TableLimits(10, 1e-6, 1.0), ROTARY) == pytest.approx(0.0018, abs=2e-6)
    assert tolerance(TableLimits(10, 1.0, 1.0), OLD) == pytest.approx(0.05, abs=2e-6)


@pytest.mark.parametrize(
    "other",
    [
        replace(OLD, minimum=1.0),
        replace(OLD, maximum=401.0),
        replace(OLD, step=49.0),
        replace(OLD, modulo=True),
        replace(OLD, index=1),
        replace(OLD, output_axis="Z1"),
        replace(OLD, deviations=OLD.deviations[:-1]),
        replace(OLD, deviations=(*OLD.deviations[:-1], 0.002)),
        replace(OLD, deviations=(*OLD.deviations[:-1], float("nan"))),
        replace(OLD, step=float("nan")),
        replace(OLD, reverse=OLD.deviations),
        replace(OLD, places=tuple(map(float, OLD.positions))),
    ],
)
def test_any_part_that_differs_is_named(other: CompensationTable) -> None:
    assert len(differences(OLD, other, 0.001)) == 1
    assert differences(OLD, OLD, 0.001) == ()


def test_a_set_is_the_same_by_what_it_holds() -> None:
    one = LiveSet("X1", ON, (), 0.001, "a", "digest a")
    assert same_set(one, replace(one, native="b", digest="digest b"), 0.001)
    assert not same_set(one, replace(one, digest="", backlash=0.002), 0.001)
    assert not same_set(one, replace(one, digest="", cross=(ON,)), 0.001)
    assert not same_set(one, replace(one, digest="", own=OFF), 0.001)


def test_the_reference_is_taken_if_it_will_do() -> None:
    assert agreeing_position(ON, NEW, 0.0, (0.0, 400.0)) == 0.0
    assert agreeing_position(LiveTable(NEVER, enabled=False), NEW, 400.0, (0.0, 400.0)) == 400.0


def test_else_the_nearest_point_where_both_are_near_zero() -> None:
    old = LiveTable(table(5.0, 5.0, 0.5, 5.0, 5.0, 5.0, 0.9, 5.0, 5.0), enabled=True)
    new = table(0.0, 0.0, 3.0, 0.0, 0.0, 0.0, -0.8, 0.0, 0.0)
    assert agreeing_position(old, new, 0.0, (0.0, 400.0)) == 300.0
    assert agreeing_position(old, new, 0.0, (0.0, 250.0)) is None
    assert agreeing_position(replace(old, enabled=False), new, 0.0, (0.0, 250.0)) == 0.0


values = st.lists(st.floats(-150.0, 150.0), min_size=2, max_size=30)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(values, values, st.booleans(), st.floats(0.0, 1000.0))
def test_wherever_it_says_they_agree_no_switching_jumps(
    old: list[float], new: list[float], enabled: bool, reference: float
) -> None:
    before, after = LiveTable(table(*old), enabled=enabled), table(*new)
    place = agreeing_position(before, after, reference, (0.0, 1000.0))
    if place is not None:
        assert abs(value_at(after, place)) <= MAX_JUMP
        assert not enabled or abs(value_at(before.table, place)) <= MAX_JUMP


@settings(max_examples=150, deadline=None, derandomize=True)
@given(values, st.floats(1.0, 20.0))
def test_effect_positions_are_reachable_and_three(new: list[float], overrun: float) -> None:
    wanted = table(*new)
    travel = (0.0, max(wanted.maximum, 3 * overrun))
    places = effect_positions(wanted, ON, travel, overrun)
    assert len(places) == len(set(places))
    assert 1 <= len(places) <= 3
    assert all(travel[0] + overrun <= place <= travel[1] - overrun for place in places)


def test_effect_on_both_slopes_and_apart() -> None:
    places = effect_positions(ROTARY, LiveTable(ROTARY, enabled=False), (0.0, 360.0), 5.0)
    slopes = [value_at(ROTARY, place + 1.0) - value_at(ROTARY, place - 1.0) for place in places]
    assert len(places) == 3
    assert min(slopes) < 0 < max(slopes)
    assert min(np.diff(places)) > 36.0
    assert all(abs(value_at(ROTARY, place)) > 15.0 for place in places)
    assert all(0.0 <= place < 360.0 for place in places)


def test_where_old_and_new_differ_is_worth_more() -> None:
    new = replace(NEW, deviations=(0.0, 10.0, 10.0, 10.0, 10.0, 10.0, 4.0, 10.0, 0.0))
    old = LiveTable(replace(new, deviations=(0.0, 10.0, 10.0, 10.0, 10.0, 10.0, -9.0, 10.0, 0.0)), enabled=True)
    assert any(250.0 < place < 350.0 for place in effect_positions(new, old, (0.0, 400.0), 5.0))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=9))
def test_the_journal_keeps_every_digit(deviations: list[float]) -> None:
    noted = replace(OLD, deviations=tuple(deviations))
    assert table_from_facts(table_facts(noted)) == noted
