"""Live against approved and before: each kind, the first difference, and never "as approved" for anything else."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.types.tables import CompensationTable, LiveTable, reversal_of
from gateway.table.live_comparison import compare_three_tables

BEFORE = CompensationTable("axis", "C1", "C1", 0.0, 360.0, 90.0, (0.0, 1.0, 2.0, 1.0, 0.0), True, 0, "deg", "deg")
APPROVED = replace(BEFORE, deviations=(0.0, 4.0, 6.0, -2.0, 0.0))
NEVER = CompensationTable("axis", "C1", "C1", 0.0, 0.0, 0.0, (0.0,), True, 0, "deg", "deg")
ON = LiveTable(APPROVED, enabled=True)
ALLOWED = 0.001


@pytest.mark.parametrize(
    ("live", "kind", "said"),
    [
        (ON, "as-approved", "the approved one, switched on"),
        (LiveTable(APPROVED, enabled=False), "switched-off", "switched off"),
        (LiveTable(BEFORE, enabled=True), "before", "the previous one, switched on"),
        (LiveTable(BEFORE, enabled=False), "before", "the previous one, switched off"),
        (LiveTable(NEVER, enabled=False), "differs", "neither"),
        (LiveTable(replace(APPROVED, step=45.0), enabled=True), "differs", "step: 90.0, live 45.0"),
        (LiveTable(replace(APPROVED, modulo=False), enabled=True), "differs", "modulo: True, live False"),
        (
            LiveTable(replace(APPROVED, reverse=BEFORE.deviations), enabled=True),
            "differs",
            "0 reverse points where 5",
        ),
    ],
)
def test_each_kind(live: LiveTable, kind: str, said: str) -> None:
    found = compare_three_tables(live, ON, LiveTable(BEFORE, enabled=True), ALLOWED)
    assert found.kind == kind
    assert said in found.words
    assert found.as_data()["kind"] == kind


def test_a_table_with_a_curve_for_each_direction_is_itself() -> None:
    both = LiveTable(replace(APPROVED, reverse=(5.0, 9.0, 11.0, 3.0, 5.0)), enabled=True)
    before = LiveTable(replace(BEFORE, reverse=(5.0, 6.0, 7.0, 6.0, 5.0)), enabled=True)
    assert compare_three_tables(both, both, before, ALLOWED).kind == "as-approved"
    assert compare_three_tables(before, both, before, ALLOWED).kind == "before"
    swapped = replace(both.table, deviations=both.table.reverse, reverse=APPROVED.deviations)
    assert compare_three_tables(LiveTable(swapped, enabled=True), both, before, ALLOWED).kind == "differs"


def test_the_first_difference_is_told_with_all_three_values() -> None:
    live = LiveTable(replace(APPROVED, deviations=(0.0, 4.0, 2.0, -3.5, 0.0)), enabled=True)
    found = compare_three_tables(live, ON, LiveTable(BEFORE, enabled=True), ALLOWED)
    assert found.kind == "differs"
    assert (len(found.places), found.as_before) == (2, 1)
    assert "at 2 of 5 points; at 1 of them it has the previous value. First at 180" in found.words
    assert "before +2.000, approved +6.000, live +2.000 arcsec" in found.words
    unknown = compare_three_tables(live, ON, None, ALLOWED)
    assert "before ?" in unknown.words
    assert unknown.as_data()["differences"][0][1] is None


def test_what_was_to_be_off_and_a_first_table_taken_back() -> None:
    off = LiveTable(NEVER, enabled=False)
    assert compare_three_tables(off, off, ON, ALLOWED).kind == "as-approved"
    assert compare_three_tables(LiveTable(NEVER, enabled=True), off, ON, ALLOWED).kind == "switched-on"
    assert compare_three_tables(ON, off, ON, ALLOWED).kind == "before"
    never = compare_three_tables(off, ON, off, ALLOWED)
    assert never.kind == "before"


@pytest.mark.parametrize(("value", "kind"), [(-1.4, "as-approved"), (0.0, "before"), (-0.7, "differs")])
def test_a_reversal_is_compared_by_its_one_value(value: float, kind: str) -> None:
    pushed, before = (LiveTable(reversal_of("X1", "mm", one), enabled=one != 0.0) for one in (-1.4, 0.0))
    live = LiveTable(reversal_of("X1", "mm", value), enabled=value != 0.0)
    found = compare_three_tables(live, pushed, before, ALLOWED)
    assert found.kind == kind
    assert [place.live for place in found.places] == ([] if kind == "as-approved" else [value])


@given(
    st.lists(st.floats(-20.0, 20.0), min_size=5, max_size=5),
    st.booleans(),
)
def test_as_approved_is_said_of_nothing_else(values: list[float], enabled: bool) -> None:
    live = LiveTable(replace(APPROVED, deviations=tuple(values)), enabled)
    same = enabled and all(abs(one - two) <= ALLOWED for one, two in zip(values, APPROVED.deviations, strict=True))
    found = compare_three_tables(live, ON, LiveTable(BEFORE, enabled=True), ALLOWED)
    assert (found.kind == "as-approved") == same
    assert found.words
