"""A pair of tables for one direction each is named as what it is, before a person is asked to approve it."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.types.tables import CompensationTable
from gateway.domain.proposals import TableChange
from gateway.workflow.axes.propose import size_of

NOTHING = np.zeros(0)


@pytest.mark.parametrize(("way", "told"), [(1, "only while X1 moves in +"), (-1, "only while X1 moves in -"), (0, "")])
def test_of_a_pair_each_table_says_when_it_acts(way: int, told: str) -> None:
    old, new = (
        CompensationTable("cross", "X1", "X1", 0.0, 20.0, 10.0, values, index=3, direction=way)
        for values in ((0.0, 0.0, 0.0), (0.0, 0.21, -0.4))
    )
    words = str(size_of(TableChange("X1", old, new, False, None, NOTHING, NOTHING, NOTHING)))
    assert words.startswith("3 points, -0.40 .. +0.21 µm")
    assert told in words
    assert ("reversal" in words) == bool(way)
