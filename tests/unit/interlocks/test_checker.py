"""The independent checker: right tables pass, and each way of being wrong is found by it alone, worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from drivers.types.tables import CompensationTable
from gateway.interlocks.checker import ApprovedCurve, faults_of, mean_readings

X = CompensationTable("axis", "X1", "X1", 0.0, 400.0, 50.0, (0.0, 5.0, 12.0, 15.5, 9.0, 4.0, -3.0, -6.0, 0.0))
WAVE = tuple(round(8.0 * math.sin(math.radians(30.0 * number)), 4) for number in range(13))
C = CompensationTable("axis", "C1", "C1", 0.0, 360.0, 30.0, WAVE, modulo=True, input_unit="deg", output_unit="deg")
FREE = replace(X, step=0.0, places=(0.0, 10.0, 60.0, 400.0), deviations=(0.0, 4.0, 6.0, -10.0))


def approved(table: CompensationTable, **more: Any) -> ApprovedCurve:
    return ApprovedCurve(table, **{"acted": None, "reference": 0.0, "allowed": 0.001, **more})


def codes(found: CompensationTable, by: ApprovedCurve) -> list[str]:
    return [one.code for one in faults_of(found, by)]


def changed(table: CompensationTable, *points: tuple[int, float]) -> CompensationTable:
    values = list(table.deviations)
    for number, value in points:
        values[number] = value
    return replace(table, deviations=tuple(values))


@pytest.mark.parametrize("table", [X, C, FREE, replace(X, reverse=tuple(one + 1e-4 for one in X.deviations))])
def test_a_right_table_passes(table: CompensationTable) -> None:
    assert codes(table, approved(table)) == []
    inexact = replace(table, deviations=tuple(one + 0.0009 for one in table.deviations))
    assert codes(inexact, approved(table)) == [], "within the control's last place"


# Half a table beyond a limit, found by hand: 200 um over 400 mm are 0.5 um/mm, 1.1 um/mm are 55 um in 50 mm.
HIGH = replace(X, deviations=(0.0, 50.0, 100.0, 150.0, 200.1, 150.0, 100.0, 50.0, 0.0))
STEEP = replace(X, deviations=(0.0, 50.2, 30.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
STEEP_C = replace(C, deviations=(0.0, 0.0, 0.0, 100.0, -201.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("table", "more", "code"),
    [
        (HIGH, {"acted": HIGH}, "W-CHECK-VALUE"),
        (replace(C, deviations=(0.0, 180.1, *([0.0] * 11))), {"acted": None}, "W-CHECK-VALUE"),
        (STEEP, {}, "W-CHECK-SLOPE"),
        (replace(X, reverse=STEEP.deviations), {}, "W-CHECK-SLOPE"),
        (STEEP_C, {"acted": STEEP_C}, "W-CHECK-SLOPE"),
        (replace(FREE, deviations=(0.0, 10.2, 6.0, -10.0)), {}, "W-CHECK-SLOPE"),
        (replace(X, deviations=(0.0, 45.0, 90.0, 120.2, 90.0, 45.0, 0.0, 0.0, 0.0)), {}, "W-CHECK-CHANGE"),
        (X, {"acted": replace(X, deviations=(-110.0,) * 9)}, "W-CHECK-CHANGE"),
        (X, {"reference": 75.0}, "W-CHECK-REFERENCE"),
        (X, {"reference": 1.1}, "W-CHECK-REFERENCE"),
    ],
)
def test_each_printed_limit_is_held_by_itself(table: CompensationTable, more: dict[str, Any], code: str) -> None:
    assert code in codes(table, approved(table, **more))


@pytest.mark.parametrize(
    ("table", "more"),
    [
        (replace(HIGH, deviations=tuple(min(one, 200.0) for one in HIGH.deviations)), {"acted": HIGH}),
        (replace(STEEP, deviations=(0.0, 50.0, 30.0, *([0.0] * 6))), {}),
        (X, {"reference": 1.0}),
    ],
)
def test_what_is_just_within_passes(table: CompensationTable, more: dict[str, Any]) -> None:
    assert codes(table, approved(table, **more)) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"step": 49.0},
        {"step": 0.0},
        {"step": math.nan},
        {"maximum": 0.0},
        {"deviations": X.deviations[:-1]},
        {"deviations": (math.nan, *X.deviations[1:])},
        {"deviations": (*X.deviations[:-1], math.inf)},
        {"reverse": X.deviations[:-1]},
        {"input_axis": "Z1"},
        {"output_unit": "deg"},
        {"input_unit": "deg"},
        {"modulo": True},
        {"places": (0.0, 50.0, 40.0, *range(100, 400, 50))},
        {"places": tuple(range(0, 400, 50))},
    ],
)
def test_a_form_that_is_not_the_approved_one_is_refused_before_anything_else(wrong: dict[str, Any]) -> None:
    assert codes(replace(X, **wrong), approved(X)) == ["W-CHECK-FORM"]


def test_a_turn_is_360_degrees_and_ends_where_it_begins() -> None:
    for wrong in (changed(C, (12, 0.2)), replace(C, maximum=359.0, step=359.0 / 12)):
        assert codes(wrong, approved(wrong)) == ["W-CHECK-FORM"]
    assert codes(changed(C, (12, 0.09)), approved(changed(C, (12, 0.09)))) == []


def times(factor: float) -> CompensationTable:
    return replace(X, deviations=tuple(factor * one for one in X.deviations))


def test_the_approved_curve_turned_round_of_another_size_or_elsewhere() -> None:
    small = replace(X, deviations=tuple(one / 100.0 for one in X.deviations))
    assert codes(times(-1.0), approved(X)) == ["W-CHECK-SIGN"]
    (size,) = faults_of(times(1 / 25.4), approved(X))
    assert (size.code, size.fields["factor"]) == ("W-CHECK-SIZE", pytest.approx(1 / 25.4, rel=1e-4))
    assert "W-CHECK-SIZE" in codes(replace(small, deviations=X.deviations), approved(small))
    (point,) = faults_of(changed(X, (3, 15.6)), approved(X))
    assert (point.code, point.fields["place"], point.fields["difference"]) == ("W-CHECK-POINT", 150.0, 0.1)
    shifted = replace(X, deviations=(0.0, *X.deviations[:-1]))
    assert codes(shifted, approved(X)) == ["W-CHECK-POINT"]
    two_ways = replace(X, reverse=X.deviations)
    assert codes(replace(two_ways, reverse=changed(X, (4, 8.0)).deviations), approved(two_ways)) == ["W-CHECK-POINT"]


READ = tuple((float(place), float(value)) for place, value in zip(range(0, 401, 50), X.deviations, strict=True))


def test_a_table_contains_the_deviation_that_was_read() -> None:
    assert codes(X, approved(X, measured=READ)) == []
    turned = times(-1.0)
    assert codes(turned, approved(turned, measured=READ)) == ["W-CHECK-MEASURED"]
    inches = tuple((place, value / 25.4) for place, value in READ)
    assert codes(X, approved(X, measured=inches)) == ["W-CHECK-MEASURED"]
    assert codes(X, approved(X, measured=READ[:4])) == [], "four targets say too little"


def test_what_acted_while_it_was_read_is_taken_off() -> None:
    half = times(0.5)
    rest = tuple((place, value / 2.0) for place, value in READ)
    assert codes(X, approved(X, acted=half, measured=rest, acting=half)) == []
    assert codes(half, approved(half, acted=X, measured=rest, acting=X)) == ["W-CHECK-MEASURED"]


def test_means_are_over_both_directions_and_leave_out_what_is_missing() -> None:
    none = math.nan
    readings = [[[1.0, 2.0], [3.0, none]], [[none, none], [none, none]], [[4.0, 6.0], [4.0, 6.0]]]
    assert mean_readings([0.0, 10.0, 20.0], readings) == ((0.0, 2.0), (20.0, 5.0))


def test_half_of_a_pair_and_a_constant_are_left_to_the_pair() -> None:
    half = replace(X, kind="cross", index=3, direction=1, deviations=tuple(one + 1.0 for one in X.deviations))
    assert codes(half, approved(half)) == []
    constant = replace(X, kind="reversal", step=0.0, maximum=0.0, deviations=(4.0,))
    assert codes(constant, approved(constant)) == []


def test_a_table_of_tenths_of_a_micrometre_is_judged_by_its_shape_too() -> None:
    """Its squares add up to 0.34 um2: less than one, and not nothing."""
    small = replace(X, deviations=(0.0, 0.2, 0.3, 0.2, 0.0, -0.2, -0.3, -0.2, 0.0))
    assert codes(changed(small, (2, 0.4)), approved(small)) == ["W-CHECK-POINT"]
    (doubled,) = faults_of(replace(small, deviations=tuple(2.0 * one for one in small.deviations)), approved(small))
    assert (doubled.code, doubled.fields["factor"]) == ("W-CHECK-SIZE", 2.0)
    turned = replace(small, deviations=tuple(-one for one in small.deviations))
    assert codes(turned, approved(small)) == ["W-CHECK-SIGN"]
