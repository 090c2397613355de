"""What to measure next: the doubt that moves the proposal most, not the largest doubt."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.errors import ModelError
from gateway.sensitivity.outputs import measure_next


def test_a_doubt_the_proposal_cannot_follow_is_not_worth_measuring() -> None:
    rng = np.random.default_rng(1)
    q, _ = np.linalg.qr(rng.normal(size=(50, 6)))
    cures = q[:, :3] @ rng.normal(size=(3, 4))
    doubts = np.stack([2.0 * q[:, 0], 9.0 * q[:, 5], 1.0 * q[:, 1], 1.0 * q[:, 2]], axis=1)
    found = measure_next(("EXX", "EZZ", "ECC", "ECC"), doubts, cures, 50)
    assert [one.name for one in found] == ["EXX", "ECC", "EZZ"]
    assert found[0].change == pytest.approx(2.0 / np.sqrt(50))
    assert found[1].change == pytest.approx(np.sqrt(2.0) / np.sqrt(50))
    assert found[2].change == pytest.approx(0.0, abs=1e-12)
    assert found[2].beyond == pytest.approx(9.0 / np.sqrt(50))
    assert sum(one.share for one in found) == pytest.approx(1.0)
    assert found[0].share == pytest.approx(4.0 / 6.0)


def test_it_is_what_the_proposal_really_moves_by() -> None:
    rng = np.random.default_rng(2)
    A, b, w = rng.normal(size=(40, 5)), rng.normal(size=40), rng.normal(size=40)
    before = A @ np.linalg.lstsq(A, -b, rcond=None)[0]
    after = A @ np.linalg.lstsq(A, -(b + w), rcond=None)[0]
    found = measure_next(("EXX",), w[:, None], A, 40)[0]
    assert found.change == pytest.approx(float(np.sqrt(np.mean((after - before) ** 2))))


def test_shapes_are_checked() -> None:
    with pytest.raises(ModelError, match="E-SENS-SHAPE"):
        measure_next(("EXX",), np.zeros((4, 2)), np.zeros((4, 1)), 4)
