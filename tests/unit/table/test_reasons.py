"""What speaks against a table: structure that may turn it into harm, reversal that outweighs it, CEC that acted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.types.tables import LiveTable
from gateway.model.fit import fit_through
from gateway.table import MeasuredMeans, propose
from gateway.table.proposal import may_harm
from tests.unit.table.world import X_GRID as X
from tests.unit.table.world import axis, live, table

AT = np.linspace(0.0, 400.0, 21)
MEANS = 8.0 * np.sin(AT / 100.0)


def offer(*, hidden: float = 0.0, rest: float = 0.0, size: float = 1.0, cross: bool = False, of: str = "A1") -> str:
    known = live(table(None, X, rotary=False), enabled=False)
    if cross:
        other = replace(table(np.arange(41.0), X, rotary=False), kind="cross", index=2, input_axis=of)
        known = replace(known, cross=(LiveTable(other, True),))
    fitted = fit_through(AT, size * MEANS, 0.02, name="EXX", axis="X1", axis_unit="mm")
    means = MeasuredMeans(AT, size * MEANS, np.full(AT.size, 0.02), rest, hidden)
    change = propose(axis(rotary=False), fitted, means, known, X, resolution=1e-3, reserved_points=100)
    return str(change.skipped or "") or " ".join(str(one.message) for one in change.findings)


def test_below_the_limit_no_hidden_structure_can_make_the_axis_worse() -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        taken = rng.normal(size=400)
        hidden = rng.normal(size=400) - rng.uniform(0.0, 4.0) * taken
        hidden *= rng.uniform(0.0, 1.2) * np.linalg.norm(taken) / np.linalg.norm(hidden)
        if not may_harm(float(np.std(hidden)), float(np.std(taken))):
            assert np.std(hidden) <= np.std(taken + hidden) + 1e-9
    alias = 0.6 * taken
    assert may_harm(float(np.std(alias)), float(np.std(taken)))
    assert np.std(alias) > np.std(taken - alias)


@pytest.mark.parametrize(("hidden", "said"), [(0.0, ""), (1.8, "W-COMP-HIDDEN"), (3.5, "S-COMP-HIDDEN")])
def test_hidden_structure_warns_then_refuses(hidden: float, said: str) -> None:
    assert offer(hidden=hidden).partition(" ")[0] == said


def test_reversal_that_outweighs_the_gain_refuses() -> None:
    assert offer(rest=8.0) == ""
    assert offer(rest=8.0, size=0.15).startswith("S-COMP-REVERSAL")
    assert offer(rest=0.5, size=0.15) == ""


def test_cec_that_acted_by_the_axis_own_position_refuses() -> None:
    assert offer(cross=True).startswith("S-COMP-CROSS-ON")
    assert offer(cross=True, of="Z1") == ""
