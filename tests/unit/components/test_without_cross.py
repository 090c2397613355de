"""Errors are not measured while a cross table acts: some set-ups would see it, others not."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.types.tables import CompensationTable, LiveSet, LiveTable
from gateway.errors import CaptureError
from gateway.workflow.errors21.setup_capture import without_cross


def cross(*, on: bool, values: tuple[float, ...] = (0.0, 2.0, 0.0), index: int = 3) -> LiveTable:
    return LiveTable(CompensationTable("cross", "Z1", "X1", 0.0, 20.0, 10.0, values, index=index), on)


def live(axis: str = "Z1", **tables: Any) -> LiveSet:
    own = LiveTable(CompensationTable("axis", axis, axis, 0.0, 20.0, 10.0, (0.0, 5.0, 0.0)), True)
    return LiveSet(axis, own, tables.get("cec", ()), 0.0, "", "d", tables.get("others", ()))


MOVED = frozenset({"X1", "Z1", "C1"})


@pytest.mark.parametrize("where", ["cec", "others"])
def test_every_cross_table_that_acts_is_named(where: str) -> None:
    without_cross(live(**{where: (cross(on=False), cross(on=True, values=(0.0, 0.0, 0.0)))}), MOVED)
    with pytest.raises(CaptureError) as caught:
        without_cross(live(**{where: (cross(on=True), cross(on=False, index=4), cross(on=True, index=5))}), MOVED)
    assert caught.value.code == "E-SETUP-CROSS"
    assert caught.value.fields["tables"] == "X1(Z1) (table 3), X1(Z1) (table 5)"


@pytest.mark.parametrize(("source", "output"), [("Y1", "X1"), ("Z1", "Y1"), ("A1", "B1")])
def test_a_table_of_the_builder_that_disturbs_no_set_up_stays_on(source: str, output: str) -> None:
    """Its input axis stands still while errors are measured, or what it moves is not measured."""
    table = CompensationTable("cross", source, output, 0.0, 20.0, 10.0, (0.0, 5.0, 0.0), index=3)
    without_cross(live(others=(LiveTable(table, enabled=True),)), MOVED)
