"""Other standards: the worked example beside ISO, bounds, and gaps refused."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.evaluate.standards import conformity, registry
from tests.steps import said

S = np.array([-1, -1, 0, 1, 1.0])
UP = np.array([0, 1, 2, 3, 4.0])[:, None] + S
DOWN = np.array([2, 4, 4, 6, 5.0])[:, None] + S * np.array([1, 1, 2, 1, 1.0])[:, None]
X = np.stack([UP, DOWN], axis=2)


def test_vdi_worked_example() -> None:
    found = registry.vdi3441(X)
    expected = {"U_max": 3, "U_mean": 2.2, "Ps_max": 9, "Ps_mean": 6.6, "Pa": 3.5, "P": 12}
    assert found.values == pytest.approx(expected)
    assert "3441" in found.standard


def test_nmtba_without_offset_is_never_smaller() -> None:
    shifted = X + 3.0
    with_offset = registry.nmtba(shifted).values["A_bi"]
    assert with_offset == pytest.approx(registry.nmtba(X).values["A_bi"])
    assert registry.nmtba(shifted, offset=False).values["A_bi"] > with_offset


def test_jis_takes_accuracy_from_the_first_pass_and_the_rest_from_all() -> None:
    up, down = np.array([[0, 2.0, 1], [1, 1, 1]]), np.array([[3, 3.0, 3], [1, 1, 2]])
    found = registry.jis_of_test(np.stack([up, down], axis=2))
    assert found.values == {"accuracy": 2.0, "repeatability": 1.0, "lost_motion": 2.0}
    assert said(found) == ("n = 3, the standard asks for 7", "repeated at 2 places, the standard asks for 3")


def test_gaps_are_flagged_and_readings_of_no_shape_refused() -> None:
    gappy = X.copy()
    gappy[0, 0, 0] = np.nan
    for evaluate in (registry.vdi3441, registry.asme_b554_1992, registry.nmtba):
        assert said(evaluate(gappy)) == ("n = 4 of 5 at i = 1",)
        for wrong in (5.0, X[0], np.full((2, 2, 2), np.nan)):
            with pytest.raises(ModelError):
                evaluate(wrong)


def test_rounding_of_flank_tolerances() -> None:
    found = conformity.flank_tolerances(100.0, 4.0, 40.0, 5)
    assert [conformity.round_as_printed(found[name]) for name in ("fp", "Fp")] == [6.5, 21.0]
    assert conformity.round_as_printed(4.44) == pytest.approx(4.4)
