"""A live table whose step does not divide its range: the control must apply it as it was read."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.capture.checks import check_applied, is_uneven
from gateway.errors import CaptureError

TABLE = CompensationTable("axis", "X1", "X1", 0.0, 280.0, 100.0, (0.0, 2.0, 4.0))
READINGS = {
    "floor": [(100.0, 2.0), (240.0, 4.0)],
    "stretched": [(100.0, 2.0), (240.0, 3.556)],
    "ceil": [(100.0, 2.0), (240.0, 5.6)],
    "idle": [(0.0, 0.0), (100.0, 0.0)],
}


def live(table: CompensationTable = TABLE, *, enabled: bool = True) -> LiveSet:
    return LiveSet("X1", LiveTable(table, enabled), (), 0.0, "", "d")


def test_as_assumed_is_fine_and_an_even_or_idle_table_is_not_asked_about() -> None:
    check_applied(live(), READINGS["floor"])
    check_applied(live(), [])
    for reading in READINGS.values():
        check_applied(live(enabled=False), reading)
        check_applied(live(replace(TABLE, maximum=200.0)), reading)


@pytest.mark.parametrize("reading", ["stretched", "ceil", "idle"])
def test_any_other_reading_is_refused_with_the_place(reading: str) -> None:
    with pytest.raises(CaptureError) as caught:
        check_applied(live(), READINGS[reading])
    assert caught.value.code == "E-CAP-APPLIED"
    assert caught.value.fields["position"] == (100.0 if reading == "idle" else 240.0)


def test_what_the_display_and_the_exact_stop_leave_open_is_no_difference() -> None:
    check_applied(live(), [(50.0, 1.0 + 0.02), (99.99, 2.0)])


@pytest.mark.parametrize(
    ("maximum", "step", "uneven"), [(280.0, 100.0, True), (300.0, 100.0, False), (0.3, 0.1, False), (0.0, 0.0, False)]
)
def test_uneven(maximum: float, step: float, uneven: bool) -> None:
    assert is_uneven(replace(TABLE, maximum=maximum, step=step)) is uneven
