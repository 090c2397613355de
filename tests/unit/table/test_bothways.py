"""A column for each direction: what the machine does in each is gone with it, merged with what acts, judged by sums."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import Gap, ValueOutOfRange
from drivers.types.tables import CompensationTable
from gateway.domain.figures import Component
from gateway.table import Grid
from gateway.table.comparison import acting_mean, directional_difference
from gateway.table.merging import with_directions
from tests.unit.table.world import axis

GRID = Grid(0.0, 400.0, 100.0)
NEVER = CompensationTable("axis", "A1", "A1", 0.0, 0.0, 0.0, (0.0,))
MEAN = replace(NEVER, maximum=400.0, step=100.0, deviations=(0.0, 2.0, 5.0, 3.0, 1.0))
PLACES = np.array([0.0, 100.0, 200.0, 300.0, 400.0])


def line(start: float, end: float) -> Component:
    """B that runs straight from one end of the travel to the other."""
    found = Component("EXX", "A1", "mm", "polynomial", (0.0, 400.0), np.zeros(2), np.eye(2) * 1e-6)
    middle, half = (start + end) / 2.0, (end - start) / 2.0
    scaled = {"centre": 200.0, "scale": 200.0, "degree": 1}
    return replace(found, coefficients=np.array([middle, half]), parameters=scaled)


def test_each_direction_gets_the_mean_and_its_half_of_the_reversal() -> None:
    new = with_directions(axis(rotary=False), MEAN, NEVER, line(-8.0, -8.0), GRID, resolution=0.001)
    assert new.deviations == pytest.approx((-4.0, -2.0, 1.0, -1.0, -3.0))
    assert new.reverse == pytest.approx((4.0, 6.0, 9.0, 7.0, 5.0))
    assert acting_mean(new, PLACES) == pytest.approx(MEAN.deviations)
    assert directional_difference(new, PLACES) == pytest.approx([-8.0] * 5)


def test_what_acts_already_stays_and_what_is_left_is_added() -> None:
    """The second measuring finds 1 um at one end and nothing at the other beside the 6 um that are taken out."""
    acts = replace(MEAN, deviations=(-3.0, -1.0, 2.0, 0.0, -2.0), reverse=(3.0, 5.0, 8.0, 6.0, 4.0))
    new = with_directions(axis(rotary=False), None, acts, line(-1.0, 0.0), GRID, resolution=0.001)
    assert acting_mean(new, PLACES) == pytest.approx(MEAN.deviations, abs=1e-3)
    assert directional_difference(new, PLACES) == pytest.approx([-7.0, -6.75, -6.5, -6.25, -6.0], abs=2e-3)
    same = with_directions(axis(rotary=False), MEAN, acts, None, GRID, resolution=0.001)
    assert (same.deviations, same.reverse) == (acts.deviations, acts.reverse)


def test_one_curve_is_enough_where_both_directions_are_alike() -> None:
    assert with_directions(axis(rotary=False), MEAN, NEVER, None, GRID, resolution=0.001).reverse == ()


def test_each_column_keeps_to_the_limits() -> None:
    with pytest.raises(ValueOutOfRange) as caught:
        with_directions(axis(rotary=False), MEAN, NEVER, line(-900.0, -900.0), GRID, resolution=0.001)
    assert caught.value.code in ("E-COMP-VALUE", "E-COMP-CHANGE")


def test_a_reversal_is_not_extended_over_a_table() -> None:
    short = replace(line(-8.0, -8.0), domain=(30.0, 400.0))
    with pytest.raises(Gap, match=r"E-COMP-REACH.*30 to 400"):
        with_directions(axis(rotary=False), MEAN, NEVER, short, GRID, resolution=0.001)
    near = replace(line(-8.0, -8.0), domain=(15.0, 400.0))
    assert with_directions(axis(rotary=False), MEAN, NEVER, near, GRID, resolution=0.001).reverse
